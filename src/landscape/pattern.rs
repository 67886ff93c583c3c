//! Where forest grows: a smooth field of "forestness" with patches, ragged edges and clearings. Pure; O(octaves) a query.

use super::{Field, smoothstep};

/// Forestness of places; the same seed and patch size give the same pattern whatever the number of trees.
pub(super) struct ForestPattern {
    regions: Field,
    patches: Field,
    edges: Field,
    clearings: Field,
    patch_m: f32,
}

impl ForestPattern {
    /// `patch_m` is the size of a forest patch in metres, clamped to 5..=10,000.
    pub fn new(seed: u64, patch_m: f32) -> Self {
        let patch_m = if patch_m.is_nan() { 5.0 } else { patch_m.clamp(5.0, 10_000.0) };
        let field = |stream: u64, octaves, wavelength_m| {
            Field::new(seed.wrapping_mul(0x9E37_79B1).wrapping_add(stream), octaves, wavelength_m)
        };
        Self {
            regions: field(4, 2, patch_m * 9.0),
            patches: field(1, 3, patch_m * 2.0),
            edges: field(2, 3, patch_m * 0.3),
            clearings: field(3, 2, patch_m * 0.7),
            patch_m,
        }
    }

    /// About 0 (open) to 1 (deep forest); a share of the ground is below each value, so a threshold gives any cover.
    pub fn forestness(&self, x: f32, z: f32) -> f32 {
        let edge = self.edges.at(x, z);
        // Pushed about by the edges' noise: tongues and bays instead of the smooth outlines of Perlin noise.
        let push = 0.16 * self.patch_m * edge;
        let base = 0.5
            + 0.35 * self.regions.at(x, z)
            + 0.75 * self.patches.at(x + push, z - push)
            + 0.17 * edge;
        // Holes in the forest where another noise is high.
        let clearing = smoothstep(0.3, 0.48, self.clearings.at(x + push, z + push));
        (base - 0.5 * clearing).clamp(0.0, 1.0)
    }

    /// The forestness that `share` (0 to 1) of all places exceed, by sampling. O(2,304 octaves).
    pub(super) fn exceeded_by(&self, share: f32) -> f32 {
        const ROW: i32 = 48;
        // Steps that are no multiple of a wavelength, over many patches.
        let step = self.patch_m * 1.37;
        let mut values: Vec<f32> = (0..ROW * ROW)
            .map(|i| {
                self.forestness(
                    (i % ROW - ROW / 2) as f32 * step,
                    (i / ROW - ROW / 2) as f32 * step,
                )
            })
            .collect();
        values.sort_unstable_by(f32::total_cmp);
        let index = (1.0 - share.clamp(0.0, 1.0)) * (values.len() - 1) as f32;
        values[index as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_asked_for_lies_above_the_threshold() {
        let pattern = ForestPattern::new(5, 260.0);
        for share in [0.2, 0.5, 0.8] {
            let threshold = pattern.exceeded_by(share);
            let places = (0..10_000).map(|i| ((i % 100) as f32 * 191.0, (i / 100) as f32 * 173.0));
            let above = places.filter(|&(x, z)| pattern.forestness(x, z) > threshold).count();
            assert!((above as f32 / 10_000.0 - share).abs() < 0.08, "{share}: {above}");
        }
    }
}
