//! Steers between the trunks: a curve and the crowns around it in; the same curve moved sideways out.
//!
//! Shortest path (Bellman) over rows across the curve: state = offset and sideways speed, so bends are bounded; cost =
//! trunks, leaves, bends, distance from the curve. O(length · offsets · speeds).

use super::crowns::{Crowns, LowCrowns};
use super::{EYE_TO_TRUNK_M, Role};
use bevy::math::{Vec2, Vec3};

/// Distance between offsets, metres.
const OFFSET_M: f32 = 0.25;
/// Rows of the curve (a metre each) to a step of the search.
const STEP: usize = 3;
/// Offsets to each side at most: 20 m.
const MOST_OFFSETS: usize = 80;
/// Most offsets a step to either side: with 3, 14°.
const SPEED: usize = 5;
/// Most change of that from step to step: with 2, bends of 18 m radius.
const BEND: usize = 3;
/// Of a trunk in the way: more than any detour.
const TRUNK_COST: f32 = 300.0;

/// How far aside the path may be moved.
#[derive(Clone, Copy)]
pub(super) struct Aside {
    /// From the curve, metres.
    pub(super) most_m: f32,
    /// From the middle of the ground in x and z, metres.
    pub(super) border_m: f32,
}

/// Moves the points of an even curve sideways by up to `aside.most_m`, and back to it at the first. Points at `above_m` over
/// the ground where no crown reaches are left alone.
pub(super) fn steer(
    points: &mut [Vec3],
    above_m: &[f32],
    roles: &[Role],
    crowns: &mut Crowns,
    low: &LowCrowns,
    aside: Aside,
) {
    let n = points.len();
    let steps = n / STEP;
    let normals: Vec<Vec2> = (0..n)
        .map(|i| {
            let along = points[(i + 2) % n] - points[(i + n - 2) % n];
            Vec2::new(-along.z, along.x).normalize_or(Vec2::X)
        })
        .collect();
    let field = Field::new(points, &normals, above_m, roles, crowns, low, aside);
    let offsets = field.cheapest(steps);
    for i in 0..n {
        let at = (i as f32 / STEP as f32).min(steps as f32 - 1e-3);
        let (k, f) = (at as usize, at.fract());
        let get = |k: usize| offsets[k.min(steps)];
        let [a, b, c, d] = [get(k.saturating_sub(1)), get(k), get(k + 1), get(k + 2)];
        // Uniform cubic B-spline: continuous bends.
        let g = 1.0 - f;
        let offset = (a * g * g * g
            + b * (3.0 * f * f * f - 6.0 * f * f + 4.0)
            + c * (3.0 * g * g * g - 6.0 * g * g + 4.0)
            + d * f * f * f)
            / 6.0;
        points[i].x += normals[i].x * offset;
        points[i].z += normals[i].y * offset;
    }
}

/// Cost of being at each offset of each row.
struct Field {
    half: usize,
    /// Rows of 2 · half + 1 costs.
    costs: Vec<f32>,
}

impl Field {
    fn new(
        points: &[Vec3],
        normals: &[Vec2],
        above_m: &[f32],
        roles: &[Role],
        crowns: &mut Crowns,
        low: &LowCrowns,
        aside: Aside,
    ) -> Self {
        let half = ((aside.most_m / OFFSET_M) as usize).clamp(8, MOST_OFFSETS);
        let width = 2 * half + 1;
        let offset = |k: usize| (k as f32 - half as f32) * OFFSET_M;
        let mut costs = Vec::with_capacity(points.len() * width);
        for (i, point) in points.iter().enumerate() {
            let at = Vec2::new(point.x, point.z);
            let start = costs.len();
            costs.extend((0..width).map(|k| {
                let place = at + normals[i] * offset(k);
                let outside = place.abs().max_element() > aside.border_m;
                4e-4 * offset(k) * offset(k) + if outside { TRUNK_COST } else { 0.0 }
            }));
            let row = &mut costs[start..];
            let above = above_m[i];
            // Among trunks leaves overhead are welcome; elsewhere the open is.
            let leaves = if roles[i] == Role::InsideForest { 0.25 } else { 3.0 };
            crowns.visit(at, half as f32 * OFFSET_M + 2.0, |crown| {
                if above > crown.height_m + 4.0 {
                    return;
                }
                let to = Vec2::new(crown.position.x, crown.position.z) - at;
                let side = to.dot(normals[i]);
                let ahead = to.perp_dot(normals[i]);
                let open = crown.open_below_m() > above + 1.0 && !low.contains(&crown.key());
                let trunk = crown.trunk_m() + EYE_TO_TRUNK_M + 0.4;
                let hard = if open { trunk } else { crown.radius_m + 1.5 };
                let soft = crown.radius_m + 1.5;
                let reach = hard.max(soft);
                if ahead.abs() >= reach {
                    return;
                }
                let wide = (reach * reach - ahead * ahead).sqrt();
                let index = |v: f32| (v / OFFSET_M + half as f32).clamp(0.0, width as f32 - 1.0);
                let from = index(side - wide).ceil() as usize;
                let to = index(side + wide) as usize;
                for (k, cost) in row.iter_mut().enumerate().take(to + 1).skip(from) {
                    let distance = (offset(k) - side).hypot(ahead);
                    if distance < hard {
                        // Deeper is worse, so that even a blocked way keeps to the rim.
                        *cost += TRUNK_COST * (1.2 - distance / hard);
                    } else if distance < soft {
                        *cost += leaves * (1.0 - distance / soft);
                    }
                }
            });
        }
        Self { half, costs }
    }

    /// Offsets in metres at steps 0 to `steps`, the first and last 0.
    fn cheapest(&self, steps: usize) -> Vec<f32> {
        let width = 2 * self.half + 1;
        let speeds = 2 * SPEED + 1;
        let rows = self.costs.len() / width;
        let mut best = vec![f32::INFINITY; width * speeds];
        best[self.half * speeds + SPEED] = 0.0;
        let mut from = vec![0u8; steps * width * speeds];
        for step in 0..steps {
            let mut next = vec![f32::INFINITY; width * speeds];
            for k in 0..width {
                for v in 0..speeds {
                    // Arrives at k with speed v.
                    let Some(before) = (k + SPEED).checked_sub(v).filter(|b| *b < width) else {
                        continue;
                    };
                    let (mut least, mut least_from) = (f32::INFINITY, 0);
                    for u in v.saturating_sub(BEND)..=(v + BEND).min(speeds - 1) {
                        let bend = v as f32 - u as f32;
                        let cost = best[before * speeds + u] + 0.25 * bend * bend;
                        if cost < least {
                            (least, least_from) = (cost, u);
                        }
                    }
                    if least == f32::INFINITY {
                        continue;
                    }
                    for r in 1..=STEP {
                        let row = (step * STEP + r) % rows;
                        let moved = (before * (STEP - r) + k * r + STEP / 2) / STEP;
                        least += self.costs[row * width + moved];
                    }
                    next[k * speeds + v] = least;
                    from[(step * width + k) * speeds + v] = least_from as u8;
                }
            }
            best = next;
        }
        let mut offsets = vec![0.0; steps + 1];
        let (mut k, mut v) = (self.half, SPEED);
        for step in (0..steps).rev() {
            let u = usize::from(from[(step * width + k) * speeds + v]);
            (k, v) = (k + SPEED - v, u);
            offsets[step] = (k as f32 - self.half as f32) * OFFSET_M;
        }
        offsets
    }
}
