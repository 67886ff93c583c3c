//! How much a tree of few points has to shrink them, so that it covers what it should, and to lighten them, so that it is
//! as bright.
//!
//! The area rule gives all points together the area of the tree, whatever their number. But a crown hides most of itself,
//! and a few large splats hide less of each other than many small ones, and reach beyond its outline: a tree of eight
//! points would cover half as much again. So the splats of each number of points get a factor on their area, with which
//! they cover what the tree covers (stochastic simplification, Cook et al. 2007, with coverage measured instead of assumed).
//!
//! What they show is not the same either: the first points of the order lie anywhere in the crown, and the dark ones of its
//! inside are seen as often as the others. So their colour gets a factor, with which the mean of what is seen stays.
//!
//! In: points in progressive order; out: two tables of factors ([`lod::thinning`](crate::lod::thinning)), and the mean of what is
//! seen, for [`lod::contrast`](crate::lod::contrast). By drawing prefixes from
//! some directions on a coarse grid, when a tree is baked or read. O(points).

mod grid;

use super::tree_data::{SeenMean, TreeData};
use crate::lod::thinning::{FACTOR_LIMIT, FACTOR_STEPS, factor_points, round_factor};
use grid::{Element, Eyes, Seen};

/// From where many points are looked at, and few: splats of few are large, and seen from one side they differ from what they
/// are from another.
const EYES_OF_MANY: Eyes = Eyes { directions: 4, grid: 512 };
const EYES_OF_FEW: Eyes = Eyes { directions: 32, grid: 128 };
/// Up to so many points are few.
const FEW: f32 = 4096.0;
/// Between so many points and all of a tree, factors are interpolated: they hardly differ, and drawing them all would take
/// seconds.
const MOST_FITTED: f32 = 65_536.0;
/// Most area of a tree in areas of the grid: bounds the work on files that lie.
const MOST_AREA: f32 = 64.0;
/// What a factor may be: a tree whose first point is seen edge on must not grow without bounds.
const RANGE: (f32, f32) = (0.05, 1.25);
/// What a light factor may be.
const LIGHT_RANGE: (f32, f32) = (0.5, 2.0);
const _: () = assert!(LIGHT_RANGE.1 <= FACTOR_LIMIT && RANGE.1 <= FACTOR_LIMIT);
/// How coverage grows with area, in logarithms, as far as one believes what two steps say of it.
const ELASTICITY: (f32, f32) = (0.3, 1.2);
/// What it is mostly.
const USUAL_ELASTICITY: f32 = 0.8;
/// Least step of the logarithm of area that is believed.
const TELLING_STEP: f32 = 0.05;

/// Factors of one point to all, for [`factor_of`](crate::lod::thinning::factor_of).
#[derive(Clone, Debug, PartialEq)]
pub struct Thinning {
    /// On the area of splats.
    pub area: [f32; FACTOR_STEPS],
    /// On their colour.
    pub light: [f32; FACTOR_STEPS],
    /// What all points show.
    pub mean: SeenMean,
}

impl Default for Thinning {
    fn default() -> Self {
        let ones = [1.0; FACTOR_STEPS];
        Self { area: ones, light: ones, mean: SeenMean::default() }
    }
}

/// The factors of a tree, and what it shows on average. All 1 for a tree without area, or of more than could be.
pub fn thinning(tree: &TreeData) -> Thinning {
    let mut factors = Thinning::default();
    let side = 4.0 * tree.bounds.radius();
    let is_possible = tree.surface_area <= MOST_AREA * side * side;
    if !is_possible {
        return factors;
    }
    let points: Vec<Element> =
        (0..tree.point_count()).filter_map(|i| tree.surfel(i)).map(|s| Element::of(&s)).collect();
    let n0 = points.len() as f32;
    let mut eyes = if n0 > FEW { EYES_OF_MANY } else { EYES_OF_FEW };
    // All points without overlap are the surface as it was sampled.
    let mut wanted = eyes.surface(tree, &points);
    let shows_anything = wanted.covered > 0.0;
    if !shows_anything {
        return factors;
    }
    factors.mean = eyes.mean(tree, &points);
    let last = FACTOR_STEPS - 1;
    let mut fitted = (last, Fit { area: 1.0, light: 1.0 });
    for step in (0..FACTOR_STEPS).rev() {
        let n = factor_points(step, n0).min(n0);
        if n > MOST_FITTED && step != last {
            continue;
        }
        let (before, start) = fitted;
        if n <= FEW && eyes == EYES_OF_MANY {
            // From here on seen from all sides, and held against what the step before covers there.
            let shown = |eyes: Eyes| {
                eyes.prefix(tree, &points, factor_points(before, n0).min(n0), start.area)
            };
            wanted = wanted.seen_as(shown(eyes), shown(EYES_OF_FEW));
            eyes = EYES_OF_FEW;
        }
        let fit = fit(wanted, start.area, |area| eyes.prefix(tree, &points, n, area));
        // Those between were left out.
        for between in step..=before {
            let share = (between - step) as f32 / (before - step).max(1) as f32;
            let mixed = |low: f32, high: f32| round_factor(low + (high - low) * share);
            let start = if before == step { fit } else { start };
            factors.area[between] = mixed(fit.area, start.area);
            factors.light[between] = mixed(fit.light, start.light);
        }
        fitted = (step, fit);
    }
    factors
}

/// Factors of a number of points.
#[derive(Clone, Copy)]
struct Fit {
    area: f32,
    light: f32,
}

/// The factors with which a prefix shows what is `wanted`. `seen`: what it shows with a factor on its area.
fn fit(wanted: Seen, start: f32, seen: impl Fn(f32) -> Seen) -> Fit {
    let nearer = |factor: f32, found: Seen, elasticity: f32| {
        let ratio = wanted.covered / found.covered.max(wanted.covered * 0.1);
        (factor * ratio.powf(1.0 / elasticity)).clamp(RANGE.0, RANGE.1)
    };
    // Coverage grows a little slower than area; then as two steps tell (secants of logarithms).
    let first = seen(start);
    let second_area = nearer(start, first, USUAL_ELASTICITY);
    let second = seen(second_area);
    let moved = (second_area / start).ln();
    let slope = (second.covered / first.covered).ln() / moved;
    // Of a small step one learns more about the grid than about the tree.
    let is_telling = slope.is_finite() && moved.abs() > TELLING_STEP;
    let elasticity =
        if is_telling { slope.clamp(ELASTICITY.0, ELASTICITY.1) } else { USUAL_ELASTICITY };
    let third_area = nearer(second_area, second, elasticity);
    let tried = [(start, first), (second_area, second), (third_area, seen(third_area))];
    let miss = |found: &Seen| (found.covered - wanted.covered).abs();
    let [mut best, rest @ ..] = tried;
    for other in rest {
        if miss(&other.1) < miss(&best.1) {
            best = other;
        }
    }
    let (area, found) = best;
    let light = wanted.brightness() / found.brightness().max(1e-6);
    Fit { area, light: light.clamp(LIGHT_RANGE.0, LIGHT_RANGE.1) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        asset::{
            surfel::{SURFEL_LEAF, SURFEL_TWO_SIDED},
            synthetic::synthetic_tree,
        },
        lod::thinning::factor_of,
    };

    /// A crown of 20,000 points that hides most of itself.
    fn dense_tree() -> TreeData {
        TreeData { surface_area: 400.0, ..synthetic_tree(20_000, 3) }
    }

    fn elements(tree: &TreeData) -> Vec<Element> {
        (0..tree.point_count())
            .filter_map(|i| tree.surfel(i))
            .map(|point| Element::of(&point))
            .collect()
    }

    #[test]
    fn every_number_of_points_covers_what_the_tree_covers() {
        let tree = dense_tree();
        let factors = thinning(&tree).area;
        let of = |n: f32| factor_of(&factors, n, 20_000.0);
        assert!((0.1..0.7).contains(&of(4.0)), "{factors:?}");
        assert!(of(4.0) < of(64.0) && of(64.0) < of(2048.0), "{factors:?}");
        let points = elements(&tree);
        // Other directions than those of the fit.
        let eyes = Eyes { directions: 48, grid: 192 };
        let whole = eyes.surface(&tree, &points).covered;
        let mut n = 2.0;
        while n < 20_000.0 {
            let found = eyes.prefix(&tree, &points, n, of(n)).covered / whole - 1.0;
            // The order is random here, and each few points more turn the mean of so few; without factors it is half as much again.
            let allowed = match n {
                ..40.0 => 0.04,
                ..150.0 => 0.09,
                _ => 0.042,
            };
            assert!(found.abs() < allowed, "{found} at {n}");
            n *= 1.3;
        }
    }

    #[test]
    fn a_tree_without_area_is_left_as_it_is() {
        let mut tree = synthetic_tree(100, 3);
        tree.surface_area = 0.0;
        assert_eq!(thinning(&tree), Thinning::default());
        let single = thinning(&synthetic_tree(1, 3));
        assert!(single.area.iter().all(|f| (RANGE.0..=RANGE.1).contains(f)));
        assert!(single.light.iter().all(|f| (LIGHT_RANGE.0..=LIGHT_RANGE.1).contains(f)));
    }

    #[test]
    fn the_mean_of_what_is_seen_is_that_of_the_points() {
        let mut tree = dense_tree();
        for i in 0..tree.point_count() {
            let mut point = tree.surfel(i).expect("it is a point");
            (point.albedo, point.ambient_visibility) = ([188, 255, 0], 255);
            // Leaves of any direction: their back is seen as often as their front.
            point.flags = SURFEL_LEAF | SURFEL_TWO_SIDED;
            point.normal = point.face_normal;
            (tree.hot[i], tree.cold[i]) = point.pack(&tree.bounds);
        }
        let mean = thinning(&tree).mean;
        let expected = [0.502, 1.0, 0.0];
        assert!(mean.color.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.01), "{mean:?}");
        assert!((0.8..1.2).contains(&mean.shade), "{mean:?}");
    }

    #[test]
    fn few_points_of_a_crown_that_is_dark_inside_are_as_bright_as_the_whole() {
        let mut tree = dense_tree();
        let (middle, radius) = (tree.bounds.center(), tree.bounds.extent() * 0.5);
        for i in 0..tree.point_count() {
            let mut point = tree.surfel(i).expect("it is a point");
            let inside = ((point.position - middle) / radius).length() < 0.8;
            point.ambient_visibility = if inside { 0 } else { 255 };
            (tree.hot[i], tree.cold[i]) = point.pack(&tree.bounds);
        }
        let factors = thinning(&tree).light;
        let of = |n: f32| factor_of(&factors, n, 20_000.0);
        assert!(of(8.0) > 1.1 && of(8.0) > of(1000.0), "{factors:?}");
        assert!((0.9..1.15).contains(&of(8000.0)), "{factors:?}");
    }
}
