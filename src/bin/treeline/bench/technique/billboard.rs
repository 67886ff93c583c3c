//! Two crossed pictures of a tree, for far away: rendered from the front and from the side by the app that uses them.
//!
//! Light is baked in, so all of them face the same way. Mip levels keep how much the tree covers, or trees would vanish with
//! distance.

use crate::{
    bench::{measure, tree::Part},
    headless::{capture, render_target, target},
    options::ToolResult,
};
use bevy::{
    asset::RenderAssetUsages,
    camera::{Projection, ScalingMode},
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    image::ImageSampler,
    mesh::{Indices, PrimitiveTopology},
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use bevy_treeline::math::{
    bounding::Aabb,
    quantize::{linear_to_srgb8, srgb8_to_linear},
};
use image::RgbaImage;

/// Side of each rendered picture, pixels.
const RENDERED: u32 = 1024;
/// Side of each in the texture, texels.
const SIDE: usize = 128;
/// Texels below this alpha are holes.
const CUT_OFF: f32 = 0.5;

/// Mesh and material of the billboards of a model, in its own space.
pub struct Billboard {
    pub mesh: Mesh,
    pub material: StandardMaterial,
    pub texture: Image,
}

impl Billboard {
    /// Renders it in `app`, whose world must hold light and nothing to see.
    pub fn bake(app: &mut App, parts: &[Part], bounds: &Aabb) -> ToolResult<Self> {
        let radius = [bounds.min.x, bounds.max.x, bounds.min.z, bounds.max.z]
            .into_iter()
            .fold(0.0f32, |radius, edge| radius.max(edge.abs()));
        let shown: Vec<Entity> = parts
            .iter()
            .map(|part| {
                let world = app.world_mut();
                let mesh = world.resource_mut::<Assets<Mesh>>().add(part.mesh.clone());
                world.spawn((Mesh3d(mesh), MeshMaterial3d(part.material.clone()))).id()
            })
            .collect();
        let front = view(app, Vec3::Z, radius, bounds)?;
        let side = view(app, Vec3::X, radius, bounds)?;
        for entity in shown {
            app.world_mut().despawn(entity);
        }
        let material = StandardMaterial {
            unlit: true,
            double_sided: true,
            cull_mode: None,
            alpha_mode: AlphaMode::Mask(CUT_OFF),
            ..default()
        };
        Ok(Self { mesh: crossed(radius, bounds), material, texture: texture(&front, &side) })
    }
}

/// The model as seen from far away in a direction; alpha is what it covers.
fn view(app: &mut App, from: Vec3, radius: f32, bounds: &Aabb) -> ToolResult<RgbaImage> {
    let image = target(app, RENDERED, RENDERED);
    let height = bounds.extent().y;
    let middle = Vec3::Y * bounds.center().y;
    let far = 4.0 * (radius + height);
    let camera = app.world_mut().spawn((
        Camera3d::default(),
        Camera { clear_color: ClearColorConfig::Custom(Color::NONE), ..default() },
        Projection::from(OrthographicProjection {
            scaling_mode: ScalingMode::Fixed { width: 2.0 * radius, height },
            near: 0.0,
            far,
            ..OrthographicProjection::default_3d()
        }),
        render_target(&image),
        Tonemapping::None,
        DebandDither::Disabled,
        Msaa::Off,
        Transform::from_translation(middle + from * far * 0.5).looking_at(middle, Vec3::Y),
    ));
    let camera = camera.id();
    measure::complete_frame(app);
    let picture = capture(app, &image)?;
    app.world_mut().despawn(camera);
    app.world_mut().resource_mut::<Assets<Image>>().remove(&image);
    Ok(picture)
}

/// Two quads that cross in the model's vertical axis: the left half of the texture, and the right half.
fn crossed(radius: f32, bounds: &Aabb) -> Mesh {
    let corners = [(-1.0f32, 0.0f32), (1.0, 0.0), (1.0, 1.0), (-1.0, 1.0)];
    let (mut positions, mut uvs) = (vec![], vec![]);
    for quad in 0..2 {
        for (x, y) in corners {
            let height = bounds.min.y + y * bounds.extent().y;
            positions.push(match quad {
                0 => [x * radius, height, 0.0],
                _ => [0.0, height, -x * radius],
            });
            uvs.push([(quad as f32 + x * 0.5 + 0.5) * 0.5, 1.0 - y]);
        }
    }
    let indices = (0..2u32).flat_map(|quad| [0, 1, 2, 0, 2, 3].map(|i| quad * 4 + i)).collect();
    Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![[0.0, 1.0, 0.0]; positions.len()])
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
        .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, uvs)
        .with_inserted_indices(Indices::U32(indices))
}

/// Linear colour, alpha.
type Texel = [f32; 4];

/// A level of a texture.
struct Level {
    width: usize,
    texels: Vec<Texel>,
}

impl Level {
    fn height(&self) -> usize {
        self.texels.len() / self.width
    }

    /// Half as large, or less; colours weighted by alpha, which holes have none of.
    fn smaller(&self, factor: usize) -> Self {
        let (width, height) = (self.width / factor, self.height() / factor);
        let mean = |i: usize| {
            let (x0, y0) = (i % width * factor, i / width * factor);
            let cells =
                (0..factor * factor).map(|k| (y0 + k / factor) * self.width + x0 + k % factor);
            let mut sum = [0.0f32; 4];
            let mut plain = [0.0f32; 3];
            for cell in cells {
                let [r, g, b, a] = self.texels[cell];
                for (k, v) in [r, g, b].into_iter().enumerate() {
                    sum[k] += v * a;
                    plain[k] += v;
                }
                sum[3] += a;
            }
            let count = (factor * factor) as f32;
            let color = |k: usize| if sum[3] > 0.0 { sum[k] / sum[3] } else { plain[k] / count };
            [color(0), color(1), color(2), sum[3] / count]
        };
        Self { width, texels: (0..width * height).map(mean).collect() }
    }

    /// Alpha times such a factor that the share of texels that are no holes is the mean of alpha.
    fn covering(&self) -> Vec<f32> {
        let mut sorted: Vec<f32> = self.texels.iter().map(|texel| texel[3]).collect();
        sorted.sort_by(|a, b| b.total_cmp(a));
        let covered = sorted.iter().sum::<f32>().round() as usize;
        let covered = covered.clamp(1, sorted.len());
        // Between the faintest texel that shows and the first that must not.
        let edge = 0.5 * (sorted[covered - 1] + sorted.get(covered).copied().unwrap_or(0.0));
        let factor = CUT_OFF / edge.max(1e-3);
        self.texels.iter().map(|texel| (texel[3] * factor).min(1.0)).collect()
    }

    /// Rgba8 in sRGB.
    fn bytes(&self) -> Vec<u8> {
        let alpha = self.covering();
        let texel = |([r, g, b, _], a): (&Texel, f32)| {
            let [r, g, b] = [*r, *g, *b].map(linear_to_srgb8);
            [r, g, b, (a * 255.0).round() as u8]
        };
        self.texels.iter().zip(alpha).flat_map(texel).collect()
    }

    /// Gives holes the mean colour, so that filters do not darken edges.
    fn fill_holes(&mut self) {
        let mut sum = [0.0f32; 4];
        for [r, g, b, a] in &self.texels {
            for (k, v) in [r, g, b].into_iter().enumerate() {
                sum[k] += v * a;
            }
            sum[3] += a;
        }
        let mean = |k: usize| sum[k] / sum[3].max(1e-6);
        for texel in self.texels.iter_mut().filter(|texel| texel[3] == 0.0) {
            *texel = [mean(0), mean(1), mean(2), 0.0];
        }
    }
}

/// Both pictures side by side with all mip levels.
fn texture(front: &RgbaImage, side: &RgbaImage) -> Image {
    let linear = |picture: &RgbaImage| {
        let texels = picture.pixels().map(|pixel| {
            let [r, g, b, a] = pixel.0;
            [srgb8_to_linear(r), srgb8_to_linear(g), srgb8_to_linear(b), f32::from(a) / 255.0]
        });
        let level = Level { width: picture.width() as usize, texels: texels.collect() };
        level.smaller(RENDERED as usize / SIDE)
    };
    let (front, side) = (linear(front), linear(side));
    let rows = front.texels.chunks_exact(SIDE).zip(side.texels.chunks_exact(SIDE));
    let texels = rows.flat_map(|(left, right)| [left, right].concat()).collect();
    let mut level = Level { width: 2 * SIDE, texels };
    level.fill_holes();
    let mut data = level.bytes();
    let mut levels = 1;
    while level.height() > 2 {
        level = level.smaller(2);
        data.extend(level.bytes());
        levels += 1;
    }
    let size = Extent3d { width: 2 * SIDE as u32, height: SIDE as u32, depth_or_array_layers: 1 };
    let mut image = Image::new_fill(
        size,
        TextureDimension::D2,
        &[0; 4],
        TextureFormat::Rgba8UnormSrgb,
        RenderAssetUsages::default(),
    );
    image.texture_descriptor.mip_level_count = levels;
    image.data = Some(data);
    image.sampler = ImageSampler::linear();
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sparse crown: one texel of four.
    fn sparse(side: usize) -> Level {
        let texel = |i: usize| match (i % side % 2, i / side % 2) {
            (0, 0) => [0.2, 0.4, 0.1, 1.0],
            _ => [0.0; 4],
        };
        Level { width: side, texels: (0..side * side).map(texel).collect() }
    }

    #[test]
    fn smaller_levels_cover_as_much_as_the_largest() {
        let mut level = sparse(64);
        level.texels[..64 * 32].fill([0.0; 4]);
        level.fill_holes();
        for _ in 0..4 {
            let bytes = level.bytes();
            let shown = bytes.chunks_exact(4).filter(|texel| texel[3] >= 128).count();
            let share = shown as f32 / (bytes.len() / 4) as f32;
            // Texels that cover alike are shown or not together.
            assert!((0.125..=0.5).contains(&share), "{share} of {}", bytes.len() / 4);
            level = level.smaller(2);
        }
    }

    #[test]
    fn holes_do_not_darken_their_neighbours() {
        let small = sparse(8).smaller(2);
        for [r, g, b, a] in &small.texels {
            assert!((r - 0.2).abs() < 1e-6 && (g - 0.4).abs() < 1e-6 && (b - 0.1).abs() < 1e-6);
            assert_eq!(*a, 0.25);
        }
    }

    #[test]
    fn the_texture_has_both_pictures_and_every_mip_level() {
        let plain = |color: [u8; 4]| RgbaImage::from_pixel(RENDERED, RENDERED, image::Rgba(color));
        let image = texture(&plain([255, 0, 0, 255]), &plain([0, 0, 255, 255]));
        assert_eq!(image.texture_descriptor.mip_level_count, 7);
        let data = image.data.expect("made here");
        let texels: usize = (0..7).map(|level| (256 >> level) * (128 >> level)).sum();
        assert_eq!(data.len(), texels * 4);
        assert_eq!(
            (&data[..4], &data[255 * 4..256 * 4]),
            (&[255, 0, 0, 255][..], &[0, 0, 255, 255][..])
        );
    }
}
