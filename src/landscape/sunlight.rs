//! Shadows that mountains throw: heights and the way to the sun in, the height of the shadow over every place out.
//!
//! One sweep over a grid away from the sun: a post is shaded up to the height of what stands before it, less the fall of
//! the ray. O(posts), about 3 ms for 512². Source of the idea: Snyder & Nowrouzezahrai 2008 for heightfields, reduced
//! to one direction.

use super::{Ground, height_grid::HeightGrid, smoothstep};
use bevy::math::{Vec2, Vec3};
use std::sync::Arc;

/// Posts a side.
const POSTS: usize = 513;

/// Heights of a ground on a grid, made once for all suns. O(posts) heights.
#[derive(Clone)]
pub struct Silhouette {
    heights: Arc<HeightGrid>,
    side_m: f32,
    cell_m: f32,
}

impl Silhouette {
    /// Reads 513² heights.
    pub fn of(ground: &dyn Ground) -> Self {
        let side_m = ground.side_m();
        let cell_m = side_m / (POSTS - 1) as f32;
        let at = |i: usize| i as f32 * cell_m - side_m * 0.5;
        let heights = Arc::new(HeightGrid::new(POSTS, POSTS, |x, z| ground.height(at(x), at(z))));
        Self { heights, side_m, cell_m }
    }

    /// The shadows for a direction towards the sun.
    pub fn shadows(&self, to_sun: Vec3) -> SunShadow {
        let away = Vec2::new(to_sun.x, to_sun.z);
        let flat = away.length();
        // A sun in the zenith throws none; one at the horizon would shade everything.
        if flat < 1e-3 || to_sun.y <= 0.0 {
            return SunShadow { silhouette: self.clone(), tops: None };
        }
        let by_column = away.x.abs() > away.y.abs();
        let (main, cross) = if by_column { (away.x, away.y) } else { (away.y, away.x) };
        // Towards the sun by one post along the main axis.
        let lean = cross / main.abs();
        let fall = to_sun.y.max(0.01) / main.abs() * self.cell_m;
        let index = |i: usize, k: usize| if by_column { k * POSTS + i } else { i * POSTS + k };
        let mut tops = vec![f32::NEG_INFINITY; POSTS * POSTS];
        let heights = &self.heights.posts;
        for step in 1..POSTS {
            let (i, before) =
                if main > 0.0 { (POSTS - 1 - step, POSTS - step) } else { (step, step - 1) };
            for k in 0..POSTS {
                let from = (k as f32 + lean).clamp(0.0, (POSTS - 1) as f32);
                let low = (from as usize).min(POSTS - 2);
                let share = from - low as f32;
                let top = |k: usize| tops[index(before, k)].max(heights[index(before, k)]);
                let (a, b) = (top(low), top(low + 1));
                tops[index(i, k)] = a + (b - a) * share - fall;
            }
        }
        let lowest = self.heights.range()[0] - 1000.0;
        tops.iter_mut().for_each(|top| *top = top.max(lowest));
        let tops = HeightGrid { columns: POSTS, rows: POSTS, posts: tops };
        SunShadow { silhouette: self.clone(), tops: Some(tops) }
    }
}

/// Shadows of the ground on itself for one direction of the sun.
#[derive(Clone)]
pub struct SunShadow {
    silhouette: Silhouette,
    tops: Option<HeightGrid>,
}

impl SunShadow {
    /// 1 in the sun to 0 in the shadow of other ground, at a height in metres.
    pub fn lit(&self, x: f32, z: f32, height: f32) -> f32 {
        let Some(tops) = &self.tops else { return 1.0 };
        let Silhouette { side_m, cell_m, .. } = self.silhouette;
        let top = tops.bilinear((x + side_m * 0.5) / cell_m, (z + side_m * 0.5) / cell_m);
        // Wide enough to hide the posts, and not so low that a slope shades itself.
        let soft = (0.16 * cell_m).clamp(0.6, 9.0);
        smoothstep(-1.5 * soft, 0.5 * soft, height - top)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Wall;
    impl Ground for Wall {
        fn side_m(&self) -> f32 {
            1024.0
        }
        fn height(&self, x: f32, _z: f32) -> f32 {
            if (0.0..20.0).contains(&x) { 100.0 } else { 0.0 }
        }
        fn height_range(&self) -> [f32; 2] {
            [0.0, 100.0]
        }
        fn detail_m(&self) -> f32 {
            1.0
        }
    }

    #[test]
    fn a_wall_throws_a_shadow_of_its_height_away_from_the_sun() {
        let silhouette = Silhouette::of(&Wall);
        for sign in [1.0, -1.0] {
            let shadows = silhouette.shadows(Vec3::new(sign, 1.0, 0.2).normalize());
            assert!(shadows.lit(-60.0 * sign, 0.0, 0.0) < 0.05, "behind the wall");
            assert!(shadows.lit(-150.0 * sign, 0.0, 0.0) > 0.95, "beyond its shadow");
            assert!(shadows.lit(60.0 * sign, 0.0, 0.0) > 0.95, "before the wall");
            assert!(shadows.lit(-60.0 * sign, 0.0, 90.0) > 0.95, "above the shadow");
        }
        assert_eq!(silhouette.shadows(Vec3::Y).lit(-60.0, 0.0, 0.0), 1.0);
    }
}
