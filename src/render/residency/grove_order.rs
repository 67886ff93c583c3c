//! Which groves are made first: those of what a camera shows, the nearest before the others.
//!
//! A tile without groves costs a look at each of its trees in every frame that shows it, and nothing in others. In: boxes of tiles,
//! cameras; out: an order that depends on nothing else. O(tiles · (cameras + log tiles)).

use crate::math::bounding::Aabb;
use bevy::math::{Vec3, Vec4};

/// A camera, as far as that order goes.
pub(super) struct Onlooker {
    pub eye: Vec3,
    /// Planes (normal, distance) that look inwards.
    pub planes: Vec<Vec4>,
}

impl Onlooker {
    fn shows(&self, bounds: &Aabb) -> bool {
        let (center, half) = (bounds.center(), bounds.extent() * 0.5);
        self.planes.iter().all(|plane| {
            let normal = plane.truncate();
            normal.dot(center) + plane.w >= -normal.abs().dot(half)
        })
    }

    fn distance_squared(&self, bounds: &Aabb) -> f32 {
        self.eye.clamp(bounds.min, bounds.max.max(bounds.min)).distance_squared(self.eye)
    }
}

/// Indices of boxes, the most urgent first: what some camera shows before the rest, each nearest first; ties go by index.
pub(super) fn by_urgency(boxes: &[Aabb], onlookers: &[Onlooker]) -> Vec<usize> {
    let urgency = |bounds: &Aabb| {
        let distances = |shown: bool| {
            onlookers
                .iter()
                .filter(move |onlooker| onlooker.shows(bounds) == shown)
                .map(|onlooker| onlooker.distance_squared(bounds))
                .reduce(f32::min)
        };
        match distances(true) {
            Some(nearest) => (false, nearest),
            None => (true, distances(false).unwrap_or(0.0)),
        }
    };
    let urgencies: Vec<(bool, f32)> = boxes.iter().map(urgency).collect();
    let mut order: Vec<usize> = (0..boxes.len()).collect();
    order.sort_by(|&a, &b| {
        let ((a_unseen, a), (b_unseen, b)) = (urgencies[a], urgencies[b]);
        a_unseen.cmp(&b_unseen).then(a.total_cmp(&b))
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Looks along an axis, 90 degrees wide.
    fn looking(eye: Vec3, along: Vec3, aside: Vec3) -> Onlooker {
        let planes = [along + aside, along - aside].map(|n| n.normalize().extend(0.0));
        Onlooker { eye, planes: planes.map(|p| p - Vec4::W * p.truncate().dot(eye)).to_vec() }
    }

    fn around(x: f32, z: f32) -> Aabb {
        let center = Vec3::new(x, 0.0, z);
        Aabb { min: center - 10.0, max: center + 10.0 }
    }

    #[test]
    fn what_a_camera_shows_comes_first_and_the_nearest_of_that() {
        let boxes = [
            around(0.0, 50.0),
            around(0.0, -900.0),
            around(500.0, -100.0),
            around(0.0, -100.0),
            around(0.0, 30.0),
            around(60.0, -100.0),
            around(0.0, -100.0),
        ];
        let north = looking(Vec3::ZERO, Vec3::NEG_Z, Vec3::X);
        assert_eq!(by_urgency(&boxes, &[north]), [3, 6, 5, 1, 4, 0, 2]);
    }

    #[test]
    fn any_camera_counts() {
        let boxes =
            [around(0.0, 400.0), around(0.0, -300.0), around(0.0, 40.0), around(900.0, 0.0)];
        let north = || looking(Vec3::ZERO, Vec3::NEG_Z, Vec3::X);
        let south = || looking(Vec3::Z * 200.0, Vec3::Z, Vec3::X);
        let expected = [0, 1, 2, 3];
        assert_eq!(by_urgency(&boxes, &[north(), south()]), expected);
        assert_eq!(by_urgency(&boxes, &[south(), north()]), expected);
    }

    #[test]
    fn without_cameras_the_order_stays() {
        assert_eq!(by_urgency(&[around(9.0, 0.0), around(1.0, 0.0)], &[]), [0, 1]);
    }
}
