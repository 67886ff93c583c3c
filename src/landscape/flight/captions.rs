//! What a finished stretch really shows: way points' roles, crowns and heights in, roles out. O(length).

use super::Role;
use super::crowns::Crowns;
use super::curve::{running_maximum, smoothed};
use crate::landscape::Ground;
use bevy::math::{Vec2, Vec3};

/// Trees this close make an edge, metres.
const EDGE_M: f32 = 28.0;
/// Shorter stretches join the one before, metres.
const SHORTEST_M: f32 = 45.0;

/// Replaces the roles that were wanted by those that came of it. `below_leaves` holds where the eye is lower than a crown's
/// top within its reach; `overview_m` is the height of the overview above the ground.
pub(super) fn name_stretches(
    roles: &mut [Role],
    points: &[Vec3],
    below_leaves: &[bool],
    overview_m: f32,
    step_m: f32,
    ground: &dyn Ground,
    crowns: &mut Crowns,
) {
    let n = roles.len();
    let places = |metres: f32| ((metres / step_m) as usize).clamp(1, n / 8);
    let level = ground.water_level().unwrap_or(f32::NEG_INFINITY);
    let number = |yes: bool| f32::from(u8::from(yes));
    let (mut above_crown, mut beside) = (vec![], vec![]);
    for p in points {
        let (mut over, mut near) = (false, false);
        crowns.visit(Vec2::new(p.x, p.z), EDGE_M, |crown| {
            near = true;
            let reach = crown.distance(Vec2::new(p.x, p.z)) < crown.radius_m + 4.0;
            over |= reach && p.y > crown.position.y + crown.height_m;
        });
        above_crown.push(number(over));
        beside.push(number(near));
    }
    let below: Vec<f32> = below_leaves.iter().map(|b| number(*b)).collect();
    // Gaps between the trunks belong to the forest.
    let inside = running_maximum(&below, places(25.0));
    let over = smoothed(&above_crown, places(20.0));
    let beside = smoothed(&beside, places(20.0));
    for (i, role) in roles.iter_mut().enumerate() {
        let p = points[i];
        let above = p.y - ground.height(p.x, p.z).max(level);
        *role = if inside[i] > 0.0 {
            Role::InsideForest
        } else if above > 0.4 * overview_m {
            Role::Overview
        } else if *role == Role::Ridge {
            Role::Ridge
        } else if over[i] > 0.4 {
            Role::Canopy
        } else if beside[i] > 0.5 {
            Role::ForestEdge
        } else {
            Role::ValleyFloor
        };
    }
    // What is too short to read; below leaves it stays, for it is a promise too.
    let shortest = places(SHORTEST_M);
    let mut start = 0;
    for i in 1..=n {
        if i == n || roles[i] != roles[start] {
            if i - start < shortest && start > 0 && roles[start] != Role::InsideForest {
                let before = roles[start - 1];
                let joined = if before == Role::InsideForest && i < n { roles[i] } else { before };
                roles[start..i].fill(joined);
            }
            start = i;
        }
    }
}
