//! Base colour of a place on a model: triangle and barycentric coordinates in, linear colour out.
//!
//! CPU twin of the lookup in the GPU peeler's shader: factor × texture (mip level 0) × vertex colour. O(1) a lookup.

use super::source::{SourceImage, SourceMesh, SourceModel, SourceTexture, SourceWrap};
use crate::math::quantize::srgb8_to_linear;
use bevy::math::{Vec2, Vec4};
use std::ops::{Add, Mul};
use std::sync::LazyLock;

/// Linear light of each sRGB byte.
static LINEAR_OF_SRGB: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|byte| srgb8_to_linear(byte as u8)));

/// Linear base colour and alpha at a place of a triangle; `barycentric` holds the weights of its corners.
///
/// As the glTF specification has it (§3.9.2): material factor × texture × vertex colour; a texture without texture
/// coordinates, or an image with fewer bytes than its size needs, counts as white. Alpha is as found, also for opaque materials.
pub fn base_color(
    model: &SourceModel,
    mesh: &SourceMesh,
    triangle: [u32; 3],
    barycentric: [f32; 3],
) -> Vec4 {
    let vertex_color = interpolate(&mesh.colors, triangle, barycentric).unwrap_or(Vec4::ONE);
    let Some(material) = model.materials.get(mesh.material) else { return vertex_color };
    let color = material.base_color * vertex_color;
    let Some(texture) = &material.base_color_texture else { return color };
    let Some(image) = model.images.get(texture.image) else { return color };
    let Some(uv) = interpolate(&mesh.uvs, triangle, barycentric) else { return color };
    color * sample(texture, image, uv)
}

/// The value of a vertex attribute within a triangle; `None` if the mesh does not have it.
pub(super) fn interpolate<T>(attribute: &[T], triangle: [u32; 3], weights: [f32; 3]) -> Option<T>
where
    T: Copy + Mul<f32, Output = T> + Add<Output = T>,
{
    let [a, b, c] = triangle.map(|i| attribute.get(i as usize).copied());
    Some(a? * weights[0] + b? * weights[1] + c? * weights[2])
}

/// The filtered texel at texture coordinate `uv` (before the texture's transform), linear light.
fn sample(texture: &SourceTexture, image: &SourceImage, uv: Vec2) -> Vec4 {
    let uv = (texture.uv_transform * uv.extend(1.0)).truncate();
    let size = Vec2::new(image.width as f32, image.height as f32);
    let place = if uv.is_finite() { uv * size } else { Vec2::ZERO };
    let texel = |x: f32, y: f32| {
        let x = wrap(x as i64, image.width, texture.wrap[0]);
        let y = wrap(y as i64, image.height, texture.wrap[1]);
        texel(image, x, y)
    };
    if texture.nearest {
        let corner = place.floor();
        return texel(corner.x, corner.y);
    }
    // Texel centres lie at halves.
    let corner = (place - 0.5).floor();
    let share = place - 0.5 - corner;
    let row = |y: f32| texel(corner.x, y).lerp(texel(corner.x + 1.0, y), share.x);
    row(corner.y).lerp(row(corner.y + 1.0), share.y)
}

/// The texel column or row that stands for `index` in an image of `size` of them.
fn wrap(index: i64, size: u32, mode: SourceWrap) -> usize {
    let size = i64::from(size.max(1));
    let wrapped = match mode {
        SourceWrap::Repeat => index.rem_euclid(size),
        SourceWrap::MirroredRepeat => {
            let period = index.rem_euclid(2 * size);
            period.min(2 * size - 1 - period)
        }
        SourceWrap::ClampToEdge => index.clamp(0, size - 1),
    };
    wrapped as usize
}

/// One texel: colour in linear light, alpha as it is.
fn texel(image: &SourceImage, x: usize, y: usize) -> Vec4 {
    let start = (y * image.width as usize + x) * 4;
    match image.rgba8.get(start..start + 4) {
        Some(&[r, g, b, a]) => {
            let [r, g, b] = [r, g, b].map(|byte| LINEAR_OF_SRGB[usize::from(byte)]);
            Vec4::new(r, g, b, f32::from(a) / 255.0)
        }
        _ => Vec4::ONE,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::source::SourceMaterial;
    use bevy::math::{Mat3, Vec3};

    /// A 2×1 image, black and opaque left, white and half transparent right, on a triangle with uv = (b, c).
    fn model(wrap: SourceWrap, nearest: bool, uv_transform: Mat3) -> SourceModel {
        let texture = SourceTexture { image: 0, wrap: [wrap; 2], nearest, uv_transform };
        SourceModel {
            meshes: vec![SourceMesh {
                positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
                normals: vec![Vec3::Z; 3],
                uvs: vec![Vec2::ZERO, Vec2::X, Vec2::Y],
                triangles: vec![[0, 1, 2]],
                ..Default::default()
            }],
            materials: vec![SourceMaterial {
                base_color_texture: Some(texture),
                ..Default::default()
            }],
            images: vec![SourceImage {
                width: 2,
                height: 1,
                rgba8: vec![0, 0, 0, 255, 255, 255, 255, 128],
            }],
            ..Default::default()
        }
    }

    fn lookup(model: &SourceModel, u: f32) -> Vec4 {
        base_color(model, &model.meshes[0], [0, 1, 2], [1.0 - u - 0.5, u, 0.5])
    }

    #[test]
    fn texels_are_mixed_in_linear_light_and_alpha_is_not_srgb() {
        let model = model(SourceWrap::ClampToEdge, false, Mat3::IDENTITY);
        assert!(lookup(&model, 0.25).distance(Vec4::new(0.0, 0.0, 0.0, 1.0)) < 1e-6);
        let half = 128.0 / 255.0;
        assert!(lookup(&model, 0.75).distance(Vec4::new(1.0, 1.0, 1.0, half)) < 1e-6);
        // Half way: linear 0.5, which is sRGB 188 and not 128.
        assert!(lookup(&model, 0.5).distance(Vec4::new(0.5, 0.5, 0.5, (1.0 + half) / 2.0)) < 1e-6);
    }

    #[test]
    fn coordinates_outside_wrap_as_the_texture_says() {
        let red = |wrap, u| lookup(&model(wrap, true, Mat3::IDENTITY), u).x;
        let rows = [
            (SourceWrap::Repeat, [1.0, 0.0, 1.0, 0.0]),
            (SourceWrap::MirroredRepeat, [0.0, 0.0, 1.0, 1.0]),
            (SourceWrap::ClampToEdge, [0.0, 0.0, 1.0, 1.0]),
        ];
        for (wrap, expected) in rows {
            assert_eq!([-0.25, 0.25, 0.75, 1.25].map(|u| red(wrap, u)), expected, "{wrap:?}");
        }
        assert_eq!(red(SourceWrap::MirroredRepeat, 1.75), 0.0);
        assert_eq!(red(SourceWrap::ClampToEdge, 1.75), 1.0);
        assert_eq!(red(SourceWrap::Repeat, -1e30), 0.0);
        assert!(red(SourceWrap::Repeat, f32::NAN).is_finite());
    }

    #[test]
    fn bilinear_texels_at_the_border_come_from_the_other_side_only_if_repeated() {
        let red = |wrap| lookup(&model(wrap, false, Mat3::IDENTITY), 0.0).x;
        assert!((red(SourceWrap::Repeat) - 0.5).abs() < 1e-6);
        assert_eq!(red(SourceWrap::ClampToEdge), 0.0);
        assert_eq!(red(SourceWrap::MirroredRepeat), 0.0);
    }

    #[test]
    fn factor_texture_transform_and_vertex_colour_multiply() {
        let transform = Mat3::from_translation(Vec2::new(0.5, 0.0));
        let mut model = model(SourceWrap::Repeat, true, transform);
        model.materials[0].base_color = Vec4::new(0.5, 1.0, 1.0, 1.0);
        model.meshes[0].colors = vec![Vec4::new(1.0, 0.25, 0.0, 1.0); 3];
        assert!(lookup(&model, 0.25).distance(Vec4::new(0.5, 0.25, 0.0, 128.0 / 255.0)) < 1e-6);
    }

    #[test]
    fn what_is_missing_or_cut_short_counts_as_white() {
        let mut model = model(SourceWrap::Repeat, false, Mat3::IDENTITY);
        model.images[0].rgba8.clear();
        assert_eq!(lookup(&model, 0.25), Vec4::ONE);
        model.meshes[0].uvs.clear();
        model.images.clear();
        model.materials.clear();
        assert_eq!(lookup(&model, 0.25), Vec4::ONE);
    }
}
