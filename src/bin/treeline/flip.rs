//! FLIP: the difference between two images as a person flipping between them sees it (Andersson et al. 2020).
//!
//! In: two images of one size and the part to look at; out: mean, 95th percentile and an error map. O(pixels · filter).

use image::{RgbaImage, imageops};

/// Part of an image, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CropRect {
    /// Left column.
    pub x: u32,
    /// Upper row.
    pub y: u32,
    /// Columns, ≥ 1.
    pub width: u32,
    /// Rows, ≥ 1.
    pub height: u32,
}

impl CropRect {
    /// True if it is not empty and lies within an image of that size.
    fn fits(&self, (width, height): (u32, u32)) -> bool {
        let ends_within = |start: u32, length: u32, size: u32| {
            length > 0 && start.checked_add(length).is_some_and(|end| end <= size)
        };
        ends_within(self.x, self.width, width) && ends_within(self.y, self.height, height)
    }
}

/// What FLIP found.
pub struct FlipReport {
    /// Mean over all pixels, 0 (equal) to 1.
    pub mean: f32,
    /// 95 % of the pixels are at most this, 0 to 1.
    pub p95: f32,
    /// Error of each pixel in the colours of magma: black is 0, pale yellow is 1. Size of the crop.
    pub error_map: RgbaImage,
}

/// Why two images cannot be compared.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum FlipError {
    /// FLIP compares pixel by pixel.
    #[error(
        "cannot compare a reference of {0} × {1} pixels with an image of {2} × {3}: render both at one size"
    )]
    Sizes(u32, u32, u32, u32),
    /// Empty or beyond the image.
    #[error(
        "the part to compare, {0:?}, must hold a pixel and lie within the {1} × {2} pixels of the images"
    )]
    Crop(CropRect, u32, u32),
}

/// Compares `test` with `reference` within `crop`, at 67 pixels per degree of view (a 0.7 m distant 4K monitor 0.7 m wide, FLIP's
/// default). Alpha is left out: both should be finished frames.
///
/// # Errors
/// If the sizes differ or `crop` does not fit them.
pub fn flip(
    reference: &RgbaImage,
    test: &RgbaImage,
    crop: CropRect,
) -> Result<FlipReport, FlipError> {
    let size = reference.dimensions();
    if size != test.dimensions() {
        return Err(FlipError::Sizes(size.0, size.1, test.width(), test.height()));
    }
    if !crop.fits(size) {
        return Err(FlipError::Crop(crop, size.0, size.1));
    }
    let rgb = |image: &RgbaImage| {
        let part = imageops::crop_imm(image, crop.x, crop.y, crop.width, crop.height);
        let bytes: Vec<u8> = part.to_image().pixels().flat_map(|p| [p[0], p[1], p[2]]).collect();
        nv_flip::FlipImageRgb8::with_data(crop.width, crop.height, &bytes)
    };
    let map = nv_flip::flip(rgb(reference), rgb(test), nv_flip::DEFAULT_PIXELS_PER_DEGREE);
    let mut errors = map.to_vec();
    let mean = errors.iter().copied().map(f64::from).sum::<f64>() / errors.len() as f64;
    // Nearest rank: the smallest error that at least 95 % of the pixels do not exceed.
    let rank = (errors.len() * 95).div_ceil(100) - 1;
    let p95 = *errors.select_nth_unstable_by(rank, f32::total_cmp).1;
    let colors = map.apply_color_lut(&nv_flip::magma_lut()).to_vec();
    let rgba = colors.chunks_exact(3).flat_map(|c| [c[0], c[1], c[2], 255]).collect();
    let error_map = RgbaImage::from_raw(crop.width, crop.height, rgba)
        .expect("the map has the size of the crop");
    Ok(FlipReport { mean: mean as f32, p95, error_map })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgba;

    fn gradient() -> RgbaImage {
        RgbaImage::from_fn(64, 48, |x, y| Rgba([(x * 4) as u8, (y * 5) as u8, 90, 255]))
    }

    fn whole(image: &RgbaImage) -> CropRect {
        CropRect { x: 0, y: 0, width: image.width(), height: image.height() }
    }

    #[test]
    fn equal_images_differ_nowhere() {
        let image = gradient();
        let report = flip(&image, &image, whole(&image)).expect("sizes fit");
        assert_eq!((report.mean, report.p95), (0.0, 0.0));
        assert_eq!(report.error_map.dimensions(), (64, 48));
        assert!(
            report.error_map.pixels().all(|p| p[0] < 8 && p[1] < 8 && p[2] < 16 && p[3] == 255)
        );
    }

    #[test]
    fn a_change_counts_only_within_the_crop() {
        let reference = gradient();
        let mut test = reference.clone();
        for (x, y, pixel) in test.enumerate_pixels_mut() {
            if x < 16 && y < 16 {
                *pixel = Rgba([255, 0, 255, 255]);
            }
        }
        let at = |x, y, width, height| {
            flip(&reference, &test, CropRect { x, y, width, height }).expect("the crop fits")
        };
        let (whole, changed, rest) = (at(0, 0, 64, 48), at(0, 0, 16, 16), at(32, 24, 32, 24));
        assert_eq!(rest.mean, 0.0);
        assert!(changed.mean > 0.3 && changed.mean > whole.mean && whole.mean > 0.0);
        assert!(whole.p95 > 0.0 && changed.p95 >= changed.mean);
        assert_eq!(changed.error_map.dimensions(), (16, 16));
    }

    #[test]
    fn what_cannot_be_compared_is_an_error() {
        let (image, other) = (gradient(), RgbaImage::new(64, 47));
        let sizes = flip(&image, &other, whole(&image)).err().expect("sizes differ");
        assert_eq!(sizes, FlipError::Sizes(64, 48, 64, 47));
        for (x, width) in [(0, 0), (60, 5), (u32::MAX, 2)] {
            let crop = CropRect { x, y: 0, width, height: 1 };
            assert_eq!(flip(&image, &image, crop).err(), Some(FlipError::Crop(crop, 64, 48)));
        }
    }
}
