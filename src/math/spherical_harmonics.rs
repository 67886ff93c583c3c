//! Real spherical harmonics up to degree 2: a function on the sphere in nine numbers.
//!
//! Enough for the light that a matt surface gets: higher degrees change it by less than 1 % (Ramamoorthi and Hanrahan
//! 2001). O(1) each.

use bevy::math::Vec3;
use std::f32::consts::PI;

/// Coefficients by degree 0, 1 (y, z, x) and 2.
pub type Harmonics = [f32; 9];

/// The basis functions at a unit vector. The coefficients of a function are its products with these, integrated.
pub fn basis(direction: Vec3) -> Harmonics {
    let Vec3 { x, y, z } = direction;
    [
        0.282_094_8,
        0.488_602_5 * y,
        0.488_602_5 * z,
        0.488_602_5 * x,
        1.092_548_4 * x * y,
        1.092_548_4 * y * z,
        0.315_391_57 * (3.0 * z * z - 1.0),
        1.092_548_4 * x * z,
        0.546_274_2 * (x * x - y * y),
    ]
}

/// Coefficients of max(0, cos) of the angle to `normal` (a unit vector).
pub fn cosine_lobe(normal: Vec3) -> Harmonics {
    let mut lobe = basis(normal);
    for (i, value) in lobe.iter_mut().enumerate() {
        *value *= match i {
            0 => PI,
            1..=3 => 2.0 * PI / 3.0,
            _ => PI / 4.0,
        };
    }
    lobe
}

/// Integral of the product of two functions.
pub fn dot(a: &Harmonics, b: &Harmonics) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Evenly spread directions.
    fn sphere(count: usize) -> impl Iterator<Item = Vec3> {
        let golden = PI * (3.0 - 5.0f32.sqrt());
        (0..count).map(move |i| {
            let y = 1.0 - (2.0 * i as f32 + 1.0) / count as f32;
            let (r, phi) = ((1.0 - y * y).sqrt(), golden * i as f32);
            Vec3::new(r * phi.cos(), y, r * phi.sin())
        })
    }

    #[test]
    fn the_basis_is_orthonormal() {
        let count = 20_000;
        let weight = 4.0 * PI / count as f32;
        let mut products = [[0.0f32; 9]; 9];
        for direction in sphere(count) {
            let b = basis(direction);
            for (row, a) in products.iter_mut().zip(b) {
                row.iter_mut().zip(b).for_each(|(p, b)| *p += a * b * weight);
            }
        }
        for (i, row) in products.iter().enumerate() {
            for (j, p) in row.iter().enumerate() {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((p - expected).abs() < 2e-3, "{i} · {j} = {p}");
            }
        }
    }

    #[test]
    fn a_lobe_is_the_cosine_of_the_angle_to_its_normal() {
        let normal = Vec3::new(0.48, 0.6, -0.64);
        for direction in sphere(200) {
            let cos = direction.dot(normal);
            let lobe = dot(&basis(direction), &cosine_lobe(normal));
            assert!((lobe - cos.max(0.0)).abs() < 0.1, "{lobe} for {cos}");
        }
    }
}
