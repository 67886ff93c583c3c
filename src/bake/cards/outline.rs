//! What a leaf covers of its card → convex polygons around it. O(cells) a number of strips.
//!
//! The polygons need not fit closely: the mask still cuts out what is drawn. Each pixel of them costs a lookup of the texture, and each triangle as much as
//! some pixels, so [`outline`] looks for the strips and corners of the least total.

use bevy::math::{Vec2, Vec2Swizzles};

/// Cells along each side of a card.
pub const CELLS: usize = 48;
/// Area of a card in cells.
const CELL_AREA: f32 = (CELLS * CELLS) as f32;
/// What a triangle costs, as the area of pixels that cost as much, in cards. Measured on a software driver with an oak whose cards cover 200
/// to 600 pixels each: 0.025 to 0.09 are alike, less makes too many triangles.
const TRIANGLE_AREA: f32 = 0.05;
/// A card is cut into so many strips at most.
const MAX_STRIPS: usize = 5;

/// The cells of a card that are covered somewhere, rows of growing `t`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coverage(Vec<bool>);

impl Coverage {
    /// Asks for each cell by its column and row.
    pub fn new(mut is_covered: impl FnMut(usize, usize) -> bool) -> Self {
        Self((0..CELLS * CELLS).map(|i| is_covered(i % CELLS, i / CELLS)).collect())
    }

    fn at(&self, column: usize, row: usize) -> bool {
        self.0[row * CELLS + column]
    }

    /// With one cell more on all sides: smaller mip levels of a texture reach farther.
    pub fn grown(&self) -> Self {
        let around = |i: usize| i.saturating_sub(1)..(i + 2).min(CELLS);
        Self::new(|column, row| around(row).any(|y| around(column).any(|x| self.at(x, y))))
    }

    fn transposed(&self) -> Self {
        Self::new(|column, row| self.at(row, column))
    }

    /// Corners of the covered cells of some rows: the two outer ones of each row's edges.
    fn corners(&self, rows: std::ops::Range<usize>) -> Vec<Vec2> {
        let corners = rows.flat_map(|row| {
            let covered = (0..CELLS).filter(|column| self.at(*column, row));
            let ends = covered.clone().min().zip(covered.max());
            ends.into_iter().flat_map(move |(first, last)| {
                [(first, row), (first, row + 1), (last + 1, row), (last + 1, row + 1)]
            })
        });
        corners.map(|(x, y)| Vec2::new(x as f32, y as f32)).collect()
    }
}

fn area(polygon: &[Vec2]) -> f32 {
    let next = polygon.iter().cycle().skip(1);
    polygon.iter().zip(next).map(|(a, b)| a.perp_dot(*b)).sum::<f32>() * 0.5
}

/// The convex hull, counter-clockwise (Andrew 1979).
fn convex_hull(mut points: Vec<Vec2>) -> Vec<Vec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    let half = |points: &mut dyn Iterator<Item = Vec2>| {
        let mut chain: Vec<Vec2> = vec![];
        for point in points {
            while let [.., a, b] = chain[..]
                && (b - a).perp_dot(point - b) <= 0.0
            {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut points.iter().copied());
    hull.extend(half(&mut points.iter().rev().copied()));
    hull
}

/// Where the sides next to the side `i` of a convex polygon meet beyond it, if they do.
fn tip(polygon: &[Vec2], i: usize) -> Option<Vec2> {
    let at = |k: usize| polygon[(i + polygon.len() + k - 1) % polygon.len()];
    let [before, a, b, after] = [0, 1, 2, 3].map(at);
    let (left, right) = (a - before, b - after);
    let turn = left.perp_dot(right);
    // Only if the polygon turns by less than half a circle between them.
    let meets = turn < -1e-4;
    meets.then(|| a + left * ((b - a).perp_dot(right) / turn))
}

/// Takes sides away while that costs less than the triangle it saves; the polygon grows, but not beyond its rows or the card.
fn simplify(polygon: &mut Vec<Vec2>, rows: &std::ops::Range<usize>) {
    let inside = |p: Vec2| {
        let (low, high) =
            (Vec2::new(0.0, rows.start as f32), Vec2::new(CELLS as f32, rows.end as f32));
        p.cmpge(low - 1e-3).all() && p.cmple(high + 1e-3).all()
    };
    while polygon.len() > 3 {
        let n = polygon.len();
        let cheapest = (0..n).filter_map(|i| {
            let tip = tip(polygon, i).filter(|tip| inside(*tip))?;
            Some((area(&[polygon[i], tip, polygon[(i + 1) % n]]), i, tip))
        });
        let cheapest = cheapest.min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, i, tip)) = cheapest.filter(|(added, ..)| *added < TRIANGLE_AREA * CELL_AREA)
        else {
            return;
        };
        polygon[i] = tip;
        polygon.remove((i + 1) % n);
    }
}

/// Polygons around what is covered in each of so many strips, in cells, and what they cost.
fn strips(coverage: &Coverage, count: usize) -> (Vec<Vec<Vec2>>, f32) {
    let strip = |k: usize| {
        let rows = k * CELLS / count..(k + 1) * CELLS / count;
        let mut polygon = convex_hull(coverage.corners(rows.clone()));
        simplify(&mut polygon, &rows);
        polygon
    };
    let polygons: Vec<Vec<Vec2>> = (0..count).map(strip).filter(|p| p.len() > 2).collect();
    let cost = |p: &Vec<Vec2>| area(p) / CELL_AREA + TRIANGLE_AREA * (p.len() - 2) as f32;
    let cost = polygons.iter().map(cost).sum();
    (polygons, cost)
}

/// Convex polygons, counter-clockwise in the unit square, that hold every covered cell. None where nothing is covered.
pub fn outline(coverage: &Coverage) -> Vec<Vec<Vec2>> {
    let transposed = coverage.transposed();
    let rows = (1..=MAX_STRIPS).map(|count| (strips(coverage, count), false));
    let columns = (2..=MAX_STRIPS).map(|count| (strips(&transposed, count), true));
    let best = rows.chain(columns).min_by(|a, b| a.0.1.total_cmp(&b.0.1));
    let Some(((mut polygons, _), is_transposed)) = best else { return vec![] };
    for polygon in &mut polygons {
        if is_transposed {
            polygon.reverse();
        }
        for corner in polygon {
            let corner_in_card = if is_transposed { corner.yx() } else { *corner };
            *corner = (corner_in_card / CELLS as f32).clamp(Vec2::ZERO, Vec2::ONE);
        }
    }
    polygons
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn holds(polygons: &[Vec<Vec2>], point: Vec2) -> bool {
        polygons.iter().any(|polygon| {
            let next = polygon.iter().cycle().skip(1);
            polygon.iter().zip(next).all(|(a, b)| (*b - *a).perp_dot(point - *a) > -1e-4)
        })
    }

    fn total_area(polygons: &[Vec<Vec2>]) -> f32 {
        polygons.iter().map(|polygon| area(polygon)).sum()
    }

    proptest! {
        #[test]
        fn every_covered_cell_lies_in_a_polygon(blobs in proptest::collection::vec((0.0f32..1.0, 0.0f32..1.0, 0.02f32..0.3), 0..6)) {
            let place = |x: usize, y: usize| (Vec2::new(x as f32, y as f32) + 0.5) / CELLS as f32;
            let coverage = Coverage::new(|x, y| {
                blobs.iter().any(|(s, t, radius)| place(x, y).distance(Vec2::new(*s, *t)) < *radius)
            });
            let polygons = outline(&coverage);
            for polygon in &polygons {
                prop_assert!(area(polygon) > 0.0, "clockwise or empty: {polygon:?}");
            }
            prop_assert!(total_area(&polygons) <= 1.0 + 1e-4);
            for (x, y) in (0..CELLS * CELLS).map(|i| (i % CELLS, i / CELLS)) {
                for corner in [Vec2::splat(-0.49), Vec2::new(-0.49, 0.49), Vec2::new(0.49, -0.49), Vec2::splat(0.49)] {
                    let point = place(x, y) + corner / CELLS as f32;
                    prop_assert!(!coverage.at(x, y) || holds(&polygons, point), "{x} {y}: {polygons:?}");
                }
            }
        }
    }

    #[test]
    fn a_full_card_stays_a_square_and_an_empty_one_goes() {
        let full = outline(&Coverage::new(|_, _| true));
        assert_eq!(full.len(), 1);
        assert_eq!((full[0].len(), area(&full[0])), (4, 1.0));
        assert!(outline(&Coverage::new(|_, _| false)).is_empty());
    }

    #[test]
    fn a_diagonal_leaf_gets_a_close_outline_of_few_corners() {
        let leaf = Coverage::new(|x, y| x.abs_diff(y) < 4);
        let polygons = outline(&leaf);
        let corners: usize = polygons.iter().map(Vec::len).sum();
        assert!(total_area(&polygons) < 0.3 && corners <= 8, "{polygons:?}");
    }

    #[test]
    fn a_round_leaf_gets_few_triangles() {
        let distance = |k: usize| k as f32 + 0.5 - CELLS as f32 * 0.5;
        let disc = Coverage::new(|x, y| distance(x).hypot(distance(y)) < 18.0);
        let polygons = outline(&disc);
        let triangles: usize = polygons.iter().map(|polygon| polygon.len() - 2).sum();
        assert!(total_area(&polygons) < 0.55 && triangles <= 6, "{polygons:?}");
    }

    #[test]
    fn growing_adds_a_cell_on_all_sides() {
        let dot = Coverage::new(|x, y| (x, y) == (5, 0));
        let grown = Coverage::new(|x, y| (4..=6).contains(&x) && y <= 1);
        assert_eq!(dot.grown(), grown);
    }
}
