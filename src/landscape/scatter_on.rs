//! Scattering by a density of one's own, on any ground: for games that have no use for biomes. O(area / spacing²).

use super::{
    Ground, ScatterError,
    blue_noise::{BlueNoise, tile_key},
};
use crate::math::hash::SplitMix64;
use bevy::math::{IVec2, Rect, Vec2, Vec3};

/// A tile of the pattern in spacings.
const TILE: f32 = 48.0;
/// The most tiles of the pattern that a rectangle may need.
const MOST_TILES: f32 = 4e6;

/// A place that was chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPoint {
    /// On the ground.
    pub position: Vec3,
    /// Of the ground, unit.
    pub normal: Vec3,
    /// Bits for whatever differs from plant to plant; the same place has the same.
    pub random: u32,
}

/// Places on `ground` within `rect` (x and z), no nearer than `spacing_m` (0.01 to 1,000 m, seen from above), as many per
/// square metre as `density` says for a position and normal; at most about 0.6 / spacing² fit. Nothing where the
/// ground's height is not a number ([`MeshGround`](super::MeshGround) in holes). A place depends on the ground there and the seed alone:
/// rectangles side by side join without seam.
///
/// ```
/// # use bevy::math::Rect; use bevy_treeline::landscape::{Heightfield, scatter_on};
/// let hills = Heightfield::rolling(200.0, 64, 1);
/// // A bush every 50 m² where it is flat.
/// let bushes = scatter_on(&hills, Rect::new(-50.0, -50.0, 50.0, 50.0), |_, normal| if normal.y > 0.95 { 0.02 } else { 0.0 }, 2.0, 7);
/// assert!(bushes.expect("the spacing is usable").len() > 50);
/// ```
///
/// # Errors
/// [`ScatterError::Setting`] for a spacing or a rectangle that cannot be used.
pub fn scatter_on(
    ground: &dyn Ground,
    rect: Rect,
    density: impl Fn(Vec3, Vec3) -> f32,
    spacing_m: f32,
    seed: u64,
) -> Result<Vec<GroundPoint>, ScatterError> {
    if !(0.01..=1000.0).contains(&spacing_m) {
        return Err(ScatterError::Setting {
            what: "spacing_m",
            value: spacing_m,
            must: "0.01 to 1000",
        });
    }
    let tile_m = TILE * spacing_m;
    let size = rect.size();
    let tiles = (size.x / tile_m + 1.0) * (size.y / tile_m + 1.0);
    let far = rect.min.abs().max(rect.max.abs()).max_element();
    if !(far.is_finite() && tiles <= MOST_TILES && far / tile_m < 1e6) {
        return Err(ScatterError::Setting {
            what: "rect",
            value: far,
            must: "finite and not huge for the spacing",
        });
    }
    let pattern = BlueNoise::new(tile_m, spacing_m, seed);
    let (first, last) =
        ((rect.min / tile_m).floor().as_ivec2(), (rect.max / tile_m).floor().as_ivec2());
    let mut found = vec![];
    for tile in (first.y..=last.y).flat_map(|z| (first.x..=last.x).map(move |x| IVec2::new(x, z))) {
        let key = tile_key(tile, seed ^ 0x0F0F);
        for candidate in pattern.candidates(tile, seed, f32::MAX) {
            let Vec2 { x, y: z } = tile.as_vec2() * tile_m + candidate.place;
            // Half open: what lies on a border belongs to one side.
            if !(x >= rect.min.x && x < rect.max.x && z >= rect.min.y && z < rect.max.y) {
                continue;
            }
            let height = ground.height(x, z);
            if !height.is_finite() {
                continue;
            }
            let (position, normal) = (Vec3::new(x, height, z), ground.normal(x, z));
            if candidate.at_density < density(position, normal) {
                let random = SplitMix64(key ^ u64::from(candidate.index) << 32).next_u64() as u32;
                found.push(GroundPoint { position, normal, random });
            }
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::landscape::{MeshGround, test_ground::Cliffs};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(8))]
        #[test]
        fn places_keep_their_distance_and_are_as_dense_as_asked(seed in any::<u64>(), spacing_m in 1.0f32..6.0, share in 0.05f32..1.0) {
            let ground = Cliffs { side: 400.0 };
            let density = share * 0.55 / (spacing_m * spacing_m);
            let rect = Rect::new(-80.0, -140.0, 60.0, 0.0);
            let found = scatter_on(&ground, rect, |_, _| density, spacing_m, seed).expect("usable");
            let expected = density * 140.0 * 140.0;
            prop_assert!((found.len() as f32 - expected).abs() < 0.06 * expected + 4.0 * expected.sqrt(), "{} of {expected}", found.len());
            let mut sorted = found.clone();
            sorted.sort_by(|a, b| a.position.x.total_cmp(&b.position.x));
            for (i, a) in sorted.iter().enumerate() {
                prop_assert_eq!(a.position.y, ground.height(a.position.x, a.position.z));
                for b in sorted[i + 1..].iter().take_while(|b| b.position.x - a.position.x < spacing_m) {
                    let apart = Vec2::new(a.position.x - b.position.x, a.position.z - b.position.z).length();
                    prop_assert!(apart > 0.999 * spacing_m, "{apart}");
                }
            }
            // Two halves are the whole.
            let halves = [Rect::new(-80.0, -140.0, -7.0, 0.0), Rect::new(-7.0, -140.0, 60.0, 0.0)]
                .map(|r| scatter_on(&ground, r, |_, _| density, spacing_m, seed).expect("usable").len());
            prop_assert_eq!(halves[0] + halves[1], found.len());
        }
    }

    #[test]
    fn nothing_stands_in_holes_or_where_the_density_is_no_number() {
        let ground = Cliffs { side: 400.0 };
        let rect = Rect::new(-60.0, 0.0, 60.0, 120.0);
        let found = scatter_on(&ground, rect, |_, _| 1.0, 1.0, 1).expect("usable");
        assert!(found.len() > 3000);
        assert!(found.iter().all(|p| p.position.x.hypot(p.position.z - 60.0) >= 20.0));
        assert_eq!(scatter_on(&ground, rect, |_, _| f32::NAN, 1.0, 1), Ok(vec![]));
        // A triangle as ground: its half of the square.
        let corners = [Vec3::ZERO, Vec3::new(0.0, 3.0, 40.0), Vec3::new(40.0, 0.0, 0.0)];
        let triangle = MeshGround::new(&corners, &[[0, 1, 2]]).expect("a ground");
        let square = Rect::new(0.0, 0.0, 40.0, 40.0);
        let found = scatter_on(&triangle, square, |_, _| 0.5, 1.0, 1).expect("usable");
        assert!((found.len() as f32 / 400.0 - 1.0).abs() < 0.15, "{}", found.len());
        assert!(found.iter().all(|p| p.position.x + p.position.z <= 40.01));
    }

    #[test]
    fn spacings_and_rectangles_that_cannot_be_used_are_named() {
        let ground = Cliffs { side: 40.0 };
        let with = |rect, spacing| scatter_on(&ground, rect, |_, _| 1.0, spacing, 1);
        let rect = Rect::new(0.0, 0.0, 9.0, 9.0);
        for spacing in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert!(matches!(
                with(rect, spacing),
                Err(ScatterError::Setting { what: "spacing_m", .. })
            ));
        }
        for rect in [Rect::new(0.0, 0.0, f32::INFINITY, 1.0), Rect::new(0.0, 0.0, 1e7, 1e7)] {
            assert!(
                matches!(with(rect, 1.0), Err(ScatterError::Setting { what: "rect", .. })),
                "{rect:?}"
            );
        }
    }
}
