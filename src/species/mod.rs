//! L1, pure: a small plant generator. A species, a seed and a season in, coloured triangles out; some ten milliseconds a tree.
//!
//! `file` (RON, presets) and `shape` (parameters, with their `ranges`) → `envelope` (outline of the crown) → `skeleton`
//! (stems) → `bark` (tubes), `leaves` (coloured by `season`) and `blossoms`; or `cover` for what has no stems →
//! [`PlainTree`] → `glb` (bytes of a file). The stems follow Weber & Penn 1995, "Creation and Rendering of Realistic
//! Trees", section 4, in their parameters (levels, down angle, rotation, curve, forks, taper); unlike there, an explicit
//! outline with lobes bounds the lengths, which gives clumps and gaps without tuning per species.
//!
//! ```
//! use bevy_treeline::species::{grow, preset};
//! let oak = preset("oak")?;
//! let tree = grow(&oak, 3, 0.0);
//! assert!(tree.triangle_count() > 20_000);
//! # Ok::<(), bevy_treeline::species::SpeciesError>(())
//! ```

mod bark;
mod blossoms;
mod cover;
mod envelope;
mod file;
pub mod glb;
mod leaves;
mod ranges;
mod season;
pub mod shape;
mod skeleton;
#[cfg(test)]
mod tests;

pub use file::{PlantShape, Species, SpeciesError, SpeciesKind, preset, species_names};
pub use shape::TreeShape;

use crate::math::bounding::Aabb;
use crate::math::hash::SplitMix64;
use bevy::math::Vec3;
use season::Season;
use shape::BlossomShape;

/// Triangles of one surface of a plant. All vertex lists have the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlainPart {
    /// `bark`, `leaves` or `blossoms`.
    pub name: String,
    /// Metres; the plant stands at the origin, y is up.
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

    /// Adds a triangle, wound so that its front is on the side of its normals: there, lighting takes them as they are.
    fn push_facing(&mut self, triangle: [u32; 3]) {
        let [a, b, c] = triangle.map(|i| self.positions[i as usize]);
        let normal: Vec3 = triangle.iter().map(|&i| self.normals[i as usize]).sum();
        let [i, j, k] = triangle;
        let front = (b - a).cross(c - a).dot(normal) >= 0.0;
        self.triangles.push(if front { [i, j, k] } else { [i, k, j] });
    }
}

/// A plant as plain data.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlainTree {
    /// Bark, leaves, blossoms: those that the plant has.
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

/// Grows a plant. The same species, seed and season give the same plant on one platform; values outside their ranges are
/// clamped to them, so every species grows. `autumn` is 0 in summer and 1 at the end of autumn (clamped); evergreens ignore
/// it. The seasons of one seed share one crown. O(stems · segments + leaves).
pub fn grow(species: &Species, seed: u64, autumn: f32) -> PlainTree {
    let species = species.clamped();
    let mut rng = SplitMix64(seed);
    let season = Season::new(species.autumn.as_ref().filter(|_| species.deciduous), autumn);
    let blossoms = species.blossoms.as_ref();
    let height = |height_m: f32, jitter: f32, rng: &mut SplitMix64| {
        height_m * rng.range(1.0 - jitter, 1.0 + jitter)
    };
    let parts = match &species.shape {
        PlantShape::Tree(shape) => {
            let height = height(shape.height_m, shape.height_jitter, &mut rng);
            grow_tree(shape, blossoms, &season, height, &mut rng)
        }
        PlantShape::Cover(shape) => {
            let height = height(shape.height_m, shape.height_jitter, &mut rng);
            cover::grow_cover(shape, blossoms, &season, height, &mut rng)
        }
    };
    PlainTree { parts: parts.into_iter().filter(|part| !part.triangles.is_empty()).collect() }
}

fn grow_tree(
    shape: &TreeShape,
    blossoms: Option<&BlossomShape>,
    season: &Season,
    height: f32,
    rng: &mut SplitMix64,
) -> Vec<PlainPart> {
    let envelope = envelope::Envelope::new(&shape.crown, height, rng);
    let stems = skeleton::grow_stems(shape, &envelope, rng);
    let mut parts = vec![bark::bark_part(&shape.bark, &stems, height, rng)];
    if let Some(leaves) = &shape.leaves {
        parts.push(leaves::leaves_part(leaves, &stems, &envelope, season, rng));
    }
    if let Some(blossoms) = blossoms {
        parts.push(blossoms::tree_blossoms(blossoms, &stems, &envelope, rng));
    }
    parts
}
