//! Where forest grows: a smooth field of "forestness" with patches, edges and clearings. Pure; O(octaves) a query.

use super::{Field, smoothstep};

/// Forestness of places; the same seed and patch size give the same pattern whatever the number of trees.
pub struct ForestPattern {
    patches: Field,
    edges: Field,
    clearings: Field,
}

impl ForestPattern {
    /// `patch_m` is the size of a forest patch in metres, clamped to 5..=10,000.
    pub fn new(seed: u64, patch_m: f32) -> Self {
        let patch_m = if patch_m.is_nan() { 5.0 } else { patch_m.clamp(5.0, 10_000.0) };
        let field = |stream: u64, octaves, wavelength_m| {
            Field::new(seed.wrapping_mul(0x9E37_79B1).wrapping_add(stream), octaves, wavelength_m)
        };
        Self {
            patches: field(1, 3, patch_m * 2.0),
            edges: field(2, 3, patch_m * 0.35),
            clearings: field(3, 2, patch_m * 0.7),
        }
    }

    /// About 0 (open) to 1 (deep forest); a share of the ground is below each value, so a threshold gives any cover.
    pub fn forestness(&self, x: f32, z: f32) -> f32 {
        let base = 0.5 + 0.75 * self.patches.at(x, z) + 0.2 * self.edges.at(x, z);
        // Round holes in the forest where a second noise is high.
        let clearing = smoothstep(0.3, 0.48, self.clearings.at(x, z));
        (base - 0.5 * clearing).clamp(0.0, 1.0)
    }
}
