//! Leaf cards cut to the outline of their leaf: a mesh and the alpha of its texture in, a mesh of fewer masked pixels out.
//!
//! A card is a parallelogram of two triangles that shares no vertex with others. A leaf or a twig covers a quarter of it or less, and each pixel of the rest
//! costs a lookup of the texture that finds a hole. The picture stays the same: what is drawn of the outline is what was
//! drawn of the card. Cost: once a texture and kind of card, and a copy of the vertices.

mod outline;

use super::source::{SourceImage, SourceMesh, SourceTexture};
use bevy::{
    math::{Vec2, Vec3, Vec4},
    platform::collections::HashMap,
};
use outline::{CELLS, Coverage, outline};

/// Texels that are looked at for each cell are those of a smaller picture of at most this side.
const MAX_ALPHA_SIDE: usize = 256;
/// By how much of its size a card may differ from a parallelogram, and its texture coordinates lie outside of the texture.
const TOLERANCE: f32 = 1e-3;

/// The largest alpha of each piece of a texture.
struct MaxAlpha {
    size: [usize; 2],
    alphas: Vec<u8>,
}

impl MaxAlpha {
    fn of(image: &SourceImage) -> Option<Self> {
        let whole = [image.width as usize, image.height as usize];
        if image.rgba8.len() != whole[0] * whole[1] * 4 || whole.contains(&0) {
            return None;
        }
        let size = whole.map(|side| side.min(MAX_ALPHA_SIDE));
        let mut alphas = vec![0; size[0] * size[1]];
        for (i, texel) in image.rgba8.chunks_exact(4).enumerate() {
            let (x, y) = (i % whole[0] * size[0] / whole[0], i / whole[0] * size[1] / whole[1]);
            let alpha = &mut alphas[y * size[0] + x];
            *alpha = texel[3].max(*alpha);
        }
        Some(Self { size, alphas })
    }

    /// The largest alpha that filtering can give between two texture coordinates.
    fn between(&self, low: Vec2, high: Vec2) -> u8 {
        let range = |axis: usize| {
            let side = self.size[axis];
            let texel = |uv: f32| (uv * side as f32) as usize;
            // The texels beside them count too: between their centres both are mixed.
            let first = texel(low[axis].max(0.0)).saturating_sub(1).min(side - 1);
            first..=(texel(high[axis].max(0.0)) + 1).min(side - 1)
        };
        let row = |y: usize| &self.alphas[y * self.size[0]..][range(0)];
        range(1).flat_map(row).copied().max().unwrap_or(0)
    }
}

/// Corners of a card by their indices: the origin, the ends of its two sides, and the corner across.
#[derive(Clone, Copy)]
struct Card([u32; 4]);

impl Card {
    /// Two triangles on either side of a diagonal, turned the same way.
    fn of(first: [u32; 3], second: [u32; 3], uses: &[u32]) -> Option<Self> {
        let alone = |triangle: [u32; 3]| {
            let k = triangle.iter().position(|i| uses[*i as usize] == 1)?;
            let turned = [0, 1, 2].map(|j| triangle[(k + j) % 3]);
            turned[1..].iter().all(|i| uses[*i as usize] == 2).then_some(turned)
        };
        let ([origin, s, t], [across, t2, s2]) = (alone(first)?, alone(second)?);
        ((s, t) == (s2, t2)).then_some(Self([origin, s, t, across]))
    }

    fn corners<T: Copy>(self, attribute: &[T]) -> [T; 4] {
        self.0.map(|i| attribute[i as usize])
    }

    fn is_flat(self, mesh: &SourceMesh) -> bool {
        let [p, x, y, q] = self.corners(&mesh.positions);
        let [p_uv, x_uv, y_uv, q_uv] = self.corners(&mesh.uvs);
        let is_small = |gap: f32, size: f32| gap <= TOLERANCE * size;
        is_small((p + q - x - y).length(), (x - y).length())
            && is_small((p_uv + q_uv - x_uv - y_uv).length(), (x_uv - y_uv).length())
    }
}

/// The value at a place of a card, of those at its corners.
fn at<T>(corners: [T; 4], place: Vec2) -> T
where
    T: std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
{
    let (s, t) = (place.x, place.y);
    let [p, x, y, q] = corners;
    p * ((1.0 - s) * (1.0 - t)) + x * (s * (1.0 - t)) + y * ((1.0 - s) * t) + q * (s * t)
}

/// Polygons for each kind of card that a mesh has: those with the same texture coordinates share them.
struct Outlines<'a> {
    texture: &'a SourceTexture,
    alpha: MaxAlpha,
    cut_off: u8,
    known: HashMap<[[u32; 2]; 4], Vec<Vec<Vec2>>>,
}

impl Outlines<'_> {
    /// `None` for cards that show the texture's repetition.
    fn of(&mut self, uvs: [Vec2; 4]) -> Option<&[Vec<Vec2>]> {
        let uvs = uvs.map(|uv| (self.texture.uv_transform * uv.extend(1.0)).truncate());
        let is_inside = |uv: &Vec2| {
            uv.cmpge(Vec2::splat(-TOLERANCE)).all() && uv.cmple(Vec2::splat(1.0 + TOLERANCE)).all()
        };
        if !uvs.iter().all(is_inside) {
            return None;
        }
        let key = uvs.map(|uv| uv.to_array().map(f32::to_bits));
        let (alpha, cut_off) = (&self.alpha, self.cut_off);
        let polygons = self.known.entry(key).or_insert_with(|| {
            let coverage = Coverage::new(|column, row| {
                let corner = |x: usize, y: usize| {
                    at(uvs, Vec2::new((column + x) as f32, (row + y) as f32) / CELLS as f32)
                };
                let corners = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
                let low = corners.into_iter().reduce(Vec2::min).unwrap_or_default();
                let high = corners.into_iter().reduce(Vec2::max).unwrap_or_default();
                alpha.between(low, high) >= cut_off
            });
            outline(&coverage.grown())
        });
        Some(polygons)
    }
}

/// The mesh with its cards cut, all else as it is; `None` if it has none. `cut_off` is the least alpha of the texture that is drawn.
pub fn cut_cards(
    mesh: &SourceMesh,
    texture: &SourceTexture,
    image: &SourceImage,
    cut_off: f32,
) -> Option<SourceMesh> {
    let count = mesh.positions.len();
    let is_complete = mesh.uvs.len() == count && mesh.normals.len() == count;
    if !is_complete || ![0, count].contains(&mesh.colors.len()) {
        return None;
    }
    let cut_off = (cut_off * 255.0).ceil().clamp(1.0, 255.0) as u8;
    let mut outlines =
        Outlines { texture, alpha: MaxAlpha::of(image)?, cut_off, known: HashMap::default() };
    let mut uses = vec![0; mesh.positions.len()];
    mesh.triangles.iter().flatten().for_each(|i| uses[*i as usize] += 1);
    let mut cut = Cut::of(mesh);
    let mut found = false;
    let mut triangles = mesh.triangles.iter().copied().peekable();
    while let Some(first) = triangles.next() {
        let second = triangles.peek().copied();
        let card = second.and_then(|second| Card::of(first, second, &uses));
        let card = card.filter(|card| card.is_flat(mesh));
        let polygons = card.and_then(|card| Some((card, outlines.of(card.corners(&mesh.uvs))?)));
        match polygons {
            Some((card, polygons)) => {
                found = true;
                triangles.next();
                polygons.iter().for_each(|polygon| cut.add_polygon(card, polygon));
            }
            None => cut.keep(first),
        }
    }
    found.then_some(cut.mesh)
}

/// The mesh in the making.
struct Cut<'a> {
    from: &'a SourceMesh,
    mesh: SourceMesh,
    /// New indices of vertices that are kept.
    kept: Vec<Option<u32>>,
}

impl<'a> Cut<'a> {
    fn of(from: &'a SourceMesh) -> Self {
        let mesh =
            SourceMesh { name: from.name.clone(), material: from.material, ..Default::default() };
        Self { from, mesh, kept: vec![None; from.positions.len()] }
    }

    fn add_vertex(&mut self, position: Vec3, normal: Vec3, uv: Vec2, color: Option<Vec4>) -> u32 {
        self.mesh.positions.push(position);
        self.mesh.normals.push(normal);
        self.mesh.uvs.push(uv);
        self.mesh.colors.extend(color);
        self.mesh.positions.len() as u32 - 1
    }

    fn keep(&mut self, triangle: [u32; 3]) {
        let from = self.from;
        let kept = triangle.map(|index| {
            let i = index as usize;
            let known = self.kept[i];
            known.unwrap_or_else(|| {
                let color = from.colors.get(i).copied();
                let new = self.add_vertex(from.positions[i], from.normals[i], from.uvs[i], color);
                self.kept[i] = Some(new);
                new
            })
        });
        self.mesh.triangles.push(kept);
    }

    fn add_polygon(&mut self, card: Card, polygon: &[Vec2]) {
        let from = self.from;
        let corners = polygon.iter().map(|place| {
            let color = (!from.colors.is_empty()).then(|| at(card.corners(&from.colors), *place));
            self.add_vertex(
                at(card.corners(&from.positions), *place),
                at(card.corners(&from.normals), *place).normalize_or_zero(),
                at(card.corners(&from.uvs), *place),
                color,
            )
        });
        let corners: Vec<u32> = corners.collect();
        let fan = corners.windows(2).skip(1).map(|side| [corners[0], side[0], side[1]]);
        self.mesh.triangles.extend(fan);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::source::SourceWrap;
    use bevy::math::Mat3;

    const TEXTURE: SourceTexture = SourceTexture {
        image: 0,
        wrap: [SourceWrap::Repeat; 2],
        nearest: false,
        uv_transform: Mat3::IDENTITY,
    };

    /// A disc in the lower left quarter of a texture.
    fn leaf() -> SourceImage {
        let side = 64;
        let texel = |i: u32| {
            let place = Vec2::new((i % side) as f32, (i / side) as f32) + 0.5;
            [60, 120, 30, if place.distance(Vec2::new(16.0, 16.0)) < 12.0 { 255 } else { 0 }]
        };
        SourceImage { width: side, height: side, rgba8: (0..side * side).flat_map(texel).collect() }
    }

    const TRIANGLE: [Vec3; 3] = [Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z];

    /// A card at z = 0; another at z = 1, turned over and six times as large; and [`TRIANGLE`], which is no card.
    fn mesh() -> SourceMesh {
        let card = |o: Vec3, s: Vec3, t: Vec3| [o, o + s, o + s + t, o + t];
        let small = card(Vec3::ZERO, Vec3::X, Vec3::Y);
        let large = card(Vec3::Z, 3.0 * Vec3::Y, 2.0 * Vec3::X);
        let uvs = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        SourceMesh {
            positions: [&small[..], &large, &TRIANGLE].concat(),
            normals: vec![Vec3::Z; 11],
            uvs: [&uvs[..], &uvs, &[Vec2::ZERO; 3]].concat(),
            colors: (0..11).map(|i| Vec4::splat(i as f32)).collect(),
            triangles: vec![[0, 1, 2], [0, 2, 3], [8, 9, 10], [6, 7, 4], [6, 4, 5]],
            ..Default::default()
        }
    }

    /// Area of the triangles in the plane z = `z`, negative where they face down.
    fn area(mesh: &SourceMesh, z: f32) -> f32 {
        let corners = mesh.triangles.iter().map(|t| t.map(|i| mesh.positions[i as usize]));
        let flat =
            corners.filter(|corners| corners.iter().all(|corner| (corner.z - z).abs() < 1e-5));
        flat.map(|[a, b, c]| (b - a).cross(c - a).z * 0.5).sum()
    }

    #[test]
    fn cards_shrink_to_their_leaf_and_other_triangles_stay() {
        let cut = cut_cards(&mesh(), &TEXTURE, &leaf(), 0.5).expect("it has cards");
        let corners = |t: &[u32; 3]| t.map(|i| cut.positions[i as usize]);
        assert!(cut.triangles.iter().any(|t| corners(t) == TRIANGLE));
        // The disc covers 0.11 of its card.
        let (small, large) = (area(&cut, 0.0), area(&cut, 1.0));
        for share in [small, large / -6.0] {
            assert!((0.11..0.25).contains(&share), "{share}");
        }
        for attribute in [cut.normals.len(), cut.uvs.len(), cut.colors.len()] {
            assert_eq!(attribute, cut.positions.len());
        }
    }

    #[test]
    fn what_is_kept_of_a_card_looks_as_before() {
        let cut = cut_cards(&mesh(), &TEXTURE, &leaf(), 0.5).expect("it has cards");
        for (position, uv) in cut.positions.iter().zip(&cut.uvs) {
            if position.min_element() < 0.0 {
                continue;
            }
            let expected = match position.z < 0.5 {
                true => position.truncate(),
                false => Vec2::new(position.y / 3.0, position.x / 2.0),
            };
            assert!(expected.distance(*uv) < 1e-6, "{position} {uv}");
        }
    }

    #[test]
    fn empty_cards_go_and_repeated_or_bent_ones_stay() {
        let empty = SourceImage { rgba8: vec![0; 64 * 64 * 4], ..leaf() };
        let cut = cut_cards(&mesh(), &TEXTURE, &empty, 0.5).expect("it has cards");
        assert_eq!(cut.triangles.len(), 1);
        let repeated = SourceMesh { uvs: vec![Vec2::splat(2.0); 11], ..mesh() };
        assert_eq!(cut_cards(&repeated, &TEXTURE, &leaf(), 0.5), None);
        let mut bent = mesh();
        bent.positions[2].z = 0.5;
        bent.positions[6].z = 0.5;
        assert_eq!(cut_cards(&bent, &TEXTURE, &leaf(), 0.5), None);
        let without = SourceMesh { uvs: vec![], ..mesh() };
        assert_eq!(cut_cards(&without, &TEXTURE, &leaf(), 0.5), None);
    }
}
