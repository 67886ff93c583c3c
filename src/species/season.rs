//! Colour of a leaf through the autumn. O(1) a leaf.

use super::shape::AutumnShape;
use bevy::math::Vec3;

/// How far the autumn is.
pub(super) struct Season<'a> {
    shape: Option<&'a AutumnShape>,
    /// 0 summer to 1 the end of autumn.
    autumn: f32,
}

/// What one leaf is like by itself, all 0 to 1.
#[derive(Clone, Copy)]
pub(super) struct LeafTime {
    /// Of its limb: whole limbs turn together.
    pub clump: f32,
    /// Of its own.
    pub own: f32,
    /// Sunlit: those turn first and redder.
    pub light: f32,
}

impl<'a> Season<'a> {
    /// `shape` is `None` for evergreens.
    pub(super) fn new(shape: Option<&'a AutumnShape>, autumn: f32) -> Self {
        let autumn = if autumn.is_nan() { 0.0 } else { autumn.clamp(0.0, 1.0) };
        Self { shape, autumn }
    }

    /// How far a leaf has turned, 0 to 1.
    fn turned(&self, shape: &AutumnShape, time: LeafTime) -> f32 {
        let late = 0.45 * time.clump + 0.3 * time.own + 0.25 * (1.0 - time.light);
        let turning = (1.0 - shape.spread).max(0.1);
        let t = ((self.autumn - late * shape.spread) / turning).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }

    /// The colour of a leaf that is `summer` in summer.
    pub(super) fn color(&self, summer: Vec3, time: LeafTime) -> Vec3 {
        let Some(shape) = self.shape.filter(|shape| !shape.colors.is_empty()) else {
            return summer;
        };
        let pick = (0.45 * time.clump + 0.3 * time.own + 0.25 * time.light).clamp(0.0, 1.0);
        // Sums of uniform numbers crowd in the middle; spread to the ends.
        let pick = ((pick - 0.5) * 1.5 + 0.5).clamp(0.0, 1.0);
        let place = pick * (shape.colors.len() - 1) as f32;
        let (low, share) = (place as usize, place.fract());
        let high = (low + 1).min(shape.colors.len() - 1);
        let autumn = Vec3::from(shape.colors[low]).lerp(Vec3::from(shape.colors[high]), share);
        // In shade as much darker as the green was.
        let autumn = autumn * (0.82 + 0.18 * time.light);
        summer.lerp(autumn, self.turned(shape, time))
    }

    /// True if the leaf lies on the ground. `chance` is uniform, 0 to 1.
    pub(super) fn fallen(&self, chance: f32) -> bool {
        let end = ((self.autumn - 0.6) / 0.4).clamp(0.0, 1.0);
        self.shape.is_some_and(|shape| chance < shape.fallen * end * end)
    }
}
