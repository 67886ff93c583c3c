//! Selection on the GPU against its CPU twin: counters of whole scenes.

mod common;

use bevy::{
    camera::{ScalingMode, primitives::Frustum},
    prelude::*,
};
use bevy_treeline::{
    Forest, GroveSettings, LodState, NearMeshes, Occlusion, SplatPath, TreeImpostor, TreeInstance,
    TreelineCounters, TreelineSettings, ViewCounters,
    asset::TreeClusters,
    forest::{PointDraw, SpeciesShape, ViewPoint, emit_items, select_instance},
    lod::fade::ViewRange,
    math::hash::SplitMix64,
};
use common::{Stage, baked};

const SIZE: UVec2 = UVec2::new(120, 90);
const SPECIES: [&str; 2] = ["oak", "birch"];

/// What selection should have counted.
#[derive(Debug, Default)]
struct Expected {
    counters: ViewCounters,
    /// Trees so close to a plane of the frustum that rounding decides.
    on_the_edge: u32,
}

fn view_point(stage: &Stage, camera: Entity) -> ViewPoint {
    let world = stage.app.world();
    let eye = world.get::<GlobalTransform>(camera).expect("it has a place").translation();
    let camera = world.get::<Camera>(camera).expect("it is a camera");
    let height = camera.physical_viewport_size().expect("it has a picture").y as f32;
    ViewPoint::new(eye, &camera.clip_from_view(), height)
}

/// The CPU twin over the trees of one forest of [`SPECIES`], which is all there is.
fn expect(stage: &Stage, camera: Entity, forest: Entity) -> Expected {
    let world = stage.app.world();
    let settings = world.get::<TreelineSettings>(camera).cloned().unwrap_or_default().clamped().0;
    let view = view_point(stage, camera);
    let frustum = world.get::<Frustum>(camera).expect("it sees something");
    let near = world.resource::<NearMeshes>();
    let mut out = Expected::default();
    let counters = &mut out.counters;
    let trees = world.get::<Forest>(forest).expect("it is a forest");
    let range = trees.view_range().map_or(ViewRange::default(), |r| ViewRange::new(r.start, r.end));
    let draws: Vec<PointDraw> = trees
        .iter()
        .enumerate()
        .map(|(index, tree)| {
            // Rotation and scale as the GPU has them.
            let tree = TreeInstance::from_compact(&tree.compact());
            let nothing = PointDraw::default();
            let data = &*baked(SPECIES[usize::from(tree.species)]).data;
            let shape = SpeciesShape::from(data);
            let center = tree.position + tree.rotation * (shape.center * tree.scale);
            let radius = data.bounds.radius() * tree.scale;
            counters.instances_seen += 1;
            // Not the far plane: the projection is infinite.
            let planes = frustum.half_spaces[..5].iter().map(|plane| plane.normal_d());
            let inside = planes.map(|p| p.truncate().dot(center) + p.w + radius);
            let inside = inside.fold(f32::INFINITY, f32::min);
            out.on_the_edge += u32::from(inside.abs() < 1e-3);
            if inside < 0.0 {
                counters.culled_frustum += 1;
                return nothing;
            }
            let has_mesh = near.is_ready(forest, index as u32);
            let s = select_instance(&view, &settings, &shape, &tree, range, has_mesh);
            if has_mesh && s.distance < s.band.near {
                counters.as_mesh += 1;
            } else if s.draw.count == 0 {
                counters.culled_small += 1;
            }
            counters.in_fade += u32::from(s.mesh > 0.0 && s.distance >= s.band.near);
            s.draw
        })
        .collect();
    let capacity = (settings.point_capacity_millions * 1e6 / 64.0) as usize;
    let layouts = SPECIES.map(|name| TreeClusters::of(&baked(name).data));
    let species: Vec<u16> = trees.iter().map(|tree| tree.species).collect();
    let tree_of = |i: usize| (&layouts[usize::from(species[i])], 0);
    let (items, overflow) = emit_items(&draws, tree_of, capacity);
    counters.points = items.iter().map(|item| item.count).sum();
    counters.items = items.len() as u32;
    counters.item_overflow = overflow as u32;
    out
}

/// Equal but for the rounding of `f32`.
fn assert_near(found: u32, expected: u32, what: &str) {
    let tolerance = (f64::from(expected) * 1e-3).max(2.0);
    let difference = (f64::from(found) - f64::from(expected)).abs();
    assert!(difference <= tolerance, "{what}: {found} on the GPU, {expected} on the CPU");
}

fn assert_counters(found: ViewCounters, expected: &Expected) {
    let ViewCounters { instances_seen, culled_frustum, culled_small, as_mesh, in_fade, .. } =
        expected.counters;
    assert_eq!(found.instances_seen, instances_seen);
    let difference = found.culled_frustum.abs_diff(culled_frustum);
    assert!(
        difference <= expected.on_the_edge,
        "culled: {} on the GPU, {culled_frustum} on the CPU, {} on the edge",
        found.culled_frustum,
        expected.on_the_edge
    );
    assert_near(found.culled_small, culled_small, "too small");
    assert_eq!((found.as_mesh, found.in_fade), (as_mesh, in_fade), "meshes, fading");
    assert_near(found.points, expected.counters.points, "points");
    assert_near(found.items, expected.counters.items, "items");
    assert_near(found.item_overflow, expected.counters.item_overflow, "overflow");
}

/// Settings with which everything in the frustum is drawn.
fn unculled() -> TreelineSettings {
    TreelineSettings { occlusion: Occlusion::Off, ..default() }
}

/// A stage with a forest, seen from 8 m above the origin towards -z.
fn planted(
    test: &str,
    with_mesh: bool,
    trees: impl Iterator<Item = TreeInstance>,
) -> Option<(Stage, Entity, Entity)> {
    let mut stage = Stage::new(test, SplatPath::Auto)?;
    // Trees are counted one by one, hidden or not.
    stage.world().insert_resource(GroveSettings { samples_per_tree: 0 });
    let species = SPECIES.map(|name| stage.tree(name, with_mesh));
    let forest = stage.world().spawn(Forest::new(species).with(trees)).id();
    let place = Transform::from_xyz(0.0, 8.0, 0.0).looking_to(Vec3::NEG_Z, Vec3::Y);
    let (camera, _) = stage.view(SIZE, place);
    stage.world().entity_mut(camera).insert(unculled());
    Some((stage, camera, forest))
}

/// Trees of both species, every size and lean, at distances of 40 m to 1500 m before the camera; `bearing` says how far
/// aside, as a share of the distance.
fn scattered(count: u32, seed: u64, bearing: f32) -> impl Iterator<Item = TreeInstance> {
    let mut random = SplitMix64(seed);
    (0..count).map(move |i| {
        let z = -40.0 * 37.0f32.powf(random.next_f32());
        TreeInstance {
            position: Vec3::new(z * random.range(-bearing, bearing), 0.0, z),
            rotation: Quat::from_rotation_x(random.range(-0.2, 0.2))
                * Quat::from_rotation_y(random.range(-3.0, 3.0)),
            scale: 0.08 * 25.0f32.powf(random.next_f32()),
            species: (i % 2) as u16,
            seed: random.below(256) as u8,
            ..default()
        }
    })
}

#[test]
fn a_forest_in_sight_is_selected_as_on_the_cpu() {
    let trees = scattered(3000, 1, 0.3);
    let Some((mut stage, camera, forest)) = planted("a_forest_in_sight", false, trees) else {
        return;
    };
    stage.step(4);
    let (found, expected) = (stage.counters(camera), expect(&stage, camera, forest));
    assert_eq!((found.instances_seen, found.culled_frustum, found.as_mesh), (3000, 0, 0));
    assert!(expected.counters.culled_small > 100, "{expected:?}");
    assert!(expected.counters.points > 100_000, "{expected:?}");
    assert_counters(found, &expected);
}

#[test]
fn trees_out_of_sight_are_culled_exactly() {
    // Every other tree far to the side or behind.
    let trees = scattered(3000, 2, 0.3).enumerate().map(|(i, tree)| {
        let away = match i % 8 {
            1 => Vec3::X * 9000.0,
            3 => Vec3::NEG_X * 9000.0,
            5 => Vec3::Z * 3000.0,
            7 => Vec3::Y * 9000.0,
            _ => Vec3::ZERO,
        };
        TreeInstance { position: tree.position + away, ..tree }
    });
    let Some((mut stage, camera, forest)) = planted("trees_out_of_sight", false, trees) else {
        return;
    };
    stage.step(4);
    let found = stage.counters(camera);
    assert_eq!((found.instances_seen, found.culled_frustum), (3000, 1500));
    assert_counters(found, &expect(&stage, camera, forest));
}

#[test]
fn trees_around_the_edges_of_the_picture_are_culled_as_on_the_cpu() {
    let trees = scattered(3000, 3, 1.5);
    let Some((mut stage, camera, forest)) = planted("trees_around_the_edges", false, trees) else {
        return;
    };
    stage.step(4);
    let expected = expect(&stage, camera, forest);
    assert!((500..2500).contains(&expected.counters.culled_frustum), "{expected:?}");
    assert!(expected.on_the_edge < 5, "{expected:?}");
    assert_counters(stage.counters(camera), &expected);
}

#[test]
fn a_parallel_view_selects_as_on_the_cpu() {
    let trees = scattered(3000, 4, 0.5);
    let Some((mut stage, camera, forest)) = planted("a_parallel_view", true, trees) else { return };
    let scaling_mode = ScalingMode::FixedVertical { viewport_height: 500.0 };
    let parallel = OrthographicProjection { scaling_mode, ..OrthographicProjection::default_3d() };
    stage.world().entity_mut(camera).insert(Projection::Orthographic(parallel));
    stage.step(6);
    let expected = expect(&stage, camera, forest);
    assert!(expected.counters.culled_frustum > 100 && expected.counters.points > 10_000);
    assert_counters(stage.counters(camera), &expected);
    assert!(stage.world().resource::<NearMeshes>().is_empty(), "parallel views draw no meshes");
}

#[test]
fn what_does_not_fit_is_counted_and_then_drawn_with_less_quality() {
    let trees = scattered(3000, 5, 0.3);
    let Some((mut stage, camera, forest)) = planted("what_does_not_fit", false, trees) else {
        return;
    };
    stage.step(1);
    let whole = expect(&stage, camera, forest);
    let settings = TreelineSettings { point_capacity_millions: 0.4, ..unculled() };
    stage.world().entity_mut(camera).insert(settings.clone());
    // Counters come back a frame later: the first say what lacked.
    let mut overflows = vec![];
    for _ in 0..40 {
        stage.step(1);
        if let Some(found) = stage.world().resource::<TreelineCounters>().of(camera) {
            overflows.push(found.item_overflow);
        }
    }
    let most = overflows.iter().max().expect("counters came back");
    assert!(*most > whole.counters.items / 4, "{overflows:?} of {whole:?}");
    assert_eq!(overflows.last(), Some(&0), "{overflows:?}");
    let found = stage.counters(camera);
    assert!(found.items > 4000 && found.items <= 6250, "{found:?}");
    assert!(found.quality < 0.9 * settings.quality, "{found:?}");
    // As many as a camera of that quality would draw of every tree: nothing is cut off.
    stage
        .world()
        .entity_mut(camera)
        .insert(TreelineSettings { quality: found.quality, ..settings });
    let expected = expect(&stage, camera, forest);
    assert_near(found.points, expected.counters.points, "points");
    // With room again all are back.
    stage.world().entity_mut(camera).insert(unculled());
    stage.step(4);
    let (found, expected) = (stage.counters(camera), expect(&stage, camera, forest));
    assert_eq!(found.item_overflow, 0);
    assert_counters(found, &expected);
}

#[test]
fn a_view_range_thins_trees_as_on_the_cpu() {
    let trees = scattered(3000, 6, 0.3);
    let Some((mut stage, camera, forest)) = planted("a_view_range", false, trees) else { return };
    stage.step(4);
    let whole = stage.counters(camera);
    let mut points = vec![];
    for range in [900.0..1000.0, 300.0..1000.0, 60.0..1000.0, 60.0..300.0, 60.0..60.0] {
        let mut trees = stage.world().get_mut::<Forest>(forest).expect("it is a forest");
        trees.set_view_range(Some(range.clone()));
        assert_eq!(trees.view_range(), Some(range));
        stage.step(4);
        let (found, expected) = (stage.counters(camera), expect(&stage, camera, forest));
        assert_counters(found, &expected);
        points.push(found.points);
    }
    assert!(whole.points > points[0], "{points:?} of {}", whole.points);
    assert!(points.is_sorted_by(|a, b| a > b), "{points:?}");
}

#[test]
fn near_trees_of_a_forest_are_meshes_as_on_the_cpu() {
    let place = |i: u32| {
        let (x, z) = ((i % 15) as f32 * 2.0 - 14.0, (i / 15) as f32 * -3.0 - 8.0);
        TreeInstance::at(Vec3::new(x, 3.0, z)).with_species((i % 2) as u16)
    };
    let trees = (0..90).map(|i| TreeInstance { seed: (i * 7) as u8, scale: 0.6, ..place(i) });
    let Some((mut stage, camera, forest)) = planted("near_trees_of_a_forest", true, trees) else {
        return;
    };
    stage.step(8);
    let expected = expect(&stage, camera, forest);
    assert!(expected.counters.as_mesh > 3 && expected.counters.in_fade > 5, "{expected:?}");
    assert!(expected.counters.as_mesh + expected.counters.in_fade < 80, "{expected:?}");
    assert_counters(stage.counters(camera), &expected);
}

#[test]
fn a_single_tree_changes_from_mesh_to_points_with_distance() {
    let Some(mut stage) = Stage::new("a_single_tree_changes", SplatPath::Auto) else { return };
    let asset = stage.tree("oak", true);
    // Half the size: its points would do from 11 m on, but nearer than 15 m there are meshes.
    let half = Transform::from_scale(Vec3::splat(0.5));
    let tree = stage.world().spawn((TreeImpostor::new(asset), half)).id();
    let middle = 0.5 * baked("oak").data.bounds.center();
    let (camera, _) = stage.view(SIZE, default());
    let all = baked("oak").data.point_count() as u32;
    // Mesh up to 11.25 m, both complete at 13.1 m, points from 15 m.
    for (distance, as_mesh, in_fade) in
        [(8.0, 1, 0), (12.5, 0, 1), (14.0, 0, 1), (15.5, 0, 0), (60.0, 0, 0), (10.0, 1, 0)]
    {
        let place = Transform::from_translation(middle + Vec3::Z * distance);
        stage.world().entity_mut(camera).insert(place.looking_at(middle, Vec3::Y));
        stage.step(9);
        let counters = stage.counters(camera);
        let state = *stage.world().get::<LodState>(tree).expect("it is required");
        let what = format!("at {distance}: {counters:?} {state:?}");
        assert_eq!((counters.as_mesh, counters.in_fade), (as_mesh, in_fade), "{what}");
        assert_eq!(counters.points == 0, as_mesh == 1, "{what}");
        // Clusters round their shares.
        assert!(counters.points.abs_diff(state.points) <= 16, "{what}");
        assert!((state.distance - distance).abs() < 1e-3, "{what}");
        assert_eq!(state.points_baked, all);
        assert_eq!(state.mesh > 0.0, as_mesh + in_fade == 1, "{what}");
        assert_eq!(state.mesh == 1.0, distance < 13.0, "{what}");
        let d0 = 0.5 * baked("oak").data.pixel * view_point(&stage, camera).z0;
        assert!((state.d0 - d0).abs() < 1e-3);
        assert_eq!(
            stage.world().resource::<NearMeshes>().len(),
            usize::from(distance < 16.0),
            "{what}"
        );
    }
}
