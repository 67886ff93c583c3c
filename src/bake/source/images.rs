//! Textures: encoded PNG or JPEG bytes → [`SourceImage`], 8-bit sRGB with straight alpha. Linear in the pixels.

use super::{SourceError, SourceImage, SourceModel, SourceTexture, SourceWrap};
use bevy::math::Vec2;
use image::{ImageFormat, ImageReader, Limits};
use std::io::Cursor;

/// Longest side of a texture in pixels.
pub const MAX_SIDE: u32 = 16384;

/// Decodes a PNG (any bit depth, grey, palette, tRNS) or a JPEG. Its first bytes say which, as MIME types often lie.
///
/// `file`, `image` and `place` name the model, the image and where it comes from in errors.
///
/// # Errors
/// [`SourceError::Image`] for other formats, broken data, or more than [`MAX_SIDE`] pixels a side (before they are
/// allocated).
pub fn decode(
    file: &str,
    image: &str,
    place: &str,
    bytes: &[u8],
) -> Result<SourceImage, SourceError> {
    let fail = |problem: String| SourceError::Image {
        file: file.to_owned(),
        image: image.to_owned(),
        place: place.to_owned(),
        problem,
    };
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg)) => format,
        Ok(other) => return Err(fail(format!("it is a {other:?} file"))),
        Err(_) if bytes.is_empty() => return Err(fail("it is empty".to_owned())),
        Err(_) => return Err(fail("it is neither a PNG nor a JPEG file".to_owned())),
    };
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    // The largest image allowed, at 8 bits a channel.
    limits.max_alloc = Some(u64::from(MAX_SIDE) * u64::from(MAX_SIDE) * 4);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    reader.limits(limits);
    let pixels = reader.decode().map_err(|error| fail(error.to_string()))?.into_rgba8();
    let (width, height) = pixels.dimensions();
    Ok(SourceImage { width, height, rgba8: pixels.into_raw() })
}

impl SourceImage {
    /// True if some pixel is more transparent than opaque.
    pub fn has_holes(&self) -> bool {
        self.rgba8.chunks_exact(4).any(|texel| texel[3] < 128)
    }
}

impl SourceModel {
    /// The sRGB texel nearest to `uv` (before the texture's transform); opaque white if the image does not exist. O(1).
    pub fn nearest_texel(&self, texture: &SourceTexture, uv: Vec2) -> [u8; 4] {
        let texel = || {
            let image = self.images.get(texture.image)?;
            let uv = texture.uv_transform.transform_point2(uv);
            let x = wrap_texel(uv.x, image.width, texture.wrap[0]);
            let y = wrap_texel(uv.y, image.height, texture.wrap[1]);
            let at = (y as usize * image.width as usize + x as usize) * 4;
            image.rgba8.get(at..at + 4)?.try_into().ok()
        };
        texel().unwrap_or([255; 4])
    }
}

/// Texel column or row of a texture coordinate.
fn wrap_texel(coordinate: f32, size: u32, wrap: SourceWrap) -> u32 {
    let unit = match wrap {
        SourceWrap::Repeat => coordinate.rem_euclid(1.0),
        SourceWrap::MirroredRepeat => 1.0 - (coordinate.rem_euclid(2.0) - 1.0).abs(),
        SourceWrap::ClampToEdge => coordinate.clamp(0.0, 1.0),
    };
    ((unit * size as f32) as u32).min(size.saturating_sub(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::math::Mat3;
    use image::{DynamicImage, ImageBuffer};

    fn encode(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn deep_grey_and_jpeg_images_become_rgba8() {
        let grey = ImageBuffer::from_raw(2, 1, vec![0u16, 65535]).unwrap();
        let bytes = encode(&DynamicImage::ImageLuma16(grey), ImageFormat::Png);
        let image = decode("t.glb", "0", "buffer view 0", &bytes).unwrap();
        assert_eq!((image.width, image.height), (2, 1));
        assert_eq!(image.rgba8, [0, 0, 0, 255, 255, 255, 255, 255]);
        assert!(!image.has_holes());

        let rgb = ImageBuffer::from_pixel(8, 8, image::Rgb([200u8, 100, 50]));
        let bytes = encode(&DynamicImage::ImageRgb8(rgb), ImageFormat::Jpeg);
        let image = decode("t.glb", "0", "buffer view 0", &bytes).unwrap();
        assert!(image.rgba8[0].abs_diff(200) < 4 && image.rgba8[3] == 255);
    }

    #[test]
    fn broken_images_are_named_with_their_source() {
        let message = |bytes: &[u8]| {
            decode("oak.glb", "`bark`", "buffer view 7", bytes).unwrap_err().to_string()
        };
        let png = encode(&DynamicImage::new_rgba8(4, 4), ImageFormat::Png);
        for (bytes, problem) in [
            (&png[..png.len() / 2], "image"),
            (b"".as_slice(), "it is empty"),
            (b"hello, I am a text".as_slice(), "neither a PNG nor a JPEG"),
            (b"RIFF\x24\0\0\0WEBPVP8 ".as_slice(), "WebP"),
        ] {
            let text = message(bytes);
            for part in ["oak.glb", "`bark`", "buffer view 7", problem] {
                assert!(text.contains(part), "{text} lacks {part}");
            }
        }
    }

    #[test]
    fn a_huge_image_is_refused_before_it_is_allocated() {
        let mut png = encode(&DynamicImage::new_luma8(4, 4), ImageFormat::Png);
        // IHDR: width and height at bytes 16 and 20, its checksum at 29.
        png[16..20].copy_from_slice(&60_000u32.to_be_bytes());
        png[20..24].copy_from_slice(&60_000u32.to_be_bytes());
        let mut crc = u32::MAX;
        for byte in &png[12..29] {
            crc ^= u32::from(*byte);
            for _ in 0..8 {
                crc = crc >> 1 ^ if crc & 1 == 1 { 0xEDB8_8320 } else { 0 };
            }
        }
        png[29..33].copy_from_slice(&(!crc).to_be_bytes());
        let text = decode("a.glb", "0", "file `a.png`", &png).unwrap_err().to_string();
        assert!(text.contains("16384"), "{text}");
        assert!(text.to_lowercase().contains("limit") || text.contains("dimension"), "{text}");
    }

    #[test]
    fn texture_coordinates_wrap_as_the_sampler_says() {
        for (wrap, at, expected) in [
            (SourceWrap::Repeat, 1.25, 1),
            (SourceWrap::Repeat, -0.25, 3),
            (SourceWrap::MirroredRepeat, 1.1, 3),
            (SourceWrap::MirroredRepeat, -0.3, 1),
            (SourceWrap::ClampToEdge, -3.0, 0),
            (SourceWrap::ClampToEdge, 1.0, 3),
            (SourceWrap::Repeat, f32::NAN, 0),
        ] {
            assert_eq!(wrap_texel(at, 4, wrap), expected, "{wrap:?} {at}");
        }
        let image = SourceImage { width: 2, height: 1, rgba8: vec![1, 2, 3, 4, 5, 6, 7, 8] };
        let model = SourceModel { images: vec![image], ..SourceModel::default() };
        let mut texture = SourceTexture {
            image: 0,
            wrap: [SourceWrap::Repeat; 2],
            nearest: false,
            uv_transform: Mat3::from_translation(Vec2::new(0.5, 0.0)),
        };
        assert_eq!(model.nearest_texel(&texture, Vec2::splat(0.1)), [5, 6, 7, 8]);
        texture.image = 1;
        assert_eq!(model.nearest_texel(&texture, Vec2::ZERO), [255; 4]);
    }
}
