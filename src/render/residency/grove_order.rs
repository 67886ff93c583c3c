//! Which groves are made first: those of what a camera shows, the nearest before the others; and for which view scales.
//!
//! A tile without groves costs a look at each of its trees in every frame that shows it, and nothing in others. In: boxes of tiles,
//! cameras; out: an order that depends on nothing else. O(tiles · (cameras + log tiles)).

use crate::{forest::view_scale, math::bounding::Aabb};
use bevy::math::{Vec3, Vec4};

/// A camera, as far as groves go.
pub(super) struct Onlooker {
    pub eye: Vec3,
    /// Planes (normal, distance) that look inwards.
    pub planes: Vec<Vec4>,
    pub quality: f32,
    /// `Z0`.
    pub pixels_per_unit: f32,
    pub orthographic: bool,
}

impl Onlooker {
    fn shows(&self, bounds: &Aabb) -> bool {
        let (center, half) = (bounds.center(), bounds.extent() * 0.5);
        self.planes.iter().all(|plane| {
            let normal = plane.truncate();
            normal.dot(center) + plane.w >= -normal.abs().dot(half)
        })
    }

    /// The largest view scale of what is in a box.
    fn view_scale(&self, bounds: &Aabb) -> f32 {
        let nearest =
            if self.orthographic { 1.0 } else { bounds.distance_squared(self.eye).sqrt() };
        view_scale(self.quality, self.pixels_per_unit, nearest)
    }
}

/// The largest view scale at which any camera may draw what is in a box; 0 without cameras.
pub(super) fn largest_view_scale(bounds: &Aabb, onlookers: &[Onlooker]) -> f32 {
    onlookers.iter().map(|onlooker| onlooker.view_scale(bounds)).fold(0.0, f32::max)
}

/// Indices of boxes, the most urgent first: what some camera shows before the rest, each nearest first; ties go by index.
pub(super) fn by_urgency(boxes: &[Aabb], onlookers: &[Onlooker]) -> Vec<usize> {
    let urgency = |bounds: &Aabb| {
        let distances = |shown: bool| {
            onlookers
                .iter()
                .filter(move |onlooker| onlooker.shows(bounds) == shown)
                .map(|onlooker| bounds.distance_squared(onlooker.eye))
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
        let planes = planes.map(|p| p - Vec4::W * p.truncate().dot(eye)).to_vec();
        Onlooker { eye, planes, quality: 2.0, pixels_per_unit: 500.0, orthographic: false }
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
    fn the_nearest_camera_decides_how_much_of_a_grove_is_needed() {
        let north = || looking(Vec3::ZERO, Vec3::NEG_Z, Vec3::X);
        let bounds = around(0.0, -1010.0);
        let near = Onlooker { eye: Vec3::new(0.0, 0.0, -1520.0), ..north() };
        let at_1000_m = 2.0 * 0.5 * 0.5;
        assert!((largest_view_scale(&bounds, &[north()]) - at_1000_m).abs() < 1e-5);
        assert!((largest_view_scale(&bounds, &[north(), near]) - at_1000_m * 4.0).abs() < 1e-5);
        let parallel = Onlooker { pixels_per_unit: 3.0, orthographic: true, ..north() };
        assert_eq!(largest_view_scale(&bounds, &[parallel]), 18.0);
        assert_eq!(largest_view_scale(&bounds, &[]), 0.0);
        let inside = largest_view_scale(&around(0.0, 0.0), &[north()]);
        assert!(inside > 1e9, "{inside}");
    }

    #[test]
    fn without_cameras_the_order_stays() {
        assert_eq!(by_urgency(&[around(9.0, 0.0), around(1.0, 0.0)], &[]), [0, 1]);
    }
}
