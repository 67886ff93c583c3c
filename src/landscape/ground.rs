//! What chunks, biomes, scattering and flights read of any ground: heights at places, and what follows from them.

use bevy::math::Vec3;

/// Ground over the square from −side/2 to side/2 in x and z, y up, metres. Queries are pure: the same place gives the
/// same answer, from any thread, in any order. Outside the square the answer is that of the nearest border or better.
pub trait Ground: Send + Sync + 'static {
    /// Length of a side in metres.
    fn side_m(&self) -> f32;

    /// Height at (x, z) in metres.
    fn height(&self, x: f32, z: f32) -> f32;

    /// A range that holds every height, metres: lowest, highest.
    fn height_range(&self) -> [f32; 2];

    /// Distance in metres below which heights hold no more detail: the finest chunk and the step of normals.
    fn detail_m(&self) -> f32;

    /// Height of still water, metres; `None` where there is none.
    fn water_level(&self) -> Option<f32> {
        None
    }

    /// How wet the soil is: 0 dry ridge, 1 river bank. Default: 0.5.
    fn moisture(&self, _x: f32, _z: f32) -> f32 {
        0.5
    }

    /// Unit normal by central differences over [`Ground::detail_m`].
    fn normal(&self, x: f32, z: f32) -> Vec3 {
        let step = self.detail_m();
        let dx = self.height(x + step, z) - self.height(x - step, z);
        let dz = self.height(x, z + step) - self.height(x, z - step);
        Vec3::new(-dx, 2.0 * step, -dz).normalize_or(Vec3::Y)
    }

    /// Everything that biomes ask about a place.
    fn site(&self, x: f32, z: f32) -> Site {
        let height_m = self.height(x, z);
        let normal = self.normal(x, z);
        // Over a wider step: hollows and ridges of the size of a stand of trees.
        let step = (4.0 * self.detail_m()).max(12.0);
        let around = self.height(x + step, z)
            + self.height(x - step, z)
            + self.height(x, z + step)
            + self.height(x, z - step);
        Site {
            height_m,
            normal,
            slope: normal.y.clamp(-1.0, 1.0).acos(),
            curvature: (around - 4.0 * height_m) / (step * step),
            moisture: self.moisture(x, z),
            above_water_m: self.water_level().map_or(f32::INFINITY, |level| height_m - level),
        }
    }
}

/// A place on the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Site {
    /// Metres.
    pub height_m: f32,
    /// Unit.
    pub normal: Vec3,
    /// Angle to the horizontal, radians.
    pub slope: f32,
    /// Sum of the second derivatives, 1/m: positive in hollows, negative on ridges.
    pub curvature: f32,
    /// 0 dry to 1 wet.
    pub moisture: f32,
    /// Metres above the water, negative under it, infinite without water.
    pub above_water_m: f32,
}
