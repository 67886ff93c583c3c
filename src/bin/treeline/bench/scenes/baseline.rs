//! The scene of `measurements/stock-bevy-baseline.md`: a square of trees before the camera, a plain, one light.
//!
//! Everything here is that protocol's, to the number, so that figures can be held against those it gives for stock Bevy.

use super::{BenchScene, Scenery, View};
use bevy::{light::GlobalAmbientLight, prelude::*};

/// Height that trees are scaled to, before each one's own scale, metres.
pub const TREE_HEIGHT_M: f32 = 10.0;
/// Side of a cell of the grid, metres; one tree a cell.
const CELL_M: f32 = 6.0;
/// How far a tree may stand from the middle of its cell: this share of the cell to either side.
const JITTER: f32 = 0.35;
/// Side of the plain, metres; larger only if the trees reach beyond it.
const PLAIN_M: f32 = 8_000.0;
/// Metres that the flying camera moves forward between two frames.
const STEP_M: f32 = 0.5;

/// The protocol's random numbers: those of a 64-bit linear congruential generator, 24 bits of each.
struct Numbers(u64);

impl Numbers {
    /// In [0, 1).
    fn next(&mut self) -> f32 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// Places of `count` trees for a model that is `height` high and whose lowest point is at `bottom`, model units: from the
/// camera's edge of the forest on, row by row.
pub fn trees(count: u64, seed: u64, height: f32, bottom: f32) -> Vec<Transform> {
    let unit_scale = TREE_HEIGHT_M / height;
    let side = (count as f32).sqrt().ceil() as u64;
    let mut numbers = Numbers(seed);
    let tree = |i: u64| {
        let (column, row) = ((i % side) as f32, (i / side) as f32);
        let x = (column + 0.5 - side as f32 * 0.5 + (numbers.next() - 0.5) * 2.0 * JITTER) * CELL_M;
        let z = -(row + 0.5 + (numbers.next() - 0.5) * 2.0 * JITTER) * CELL_M;
        let scale = unit_scale * (0.85 + 0.3 * numbers.next());
        let yaw = numbers.next() * std::f32::consts::TAU;
        Transform::from_xyz(x, -bottom * scale, z)
            .with_rotation(Quat::from_rotation_y(yaw))
            .with_scale(Vec3::splat(scale))
    };
    (0..count).map(tree).collect()
}

/// Where the camera is `steps` frames before the last one: flying it goes forward and turns a little, and the last frame is
/// the still camera's, so that both have one truth.
fn place(view: View, steps: u32) -> Transform {
    let mut place =
        Transform::from_xyz(0.0, 10.0, 8.0).looking_at(Vec3::new(0.0, 3.0, -80.0), Vec3::Y);
    if view == View::Flying {
        place.translation.z += STEP_M * steps as f32;
        place.rotate_y((steps as f32 * 0.15).sin() * 0.1);
    }
    place
}

/// The scene with its trees.
pub struct Baseline {
    trees: Vec<Transform>,
    view: View,
}

impl Baseline {
    pub fn new(count: u64, seed: u64, height: f32, bottom: f32, view: View) -> Self {
        Self { trees: trees(count, seed, height, bottom), view }
    }
}

impl BenchScene for Baseline {
    fn set_up(&self, world: &mut World) -> Scenery {
        let sky = Color::srgb(0.55, 0.7, 0.9);
        world.insert_resource(ClearColor(sky));
        world.insert_resource(GlobalAmbientLight { brightness: 600.0, ..default() });
        world.spawn((
            DirectionalLight { illuminance: 9_000.0, shadow_maps_enabled: false, ..default() },
            Transform::from_xyz(6.0, 8.0, 4.0).looking_at(Vec3::ZERO, Vec3::Y),
        ));
        let farthest = self.trees.iter().map(|t| t.translation.abs().max_element());
        let side = PLAIN_M.max(2.0 * farthest.fold(0.0, f32::max) + 100.0);
        let plain = Plane3d::default().mesh().size(side, side);
        let plain = world.resource_mut::<Assets<Mesh>>().add(plain);
        let earth = world.resource_mut::<Assets<StandardMaterial>>().add(StandardMaterial {
            base_color: Color::srgb(0.33, 0.36, 0.2),
            perceptual_roughness: 1.0,
            ..default()
        });
        let ground = world.spawn((Mesh3d(plain), MeshMaterial3d(earth))).id();
        Scenery { ground: Some(ground), sky }
    }

    fn trees(&self) -> &[Transform] {
        &self.trees
    }

    fn place(&self, steps: u32) -> Transform {
        place(self.view, steps)
    }

    fn first_row_below(&self, height: u32) -> Option<u32> {
        // The protocol's row 270 of 720: some of the trees stand out against the sky.
        Some(height * 3 / 8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_gives_the_same_forest_and_another_one_another() {
        assert_eq!(trees(50, 42, 3.0, -0.1), trees(50, 42, 3.0, -0.1));
        assert_ne!(trees(50, 42, 3.0, -0.1), trees(50, 43, 3.0, -0.1));
    }

    #[test]
    fn each_tree_stands_in_its_cell_on_the_ground_and_is_about_ten_metres_high() {
        let (height, bottom) = (3.0, -0.25);
        let found = trees(1000, 42, height, bottom);
        assert_eq!(found.len(), 1000);
        for (i, tree) in found.iter().enumerate() {
            // 32 columns: the smallest square that holds 1000.
            let middle = Vec2::new((i % 32) as f32 - 15.5, -((i / 32) as f32) - 0.5) * CELL_M;
            let offset = (tree.translation.xz() - middle).abs().max_element();
            assert!(offset <= JITTER * CELL_M + 1e-3, "{i}: {offset}");
            let scale = tree.scale.y;
            assert!((8.5..=11.5).contains(&(height * scale)), "{scale}");
            assert!((tree.translation.y + bottom * scale).abs() < 1e-4);
        }
    }

    #[test]
    fn the_flight_ends_where_the_still_camera_stands() {
        assert_eq!(place(View::Flying, 0), place(View::Still, 9));
        let (before, last) = (place(View::Flying, 10), place(View::Flying, 0));
        assert!((before.translation.z - last.translation.z - 5.0).abs() < 1e-5);
        assert_ne!(before.rotation, last.rotation);
    }
}
