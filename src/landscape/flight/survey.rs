//! Where to fly: ground and biomes in; a good middle and one way point per role around it out. O(samples).

use super::{FlightSettings, Role};
use crate::landscape::{Biomes, Ground, smoothstep};
use crate::math::hash::SplitMix64;
use bevy::math::Vec2;
use std::f32::consts::{PI, TAU};

/// Cells a side of the survey.
const CELLS: usize = 72;
/// Middles that are tried a side.
const MIDDLES: usize = 7;
/// Places that are looked at around each middle.
const PLACES: usize = 32;
/// Way points are this share of the loop's mean radius from its middle.
const NEAREST: f32 = 0.6;
const FURTHEST: f32 = 1.25;

/// A place to pass and what is to be seen there.
#[derive(Clone, Copy, Debug)]
pub(super) struct WayPoint {
    pub(super) at: Vec2,
    pub(super) role: Role,
}

/// What a loop of a length shows, in turn.
fn roles(length_m: f32) -> &'static [Role] {
    use Role::{ForestEdge, InsideForest, Overview, Ridge, ValleyFloor};
    if length_m > 4000.0 {
        &[
            Overview,
            ValleyFloor,
            ValleyFloor,
            ForestEdge,
            InsideForest,
            ForestEdge,
            Ridge,
            Ridge,
            ForestEdge,
            InsideForest,
            InsideForest,
            ForestEdge,
        ]
    } else {
        &[
            Overview,
            ValleyFloor,
            ForestEdge,
            InsideForest,
            ForestEdge,
            Ridge,
            InsideForest,
            ForestEdge,
        ]
    }
}

/// The length asked for, as far as the ground has room for it.
pub(super) fn loop_length_m(side_m: f32, settings: &FlightSettings) -> f32 {
    let asked = if settings.length_m.is_finite() { settings.length_m } else { 7000.0 };
    // A loop with wiggles is some 15 % longer than its circle, and its furthest points stay 6 % of the side from the border.
    let most = side_m * 0.44 / FURTHEST * TAU * 1.15;
    asked.clamp(200.0, 40_000.0).min(most)
}

/// One way point per role, the first an overview.
pub(super) fn way_points(
    ground: &dyn Ground,
    biomes: &Biomes,
    settings: &FlightSettings,
    length_m: f32,
) -> Vec<WayPoint> {
    let radius = length_m / (TAU * 1.15);
    let mut rng = SplitMix64(settings.seed ^ 0xF11_6847);
    let middle = middle(ground, biomes, settings, radius * FURTHEST, &mut rng);
    let survey = Survey::new(ground, biomes, middle, radius * FURTHEST);
    let roles = roles(length_m);
    // The turn and the direction in which the roles meet the best places for them.
    let start = rng.range(0.0, TAU);
    let mut best: (f32, Vec<WayPoint>) = (f32::NEG_INFINITY, vec![]);
    for turn in 0..2 * roles.len() {
        let direction = if turn % 2 == 0 { 1.0 } else { -1.0 };
        let from = start + TAU * (turn / 2) as f32 / roles.len() as f32;
        let found = survey.around(roles, from, direction, radius);
        if found.0 > best.0 {
            best = found;
        }
    }
    for point in &mut best.1 {
        point.role = survey.honest(point);
    }
    best.1
}

/// The middle of the most varied surroundings of `reach_m`.
fn middle(
    ground: &dyn Ground,
    biomes: &Biomes,
    settings: &FlightSettings,
    reach_m: f32,
    rng: &mut SplitMix64,
) -> Vec2 {
    let room = (ground.side_m() * 0.44 - reach_m).max(0.0);
    if let Some(center) = settings.center.filter(|c| c.is_finite()) {
        return center.clamp(Vec2::splat(-room), Vec2::splat(room));
    }
    if room < reach_m * 0.1 {
        return Vec2::ZERO;
    }
    let mut best = (f32::NEG_INFINITY, Vec2::ZERO);
    for i in 0..MIDDLES * MIDDLES {
        let cell = Vec2::new((i % MIDDLES) as f32, (i / MIDDLES) as f32);
        let jitter = Vec2::new(rng.next_f32(), rng.next_f32());
        let at = ((cell + jitter) / MIDDLES as f32 * 2.0 - 1.0) * room;
        // Seeds differ in taste, so that they show different places.
        let score = variety(ground, biomes, at, reach_m) + rng.range(0.0, 0.3);
        if score > best.0 {
            best = (score, at);
        }
    }
    best.1
}

/// How varied a neighbourhood is, about −2 to 3: half forest, some water, some rock, relief that is not all cliffs.
fn variety(ground: &dyn Ground, biomes: &Biomes, middle: Vec2, reach_m: f32) -> f32 {
    let (mut forest, mut water, mut bare, mut steep) = (0.0, 0.0, 0.0, 0.0);
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for i in 0..PLACES {
        // A sunflower: even over the disc (Vogel 1979).
        let radius = reach_m * ((i as f32 + 0.5) / PLACES as f32).sqrt();
        let at = middle + Vec2::from_angle(i as f32 * PI * (3.0 - 5f32.sqrt())) * radius;
        let site = ground.site(at.x, at.y);
        let biome = biomes.at(at.x, at.y, &site);
        let share = 1.0 / PLACES as f32;
        forest += biome.forest * share;
        water += if site.above_water_m < 0.0 { share } else { 0.0 };
        bare += (biome.rock + biome.snow + biome.scree) * share;
        steep += smoothstep(0.45, 0.75, site.slope) * share;
        (low, high) = (low.min(site.height_m), high.max(site.height_m));
    }
    let mixed = 1.0 - (2.0 * forest - 1.0).abs();
    let relief = ((high - low) / 250.0).min(1.0);
    1.2 * mixed + 4.0 * water.min(0.15) - 3.0 * (water - 0.3).max(0.0) + 1.5 * bare.min(0.2)
        - 1.5 * (bare - 0.4).max(0.0)
        + 0.7 * relief
        - steep
}

/// Heights and forest on a grid around the middle.
struct Survey {
    middle: Vec2,
    reach_m: f32,
    /// Metres; of the water where it is higher than the ground.
    heights: Vec<f32>,
    /// Heights minus those of the surroundings, −1 deep valley to 1 high ridge.
    stands_out: Vec<f32>,
    forest: Vec<f32>,
    /// Mean forest of the cell and its neighbours.
    forest_around: Vec<f32>,
    /// Tangent of the slope over a cell.
    slope: Vec<f32>,
    /// 1 beside and on shallow water, less far out.
    water: Vec<f32>,
    /// 0 lowest to 1 highest of the survey.
    altitude: Vec<f32>,
}

impl Survey {
    fn new(ground: &dyn Ground, biomes: &Biomes, middle: Vec2, reach_m: f32) -> Self {
        let mut survey = Self {
            middle,
            reach_m,
            heights: vec![],
            stands_out: vec![],
            forest: vec![],
            forest_around: vec![],
            slope: vec![],
            water: vec![],
            altitude: vec![],
        };
        let level = ground.water_level().unwrap_or(f32::NEG_INFINITY);
        let cells = CELLS * CELLS;
        let mut bed = Vec::with_capacity(cells);
        for cell in 0..cells {
            let at = survey.place(cell);
            let site = ground.site(at.x, at.y);
            survey.forest.push(biomes.at(at.x, at.y, &site).forest);
            bed.push(site.above_water_m);
            survey.heights.push(site.height_m.max(level));
        }
        let low = survey.heights.iter().copied().fold(f32::INFINITY, f32::min);
        let high = survey.heights.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let step = 2.0 * reach_m / CELLS as f32;
        let wide: Vec<f32> = (0..cells).map(|c| survey.mean(&survey.heights, c, 8)).collect();
        let out: Vec<f32> = survey.heights.iter().zip(&wide).map(|(h, w)| h - w).collect();
        let most = out.iter().map(|v| v.abs()).fold(1.0, f32::max);
        survey.stands_out = out.iter().map(|v| v / most).collect();
        for (cell, &above_water_m) in bed.iter().enumerate() {
            let [x, z] = [cell % CELLS, cell / CELLS];
            let h = |x: usize, z: usize| survey.heights[z * CELLS + x];
            let dx = h((x + 1).min(CELLS - 1), z) - h(x.saturating_sub(1), z);
            let dz = h(x, (z + 1).min(CELLS - 1)) - h(x, z.saturating_sub(1));
            survey.slope.push(dx.hypot(dz) / (2.0 * step));
            survey.forest_around.push(survey.mean(&survey.forest, cell, 1));
            // Shores show more than open water.
            let far_out = smoothstep(3.0, 15.0, -above_water_m);
            survey.water.push((1.0 - smoothstep(0.5, 8.0, above_water_m)) * (1.0 - 0.8 * far_out));
            survey.altitude.push((survey.heights[cell] - low) / (high - low).max(1.0));
        }
        survey
    }

    fn place(&self, cell: usize) -> Vec2 {
        let index = Vec2::new((cell % CELLS) as f32, (cell / CELLS) as f32);
        self.middle + ((index + 0.5) / CELLS as f32 * 2.0 - 1.0) * self.reach_m
    }

    fn cell(&self, at: Vec2) -> usize {
        let share = (at - self.middle) / (2.0 * self.reach_m) + 0.5;
        let [x, z] =
            share.to_array().map(|v| ((v * CELLS as f32).max(0.0) as usize).min(CELLS - 1));
        z * CELLS + x
    }

    /// Mean within `half` cells in x and z.
    fn mean(&self, values: &[f32], cell: usize, half: usize) -> f32 {
        let range = |v: usize| v.saturating_sub(half)..=(v + half).min(CELLS - 1);
        let (mut sum, mut count) = (0.0, 0.0);
        for z in range(cell / CELLS) {
            for x in range(cell % CELLS) {
                sum += values[z * CELLS + x];
                count += 1.0;
            }
        }
        sum / count
    }

    /// How well a cell suits a role, about −1 to 2.
    fn suits(&self, cell: usize, role: Role) -> f32 {
        let (here, around) = (self.forest[cell], self.forest_around[cell]);
        let gentle = 1.0 - smoothstep(0.25, 0.7, self.slope[cell]);
        match role {
            Role::ValleyFloor => {
                gentle - 0.9 * self.stands_out[cell] + 0.8 * self.water[cell]
                    - around
                    - 0.8 * self.altitude[cell]
            }
            // About half of the surroundings is forest, none of the place itself.
            Role::ForestEdge => 0.6 * gentle + 1.2 - 0.8 * here - 2.0 * (around - 0.45).abs(),
            Role::InsideForest | Role::Canopy => here + 0.8 * around + 1.2 * gentle - 1.5,
            Role::Ridge => 1.6 * self.stands_out[cell] + 0.6 * self.altitude[cell] - 0.2 * here,
            Role::Overview => 0.3 * self.altitude[cell],
        }
    }

    /// One place per role from azimuth `from`, each the best of its sector, and what they are worth together.
    fn around(
        &self,
        roles: &[Role],
        from: f32,
        direction: f32,
        radius_m: f32,
    ) -> (f32, Vec<WayPoint>) {
        let mut total = 0.0;
        let mut before = 1.0;
        let mut found = Vec::with_capacity(roles.len());
        for (i, &role) in roles.iter().enumerate() {
            let mut best = (f32::NEG_INFINITY, Vec2::ZERO, before);
            for a in -3..=3 {
                let share = (i as f32 + a as f32 * 0.09) / roles.len() as f32;
                for r in 0..=12 {
                    let radius = NEAREST + (FURTHEST * 0.97 - NEAREST) * r as f32 / 12.0;
                    let toward = Vec2::from_angle(from + direction * TAU * share);
                    let at = self.middle + toward * (radius * radius_m);
                    let change: f32 = radius - before;
                    // Smooth loops: no zigzag between the middle and the border, and the last near the first.
                    let closing = if i + 1 == roles.len() { (radius - 1.0).abs() } else { 0.0 };
                    let score = self.suits(self.cell(at), role) - 1.6 * change * change - closing;
                    if score > best.0 {
                        best = (score, at, radius);
                    }
                }
            }
            total += best.0;
            before = best.2;
            found.push(WayPoint { at: best.1, role });
        }
        (total, found)
    }

    /// What is really there: no forest is claimed where none grows.
    fn honest(&self, point: &WayPoint) -> Role {
        let cell = self.cell(point.at);
        let (here, around) = (self.forest[cell], self.forest_around[cell]);
        let open = if self.stands_out[cell] > 0.25 { Role::Ridge } else { Role::ValleyFloor };
        match point.role {
            Role::InsideForest if around < 0.2 => open,
            Role::InsideForest if here < 0.4 => Role::ForestEdge,
            Role::ForestEdge if around < 0.05 => open,
            Role::ForestEdge if around > 0.95 => Role::InsideForest,
            role => role,
        }
    }
}
