//! Settings of a camera and of the plugin.

use super::grove::SAMPLES_PER_TREE;
use bevy::{prelude::*, render::extract_component::ExtractComponent};

/// Shape of a splat. All have the area that their point stands for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
pub enum SplatShape {
    /// The piece of the surface that an LDI pixel hit: pieces tile the surface. Discs where a tree was peeled from more
    /// than three directions.
    #[default]
    Cells,
    /// Discs that lie in the surface.
    Discs,
    /// Screen-aligned squares, for comparison: they thin and fatten crowns.
    Squares,
}

/// What is not drawn because something is in front of it.
///
/// Two phases: what the depths of the frame before do not hide is drawn first, then what this frame's do not hide of the
/// rest. Nothing that would be seen is missing, however fast the camera moves. Trees hide each other; meshes and ground hide
/// trees for cameras with a [`DepthPrepass`](bevy::core_pipeline::prepass::DepthPrepass) and without MSAA.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
pub enum Occlusion {
    /// Everything in the frustum is drawn.
    Off,
    /// What is hidden behind every pixel is not drawn: the same picture.
    Exact,
    /// Single pixels that show something far through a crown count as closed (the largest of each 2×2 pixels), which hides
    /// much more behind crowns; what could only be seen through such holes may lack.
    #[default]
    Closed,
}

/// Which of its points a tree shows from frame to frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
pub enum TemporalSampling {
    /// Windows on cameras with a [`TemporalJitter`](bevy::render::camera::TemporalJitter), which temporal antialiasing adds;
    /// prefixes on others.
    #[default]
    Auto,
    /// The first points of its list: the same in every frame.
    Prefix,
    /// As many points, but others in each of eight frames. A camera that averages frames then sees eight times the
    /// points; one that does not sees noise.
    Windows,
}

/// What a camera shows of the points instead of their lit colours: to see what the level of detail does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
pub enum DebugView {
    /// The picture.
    #[default]
    Off,
    /// Points red, near meshes blue (the figure of Chen and Nguyen 2001). Every camera then sees the meshes blue.
    PointsAndTriangles,
    /// Length of the prefix that is drawn, `N / N0`: red is all points, and each step towards blue fewer (blue: 1/4096).
    PrefixLength,
    /// Points per pixel of the tree's surface seen face on, before fading: blue 1/4 or less, green 2, red 16 or more. It
    /// is `q` until a tree has no more points to give.
    PointsPerPixel,
    /// Trees in the crossfade band orange, complete points green.
    FadeBand,
    /// A colour for each 256 neighbours of the instance buffer.
    Tiles,
    /// Shading normals in world space as colours: x, y, z from -1 to 1 are red, green, blue from 0 to 1.
    SurfelNormals,
    /// How much of the sky reaches each point: white is all of it.
    AmbientVisibility,
    /// Colours without light.
    Albedo,
}

/// A view that decides what another camera draws.
#[derive(Clone, Copy, Debug, PartialEq, Reflect)]
pub struct CullingView {
    /// Its projection and place: what lies outside is not drawn.
    pub clip_from_world: Mat4,
    /// Its eye, world space: distances, and so the numbers of points, are measured from here.
    pub eye: Vec3,
}

impl CullingView {
    /// That of a camera as it is now.
    pub fn of(camera: &Camera, transform: &GlobalTransform) -> Self {
        Self {
            clip_from_world: camera.clip_from_view() * transform.to_matrix().inverse(),
            eye: transform.translation(),
        }
    }
}

/// Which kernels draw the points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
pub enum SplatPath {
    /// 64-bit atomics where the device has them, else two passes of 32 bits.
    #[default]
    Auto,
    /// One pass of 64-bit `atomicMax`. Draws nothing, with an error, where they are missing.
    U64,
    /// Two passes of 32-bit `atomicMax`: the same picture at 1.3 to 1.9 times the splatting cost.
    U32,
}

/// How a camera draws trees. Every `Camera3d` draws them with the defaults; add this component to change that.
#[derive(Component, Clone, Debug, PartialEq, Reflect, ExtractComponent)]
#[reflect(Component, Default)]
pub struct TreelineSettings {
    /// Draw trees at all. Default: true.
    pub enabled: bool,
    /// `q`: points per pixel that the surface of a tree would cover, 0.05 to 16. Points cost in proportion; error
    /// falls. 1 is the paper. Default: 2 (measured, see `docs/results.md`).
    pub quality: f32,
    /// Trees nearer than this are meshes even where the paper's `d0` is less, metres. Default: 15.
    pub min_mesh_distance: f32,
    /// Width of the band in which mesh and points change, as a share of its distance, 0 to 0.9. Default: 0.25.
    pub fade_width: f32,
    /// How much the distance of that band differs between instances, as a share, 0 to 0.9. Default: 0.15.
    pub fade_jitter: f32,
    /// Overlap of splats, 0 to 1 (see [`lod::splat_size`](crate::lod::splat_size)). Default: 0.22.
    pub overlap_gain: f32,
    /// Shape of the splats. Default: cells.
    pub splat_shape: SplatShape,
    /// Strength of the contrast correction, 0 to 1: a pixel of a far crown that shows one leaf of many is moved towards the
    /// mean of its tree, by as much as its variance is too large (see [`lod::contrast`](crate::lod::contrast)). Antialiasing
    /// averages leaves itself, and then less is done. Of light only that of directional lights, where there are no others.
    /// 0 is off and costs nothing. Default: 0.5 (measured, see `docs/results.md`).
    pub contrast: f32,
    /// What is not drawn because it is hidden. Default: closed.
    pub occlusion: Occlusion,
    /// Samples of points in each pixel: 1 or 4. 4 antialias every single frame, without a history, for pictures and for
    /// cameras with [`Msaa`]; each point that a pixel shows is lit once. Default: 1.
    pub samples: u32,
    /// Which points trees show from frame to frame. Default: auto, other points in each frame of temporal antialiasing.
    pub temporal: TemporalSampling,
    /// What to show instead of lit points. Default: off, which costs nothing.
    pub debug_view: DebugView,
    /// Another view that decides which trees are drawn and with how many points, to look at culling from outside. Near
    /// meshes stay where the camera is. Default: none.
    pub culling_view: Option<CullingView>,
    /// Points per frame at most, in millions; 64 points are a work item. Items that do not fit are counted and reported,
    /// and later frames are drawn with less quality, evenly, until they fit. 116 bytes of GPU memory for each 64 points.
    /// Default: 16.
    pub point_capacity_millions: f32,
}

impl Default for TreelineSettings {
    fn default() -> Self {
        Self {
            enabled: true,
            quality: 2.0,
            min_mesh_distance: 15.0,
            fade_width: 0.25,
            fade_jitter: 0.15,
            overlap_gain: crate::lod::splat_size::OVERLAP_GAIN,
            splat_shape: SplatShape::Cells,
            contrast: 0.5,
            occlusion: Occlusion::Closed,
            samples: 1,
            temporal: TemporalSampling::Auto,
            debug_view: DebugView::Off,
            culling_view: None,
            point_capacity_millions: 16.0,
        }
    }
}

impl TreelineSettings {
    /// These settings with every value moved into its range, and what was moved, for a warning.
    pub fn clamped(&self) -> (Self, Vec<&'static str>) {
        let mut out = self.clone();
        let mut moved = vec![];
        let mut clamp = |value: &mut f32, low: f32, high: f32, default: f32, name| {
            let inside = if value.is_nan() { default } else { value.clamp(low, high) };
            if inside != *value {
                *value = inside;
                moved.push(name);
            }
        };
        clamp(&mut out.quality, 0.05, 16.0, 2.0, "quality");
        clamp(&mut out.min_mesh_distance, 0.0, 1e6, 15.0, "min_mesh_distance");
        clamp(&mut out.fade_width, 0.0, 0.9, 0.25, "fade_width");
        clamp(&mut out.fade_jitter, 0.0, 0.9, 0.15, "fade_jitter");
        clamp(&mut out.overlap_gain, 0.0, 1.0, 0.22, "overlap_gain");
        clamp(&mut out.contrast, 0.0, 1.0, 0.5, "contrast");
        clamp(&mut out.point_capacity_millions, 0.01, 1000.0, 16.0, "point_capacity_millions");
        let samples = if out.samples > 1 { 4 } else { 1 };
        if out.samples != samples {
            out.samples = samples;
            moved.push("samples");
        }
        (out, moved)
    }
}

/// What a camera's [`TreelineSettings::quality`] is multiplied by, 0 to 1: written by its
/// [`QualityGovernor`](crate::QualityGovernor), for others to read. Without this component: 1.
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect, ExtractComponent)]
#[reflect(Component, Default)]
pub struct QualityFactor(pub(crate) f32);

impl Default for QualityFactor {
    fn default() -> Self {
        Self(1.0)
    }
}

impl QualityFactor {
    /// The factor.
    pub fn get(self) -> f32 {
        self.0
    }
}

/// How much of new forests is sent to the GPU in a frame, so that streaming never holds up one frame for long. A
/// resource.
///
/// Forests that do not fit wait, the longest waiting first, and are not drawn until then; one a frame is always sent,
/// however large. Without a limit every picture is complete. The first forests of an app, and changes of forests that are
/// drawn already, are sent at once in any case.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Resource, Default)]
pub struct UploadBudget {
    /// Bytes a frame (a tree takes 32), `None` for no limit. Default: `None`.
    pub bytes_per_frame: Option<usize>,
}

/// Groves: far trees in blocks of up to 256 neighbours, each block one ordered list of points. A resource.
///
/// They are made in the background, and change no pixel: where a block has none (yet), its trees are looked at one by one,
/// which costs more the farther they are. Changes count for groves that are made later.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Eq, Reflect)]
#[reflect(Resource, Default)]
pub struct GroveSettings {
    /// Most points kept of each tree, on average: a grove serves where its trees get fewer. 2 bytes of GPU memory each; groves keep
    /// only what cameras at two thirds of their distance would see. 0: no groves. Default: 10.
    pub samples_per_tree: usize,
}

impl Default for GroveSettings {
    fn default() -> Self {
        Self { samples_per_tree: SAMPLES_PER_TREE }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_range_are_moved_and_named() {
        let (same, moved) = TreelineSettings::default().clamped();
        assert_eq!((same, moved.len()), (TreelineSettings::default(), 0));
        let bad = TreelineSettings {
            quality: f32::NAN,
            fade_width: 7.0,
            contrast: -1.0,
            samples: 2,
            ..default()
        };
        let (good, moved) = bad.clamped();
        assert_eq!((good.quality, good.fade_width, good.contrast), (2.0, 0.9, 0.0));
        assert_eq!(good.samples, 4);
        assert_eq!(moved, ["quality", "fade_width", "contrast", "samples"]);
    }
}
