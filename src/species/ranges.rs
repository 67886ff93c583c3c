//! Ranges of all parameters, once: the same walk checks what a file says and clamps what code says. O(parameters).

use super::shape::*;

/// A number outside its range.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct OutOfRange {
    /// Dotted path of the field, such as `levels[0].angle_deg[1]`.
    pub field: String,
    pub value: f64,
    pub low: f64,
    pub high: f64,
}

/// What is done with each number.
enum Mode {
    /// Into its range; NaN becomes the lower end.
    Clamp,
    /// The first that is outside is kept.
    Check(Option<OutOfRange>),
}

/// Visits every number of a shape with its path and range.
pub(super) struct Walk {
    path: String,
    mode: Mode,
}

trait Number: Copy {
    fn to_f64(self) -> f64;
    fn from_f64(value: f64) -> Self;
}

impl Number for f32 {
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    fn from_f64(value: f64) -> Self {
        value as Self
    }
}

impl Number for u32 {
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    fn from_f64(value: f64) -> Self {
        value as Self
    }
}

/// The number with the fewest digits that reads back as `value`.
fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

impl Walk {
    fn number<N: Number>(&mut self, name: &str, value: &mut N, low: f32, high: f32) {
        let given = value.to_f64();
        if (f64::from(low)..=f64::from(high)).contains(&given) {
            return;
        }
        // As people write them: 0.2, not 0.20000000298.
        let [low, high] = [low, high].map(shortest);
        match &mut self.mode {
            Mode::Clamp => {
                let inside = if given.is_nan() { low } else { given.clamp(low, high) };
                *value = N::from_f64(inside);
            }
            Mode::Check(found) => {
                let field = format!("{}{name}", self.path);
                let value = shortest(given as f32);
                found.get_or_insert(OutOfRange { field, value, low, high });
            }
        }
    }

    fn numbers<N: Number>(&mut self, name: &str, values: &mut [N], low: f32, high: f32) {
        for (i, value) in values.iter_mut().enumerate() {
            self.number(&format!("{name}[{i}]"), value, low, high);
        }
    }

    fn color(&mut self, name: &str, color: &mut LinearRgb) {
        self.numbers(name, color, 0.0, 1.0);
    }

    /// Two numbers, of which the second is not below the first.
    fn ascending(&mut self, name: &str, pair: &mut [f32; 2], low: f32, high: f32) {
        self.number(&format!("{name}[0]"), &mut pair[0], low, high);
        let from = if pair[0].is_nan() { low } else { pair[0].clamp(low, high) };
        self.number(&format!("{name}[1]"), &mut pair[1], from, high);
    }

    /// A list of colours; a list that is too long is cut when clamping.
    fn palette(&mut self, name: &str, colors: &mut Vec<LinearRgb>) {
        let mut length = colors.len() as u32;
        self.number(&format!("{name}.length"), &mut length, 1.0, 6.0);
        colors.resize(length as usize, [0.2; 3]);
        for (i, color) in colors.iter_mut().enumerate() {
            self.color(&format!("{name}[{i}]"), color);
        }
    }

    /// Visits what stands below `name`.
    fn inside(&mut self, name: &str, visit: impl FnOnce(&mut Self)) {
        let length = self.path.len();
        self.path.push_str(name);
        self.path.push('.');
        visit(self);
        self.path.truncate(length);
    }
}

/// A shape that knows the ranges of its numbers.
pub(super) trait Ranged: Clone {
    /// Visits every number.
    fn walk(&mut self, walk: &mut Walk);

    /// This shape with every value inside its range; NaN becomes the lower end.
    fn clamped(&self) -> Self {
        let mut shape = self.clone();
        shape.walk(&mut Walk { path: String::new(), mode: Mode::Clamp });
        shape
    }

    /// The first value outside its range; `path` is that of this shape.
    fn out_of_range(&self, path: &str) -> Option<OutOfRange> {
        let mut walk = Walk { path: format!("{path}."), mode: Mode::Check(None) };
        self.clone().walk(&mut walk);
        match walk.mode {
            Mode::Check(found) => found,
            Mode::Clamp => None,
        }
    }
}

impl Ranged for TreeShape {
    fn walk(&mut self, walk: &mut Walk) {
        walk.number("height_m", &mut self.height_m, 0.2, 80.0);
        walk.number("height_jitter", &mut self.height_jitter, 0.0, 0.5);
        walk.inside("crown", |walk| {
            let crown = &mut self.crown;
            walk.number("base", &mut crown.base, 0.0, 0.9);
            walk.number("radius_m", &mut crown.radius_m, 0.1, 30.0);
            walk.number("widest", &mut crown.widest, 0.0, 1.0);
            walk.number("lower_power", &mut crown.lower_power, 0.5, 6.0);
            walk.number("upper_power", &mut crown.upper_power, 0.5, 6.0);
            walk.number("lumpiness", &mut crown.lumpiness, 0.0, 0.9);
        });
        walk.inside("trunk", |walk| {
            let trunk = &mut self.trunk;
            walk.number("count", &mut trunk.count, 1.0, 40.0);
            walk.number("lean_deg", &mut trunk.lean_deg, 0.0, 80.0);
            walk.number("radius_m", &mut trunk.radius_m, 0.005, 3.0);
            walk.number("length", &mut trunk.length, 0.2, 1.0);
            walk.number("flare", &mut trunk.flare, 0.0, 2.0);
            walk.number("wander_deg", &mut trunk.wander_deg, 0.0, 30.0);
            walk.number("segments", &mut trunk.segments, 3.0, 128.0);
            walk.number("taper", &mut trunk.taper, 0.5, 4.0);
        });
        let mut levels = self.levels.len() as u32;
        walk.number("levels.length", &mut levels, 1.0, 4.0);
        if let Some(last) = self.levels.last().cloned() {
            self.levels.resize(levels as usize, last);
        }
        for (i, level) in self.levels.iter_mut().enumerate() {
            walk.inside(&format!("levels[{i}]"), |walk| walk_stem(level, walk));
        }
        walk.inside("bark", |walk| walk_bark(&mut self.bark, walk));
        if let Some(leaves) = &mut self.leaves {
            walk.inside("leaves", |walk| walk_leaves(leaves, walk));
        }
    }
}

fn walk_stem(stem: &mut StemShape, walk: &mut Walk) {
    walk.number("per_m", &mut stem.per_m, 0.0, 60.0);
    walk.ascending("bearing", &mut stem.bearing, 0.0, 1.0);
    walk.number("whorl", &mut stem.whorl, 1.0, 12.0);
    walk.numbers("angle_deg", &mut stem.angle_deg, 0.0, 150.0);
    walk.number("angle_jitter_deg", &mut stem.angle_jitter_deg, 0.0, 60.0);
    walk.number("flatness", &mut stem.flatness, 0.0, 1.0);
    walk.number("length", &mut stem.length, 0.0, 3.0);
    walk.number("length_jitter", &mut stem.length_jitter, 0.0, 0.9);
    walk.number("hang", &mut stem.hang, 0.0, 1.0);
    walk.numbers("lift_deg", &mut stem.lift_deg, -150.0, 150.0);
    walk.number("wander_deg", &mut stem.wander_deg, 0.0, 60.0);
    walk.number("forks", &mut stem.forks, 0.0, 4.0);
    walk.number("fork_deg", &mut stem.fork_deg, 0.0, 120.0);
    walk.number("broken", &mut stem.broken, 0.0, 1.0);
    walk.number("radius", &mut stem.radius, 0.05, 1.0);
    walk.number("taper", &mut stem.taper, 0.5, 4.0);
    walk.number("segments", &mut stem.segments, 1.0, 24.0);
    walk.number("sides", &mut stem.sides, 0.0, 16.0);
}

fn walk_bark(bark: &mut BarkShape, walk: &mut Walk) {
    walk.number("sides", &mut bark.sides, 3.0, 32.0);
    walk.number("gnarl", &mut bark.gnarl, 0.0, 0.5);
    walk.color("foot", &mut bark.foot);
    walk.color("trunk", &mut bark.trunk);
    walk.color("upper", &mut bark.upper);
    walk.ascending("upper_from", &mut bark.upper_from, 0.0, 1.0);
    walk.color("twig", &mut bark.twig);
    walk.color("mark", &mut bark.mark);
    walk.number("mark_share", &mut bark.mark_share, 0.0, 1.0);
    walk.number("roughness", &mut bark.roughness, 0.0, 1.0);
}

fn walk_leaves(leaves: &mut LeafShape, walk: &mut Walk) {
    walk.number("count", &mut leaves.count, 0.0, 500_000.0);
    walk.number("levels", &mut leaves.levels, 1.0, 4.0);
    walk.number("from", &mut leaves.from, 0.0, 0.95);
    walk.number("per_node", &mut leaves.per_node, 1.0, 16.0);
    walk.number("length_m", &mut leaves.length_m, 0.005, 3.0);
    walk.number("width", &mut leaves.width, 0.01, 2.0);
    walk.number("size_jitter", &mut leaves.size_jitter, 0.0, 0.9);
    walk.number("widest", &mut leaves.widest, 0.1, 0.9);
    walk.number("fold_deg", &mut leaves.fold_deg, 0.0, 80.0);
    walk.number("angle_deg", &mut leaves.angle_deg, 0.0, 150.0);
    walk.number("flatness", &mut leaves.flatness, 0.0, 1.0);
    walk.number("droop", &mut leaves.droop, -1.0, 3.0);
    walk.number("bend", &mut leaves.bend, 0.0, 1.0);
    walk.color("inside", &mut leaves.inside);
    walk.color("outside", &mut leaves.outside);
    walk.color("top", &mut leaves.top);
    walk.number("color_jitter", &mut leaves.color_jitter, 0.0, 0.8);
    walk.number("roughness", &mut leaves.roughness, 0.0, 1.0);
}

impl Ranged for CoverShape {
    fn walk(&mut self, walk: &mut Walk) {
        walk.number("height_m", &mut self.height_m, 0.02, 6.0);
        walk.number("height_jitter", &mut self.height_jitter, 0.0, 0.5);
        walk.number("base_radius_m", &mut self.base_radius_m, 0.0, 2.0);
        walk.inside("blades", |walk| walk_blades(&mut self.blades, walk));
        if let Some(stalks) = &mut self.stalks {
            walk.inside("stalks", |walk| {
                walk.number("count", &mut stalks.count, 0.0, 500.0);
                walk.ascending("length", &mut stalks.length, 0.1, 1.5);
                walk.number("lean_deg", &mut stalks.lean_deg, 0.0, 60.0);
                walk.number("radius_m", &mut stalks.radius_m, 0.0005, 0.05);
                walk.number("leaves", &mut stalks.leaves, 0.0, 20.0);
                walk.number("leaf_length_m", &mut stalks.leaf_length_m, 0.005, 0.6);
                walk.number("leaf_width", &mut stalks.leaf_width, 0.02, 2.0);
                walk.color("color", &mut stalks.color);
            });
        }
    }
}

fn walk_blades(blades: &mut BladeShape, walk: &mut Walk) {
    walk.number("count", &mut blades.count, 0.0, 2000.0);
    walk.ascending("length", &mut blades.length, 0.05, 1.5);
    walk.number("width_m", &mut blades.width_m, 0.0005, 0.3);
    walk.number("segments", &mut blades.segments, 1.0, 24.0);
    walk.numbers("angle_deg", &mut blades.angle_deg, 0.0, 89.0);
    walk.number("arch_deg", &mut blades.arch_deg, 0.0, 170.0);
    walk.number("wander_deg", &mut blades.wander_deg, 0.0, 40.0);
    if let Some(leaflets) = &mut blades.leaflets {
        walk.inside("leaflets", |walk| {
            walk.number("pairs", &mut leaflets.pairs, 1.0, 60.0);
            walk.number("from", &mut leaflets.from, 0.0, 0.9);
            walk.number("length", &mut leaflets.length, 0.01, 1.0);
            walk.number("longest", &mut leaflets.longest, 0.0, 1.0);
            walk.number("width", &mut leaflets.width, 0.02, 1.0);
            walk.number("angle_deg", &mut leaflets.angle_deg, 5.0, 120.0);
        });
    }
    walk.number("bend", &mut blades.bend, 0.0, 1.0);
    walk.color("foot", &mut blades.foot);
    walk.color("middle", &mut blades.middle);
    walk.color("tip", &mut blades.tip);
    walk.number("color_jitter", &mut blades.color_jitter, 0.0, 0.8);
    walk.number("roughness", &mut blades.roughness, 0.0, 1.0);
}

impl Ranged for BlossomShape {
    fn walk(&mut self, walk: &mut Walk) {
        walk.number("count", &mut self.count, 0.0, 50_000.0);
        walk.number("petals", &mut self.petals, 3.0, 40.0);
        walk.number("radius_m", &mut self.radius_m, 0.002, 0.5);
        walk.number("petal_width", &mut self.petal_width, 0.05, 2.0);
        walk.number("cup_deg", &mut self.cup_deg, -60.0, 89.0);
        walk.number("disc", &mut self.disc, 0.0, 0.9);
        walk.palette("colors", &mut self.colors);
        walk.color("disc_color", &mut self.disc_color);
    }
}

impl Ranged for AutumnShape {
    fn walk(&mut self, walk: &mut Walk) {
        walk.palette("colors", &mut self.colors);
        walk.number("spread", &mut self.spread, 0.0, 0.9);
        walk.number("fallen", &mut self.fallen, 0.0, 1.0);
    }
}
