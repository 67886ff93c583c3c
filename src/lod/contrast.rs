//! How much of its own colour a point keeps where a pixel shows one of many: the contrast correction of Cook et al. 2007
//! ("Stochastic simplification of aggregate detail").
//!
//! A pixel of a far crown averages many leaves. A picture of points shows as many of them as the pixel has samples, mostly
//! one, so that it varies more than it should. The cure is to move every colour `c` towards the mean `m` of the tree,
//! `m + a (c − m)`: the mean stays, and `a` is chosen so that the variance is that of the average.
//!
//! In: sizes of a pixel and of a leaf, samples; out: `a`, and how bright leaves of any direction are on average. WGSL twins:
//! `shaders/lib/contrast.wgsl`.

use std::f32::consts::PI;

/// Different leaves in a pixel: one over the chance that two places in it are of the same leaf. `leaf_area` is the mean
/// area of a leaf, of which half is seen on average (0: no leaves, and then 1); `unit` is the side of a pixel, in the same
/// units.
pub fn leaves_in_pixel(leaf_area: f32, unit: f32) -> f32 {
    if leaf_area > 0.0 { 1.0 + unit * unit / (0.5 * leaf_area) } else { 1.0 }
}

/// The factor `a`, 0 to 1, for a pixel of `leaves` different leaves and `samples` samples.
///
/// With variance 1 of a leaf, the average over the pixel has the variance `1 / leaves`. That of `samples` samples has
/// `1 / samples + (1 − 1 / samples) / leaves`, since two of them are of the same leaf with chance `1 / leaves`. The ratio
/// is `a²`: 1 / leaves for one sample, and 1 where antialiasing averages all that there is.
pub fn contrast_factor(leaves: f32, samples: f32) -> f32 {
    (samples / (leaves + samples - 1.0)).sqrt()
}

/// The factor with which a setting's `strength`, 0 to 1, takes part.
pub fn own_share(factor: f32, strength: f32) -> f32 {
    1.0 - strength * (1.0 - factor)
}

/// What the colours of a tree are multiplied by where they keep the share `own` of themselves.
///
/// Pictures are averages of what is displayed. Curves of displays are concave, so that the average of displayed colours is
/// darker than the display of their average, the more the wider they spread. For a curve `c^g` and colours of the relative
/// variance `v` that `own` narrows, `(1 − g) / 2 · v · (1 − own²)` is lost.
pub fn averaged_after_display(own: f32) -> f32 {
    1.0 - LOST_BY_DISPLAY * (1.0 - own * own)
}

/// `(1 − g) / 2 · v` of lit leaves behind Bevy's default tone mapping, measured so that the mean of pictures stays: 0.08 to 0.12
/// for an aspen and two oaks.
const LOST_BY_DISPLAY: f32 = 0.12;

/// Mean of `max(n · l, 0)` over leaves of any direction, as many of each, that show their lit or their unlit side: `cos_angle`
/// is that between light and view. It is the phase function of a Lambertian sphere.
pub fn mean_shade(cos_angle: f32) -> f32 {
    let cosine = cos_angle.clamp(-1.0, 1.0);
    let angle = cosine.acos();
    2.0 / (3.0 * PI) * (angle.sin() + (PI - angle) * cosine)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Mean and variance.
    fn moments(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
        let n = values.clone().count() as f64;
        let mean = values.clone().sum::<f64>() / n;
        (mean, values.map(|v| (v - mean) * (v - mean)).sum::<f64>() / n)
    }

    /// Random numbers in [0, 1).
    fn numbers(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed.wrapping_mul(2).wrapping_add(1);
        move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn corrected_pixels_vary_as_averages_do(seed: u64, leaves in 1usize..40, samples in 1usize..9) {
            let mut next = numbers(seed);
            let factor = f64::from(contrast_factor(leaves as f32, samples as f32));
            let (mut truth, mut drawn) = (vec![], vec![]);
            for _ in 0..20_000 {
                let colors: Vec<f64> = (0..leaves).map(|_| next() * next()).collect();
                truth.push(colors.iter().sum::<f64>() / leaves as f64);
                let shown = (0..samples).map(|_| colors[(next() * leaves as f64) as usize]);
                drawn.push(shown.sum::<f64>() / samples as f64);
            }
            // The mean of the colours is 1/4.
            let corrected = drawn.iter().map(|color| 0.25 + factor * (color - 0.25));
            let (mean, variance) = moments(corrected);
            let (true_mean, true_variance) = moments(truth.iter().copied());
            prop_assert!((mean - true_mean).abs() < 0.01, "{mean} {true_mean}");
            prop_assert!((variance / true_variance - 1.0).abs() < 0.12, "{variance} {true_variance}");
        }

        #[test]
        fn nearer_and_with_more_samples_less_is_corrected(unit in 0.0f32..10.0, samples in 1.0f32..64.0) {
            let at = |unit, samples| contrast_factor(leaves_in_pixel(0.01, unit), samples);
            let factor = at(unit, samples);
            prop_assert!((0.0..=1.0).contains(&factor));
            prop_assert!(at(unit * 1.1, samples) <= factor && at(unit, samples * 1.1) >= factor);
            prop_assert_eq!(own_share(factor, 0.0), 1.0);
            prop_assert!((own_share(factor, 1.0) - factor).abs() < 1e-6);
        }
    }

    #[test]
    fn nothing_is_corrected_where_a_leaf_fills_the_pixel_or_there_is_none() {
        assert_eq!(contrast_factor(leaves_in_pixel(0.01, 0.0), 1.0), 1.0);
        assert_eq!(contrast_factor(leaves_in_pixel(0.0, 5.0), 1.0), 1.0);
        // Pixels of the size that a leaf shows hold parts of two.
        assert!((leaves_in_pixel(0.02, 0.1) - 2.0).abs() < 1e-5);
    }

    #[test]
    fn leaves_of_any_direction_are_as_bright_as_their_formula() {
        let mut next = numbers(5);
        for cosine in [-1.0f64, -0.6, 0.0, 0.5, 1.0] {
            let light = [(1.0 - cosine * cosine).sqrt(), 0.0, cosine];
            let (mut sum, mut weight) = (0.0, 0.0);
            for _ in 0..100_000 {
                let (z, angle) = (2.0 * next() - 1.0, next() * std::f64::consts::TAU);
                let flat = (1.0 - z * z).sqrt();
                // The view is +z: the side that is seen.
                let side = z.signum();
                let toward = (flat * angle.cos() * light[0] + z * light[2]) * side;
                sum += z.abs() * toward.max(0.0);
                weight += z.abs();
            }
            let found = f64::from(mean_shade(cosine as f32));
            assert!((sum / weight - found).abs() < 0.01, "{cosine}: {found}");
        }
    }
}
