//! Parameters of a tree and their ranges. Lengths in metres, angles in degrees, colours linear.

/// Outline of the crown: a body of revolution around the trunk with random lobes.
#[derive(Clone, Debug, PartialEq)]
pub struct CrownShape {
    /// Where the crown begins, as a share of the tree's height; 0 to 0.8.
    pub base: f32,
    /// Largest radius in metres; 0.2 to 20.
    pub radius_m: f32,
    /// Where it is widest, as a share of the crown's height; 0 to 1.
    pub widest: f32,
    /// Superellipse exponent below the widest place; 1 is a cone, 2 an ellipse, more is boxy; 0.5 to 6.
    pub lower_power: f32,
    /// Superellipse exponent above the widest place; 0.5 to 6.
    pub upper_power: f32,
    /// How far lobes swell and hollows shrink the outline, as a share of the radius; 0 to 0.6.
    pub lumpiness: f32,
}

/// Trunk of a tree.
#[derive(Clone, Debug, PartialEq)]
pub struct TrunkShape {
    /// Radius in metres above the root flare; 0.02 to 2.
    pub radius_m: f32,
    /// Length as a share of the tree's height (less than 1 where limbs form the top); 0.3 to 1.
    pub length: f32,
    /// How much wider the foot is, as a share of the radius; 0 to 2.
    pub flare: f32,
    /// Random bending per segment in degrees; 0 to 30.
    pub wander_deg: f32,
    /// Rings; 4 to 64.
    pub segments: u32,
}

/// Stems that grow from the stems of the level below.
#[derive(Clone, Debug, PartialEq)]
pub struct StemShape {
    /// Stems per metre of the parent's bearing part; 0 to 20.
    pub per_m: f32,
    /// Bearing part of the parent as shares of its length; 0 to 1, ascending.
    pub bearing: [f32; 2],
    /// Stems that spring from one height: 1 is a spiral by the golden angle; 1 to 12.
    pub whorl: u32,
    /// Angle to the parent at the start and the end of the bearing part, in degrees; 0 to 150.
    pub angle_deg: [f32; 2],
    /// Random part of the angle, in degrees; 0 to 60.
    pub angle_jitter_deg: f32,
    /// 0 springs off all around, 1 only to the left and right, like fronds; 0 to 1.
    pub flatness: f32,
    /// Length as a share of what is left to the outline (limbs) or of the parent's length (others); 0 to 1.5.
    pub length: f32,
    /// Random part of the length, as a share of it; 0 to 0.9.
    pub length_jitter: f32,
    /// Turn towards the sky (down if negative) over the inner and the outer half, in degrees; −150 to 150.
    pub lift_deg: [f32; 2],
    /// Random bending per segment, in degrees; 0 to 60.
    pub wander_deg: f32,
    /// Radius as a share of the parent's where it springs off; 0.05 to 1.
    pub radius: f32,
    /// Segments along the stem; 1 to 16.
    pub segments: u32,
    /// Sides of its tube; 0 draws none, else 3 to 16.
    pub sides: u32,
}

/// Bark colours and the trunk's tube.
#[derive(Clone, Debug, PartialEq)]
pub struct BarkShape {
    /// Sides of the trunk's tube; 3 to 16.
    pub sides: u32,
    /// Colour at the foot.
    pub foot: [f32; 3],
    /// Colour of the trunk and thick limbs.
    pub trunk: [f32; 3],
    /// Colour of stems thinner than 2 cm.
    pub twig: [f32; 3],
    /// Colour of the marks.
    pub mark: [f32; 3],
    /// Share of the vertices of thick stems that are marked; 0 to 1.
    pub mark_share: f32,
    /// Perceptual roughness; 0 to 1.
    pub roughness: f32,
}

/// Leaves (or sprays of needles) on the stems of the last level.
#[derive(Clone, Debug, PartialEq)]
pub struct LeafShape {
    /// Leaves of the whole tree, spread evenly along its leafy stems (met within a few percent); 0 to 500,000.
    pub count: u32,
    /// How many of the last levels bear leaves (stems without children always do); 1 to 3.
    pub levels: u32,
    /// Leaves a place; they share a vertex; 1 to 8.
    pub per_node: u32,
    /// Length in metres; 0.01 to 2.
    pub length_m: f32,
    /// Width as a share of the length; 0.02 to 2.
    pub width: f32,
    /// Random part of the size, as a share of it; 0 to 0.9.
    pub size_jitter: f32,
    /// Where a leaf is widest, as a share of its length; 0.1 to 0.9.
    pub widest: f32,
    /// Fold along the middle, in degrees; 0 to 80.
    pub fold_deg: f32,
    /// Angle to the stem, in degrees; 0 to 150.
    pub angle_deg: f32,
    /// 0 all around the stem, 1 only to the left and right; 0 to 1.
    pub flatness: f32,
    /// Pull of gravity on the leaf's direction; −1 (up) to 2.
    pub droop: f32,
    /// Share of the shading normal that is bent to the outside; 0 to 1.
    pub bend: f32,
    /// Colours deep inside the crown, at its surface, and of its sunlit top.
    pub inside: [f32; 3],
    /// See `inside`.
    pub outside: [f32; 3],
    /// See `inside`.
    pub top: [f32; 3],
    /// Random part of a leaf's brightness; 0 to 0.8.
    pub color_jitter: f32,
    /// Perceptual roughness; 0 to 1.
    pub roughness: f32,
}

/// Everything that describes a species.
#[derive(Clone, Debug, PartialEq)]
pub struct TreeShape {
    /// Height in metres; 1 to 60.
    pub height_m: f32,
    /// Random part of the height, as a share of it; 0 to 0.5.
    pub height_jitter: f32,
    /// Outline.
    pub crown: CrownShape,
    /// Level 0.
    pub trunk: TrunkShape,
    /// Level 1, on the trunk.
    pub limbs: StemShape,
    /// Level 2, on limbs.
    pub boughs: StemShape,
    /// Level 3, on boughs; with `per_m` 0 the boughs bear the leaves.
    pub twigs: StemShape,
    /// Colours of wood.
    pub bark: BarkShape,
    /// Leaves.
    pub leaves: LeafShape,
}

impl TreeShape {
    /// This shape with every value inside its range; NaN becomes the lower end.
    pub fn clamped(&self) -> Self {
        let mut shape = self.clone();
        shape.height_m = within(shape.height_m, 1.0, 60.0);
        shape.height_jitter = within(shape.height_jitter, 0.0, 0.5);
        let crown = &mut shape.crown;
        crown.base = within(crown.base, 0.0, 0.8);
        crown.radius_m = within(crown.radius_m, 0.2, 20.0);
        crown.widest = within(crown.widest, 0.0, 1.0);
        crown.lower_power = within(crown.lower_power, 0.5, 6.0);
        crown.upper_power = within(crown.upper_power, 0.5, 6.0);
        crown.lumpiness = within(crown.lumpiness, 0.0, 0.6);
        let trunk = &mut shape.trunk;
        trunk.radius_m = within(trunk.radius_m, 0.02, 2.0);
        trunk.length = within(trunk.length, 0.3, 1.0);
        trunk.flare = within(trunk.flare, 0.0, 2.0);
        trunk.wander_deg = within(trunk.wander_deg, 0.0, 30.0);
        trunk.segments = trunk.segments.clamp(4, 64);
        for stem in [&mut shape.limbs, &mut shape.boughs, &mut shape.twigs] {
            stem.clamp();
        }
        shape.bark.clamp();
        shape.leaves.clamp();
        shape
    }
}

impl StemShape {
    fn clamp(&mut self) {
        self.per_m = within(self.per_m, 0.0, 20.0);
        self.bearing[0] = within(self.bearing[0], 0.0, 1.0);
        self.bearing[1] = within(self.bearing[1], self.bearing[0], 1.0);
        self.whorl = self.whorl.clamp(1, 12);
        self.angle_deg = self.angle_deg.map(|v| within(v, 0.0, 150.0));
        self.angle_jitter_deg = within(self.angle_jitter_deg, 0.0, 60.0);
        self.flatness = within(self.flatness, 0.0, 1.0);
        self.length = within(self.length, 0.0, 1.5);
        self.length_jitter = within(self.length_jitter, 0.0, 0.9);
        self.lift_deg = self.lift_deg.map(|v| within(v, -150.0, 150.0));
        self.wander_deg = within(self.wander_deg, 0.0, 60.0);
        self.radius = within(self.radius, 0.05, 1.0);
        self.segments = self.segments.clamp(1, 16);
        self.sides = if self.sides == 0 { 0 } else { self.sides.clamp(3, 16) };
    }
}

impl BarkShape {
    fn clamp(&mut self) {
        self.sides = self.sides.clamp(3, 16);
        for color in [&mut self.foot, &mut self.trunk, &mut self.twig, &mut self.mark] {
            *color = color.map(|v| within(v, 0.0, 1.0));
        }
        self.mark_share = within(self.mark_share, 0.0, 1.0);
        self.roughness = within(self.roughness, 0.0, 1.0);
    }
}

impl LeafShape {
    fn clamp(&mut self) {
        self.count = self.count.min(500_000);
        self.levels = self.levels.clamp(1, 3);
        self.per_node = self.per_node.clamp(1, 8);
        self.length_m = within(self.length_m, 0.01, 2.0);
        self.width = within(self.width, 0.02, 2.0);
        self.size_jitter = within(self.size_jitter, 0.0, 0.9);
        self.widest = within(self.widest, 0.1, 0.9);
        self.fold_deg = within(self.fold_deg, 0.0, 80.0);
        self.angle_deg = within(self.angle_deg, 0.0, 150.0);
        self.flatness = within(self.flatness, 0.0, 1.0);
        self.droop = within(self.droop, -1.0, 2.0);
        self.bend = within(self.bend, 0.0, 1.0);
        for color in [&mut self.inside, &mut self.outside, &mut self.top] {
            *color = color.map(|v| within(v, 0.0, 1.0));
        }
        self.color_jitter = within(self.color_jitter, 0.0, 0.8);
        self.roughness = within(self.roughness, 0.0, 1.0);
    }
}

/// `f32::clamp` that also takes NaN (to the lower end).
fn within(value: f32, low: f32, high: f32) -> f32 {
    if value.is_nan() { low } else { value.clamp(low, high) }
}
