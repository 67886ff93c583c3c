//! A look at the trees without a GPU: orthographic, z-buffered, one sun with a shadow map. Tests only.

use super::{PlainTree, grow, presets};
use crate::math::quantize::linear_to_srgb8;
use bevy::math::{Mat3, Vec2, Vec3};

const SIZE: usize = 1400;
const SUPERSAMPLING: usize = 2;

struct Buffer {
    depth: Vec<f32>,
    /// Part and triangle.
    seen: Vec<Option<(u32, u32)>>,
}

/// Rasterises with `view_from_world` (rows: right, up, towards the eye); `scale` pixels a metre, `center` in the middle.
fn raster(tree: &PlainTree, view_from_world: Mat3, scale: f32, center: Vec3) -> Buffer {
    let mut buffer =
        Buffer { depth: vec![f32::NEG_INFINITY; SIZE * SIZE], seen: vec![None; SIZE * SIZE] };
    for (p, part) in tree.parts.iter().enumerate() {
        for (t, triangle) in part.triangles.iter().enumerate() {
            let [a, b, c] = triangle
                .map(|i| to_pixel(view_from_world, scale, center, part.positions[i as usize]));
            let low = a.min(b).min(c).max(Vec3::ZERO);
            let high = a.max(b).max(c).min(Vec3::splat(SIZE as f32 - 1.0).with_z(f32::INFINITY));
            let area = (b - a).truncate().perp_dot((c - a).truncate());
            if area == 0.0 {
                continue;
            }
            for y in low.y.floor() as i32..=high.y.ceil().min(SIZE as f32 - 1.0) as i32 {
                for x in low.x.floor() as i32..=high.x.ceil().min(SIZE as f32 - 1.0) as i32 {
                    let pixel = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                    let w = [(b, c), (c, a), (a, b)]
                        .map(|(u, v)| (u.truncate() - pixel).perp_dot(v.truncate() - pixel) / area);
                    if w.iter().any(|w| *w < 0.0) {
                        continue;
                    }
                    let z = w[0] * a.z + w[1] * b.z + w[2] * c.z;
                    let i = y as usize * SIZE + x as usize;
                    if z > buffer.depth[i] {
                        buffer.depth[i] = z;
                        buffer.seen[i] = Some((p as u32, t as u32));
                    }
                }
            }
        }
    }
    buffer
}

fn to_pixel(view_from_world: Mat3, scale: f32, center: Vec3, position: Vec3) -> Vec3 {
    let v = view_from_world * (position - center);
    Vec3::new(v.x * scale + SIZE as f32 * 0.5, SIZE as f32 * 0.5 - v.y * scale, v.z)
}

fn looking_from(direction: Vec3) -> Mat3 {
    let back = direction.normalize();
    let right = Vec3::Y.cross(back).normalize_or(Vec3::X);
    Mat3::from_cols(right, back.cross(right), back).transpose()
}

fn picture(tree: &PlainTree, eye: Vec3) -> Vec<Vec3> {
    let sun = Vec3::new(0.55, 0.75, 0.35).normalize();
    let bounds = tree.bounds();
    let scale = SIZE as f32 / 16.5;
    let (view, light) = (looking_from(eye), looking_from(sun));
    let (seen, shadow) =
        (raster(tree, view, scale, bounds.center()), raster(tree, light, scale, bounds.center()));
    let mut pixels = vec![Vec3::new(0.62, 0.74, 0.86); SIZE * SIZE];
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let Some((p, t)) = seen.seen[i] else { continue };
        let part = &tree.parts[p as usize];
        let triangle = part.triangles[t as usize];
        let (x, y) = ((i % SIZE) as f32 + 0.5, (i / SIZE) as f32 + 0.5);
        let corner = triangle.map(|v| part.positions[v as usize]);
        let flat = corner.map(|c| to_pixel(view, scale, bounds.center(), c).truncate());
        let area = (flat[1] - flat[0]).perp_dot(flat[2] - flat[0]);
        let at = Vec2::new(x, y);
        let w = [(1, 2), (2, 0), (0, 1)].map(|(u, v)| (flat[u] - at).perp_dot(flat[v] - at) / area);
        let mix = |list: [Vec3; 3]| list[0] * w[0] + list[1] * w[1] + list[2] * w[2];
        let normal = mix(triangle.map(|v| part.normals[v as usize])).normalize_or(Vec3::Y);
        let color = mix(triangle.map(|v| Vec3::from_slice(&part.colors[v as usize][..3])));
        let in_light = to_pixel(light, scale, bounds.center(), mix(corner));
        let (sx, sy) = (in_light.x as usize, in_light.y as usize);
        let lit = sx >= SIZE || sy >= SIZE || shadow.depth[sy * SIZE + sx] <= in_light.z + 0.12;
        let direct = normal.dot(sun).max(0.0) * if lit { 3.0 } else { 0.25 };
        let sky = 0.35 + 0.35 * (0.5 + 0.5 * normal.y);
        *pixel = color * (Vec3::new(1.0, 0.96, 0.88) * direct + Vec3::new(0.85, 0.95, 1.1) * sky);
    }
    pixels
}

#[test]
#[ignore = "writes pictures to look at; run with --ignored"]
fn previews_are_written_to_the_temporary_folder() {
    let views = [Vec3::new(0.2, 0.12, 1.0), Vec3::new(0.3, 2.2, 0.6)];
    let out = SIZE / SUPERSAMPLING;
    for (name, shape) in presets() {
        let trees = [1u64, 2].map(|seed| grow(&shape, seed));
        let mut image = image::RgbImage::new((2 * out) as u32, (2 * out) as u32);
        for (tile, (tree, eye)) in
            trees.iter().flat_map(|tree| views.iter().map(move |view| (tree, view))).enumerate()
        {
            let pixels = picture(tree, *eye);
            for y in 0..out {
                for x in 0..out {
                    let cells = (0..SUPERSAMPLING * SUPERSAMPLING).map(|k| {
                        let (dx, dy) = (k % SUPERSAMPLING, k / SUPERSAMPLING);
                        pixels[(y * SUPERSAMPLING + dy) * SIZE + x * SUPERSAMPLING + dx]
                    });
                    let mean = cells.sum::<Vec3>() / (SUPERSAMPLING * SUPERSAMPLING) as f32;
                    let mapped = mean / (1.0 + mean * 0.25);
                    let rgb = mapped.to_array().map(linear_to_srgb8);
                    image.put_pixel(
                        (tile % 2 * out + x) as u32,
                        (tile / 2 * out + y) as u32,
                        image::Rgb(rgb),
                    );
                }
            }
        }
        let path = std::env::temp_dir().join(format!("treeline_{name}.png"));
        image.save(&path).expect("the temporary folder is writable");
        for tree in &trees {
            let parts = tree.parts.iter().map(|part| part.triangles.len()).collect::<Vec<_>>();
            println!(
                "{}: {parts:?} triangles, {} bytes",
                path.display(),
                super::glb::write_glb(tree, name).len()
            );
        }
    }
}
