//! Rasterisation by the rules GPUs follow: projected triangles in, fragments out.
//!
//! Vertices are snapped to 1/256 pixel; a pixel is covered if its centre is inside or on a top or left edge (rows count
//! downwards, as in a framebuffer). Edge functions are exact integers, so triangles that share an edge cover each pixel
//! once. Each row's span is solved for, so the cost is O(rows + fragments), however long and thin the triangle.

use super::LdiViewport;
use bevy::math::Vec3;
use std::ops::Range;

/// Steps a pixel: what Direct3D 11+ demands and other GPUs report (`subPixelPrecisionBits = 8`).
const STEPS: i64 = 256;
/// Coordinates beyond this (in steps) are dropped, so that no product overflows. 64 times the largest image.
const FARTHEST: f64 = (1u64 << 28) as f64;

/// A vertex in an LDI: snapped coordinates in 1/256 pixel, depth in 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProjectedVertex {
    pub x: i64,
    pub y: i64,
    pub depth: f64,
}

/// Projects a position; `None` if it is not finite or absurdly far outside the image.
pub fn project(viewport: &LdiViewport, position: Vec3) -> Option<ProjectedVertex> {
    let offset = position.as_dvec3() - viewport.origin.as_dvec3();
    let frame = viewport.direction;
    let steps = STEPS as f64 / f64::from(viewport.pixel);
    let x = (offset.dot(frame.right.as_dvec3()) * steps).round();
    let y = (offset.dot(frame.up.as_dvec3()) * steps).round();
    let depth = offset.dot(frame.forward.as_dvec3()) / f64::from(viewport.depth);
    let inside = x.abs() < FARTHEST && y.abs() < FARTHEST && depth.is_finite();
    inside.then_some(ProjectedVertex { x: x as i64, y: y as i64, depth })
}

/// The edge function `slope · column + offset` of one row, at pixel centres.
#[derive(Clone, Copy)]
struct Edge {
    from: [i64; 2],
    step: [i64; 2],
    /// −1 on edges that do not own the pixels they pass through, so that ≥ 0 tests all edges.
    bias: i64,
}

impl Edge {
    fn new(from: ProjectedVertex, to: ProjectedVertex) -> Self {
        let step = [to.x - from.x, to.y - from.y];
        let owns = step[1] < 0 || (step[1] == 0 && step[0] > 0);
        Self { from: [from.x, from.y], step, bias: if owns { 0 } else { -1 } }
    }

    /// Slope along a row and value at the centre of the row's first pixel.
    fn in_row(&self, row: i64) -> (i64, i64) {
        let center = row * STEPS + STEPS / 2;
        let value =
            self.step[0] * (center - self.from[1]) - self.step[1] * (STEPS / 2 - self.from[0]);
        (-self.step[1] * STEPS, value)
    }
}

/// A triangle ready to be rasterised.
pub struct RasterTriangle {
    /// Edge i lies opposite to corner i.
    edges: [Edge; 3],
    /// Depth of the corners.
    depths: [f64; 3],
    inverse_area: f64,
    /// Corners 1 and 2 were swapped to make the area positive.
    swapped: bool,
    /// First and last row whose centres lie within the triangle's extent.
    rows: [i64; 2],
}

impl RasterTriangle {
    /// `None` if the snapped triangle has no area or no row of pixel centres passes through it.
    pub fn new(vertices: [ProjectedVertex; 3]) -> Option<Self> {
        let [a, mut b, mut c] = vertices;
        let mut area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        let swapped = area < 0;
        if swapped {
            (b, c, area) = (c, b, -area);
        }
        let (top, bottom) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
        // The first centre at or below the top, the last at or above the bottom.
        let rows =
            [(top + STEPS / 2 - 1).div_euclid(STEPS), (bottom - STEPS / 2).div_euclid(STEPS)];
        (area > 0 && rows[0] <= rows[1]).then(|| Self {
            edges: [Edge::new(b, c), Edge::new(c, a), Edge::new(a, b)],
            depths: [a.depth, b.depth, c.depth],
            inverse_area: 1.0 / area as f64,
            swapped,
            rows,
        })
    }

    /// The rows it may cover in an image of this height.
    pub fn rows(&self, height: u32) -> Range<u32> {
        let start = self.rows[0].clamp(0, i64::from(height));
        let end = (self.rows[1] + 1).clamp(start, i64::from(height));
        start as u32..end as u32
    }

    /// Calls `emit(column, row, depth, weights of the corners)` for each fragment within `rows` and `width` columns, row by
    /// row. Depth is clamped to 0 to 1.
    pub fn for_each_fragment(
        &self,
        rows: Range<u32>,
        width: u32,
        mut emit: impl FnMut(u32, u32, f32, [f32; 3]),
    ) {
        let own = self.rows(rows.end);
        for row in own.start.max(rows.start)..own.end {
            let edges = self.edges.map(|edge| edge.in_row(i64::from(row)));
            let (mut first, mut last) = (0, i64::from(width) - 1);
            for ((slope, value), edge) in std::iter::zip(edges, self.edges) {
                let value = value + edge.bias;
                // slope · column + value ≥ 0, solved for the column.
                match slope.signum() {
                    1 => first = first.max(-value.div_euclid(slope)),
                    -1 => last = last.min(value.div_euclid(-slope)),
                    _ if value < 0 => last = -1,
                    _ => {}
                }
            }
            for column in first..=last {
                let [u, v, w] =
                    edges.map(|(slope, value)| (slope * column + value) as f64 * self.inverse_area);
                let depth = self.depths[0] * u + self.depths[1] * v + self.depths[2] * w;
                let weights = if self.swapped { [u, w, v] } else { [u, v, w] };
                // + 0.0 turns −0 into 0, so that bits sort as depths do.
                let depth = depth.clamp(0.0, 1.0) as f32 + 0.0;
                emit(column as u32, row, depth, weights.map(|w| w as f32));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vertex(x: i64, y: i64) -> ProjectedVertex {
        ProjectedVertex { x, y, depth: 0.5 }
    }

    /// How often each pixel of a 16×16 image is covered.
    fn coverage(triangles: &[[ProjectedVertex; 3]]) -> Vec<u32> {
        let mut image = vec![0; 256];
        for triangle in triangles.iter().filter_map(|&t| RasterTriangle::new(t)) {
            triangle.for_each_fragment(0..16, 16, |x, y, _, _| image[(y * 16 + x) as usize] += 1);
        }
        image
    }

    #[test]
    fn centres_on_top_and_left_edges_are_covered_and_on_others_not() {
        // A square whose sides pass exactly through the centres of pixels 2 and 5.
        let [low, high] = [2, 5].map(|pixel| pixel * 256 + 128);
        let (a, b, c, d) =
            (vertex(low, low), vertex(high, low), vertex(high, high), vertex(low, high));
        let image = coverage(&[[a, b, c], [a, c, d]]);
        for y in 0..16 {
            for x in 0..16 {
                let inside = (2..5).contains(&x) && (2..5).contains(&y);
                assert_eq!(image[y * 16 + x], u32::from(inside), "pixel {x}, {y}");
            }
        }
    }

    #[test]
    fn lines_cover_nothing() {
        let line = [vertex(0, 0), vertex(1000, 1000), vertex(2000, 2000)];
        assert!(RasterTriangle::new(line).is_none());
    }

    #[test]
    fn weights_reproduce_the_vertices_whatever_the_winding() {
        let corners = [[100, 150], [3900, 400], [1200, 3800]];
        for winding in [[0, 1, 2], [0, 2, 1], [1, 0, 2]] {
            let triangle = winding.map(|i: usize| vertex(corners[i][0], corners[i][1]));
            let raster = RasterTriangle::new(triangle).expect("it has an area");
            let mut fragments = 0;
            raster.for_each_fragment(0..16, 16, |x, y, _, weights| {
                let at = |axis: usize| -> f32 {
                    std::iter::zip(weights, winding).map(|(w, i)| w * corners[i][axis] as f32).sum()
                };
                let center = [x, y].map(|pixel| pixel as f32 * 256.0 + 128.0);
                assert!((at(0) - center[0]).abs() < 0.1 && (at(1) - center[1]).abs() < 0.1);
                fragments += 1;
            });
            assert!(fragments > 50);
        }
    }

    fn any_vertex() -> impl Strategy<Value = ProjectedVertex> {
        // Multiples of half a pixel are common, so that edges and corners hit pixel centres.
        let coordinate = || prop_oneof![-600i64..4700, (-4i64..36).prop_map(|half| half * 128)];
        (coordinate(), coordinate()).prop_map(|(x, y)| vertex(x, y))
    }

    proptest! {
        #[test]
        fn a_fan_around_any_point_covers_each_pixel_of_a_square_once(
            hub_x in 256i64..3840, hub_y in 256i64..3840, snap in any::<bool>(),
        ) {
            let snapped = |v: i64| if snap { v / 128 * 128 } else { v };
            let hub = vertex(snapped(hub_x), snapped(hub_y));
            let corners = [vertex(128, 128), vertex(3968, 128), vertex(3968, 3968), vertex(128, 3968)];
            let fan: Vec<_> = (0..4).map(|i| [hub, corners[i], corners[(i + 1) % 4]]).collect();
            let image = coverage(&fan);
            for (i, &count) in image.iter().enumerate() {
                let inside = i % 16 < 15 && i / 16 < 15;
                prop_assert_eq!(count, u32::from(inside), "pixel {}, {}", i % 16, i / 16);
            }
        }

        #[test]
        fn two_sides_of_a_shared_edge_never_both_own_a_pixel(
            a in any_vertex(), b in any_vertex(), c in any_vertex(), d in any_vertex(),
        ) {
            let side = |p: ProjectedVertex| (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x);
            prop_assume!(side(c).signum() * side(d).signum() == -1);
            prop_assert!(coverage(&[[a, b, c], [b, a, d]]).iter().all(|&count| count <= 1));
        }

        #[test]
        fn strictly_inside_centres_are_covered_and_outside_ones_are_not(
            a in any_vertex(), b in any_vertex(), c in any_vertex(),
        ) {
            let image = coverage(&[[a, b, c]]);
            for (i, &count) in image.iter().enumerate() {
                let p = vertex((i % 16) as i64 * 256 + 128, (i / 16) as i64 * 256 + 128);
                let side = |a: ProjectedVertex, b: ProjectedVertex| {
                    ((b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x)).signum()
                };
                let sides = [side(a, b), side(b, c), side(c, a)];
                if sides == [1; 3] || sides == [-1; 3] {
                    prop_assert_eq!(count, 1);
                }
                if sides.contains(&1) && sides.contains(&-1) {
                    prop_assert_eq!(count, 0);
                }
            }
        }
    }
}
