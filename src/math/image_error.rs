//! How far an image is from the truth, and the truth's supersampling.
//!
//! In: sRGB rgba8 images, rows from the top; out: numbers in linear light, or a smaller image. O(pixels).

use super::quantize::{linear_to_srgb8, srgb8_to_linear};

/// Images that do not fit each other or what was said about them.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ImageError {
    /// A buffer has another size than its width and height say.
    #[error(
        "an image of {width} × {height} pixels takes {expected} bytes of rgba8, but {found} were given"
    )]
    Size {
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
        /// 4 × width × height.
        expected: u64,
        /// Length of the buffer.
        found: u64,
    },
    /// A block or a factor of no pixels.
    #[error("`{name}` is 0, but must be at least 1")]
    Zero {
        /// Parameter name.
        name: &'static str,
    },
}

fn check_size(rgba8: &[u8], width: u32, height: u32) -> Result<(), ImageError> {
    // u128: 4 × (2³² − 1)² does not fit 64 bits.
    let expected = 4 * u128::from(width) * u128::from(height);
    if expected == rgba8.len() as u128 {
        return Ok(());
    }
    let expected = u64::try_from(expected).unwrap_or(u64::MAX);
    Err(ImageError::Size { width, height, expected, found: rgba8.len() as u64 })
}

/// Linear light of each sRGB byte.
fn linear_table() -> [f32; 256] {
    std::array::from_fn(|byte| srgb8_to_linear(byte as u8))
}

/// Sums of linear r, g, b, of alpha (0 to 255) and of pixels in every block of `side` pixels, row by row. Blocks at the
/// right and lower edge are as large as the image leaves them.
fn block_sums(rgba8: &[u8], width: u32, side: u32) -> Vec<[f64; 5]> {
    if rgba8.is_empty() {
        return Vec::new();
    }
    let table = linear_table();
    let (width, side) = (width as usize, side as usize);
    let columns = width.div_ceil(side);
    let rows = (rgba8.len() / 4 / width).div_ceil(side);
    let mut sums = vec![[0.0; 5]; columns * rows];
    for (y, row) in rgba8.chunks_exact(width * 4).enumerate() {
        for (x, pixel) in row.chunks_exact(4).enumerate() {
            let sum = &mut sums[y / side * columns + x / side];
            for c in 0..3 {
                sum[c] += f64::from(table[usize::from(pixel[c])]);
            }
            sum[3] += f64::from(pixel[3]);
            sum[4] += 1.0;
        }
    }
    sums
}

/// Root mean square difference of the mean colours of `block` × `block` pixels, over r, g, b in linear light: 0 for equal
/// images, at most 1. Blocks at the edge count like others. Blind to detail smaller than a block, which points may
/// place differently, and sharp about brightness and colour, which they may not. `block` ≥ 1, usually 16.
///
/// # Errors
/// If a buffer does not fit `width` and `height`, or `block` is 0.
pub fn block_rmse(
    a: &[u8],
    b: &[u8],
    width: u32,
    height: u32,
    block: u32,
) -> Result<f32, ImageError> {
    check_size(a, width, height)?;
    check_size(b, width, height)?;
    if block == 0 {
        return Err(ImageError::Zero { name: "block" });
    }
    let (a, b) = (block_sums(a, width, block), block_sums(b, width, block));
    if a.is_empty() {
        return Ok(0.0);
    }
    let count = 3.0 * a.len() as f64;
    let difference = |(a, b): (&[f64; 5], &[f64; 5])| -> f64 {
        (0..3).map(|c| (a[c] / a[4] - b[c] / b[4]).powi(2)).sum()
    };
    let total: f64 = std::iter::zip(&a, &b).map(difference).sum();
    Ok((total / count).sqrt() as f32)
}

/// How much more or less than `truth` an image covers, as a share of what `truth` covers: |Σa − Σtruth| / Σtruth over alpha
/// bytes. 0 if neither covers anything, infinite if only `a` does.
pub fn coverage_error(a: impl IntoIterator<Item = u8>, truth: impl IntoIterator<Item = u8>) -> f32 {
    let a: u64 = a.into_iter().map(u64::from).sum();
    let truth: u64 = truth.into_iter().map(u64::from).sum();
    match (a, truth) {
        (0, 0) => 0.0,
        (_, 0) => f32::INFINITY,
        _ => (a.abs_diff(truth) as f64 / truth as f64) as f32,
    }
}

/// The image at a `factor`-th of its size: each pixel is the mean of `factor` × `factor` pixels, colours in linear light,
/// alpha as it is (colours are not weighted by it). The result has `width.div_ceil(factor)` columns and
/// `height.div_ceil(factor)` rows; where that is not exact, the last ones are means of what there is.
///
/// # Errors
/// If the buffer does not fit `width` and `height`, or `factor` is 0.
pub fn box_downsample_linear(
    rgba8: &[u8],
    width: u32,
    height: u32,
    factor: u32,
) -> Result<Vec<u8>, ImageError> {
    check_size(rgba8, width, height)?;
    if factor == 0 {
        return Err(ImageError::Zero { name: "factor" });
    }
    let pixel = |[r, g, b, alpha, count]: [f64; 5]| {
        let [r, g, b] = [r, g, b].map(|sum| linear_to_srgb8((sum / count) as f32));
        [r, g, b, (alpha / count).round() as u8]
    };
    Ok(block_sums(rgba8, width, factor).into_iter().flat_map(pixel).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(color: [u8; 4], pixels: usize) -> Vec<u8> {
        color.repeat(pixels)
    }

    #[test]
    fn equal_images_have_no_error() {
        let image: Vec<u8> = (0..20 * 18 * 4).map(|i| (i * 7 % 256) as u8).collect();
        assert_eq!(block_rmse(&image, &image, 20, 18, 16), Ok(0.0));
    }

    #[test]
    fn black_against_white_is_one_whatever_the_alpha() {
        let (black, white) = (flat([0, 0, 0, 255], 35), flat([255, 255, 255, 0], 35));
        assert_eq!(block_rmse(&black, &white, 7, 5, 4), Ok(1.0));
    }

    #[test]
    fn detail_within_a_block_does_not_count_and_its_mean_does() {
        // Two columns swapped: equal block means.
        let stripes: Vec<u8> = [[0, 0, 0, 255], [200, 200, 200, 255]].concat().repeat(32);
        let swapped: Vec<u8> = [[200, 200, 200, 255], [0, 0, 0, 255]].concat().repeat(32);
        assert_eq!(block_rmse(&stripes, &swapped, 8, 8, 4), Ok(0.0));
        assert!(block_rmse(&stripes, &swapped, 8, 8, 1).expect("sizes fit") > 0.5);
        // The mean is taken in linear light: half of 255 is not 128 but 188.
        let half: Vec<u8> = [[0, 0, 0, 255], [255, 255, 255, 255]].concat().repeat(32);
        assert!(
            block_rmse(&half, &flat([188, 188, 188, 255], 64), 8, 8, 8).expect("sizes fit") < 0.003
        );
    }

    #[test]
    fn a_partial_block_at_the_edge_counts_like_a_whole_one() {
        let mut image = flat([0, 0, 0, 255], 5);
        image[16..20].copy_from_slice(&[255, 0, 0, 255]);
        // Two blocks of 4 and 1 pixels; one of six channels differs by 1.
        let error = block_rmse(&image, &flat([0, 0, 0, 255], 5), 5, 1, 4).expect("sizes fit");
        assert!((error - (1.0f32 / 6.0).sqrt()).abs() < 1e-6);
    }

    #[test]
    fn coverage_error_is_relative_to_the_truth() {
        assert_eq!(coverage_error([255, 255, 0], [255, 255, 255, 255]), 0.5);
        assert_eq!(coverage_error([255; 3], [255; 2]), 0.5);
        assert_eq!(coverage_error([], []), 0.0);
        assert_eq!(coverage_error([1], [0]), f32::INFINITY);
    }

    #[test]
    fn downsampling_averages_light_and_alpha() {
        let image = [[0, 0, 0, 255], [255, 255, 255, 0]].concat().repeat(2);
        assert_eq!(box_downsample_linear(&image, 2, 2, 2), Ok(vec![188, 188, 188, 128]));
        assert_eq!(box_downsample_linear(&image, 2, 2, 1), Ok(image.clone()));
    }

    #[test]
    fn a_size_that_does_not_divide_keeps_its_edge() {
        let image = [[10, 20, 30, 255], [10, 20, 30, 255], [90, 80, 70, 40]].concat();
        assert_eq!(
            box_downsample_linear(&image, 3, 1, 2),
            Ok(vec![10, 20, 30, 255, 90, 80, 70, 40])
        );
    }

    #[test]
    fn wrong_sizes_are_errors_that_name_them() {
        let error =
            block_rmse(&[0; 16], &[0; 12], 2, 2, 16).expect_err("12 bytes are no 2 × 2 image");
        assert_eq!(error, ImageError::Size { width: 2, height: 2, expected: 16, found: 12 });
        assert!(error.to_string().contains("16 bytes"));
        assert_eq!(block_rmse(&[], &[], 0, 5, 16), Ok(0.0));
        assert_eq!(box_downsample_linear(&[], 0, 0, 2), Ok(vec![]));
        assert_eq!(
            box_downsample_linear(&[0; 4], 1, 1, 0),
            Err(ImageError::Zero { name: "factor" })
        );
        assert!(box_downsample_linear(&[], u32::MAX, u32::MAX, 1).is_err());
    }
}
