//! Normal and area of a triangle, in double precision inside: tiny and thin triangles keep their direction.

use bevy::math::{DVec3, Vec3};

/// The unit normal (on the counter-clockwise side) and the area of a triangle.
///
/// `None` if the corners lie on a line or are not finite: such a triangle has no side to be seen from.
pub fn normal_and_area(a: Vec3, b: Vec3, c: Vec3) -> Option<(Vec3, f64)> {
    let [a, b, c]: [DVec3; 3] = [a.as_dvec3(), b.as_dvec3(), c.as_dvec3()];
    let cross = (b - a).cross(c - a);
    let length = cross.length();
    (length > 0.0 && length.is_finite()).then(|| ((cross / length).as_vec3(), length * 0.5))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_right_triangle_has_half_the_area_of_its_square() {
        let (normal, area) = normal_and_area(Vec3::ZERO, Vec3::X, Vec3::Y).expect("not on a line");
        assert_eq!((normal, area), (Vec3::Z, 0.5));
    }

    #[test]
    fn tiny_triangles_keep_their_normal_and_lines_have_none() {
        let tiny = 1e-20;
        let (normal, _) =
            normal_and_area(Vec3::ZERO, Vec3::Y * tiny, Vec3::Z * tiny).expect("small");
        assert_eq!(normal, Vec3::X);
        assert_eq!(normal_and_area(Vec3::ZERO, Vec3::X, Vec3::X * 2.0), None);
        assert_eq!(normal_and_area(Vec3::ZERO, Vec3::NAN, Vec3::X), None);
    }
}
