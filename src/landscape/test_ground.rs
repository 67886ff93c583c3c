//! Grounds for tests.

use super::Ground;

/// Waves up to 400 m high with cliffs on one side, a lake, and a hole near the origin.
pub(super) struct Cliffs {
    pub side: f32,
}

impl Ground for Cliffs {
    fn side_m(&self) -> f32 {
        self.side
    }

    fn height(&self, x: f32, z: f32) -> f32 {
        // The hole, 40 m wide.
        if x.hypot(z - 60.0) < 20.0 {
            return f32::NAN;
        }
        let slope = (x / 2000.0 + 0.5).clamp(0.0, 1.0);
        let step = 30.0 * (x / 90.0 + (z / 70.0).sin()).sin().max(0.6);
        330.0 * slope * slope + 14.0 * (x / 60.0).sin() * (z / 80.0).cos() + step - 22.0
    }

    fn height_range(&self) -> [f32; 2] {
        [-30.0, 360.0]
    }

    fn detail_m(&self) -> f32 {
        1.0
    }

    fn water_level(&self) -> Option<f32> {
        Some(0.0)
    }
}
