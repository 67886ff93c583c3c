//! Parameters of a plant. Lengths in metres, angles in degrees, colours linear red, green and blue from 0 to 1.
//!
//! The doc comment of a field gives its meaning; its range stands once, in `species/ranges.rs`.

use serde::Deserialize;

/// Linear red, green and blue, each 0 to 1.
pub type LinearRgb = [f32; 3];

/// Outline of the crown: a body of revolution around the trunk with random lobes.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CrownShape {
    /// Where the crown begins, as a share of the tree's height.
    pub base: f32,
    /// Largest radius in metres.
    pub radius_m: f32,
    /// Where it is widest, as a share of the crown's height.
    pub widest: f32,
    /// Superellipse exponent below the widest place; 1 is a cone, 2 an ellipse, more is boxy.
    pub lower_power: f32,
    /// Superellipse exponent above the widest place.
    pub upper_power: f32,
    /// How far lobes swell and hollows shrink the outline, as a share of the radius.
    pub lumpiness: f32,
}

/// Trunk of a tree: level 0 of its stems.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrunkShape {
    /// Trunks that rise from the same root: 1 for trees, several for shrubs.
    pub count: u32,
    /// Angle of several trunks to the vertical, in degrees.
    pub lean_deg: f32,
    /// Radius in metres above the root flare.
    pub radius_m: f32,
    /// Length as a share of the tree's height (less than 1 where limbs form the top).
    pub length: f32,
    /// How much wider the foot is, as a share of the radius.
    pub flare: f32,
    /// Random bending per segment in degrees.
    pub wander_deg: f32,
    /// Segments along it.
    pub segments: u32,
    /// Exponent of the taper: 1 is a cone, more keeps the strength to the top.
    pub taper: f32,
}

/// Stems that grow from the stems of the level below.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StemShape {
    /// Stems per metre of the parent's bearing part.
    pub per_m: f32,
    /// Bearing part of the parent as shares of its length, ascending.
    pub bearing: [f32; 2],
    /// Stems that spring from one height: 1 is a spiral by the golden angle.
    pub whorl: u32,
    /// Angle to the parent at the start and the end of the bearing part, in degrees.
    pub angle_deg: [f32; 2],
    /// Random part of the angle, in degrees.
    pub angle_jitter_deg: f32,
    /// 0 springs off all around, 1 only to the left and right, like fronds.
    pub flatness: f32,
    /// Length as a share of what is left to the outline (first level) or of the parent's length (others).
    pub length: f32,
    /// Random part of the length, as a share of it.
    pub length_jitter: f32,
    /// How much of a stem may leave the outline: 0 ends there, 1 hangs freely out of the crown (never into the ground).
    pub hang: f32,
    /// Turn towards the sky (down if negative) over the inner and the outer half, in degrees.
    pub lift_deg: [f32; 2],
    /// Random bending per segment, in degrees.
    pub wander_deg: f32,
    /// Times that a stem forks, on average.
    pub forks: f32,
    /// Angle between the two arms of a fork, in degrees.
    pub fork_deg: f32,
    /// Share of the stems that broke off and end blunt.
    pub broken: f32,
    /// Radius as a share of the parent's where it springs off.
    pub radius: f32,
    /// Exponent of the taper: 1 is a cone, more keeps the strength to the end.
    pub taper: f32,
    /// Segments along the stem.
    pub segments: u32,
    /// Sides of its tube; 0 draws none, else 3 or more.
    pub sides: u32,
}

/// Bark colours and the trunk's tube.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BarkShape {
    /// Sides of the trunk's tube.
    pub sides: u32,
    /// Ridges and knots of thick wood, as a share of its radius.
    pub gnarl: f32,
    /// Colour at the foot.
    pub foot: LinearRgb,
    /// Colour of the trunk and thick limbs.
    pub trunk: LinearRgb,
    /// Colour of thick wood in the upper part of the tree.
    pub upper: LinearRgb,
    /// Where `trunk` begins and ends to turn into `upper`, as shares of the tree's height, ascending.
    pub upper_from: [f32; 2],
    /// Colour of stems thinner than 2 cm.
    pub twig: LinearRgb,
    /// Colour of the marks.
    pub mark: LinearRgb,
    /// Share of thick wood that is marked.
    pub mark_share: f32,
    /// Perceptual roughness.
    pub roughness: f32,
}

/// Outline of one leaf.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum LeafForm {
    /// Two triangles, folded along the middle.
    Kite,
    /// Four triangles: rounded.
    Oval,
    /// Four triangles: a kite with a pointed lobe on each side.
    Lobed,
    /// Seven triangles: a twig of needles with side twigs to left and right.
    Spray,
}

/// Leaves (or sprays of needles) on the outer stems.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeafShape {
    /// Leaves of the whole tree, spread evenly along its leafy stems (met within a few percent).
    pub count: u32,
    /// Outline of a leaf.
    pub form: LeafForm,
    /// How many of the last levels bear leaves (stems without children always do).
    pub levels: u32,
    /// Where on a stem its leaves begin, as a share of its length.
    pub from: f32,
    /// Leaves a place; they share a vertex.
    pub per_node: u32,
    /// Length in metres.
    pub length_m: f32,
    /// Width as a share of the length.
    pub width: f32,
    /// Random part of the size, as a share of it.
    pub size_jitter: f32,
    /// Where a leaf is widest, as a share of its length.
    pub widest: f32,
    /// Fold along the middle, in degrees.
    pub fold_deg: f32,
    /// Angle to the stem, in degrees.
    pub angle_deg: f32,
    /// 0 all around the stem, 1 only to the left and right.
    pub flatness: f32,
    /// Pull of gravity on the leaf's direction; negative is up.
    pub droop: f32,
    /// Share of the shading normal that is bent to the outside.
    pub bend: f32,
    /// Colour deep inside the crown.
    pub inside: LinearRgb,
    /// Colour at the crown's surface.
    pub outside: LinearRgb,
    /// Colour of the crown's sunlit top.
    pub top: LinearRgb,
    /// Random part of a leaf's brightness.
    pub color_jitter: f32,
    /// Perceptual roughness.
    pub roughness: f32,
}

/// A plant of stems: trees and shrubs.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TreeShape {
    /// Height in metres.
    pub height_m: f32,
    /// Random part of the height, as a share of it.
    pub height_jitter: f32,
    /// Outline.
    pub crown: CrownShape,
    /// Level 0.
    pub trunk: TrunkShape,
    /// Levels 1 (limbs on the trunk), 2 (boughs on limbs) and so on; one to four.
    pub levels: Vec<StemShape>,
    /// Colours of wood.
    pub bark: BarkShape,
    /// Leaves; absent on dead trees.
    #[serde(default)]
    pub leaves: Option<LeafShape>,
}

/// Leaflets to both sides of a blade, which make it a frond.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeafletShape {
    /// Leaflets on each side.
    pub pairs: u32,
    /// Share of the blade's length below the first pair.
    pub from: f32,
    /// Length of the longest ones as a share of the blade's length.
    pub length: f32,
    /// Where along the leafy part they are longest.
    pub longest: f32,
    /// Width as a share of their length.
    pub width: f32,
    /// Angle to the blade, in degrees.
    pub angle_deg: f32,
}

/// Blades (grass) or fronds (fern) that rise from the ground and arch over.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BladeShape {
    /// How many.
    pub count: u32,
    /// Shortest and longest, as shares of the length that reaches the plant's height, ascending.
    pub length: [f32; 2],
    /// Width at the widest place in metres.
    pub width_m: f32,
    /// Segments along a blade.
    pub segments: u32,
    /// Angle to the vertical at the ground of the innermost and the outermost, in degrees.
    pub angle_deg: [f32; 2],
    /// Bending from foot to tip, in degrees.
    pub arch_deg: f32,
    /// Random part of all angles, in degrees.
    pub wander_deg: f32,
    /// Leaflets; absent on grass.
    #[serde(default)]
    pub leaflets: Option<LeafletShape>,
    /// Share of the shading normal that is bent up and out.
    pub bend: f32,
    /// Colour at the ground.
    pub foot: LinearRgb,
    /// Colour in the middle.
    pub middle: LinearRgb,
    /// Colour at the tip.
    pub tip: LinearRgb,
    /// Random part of a blade's brightness.
    pub color_jitter: f32,
    /// Perceptual roughness.
    pub roughness: f32,
}

/// Stalks, each with a blossom at its end.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StalkShape {
    /// How many.
    pub count: u32,
    /// Shortest and longest, as shares of the plant's height, ascending.
    pub length: [f32; 2],
    /// Largest angle to the vertical, in degrees.
    pub lean_deg: f32,
    /// Radius in metres.
    pub radius_m: f32,
    /// Leaves on each.
    pub leaves: u32,
    /// Length of those in metres.
    pub leaf_length_m: f32,
    /// Width of those as a share of their length.
    pub leaf_width: f32,
    /// Colour.
    pub color: LinearRgb,
}

/// A plant without wood: grass, ferns, flowers.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoverShape {
    /// Height in metres.
    pub height_m: f32,
    /// Random part of the height, as a share of it.
    pub height_jitter: f32,
    /// Blades rise from a disc of this radius in metres.
    pub base_radius_m: f32,
    /// Blades or fronds.
    pub blades: BladeShape,
    /// Stalks with blossoms; absent on ferns.
    #[serde(default)]
    pub stalks: Option<StalkShape>,
}

/// Blossoms: at the ends of stalks, or on the leafy stems of a tree.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlossomShape {
    /// Blossoms of a whole tree or shrub (stalks bear one each, whatever this says).
    pub count: u32,
    /// Petals of one.
    pub petals: u32,
    /// Radius in metres.
    pub radius_m: f32,
    /// Width of a petal as a share of its length.
    pub petal_width: f32,
    /// How far petals rise from the flat, in degrees.
    pub cup_deg: f32,
    /// Radius of the disc in the middle, as a share of the blossom's.
    pub disc: f32,
    /// Colours of petals: each plant has one mixed from two neighbours.
    pub colors: Vec<LinearRgb>,
    /// Colour of the disc.
    pub disc_color: LinearRgb,
}

/// Autumn of a deciduous plant.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AutumnShape {
    /// Colours of turned leaves, from the first to the last that a leaf may take; one to six.
    pub colors: Vec<LinearRgb>,
    /// How much later the last leaf turns than the first, as a share of the autumn.
    pub spread: f32,
    /// Share of the leaves that lie on the ground at the end.
    pub fallen: f32,
}
