//! Grounds and woods to fly over in tests.

use super::Crown;
use crate::landscape::{BiomeSettings, Biomes, Field, Ground, Heightfield};
use crate::math::hash::unit_from_bits;
use bevy::math::{Vec2, Vec3};
use std::path::Path;

/// Ridges, valleys and lakes by a formula.
pub(super) struct Mountains {
    side_m: f32,
    broad: Field,
    ridges: Field,
}

impl Mountains {
    pub(super) fn new(side_m: f32, seed: u64) -> Self {
        let wavelength_m = (side_m * 0.7).min(3800.0);
        Self {
            side_m,
            broad: Field::new(seed * 7 + 1, 4, wavelength_m),
            ridges: Field::new(seed * 7 + 2, 4, wavelength_m * 0.4),
        }
    }
}

impl Ground for Mountains {
    fn side_m(&self) -> f32 {
        self.side_m
    }
    fn height(&self, x: f32, z: f32) -> f32 {
        let relief = (self.side_m / 2000.0).min(1.0);
        let broad = self.broad.at(x, z);
        let ridge = 1.0 - 2.0 * self.ridges.at(x, z).abs();
        relief * (420.0 * broad + 130.0 * ridge * (0.6 + broad).max(0.0))
    }
    fn height_range(&self) -> [f32; 2] {
        [-600.0, 800.0]
    }
    fn detail_m(&self) -> f32 {
        4.0
    }
    fn water_level(&self) -> Option<f32> {
        Some(-40.0 * (self.side_m / 2000.0).min(1.0))
    }
}

/// A real DEM of 30 m spacing, 19 km of it; `None` where the file is not there.
pub(super) fn real_dem() -> Option<Heightfield> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/dem");
    let image = image::open(folder.join("bigtujunga_1197x643.png")).ok()?.into_luma16();
    let cells = 640;
    let heights = (0..=cells).flat_map(|z| (0..=cells).map(move |x| (x, z))).map(|(x, z)| {
        315.0 + f32::from(image.get_pixel(x + 200, z).0[0]) / 65535.0 * (2295.0 - 315.0)
    });
    Heightfield::from_heights(cells as f32 * 30.0, cells, heights.collect()).ok()
}

pub(super) fn biomes(ground: &dyn Ground, seed: u64) -> Biomes {
    Biomes::new(ground, &BiomeSettings { seed, ..BiomeSettings::default() })
}

/// Trees where the biomes have forest, one per cell of `cell_m` at most, some young, some lone.
pub(super) fn woods<'a>(
    ground: &'a dyn Ground,
    biomes: &'a Biomes,
    cell_m: f32,
) -> impl Fn(Vec2, Vec2) -> Vec<Crown> + 'a {
    move |min, max| {
        let mut crowns = vec![];
        let index = |v: f32| (v / cell_m).floor() as i32;
        for z in index(min.y)..=index(max.y) {
            for x in index(min.x)..=index(max.x) {
                let base = (x as u32).wrapping_mul(0x9E37) ^ (z as u32).wrapping_mul(0x85EB_CA6B);
                let random = |k: u32| unit_from_bits(base.wrapping_add(k << 27));
                let at = Vec2::new(
                    (x as f32 + 0.15 + 0.7 * random(1)) * cell_m,
                    (z as f32 + 0.15 + 0.7 * random(2)) * cell_m,
                );
                let inside = at.cmpge(min).all() && at.cmplt(max).all();
                if !inside || at.abs().max_element() > ground.side_m() * 0.5 {
                    continue;
                }
                let site = ground.site(at.x, at.y);
                let share = biomes.at(at.x, at.y, &site).forest;
                let dry = site.above_water_m > 0.5;
                if !dry || random(3) > 0.85 * share + 0.004 {
                    continue;
                }
                let young = random(4) < 0.1;
                let height_m = if young { 3.0 + 4.0 * random(5) } else { 12.0 + 12.0 * random(5) };
                crowns.push(Crown {
                    position: Vec3::new(at.x, site.height_m, at.y),
                    radius_m: height_m * (0.12 + 0.1 * random(6)),
                    height_m,
                });
            }
        }
        crowns
    }
}
