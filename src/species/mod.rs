//! L1, pure: a small tree generator. Shape parameters and a seed in, coloured triangles out; a few milliseconds a tree.
//!
//! `shape` (parameters) and `presets` → `envelope` (outline of the crown) → `skeleton` (stems) → `bark` (tubes) and `leaves`
//! → [`PlainTree`] → `glb` (bytes of a file). The stems follow Weber & Penn 1995, "Creation and Rendering of Realistic
//! Trees", section 4, in their parameters (down angle, rotation, curve, taper); unlike there, an explicit outline with lobes
//! bounds the lengths, which gives clumps and gaps without tuning per species.

mod bark;
mod envelope;
pub mod glb;
mod leaves;
mod presets;
#[cfg(test)]
mod preview;
pub mod shape;
mod skeleton;

pub use presets::presets;
pub use shape::TreeShape;

use crate::math::bounding::Aabb;
use crate::math::hash::SplitMix64;
use bevy::math::Vec3;

/// Triangles of one surface of a tree. All vertex lists have the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlainPart {
    /// `bark` or `leaves`.
    pub name: String,
    /// Metres; the tree stands at the origin, y is up.
    pub positions: Vec<Vec3>,
    /// Unit, for shading; those of leaves are bent to the outside of the crown.
    pub normals: Vec<Vec3>,
    /// Linear red, green, blue and an alpha of 1, one a vertex.
    pub colors: Vec<[f32; 4]>,
    /// Counter-clockwise seen from the side the normals point to.
    pub triangles: Vec<[u32; 3]>,
    /// Seen from both sides (leaves).
    pub double_sided: bool,
    /// Perceptual roughness, 0 to 1.
    pub roughness: f32,
}

impl PlainPart {
    fn push_vertex(&mut self, position: Vec3, normal: Vec3, color: Vec3) -> u32 {
        let index = self.positions.len() as u32;
        let [r, g, b] = color.clamp(Vec3::ZERO, Vec3::ONE).to_array();
        // Drooping leaves lie on the ground, they do not pierce it.
        self.positions.push(position.with_y(position.y.max(0.0)));
        self.normals.push(normal);
        self.colors.push([r, g, b, 1.0]);
        index
    }
}

/// A tree as plain data.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlainTree {
    /// Bark first, then leaves.
    pub parts: Vec<PlainPart>,
}

impl PlainTree {
    /// Triangles of all parts.
    pub fn triangle_count(&self) -> usize {
        self.parts.iter().map(|part| part.triangles.len()).sum()
    }

    /// The box around all vertices. O(n).
    pub fn bounds(&self) -> Aabb {
        Aabb::of(self.parts.iter().flat_map(|part| part.positions.iter().copied()))
    }
}

/// Grows a tree. The same shape and seed give the same tree on one platform; shapes with values outside their ranges
/// are clamped to them, so every shape grows. O(stems · segments + leaves).
pub fn grow(shape: &TreeShape, seed: u64) -> PlainTree {
    let shape = shape.clamped();
    let mut rng = SplitMix64(seed);
    let height = shape.height_m * rng.range(1.0 - shape.height_jitter, 1.0 + shape.height_jitter);
    let envelope = envelope::Envelope::new(&shape.crown, height, &mut rng);
    let stems = skeleton::grow_stems(&shape, &envelope, &mut rng);
    let bark = bark::bark_part(&shape.bark, &stems, height, &mut rng);
    let leaves = leaves::leaves_part(&shape.leaves, &stems, &envelope, &mut rng);
    PlainTree { parts: vec![bark, leaves] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_stands_on_the_ground_within_its_budget() {
        for (name, shape) in presets() {
            for seed in 1..9 {
                let tree = grow(&shape, seed);
                let bounds = tree.bounds();
                assert!((8.0..=17.0).contains(&bounds.max.y), "{name} {seed}: {bounds:?}");
                assert!(bounds.min.y.abs() < 1e-4, "{name} {seed}: {bounds:?}");
                let triangles = tree.triangle_count();
                assert!((11_500..=25_000).contains(&triangles), "{name} {seed}: {triangles}");
            }
        }
    }

    #[test]
    fn vertices_are_finite_with_unit_normals_and_indices_in_range() {
        for (name, shape) in presets() {
            let tree = grow(&shape, 7);
            assert_eq!(tree.parts.len(), 2);
            for part in &tree.parts {
                let vertices = part.positions.len();
                assert_eq!((part.normals.len(), part.colors.len()), (vertices, vertices));
                assert!(part.positions.iter().all(|p| p.is_finite()), "{name} {}", part.name);
                assert!(
                    part.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3),
                    "{name} {}",
                    part.name
                );
                assert!(part.triangles.iter().flatten().all(|&i| (i as usize) < vertices));
            }
        }
    }

    #[test]
    fn triangles_face_the_side_of_their_normals() {
        for (name, shape) in presets() {
            for part in grow(&shape, 3).parts {
                let agreeing = part.triangles.iter().filter(|t| {
                    let [a, b, c] = t.map(|i| part.positions[i as usize]);
                    let normal: Vec3 = t.iter().map(|&i| part.normals[i as usize]).sum();
                    (b - a).cross(c - a).dot(normal) >= 0.0
                });
                let share = agreeing.count() as f32 / part.triangles.len() as f32;
                assert!(share > 0.97, "{name} {}: {share}", part.name);
            }
        }
    }

    #[test]
    fn equal_seeds_give_equal_trees_and_others_do_not() {
        let shape = TreeShape::broadleaf();
        assert_eq!(grow(&shape, 5), grow(&shape, 5));
        assert_ne!(grow(&shape, 5), grow(&shape, 6));
    }

    #[test]
    fn absurd_shapes_grow_without_panic() {
        let mut shape = TreeShape::broadleaf();
        shape.height_m = f32::NAN;
        shape.crown.radius_m = -4.0;
        shape.limbs.per_m = f32::INFINITY;
        shape.twigs.segments = u32::MAX;
        shape.bark.sides = 0;
        shape.leaves.width = f32::NAN;
        let tree = grow(&shape, 1);
        assert!(tree.parts.iter().flat_map(|p| &p.positions).all(|p| p.is_finite()));
    }
}
