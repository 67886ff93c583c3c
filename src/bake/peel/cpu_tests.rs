use super::*;
use crate::bake::peel::{directions, viewports};
use crate::bake::source::{SourceImage, SourceTexture, SourceWrap};
use crate::bake::test_models::{self, bounds, quad};
use bevy::math::{Mat3, Vec2, Vec4};
use proptest::prelude::*;

fn peel_with(model: &SourceModel, ldi_size: u32, settings: &BakeSettings) -> PeelOutput {
    let viewports = viewports(&bounds(model), ldi_size, &directions(settings.directions));
    peel(model, &viewports, settings, &|_| {})
}

/// Three parallel squares of different materials, nearest first.
fn stack() -> SourceModel {
    let quads = (0..3).map(|i| quad(Vec3::Z * i as f32, Vec3::X * 4.0, Vec3::Y * 4.0, i)).collect();
    test_models::model(quads, 3)
}

#[test]
fn squares_behind_each_other_are_layers() {
    let output = peel_with(&stack(), 8, &BakeSettings::default());
    // Seen from the side, the squares have no width.
    assert_eq!(output.layers, [0, 0, 3]);
    assert_eq!(output.fragments, [0, 0, 3 * 64]);
    assert_eq!(output.samples.len(), 3 * 64);
    for (i, sample) in output.samples.iter().enumerate() {
        let (layer, row, column) = (i / 64, i / 8 % 8, i % 8);
        assert_eq!((sample.direction, usize::from(sample.layer)), (2, layer));
        assert_eq!(usize::from(sample.material), layer);
        assert_eq!(sample.cell, [column as u16, row as u16]);
        // Direction Z has right = X and up = Y.
        let expected = Vec3::new(column as f32 + 0.5, row as f32 + 0.5, layer as f32 * 2.0) * 0.5;
        assert!(sample.position.distance(expected) < 1e-5, "{} is not {expected}", sample.position);
        assert_eq!(
            (sample.face_normal, sample.normal, sample.albedo),
            (Vec3::Z, Vec3::Z, [255; 3])
        );
    }
}

#[test]
fn layers_beyond_the_limit_are_left_over() {
    let settings = BakeSettings { max_layers: 2, ..Default::default() };
    let output = peel_with(&stack(), 8, &settings);
    assert_eq!((output.layers[2], output.fragments[2], output.left_over[2]), (2, 128, 64));
    assert_eq!(output.samples.len(), 128);
}

#[test]
fn coincident_surfaces_count_once_and_the_first_stays() {
    let mut model = stack();
    // The same square with the other winding, as two-sided leaves are often modelled.
    model.meshes.push(quad(Vec3::ZERO, Vec3::Y * 4.0, Vec3::X * 4.0, 2));
    let output = peel_with(&model, 32, &BakeSettings::default());
    assert_eq!((output.layers[2], output.fragments[2]), (3, 3 * 1024));
    assert!(output.samples[..1024].iter().all(|s| s.material == 0 && s.face_normal == Vec3::Z));
}

#[test]
fn holes_of_a_mask_are_no_layer() {
    let mut model = stack();
    model.meshes[0].uvs = vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    model.images.push(SourceImage { width: 2, height: 1, rgba8: vec![9, 9, 9, 127, 9, 9, 9, 128] });
    let (wrap, uv_transform) = ([SourceWrap::ClampToEdge; 2], Mat3::IDENTITY);
    model.materials[0].base_color_texture =
        Some(SourceTexture { image: 0, wrap, nearest: true, uv_transform });
    model.materials[0].alpha = SourceAlpha::Mask(0.5);
    let output = peel_with(&model, 8, &BakeSettings::default());
    assert_eq!(output.fragments[2], 2 * 64 + 32);
    let first_layer: Vec<_> = output.samples.iter().filter(|s| s.layer == 0).collect();
    assert_eq!(first_layer.len(), 64);
    for sample in first_layer {
        assert_eq!(sample.material, u16::from(sample.cell[0] < 4), "{:?}", sample.cell);
        assert_eq!(sample.albedo, if sample.cell[0] < 4 { [255; 3] } else { [9; 3] });
    }
    // Without a mask, alpha is ignored.
    model.materials[0].alpha = SourceAlpha::Opaque;
    assert_eq!(peel_with(&model, 8, &BakeSettings::default()).fragments[2], 3 * 64);
}

#[test]
fn each_side_of_a_box_is_kept_by_the_direction_that_faces_it() {
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z];
    let sides = [(x, y, z), (y, z, x), (z, x, y)];
    let quads =
        sides.iter().flat_map(|&(a, b, c)| [quad(Vec3::ZERO, a, b, 0), quad(c, a, b, 0)]).collect();
    let output = peel_with(&test_models::model(quads, 1), 10, &BakeSettings::default());
    assert_eq!(output.samples.len(), 6 * 100);
    assert_eq!(output.layers, [2; 3]);
    for sample in &output.samples {
        let forward = output.viewports[usize::from(sample.direction)].direction.forward;
        assert_eq!(sample.face_normal.dot(forward).abs(), 1.0);
    }
}

#[test]
fn vertex_colours_become_srgb() {
    let mut model = stack();
    model.meshes[0].colors = vec![Vec4::new(0.5, 0.0, 0.214_041_14, 1.0); 4];
    let output = peel_with(&model, 4, &BakeSettings::default());
    assert_eq!(output.samples[0].albedo, [188, 0, 128]);
}

#[test]
fn broken_input_gives_what_is_left_of_it() {
    let mut model = stack();
    model.meshes[0].positions[2] = Vec3::NAN;
    model.meshes[1].triangles[0] = [0, 1, 99];
    model.meshes[2].normals.clear();
    model.materials.clear();
    let viewports = viewports(&bounds(&stack()), 8, &directions(3));
    let output = peel(&model, &viewports, &BakeSettings::default(), &|_| {});
    // The third square is whole; of the second, one triangle is left.
    assert_eq!(output.samples.iter().filter(|s| s.material == 2).count(), 64);
    assert!(output.samples.iter().all(|s| s.normal == Vec3::Z));
    let nothing = peel(&SourceModel::default(), &viewports, &BakeSettings::default(), &|_| {});
    assert_eq!((nothing.samples.len(), nothing.layers), (0, vec![0; 3]));
}

#[test]
fn progress_reaches_one_and_threads_do_not_change_the_result() {
    let Some(model) = test_models::cow("progress_reaches_one_and_threads_do_not_change_the_result")
    else {
        return;
    };
    let settings = BakeSettings::default();
    let largest = std::sync::Mutex::new(0.0f32);
    let viewports = viewports(&bounds(&model), 200, &directions(3));
    let output = peel(&model, &viewports, &settings, &|share| {
        let mut largest = largest.lock().expect("no thread panics");
        *largest = largest.max(share);
    });
    assert_eq!(*largest.lock().expect("no thread panics"), 1.0);
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    assert_eq!(one.install(|| peel(&model, &viewports, &settings, &|_| {})), output);
}

/// A few triangles, some sharing depths, some masked away.
fn any_soup() -> impl Strategy<Value = SourceModel> {
    let coordinate = || (0i8..17).prop_map(|v| f32::from(v) * 0.25);
    let point = move || (coordinate(), coordinate(), coordinate()).prop_map(Vec3::from);
    proptest::collection::vec((point(), point(), point()), 1..24).prop_map(|triangles| {
        let meshes = triangles.into_iter().map(|(a, b, c)| {
            let mut mesh = quad(a, b - a, Vec3::Y, 0);
            mesh.positions[2] = c;
            mesh.normals = vec![Vec3::Y; 4];
            mesh.triangles.truncate(1);
            mesh
        });
        let meshes =
            meshes.chain([quad(Vec3::ZERO, Vec3::X * 4.0, Vec3::new(0.0, 4.0, 4.0), 0)]).collect();
        test_models::model(meshes, 1)
    })
}

proptest! {
    #[test]
    fn samples_come_by_direction_layer_row_and_column(model in any_soup()) {
        let output = peel_with(&model, 16, &BakeSettings::default());
        let place = |s: &PeelSample| (s.direction, s.layer, s.cell[1], s.cell[0]);
        prop_assert!(output.samples.windows(2).all(|pair| place(&pair[0]) < place(&pair[1])));
        let inside = output.samples.iter().all(|s| {
            let viewport = output.viewports[usize::from(s.direction)];
            u32::from(s.cell[0]) < viewport.width && u32::from(s.cell[1]) < viewport.height
        });
        prop_assert!(inside);
    }

    #[test]
    fn partitioned_triangles_give_the_same_points_with_fewer_layers(model in any_soup()) {
        let whole = peel_with(&model, 16, &BakeSettings::default());
        let partition = BakeSettings { partition_triangles: true, ..Default::default() };
        let parts = peel_with(&model, 16, &partition);
        // Every fragment of a partitioned direction is kept.
        prop_assert_eq!(parts.samples.len() as u64, parts.fragments.iter().sum::<u64>());
        prop_assert!(std::iter::zip(&parts.layers, &whole.layers).all(|(part, all)| part <= all));
        // A surface coincident with one of another direction is lost in the whole, kept in the part; nothing else differs.
        let positions = |output: &PeelOutput| -> Vec<_> {
            let mut all: Vec<_> = output.samples.iter().map(|s| (s.direction, s.position.to_array().map(f32::to_bits))).collect();
            all.sort_unstable();
            all
        };
        let (whole, parts) = (positions(&whole), positions(&parts));
        prop_assert!(whole.iter().all(|sample| parts.binary_search(sample).is_ok()));
    }
}

/// Run with `--ignored --nocapture`: the table of the report.
#[test]
#[ignore = "measures; run it alone, in release"]
fn timings_of_peeling() {
    let models = [
        ("bunny", test_models::bunny("timings_of_peeling")),
        ("cow", test_models::cow("timings_of_peeling")),
    ];
    for (name, model) in models {
        let Some(model) = model else { return };
        for (ldi_size, partition_triangles) in [(100, false), (1000, false), (1000, true)] {
            let settings = BakeSettings { partition_triangles, ..Default::default() };
            let start = std::time::Instant::now();
            let output = peel_with(&model, ldi_size, &settings);
            println!(
                "{name} LDI {ldi_size} partition {partition_triangles}: {:.3} s, {} points, layers {:?}, fragments {:?}",
                start.elapsed().as_secs_f32(),
                output.samples.len(),
                output.layers,
                output.fragments,
            );
        }
    }
}
