//! Axis-aligned boxes and bounding spheres.

use bevy::math::Vec3;

/// An axis-aligned box. Empty (min > max) by default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Smallest corner.
    pub min: Vec3,
    /// Largest corner.
    pub max: Vec3,
}

impl Default for Aabb {
    fn default() -> Self {
        Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY }
    }
}

impl Aabb {
    /// The smallest box around `points`; empty if there are none. O(n).
    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::default(), |b, p| b.including(p))
    }

    /// This box grown to hold `point`.
    pub fn including(self, point: Vec3) -> Self {
        Self { min: self.min.min(point), max: self.max.max(point) }
    }

    /// The smallest box around both.
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// True if it holds no point.
    pub fn is_empty(&self) -> bool {
        self.min.cmpgt(self.max).any()
    }

    /// Side lengths, 0 if empty.
    pub fn extent(&self) -> Vec3 {
        (self.max - self.min).max(Vec3::ZERO)
    }

    /// Middle of the box.
    pub fn center(&self) -> Vec3 {
        (self.min + self.max) * 0.5
    }

    /// Square of the distance from a point to the nearest of the box; 0 inside, infinite if it is empty.
    pub fn distance_squared(&self, point: Vec3) -> f32 {
        point.clamp(self.min, self.max.max(self.min)).distance_squared(point)
    }

    /// Half the diagonal: radius of the sphere around the box.
    pub fn radius(&self) -> f32 {
        self.extent().length() * 0.5
    }
}
