use super::*;
use crate::bake::peel::{directions, viewports};
use crate::bake::source::{
    SourceAlpha, SourceImage, SourceMaterial, SourceMesh, SourceTexture, SourceWrap,
};
use crate::gpu::headless::headless_device;
use crate::math::bounding::Aabb;
use bevy::math::{Mat3, Vec2, Vec3, Vec4};
use std::sync::Mutex;

/// A peeler, or nothing where there is no adapter (and a failure where there must be one).
pub(super) fn peeler(test: &str) -> Option<GpuPeeler> {
    match headless_device() {
        Ok((_, device, queue)) => {
            Some(GpuPeeler::new(device, queue).expect("the adapter can peel"))
        }
        Err(error) => {
            assert!(
                std::env::var("REQUIRE_GPU").as_deref() != Ok("1"),
                "REQUIRE_GPU=1, but {error}"
            );
            println!("SKIPPED {test} (no adapter)");
            None
        }
    }
}

pub(super) fn bounds(model: &SourceModel) -> Aabb {
    Aabb::of(model.meshes.iter().flat_map(|mesh| mesh.positions.iter().copied()))
}

pub(super) fn settings(ldi_size: u32) -> BakeSettings {
    BakeSettings { ldi_size, ..Default::default() }
}

pub(super) fn peel_model(
    peeler: &GpuPeeler,
    model: &SourceModel,
    settings: &BakeSettings,
) -> PeelOutput {
    let viewports = viewports(&bounds(model), settings.ldi_size, &directions(settings.directions));
    peeler.peel(model, &viewports, settings, &|_| ()).expect("it peels")
}

/// A rectangle at `corner` with sides `u` and `v`, texture coordinates 0 to 1, front side towards `u × v`.
pub(super) fn quad(corner: Vec3, u: Vec3, v: Vec3, material: usize) -> SourceMesh {
    SourceMesh {
        positions: vec![corner, corner + u, corner + u + v, corner + v],
        normals: vec![u.cross(v).normalize(); 4],
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        material,
        ..Default::default()
    }
}

pub(super) fn model_of(meshes: Vec<SourceMesh>, materials: Vec<SourceMaterial>) -> SourceModel {
    SourceModel { name: "test".into(), meshes, materials, ..Default::default() }
}

/// A cube of side 2 around the centre, one material a face pair.
pub(super) fn cube() -> SourceModel {
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    let mut meshes = Vec::new();
    for i in 0..3 {
        let [n, u, v] = [axes[i], axes[(i + 1) % 3], axes[(i + 2) % 3]];
        meshes.push(quad(n - u - v, 2.0 * u, 2.0 * v, i));
        meshes.push(quad(-n - u - v, 2.0 * v, 2.0 * u, i));
    }
    let material = |base_color| SourceMaterial { base_color, ..Default::default() };
    let colors = [
        Vec4::new(1.0, 0.0, 0.0, 1.0),
        Vec4::new(0.0, 0.5, 0.0, 1.0),
        Vec4::new(0.0, 0.0, 0.1, 1.0),
    ];
    model_of(meshes, colors.map(material).to_vec())
}

/// Quads that cross each other at all angles, some masked by a texture of dots.
pub(super) fn thicket(count: u32, wrap: SourceWrap) -> SourceModel {
    let mut random = crate::math::hash::SplitMix64(7);
    let mut meshes = Vec::new();
    for i in 0..count {
        let mut point =
            || Vec3::new(random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0));
        let (corner, u) = (point() * 4.0, point());
        let v = u.cross(point()).normalize() * u.length();
        let mut mesh = quad(corner, u, v, i as usize % 2);
        for uv in &mut mesh.uvs {
            *uv = *uv * 3.0 - 1.0;
        }
        mesh.normals = (0..4).map(|_| (mesh.normals[0] + 0.5 * point()).normalize()).collect();
        mesh.colors = (0..4).map(|_| (point() * 0.3 + 0.7).extend(1.0)).collect();
        meshes.push(mesh);
    }
    let texture = SourceTexture {
        image: 0,
        wrap: [wrap; 2],
        nearest: false,
        uv_transform: Mat3::from_scale(Vec2::new(1.0, 0.5)),
    };
    let masked = SourceMaterial {
        alpha: SourceAlpha::Mask(0.5),
        base_color_texture: Some(texture),
        ..Default::default()
    };
    let mut model = model_of(meshes, vec![SourceMaterial::default(), masked]);
    let rgba8 = (0..16 * 16).flat_map(|i: i32| {
        let (x, y) = (i % 16 - 8, i / 16 - 8);
        [(i * 3) as u8, 255 - i as u8, 40, if x * x + y * y < 40 { 255 } else { 0 }]
    });
    model.images.push(SourceImage { width: 16, height: 16, rgba8: rgba8.collect() });
    model
}

#[test]
fn a_cube_gives_each_face_once_and_two_layers_a_direction() {
    let Some(peeler) = peeler("a_cube_gives_each_face_once_and_two_layers_a_direction") else {
        return;
    };
    let model = cube();
    let output = peel_model(&peeler, &model, &settings(16));
    assert_eq!((&output.layers[..], &output.fragments[..]), (&[2, 2, 2][..], &[512, 512, 512][..]));
    assert_eq!((output.samples.len(), &output.left_over[..]), (6 * 256, &[0, 0, 0][..]));
    let albedo = [[255, 0, 0], [0, 188, 0], [0, 0, 89]];
    for sample in &output.samples {
        let direction = usize::from(sample.direction);
        assert_eq!((usize::from(sample.material), sample.albedo), (direction, albedo[direction]));
        assert!((sample.position[direction].abs() - 1.0).abs() < 1e-6, "{sample:?}");
        assert!(sample.face_normal[direction] * sample.position[direction] > 0.999);
        assert!(sample.normal.distance(sample.face_normal) < 1e-4);
        let frame = output.viewports[direction];
        let x = (sample.position - frame.origin).dot(frame.direction.right) / frame.pixel;
        assert!((x - f32::from(sample.cell[0]) - 0.5).abs() < 1e-3);
    }
    let key = |s: &crate::bake::peel::PeelSample| (s.direction, s.layer, s.cell[1], s.cell[0]);
    assert!(output.samples.is_sorted_by(|a, b| key(a) < key(b)));
}

#[test]
fn tiles_and_batches_do_not_change_the_result() {
    let Some(mut peeler) = peeler("tiles_and_batches_do_not_change_the_result") else { return };
    let model = thicket(200, SourceWrap::Repeat);
    let whole = peel_model(&peeler, &model, &settings(200));
    assert!(whole.layers.iter().all(|&layers| layers > 4), "{:?}", whole.layers);
    for limit in [1024, 64, 16] {
        peeler.tile_limit = limit;
        let tiled = peel_model(&peeler, &model, &settings(200));
        assert_eq!(tiled.layers, whole.layers);
        assert_eq!(tiled.fragments, whole.fragments);
        let different =
            std::iter::zip(&tiled.samples, &whole.samples).filter(|(a, b)| a != b).count();
        assert_eq!((different, tiled.samples.len()), (0, whole.samples.len()), "tiles of {limit}");
    }
}

#[test]
fn the_result_is_the_same_every_time() {
    let Some(peeler) = peeler("the_result_is_the_same_every_time") else { return };
    let model = thicket(100, SourceWrap::MirroredRepeat);
    let first = peel_model(&peeler, &model, &settings(64));
    assert_eq!(peel_model(&peeler, &model, &settings(64)), first);
}

#[test]
fn partitioned_triangles_give_the_samples_that_are_kept() {
    let Some(peeler) = peeler("partitioned_triangles_give_the_samples_that_are_kept") else {
        return;
    };
    let model = thicket(100, SourceWrap::Repeat);
    let all = peel_model(&peeler, &model, &settings(64));
    let partition = BakeSettings { partition_triangles: true, ..settings(64) };
    let own = peel_model(&peeler, &model, &partition);
    assert_eq!(own.fragments.iter().sum::<u64>(), own.samples.len() as u64);
    let surfaces = |output: &PeelOutput| {
        let mut all: Vec<_> = output
            .samples
            .iter()
            .map(|s| (s.direction, s.cell, s.position.to_array().map(f32::to_bits)))
            .collect();
        all.sort_unstable();
        all
    };
    assert_eq!(surfaces(&own), surfaces(&all));
}

#[test]
fn layers_beyond_the_last_are_counted_and_lost() {
    let Some(peeler) = peeler("layers_beyond_the_last_are_counted_and_lost") else { return };
    let sheets = (0..10).map(|i| quad(Vec3::Z * i as f32 * 0.1, Vec3::X, Vec3::Y, 0)).collect();
    let model = model_of(sheets, vec![SourceMaterial::default()]);
    for (max_layers, layers, left_over) in
        [(3, 3, 7), (4, 4, 6), (9, 9, 1), (10, 10, 0), (11, 10, 0)]
    {
        let output = peel_model(&peeler, &model, &BakeSettings { max_layers, ..settings(20) });
        let got =
            (output.layers[2], output.fragments[2], output.left_over[2], output.samples.len());
        assert_eq!(got, (layers, u64::from(layers) * 400, left_over * 400, layers as usize * 400));
    }
}

#[test]
fn coincident_triangles_count_once_whatever_their_winding() {
    let Some(peeler) = peeler("coincident_triangles_count_once_whatever_their_winding") else {
        return;
    };
    let model = thicket(30, SourceWrap::Repeat);
    let single = peel_model(&peeler, &model, &settings(100));
    let mut doubled = model.clone();
    for mesh in &model.meshes {
        let mut back = mesh.clone();
        for triangle in &mut back.triangles {
            *triangle = [triangle[1], triangle[0], triangle[2]];
        }
        doubled.meshes.push(back);
    }
    assert_eq!(peel_model(&peeler, &doubled, &settings(100)), single);
}

#[test]
fn texels_are_read_where_they_are_and_holes_are_empty() {
    let Some(peeler) = peeler("texels_are_read_where_they_are_and_holes_are_empty") else { return };
    let rgba8 = vec![255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 9, 9, 9, 0];
    let texture = SourceTexture {
        image: 0,
        wrap: [SourceWrap::ClampToEdge; 2],
        nearest: true,
        uv_transform: Mat3::IDENTITY,
    };
    let material = SourceMaterial {
        base_color_texture: Some(texture),
        alpha: SourceAlpha::Mask(0.5),
        ..Default::default()
    };
    let mut model = model_of(vec![quad(Vec3::ZERO, Vec3::X, Vec3::Y, 0)], vec![material]);
    model.images.push(SourceImage { width: 2, height: 2, rgba8 });
    let masked = peel_model(&peeler, &model, &settings(10));
    assert_eq!(masked.samples.len(), 75);
    for sample in &masked.samples {
        let texel = usize::from(sample.position.x > 0.5) + 2 * usize::from(sample.position.y > 0.5);
        assert_eq!(sample.albedo, [[255, 0, 0], [0, 255, 0], [0, 0, 255]][texel]);
    }
    model.materials[0].alpha = SourceAlpha::Opaque;
    assert_eq!(peel_model(&peeler, &model, &settings(10)).samples.len(), 100);
    model.meshes[0].uvs.clear();
    model.materials[0].alpha = SourceAlpha::Mask(0.5);
    assert!(
        peel_model(&peeler, &model, &settings(10)).samples.iter().all(|s| s.albedo == [255; 3])
    );
}

#[test]
fn empty_and_tiny_models_peel_to_what_they_hold() {
    let Some(peeler) = peeler("empty_and_tiny_models_peel_to_what_they_hold") else { return };
    let empty = peel_model(&peeler, &SourceModel::default(), &settings(10));
    assert_eq!((empty.samples.len(), empty.layers), (0, vec![0; 3]));
    let mut dot =
        model_of(vec![quad(Vec3::ONE, Vec3::ZERO, Vec3::ZERO, 0)], vec![SourceMaterial::default()]);
    assert!(peel_model(&peeler, &dot, &settings(10)).samples.is_empty());
    dot.meshes[0].positions[1] = Vec3::NAN;
    dot.meshes[0].triangles.push([0, 1, 99]);
    assert!(peel_model(&peeler, &dot, &settings(10)).samples.is_empty());
    let one = peel_model(&peeler, &cube(), &settings(1));
    assert_eq!((one.samples.len(), one.layers), (6, vec![2; 3]));
}

#[test]
fn broken_models_and_settings_are_errors_that_say_where() {
    let Some(peeler) = peeler("broken_models_and_settings_are_errors_that_say_where") else {
        return;
    };
    let fail = |model: &SourceModel, settings: &BakeSettings, width: u32| {
        let mut viewports = viewports(&bounds(model), 8, &directions(3));
        viewports[1].width = width;
        let error = peeler.peel(model, &viewports, settings, &|_| ()).expect_err("it is broken");
        error.to_string()
    };
    let fine = settings(8);
    assert!(fail(&cube(), &fine, 0).contains("the LDI of direction 1 is 0x8"));
    assert!(
        fail(&cube(), &BakeSettings { max_layers: 0, ..fine.clone() }, 8).contains("max_layers")
    );
    let mut model = cube();
    model.meshes[4].material = 3;
    assert!(fail(&model, &fine, 8).contains("mesh 4 (``) has material 3"));
    let mut model = thicket(4, SourceWrap::Repeat);
    model.images[0].rgba8.pop();
    assert!(fail(&model, &fine, 8).contains("image 0 is 16x16, but has 1023 bytes"));
    model.images.clear();
    assert!(fail(&model, &fine, 8).contains("a material uses image 0, but there are 0"));
}

#[test]
fn more_directions_share_the_samples_among_them() {
    let Some(peeler) = peeler("more_directions_share_the_samples_among_them") else { return };
    let output = peel_model(
        &peeler,
        &thicket(60, SourceWrap::Repeat),
        &BakeSettings { directions: 9, ..settings(50) },
    );
    for direction in 0..9 {
        assert!(output.samples.iter().any(|s| s.direction == direction));
    }
}

#[test]
fn progress_grows_to_one() {
    let Some(peeler) = peeler("progress_grows_to_one") else { return };
    let model = thicket(50, SourceWrap::Repeat);
    let viewports = viewports(&bounds(&model), 40, &directions(3));
    let shares = Mutex::new(Vec::new());
    let note = |share| shares.lock().expect("no test thread panics").push(share);
    peeler.peel(&model, &viewports, &settings(40), &note).expect("it peels");
    let shares = shares.into_inner().expect("no test thread panics");
    assert!(
        shares.is_sorted() && shares.first() == Some(&0.0) && shares.last() == Some(&1.0),
        "{shares:?}"
    );
}

#[test]
fn a_lost_device_is_an_error() {
    let Some(peeler) = peeler("a_lost_device_is_an_error") else { return };
    peeler.device.destroy();
    let model = cube();
    let viewports = viewports(&bounds(&model), 8, &directions(3));
    let error =
        peeler.peel(&model, &viewports, &settings(8), &|_| ()).expect_err("the device is gone");
    assert!(error.to_string().contains("--peel cpu"), "{error}");
}
