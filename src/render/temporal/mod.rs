//! Temporal antialiasing made for points: frames add up where depth says that they show the same place.
//!
//! `jitter` moves each frame by less than a pixel; `history` keeps what the past looked like; `accumulate` blends. In: a
//! lit picture, motion vectors, depth. Out: the picture, antialiased, before bloom and tone mapping. Cost: pixels.

mod accumulate;
mod history;

pub(super) use accumulate::{
    AccumulatePipeline, accumulate, init_accumulate_pipeline, specialize_accumulate,
};
pub(super) use history::{Histories, prepare_history};

use bevy::{
    core_pipeline::prepass::{DepthPrepass, MotionVectorPrepass},
    diagnostic::FrameCount,
    prelude::*,
    render::{
        MainWorld,
        camera::{MipBias, TemporalJitter},
        sync_component::SyncComponent,
        sync_world::RenderEntity,
    },
};

/// Antialiases a camera over time, for pictures of points: add it to a `Camera3d` with [`Msaa::Off`].
///
/// Trees of such a camera show other points in each frame ([`TemporalSampling`](crate::TemporalSampling)); their average is
/// much closer to the truth than any one frame. Bevy's own `TemporalAntiAliasing` works with points, too, but takes the
/// difference of neighbouring points for change and forgets; do not add both.
///
/// Works with and without [`Hdr`](bevy::camera::Hdr) (with it, the average is finer), with several cameras, and with any
/// material that writes motion vectors. What moves without them (particles, transparent things) leaves a trail.
#[derive(Component, Clone, Debug, PartialEq, Reflect)]
#[reflect(Component, Default)]
#[require(TemporalJitter, MipBias, DepthPrepass, MotionVectorPrepass)]
pub struct TreelineTaa {
    /// Frames that a pixel averages while nothing moves, 1 to 1000. More is smoother and follows changes of light more
    /// slowly. Default: 32.
    pub frames_at_rest: f32,
    /// Frames that it averages in motion, 1 to 1000. More is smoother and less sharp. Fewer count where things around a
    /// pixel move apart, as leaves at many depths do. Default: 4 (measured).
    pub frames_in_motion: f32,
    /// How far, in standard deviations of the pixels around it, a pixel of the past may differ from their mean, 0.5 to 100.
    /// Less follows changes of light faster and is noisier. At most 1 in motion. Default: 3.
    pub clip: f32,
    /// Forget the past, as after a cut: set it in the frame that shows the new place. It falls back to false by itself.
    pub reset: bool,
}

impl Default for TreelineTaa {
    fn default() -> Self {
        Self { frames_at_rest: 32.0, frames_in_motion: 4.0, clip: 3.0, reset: true }
    }
}

impl SyncComponent for TreelineTaa {
    type Target = Self;
}

/// Subpixel positions, in pixels from the centre: the Halton sequence of bases 2 and 3. Twice as many as windows of points,
/// so that each window is seen at two.
const JITTER_CYCLE: u32 = 16;

/// The `index`-th number of the van der Corput sequence (Halton 1960), 0 to 1.
fn radical_inverse(mut index: u32, base: u32) -> f32 {
    let (mut value, mut digit) = (0.0, 1.0);
    while index > 0 {
        digit /= base as f32;
        value += digit * (index % base) as f32;
        index /= base;
    }
    value
}

fn jitter_of_frame(frame: u32) -> Vec2 {
    let index = frame % JITTER_CYCLE + 1;
    Vec2::new(radical_inverse(index, 2), radical_inverse(index, 3)) - 0.5
}

pub(super) fn extract_temporal(mut commands: Commands, mut main_world: ResMut<MainWorld>) {
    let mut cameras = main_world.query::<(RenderEntity, &Camera, Option<&mut TreelineTaa>)>();
    for (entity, camera, settings) in cameras.iter_mut(&mut main_world) {
        let mut entity = commands.entity(entity);
        match settings {
            Some(mut settings) if camera.is_active => {
                entity.insert(settings.clone());
                if settings.reset {
                    settings.reset = false;
                }
            }
            _ => {
                entity.remove::<TreelineTaa>();
            }
        }
    }
}

pub(super) fn prepare_jitter(
    frame: Res<FrameCount>,
    mut cameras: Query<&mut TemporalJitter, With<TreelineTaa>>,
) {
    for mut jitter in &mut cameras {
        jitter.offset = jitter_of_frame(frame.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_jitter_is_centred_and_stays_within_the_pixel() {
        let all: Vec<Vec2> = (0..JITTER_CYCLE).map(jitter_of_frame).collect();
        let mean = all.iter().sum::<Vec2>() / all.len() as f32;
        assert!(mean.abs().max_element() < 0.04, "{mean}");
        assert!(all.iter().all(|offset| offset.abs().max_element() <= 0.5));
        let quarters: std::collections::BTreeSet<[bool; 2]> =
            all[..8].iter().map(|offset| [offset.x < 0.0, offset.y < 0.0]).collect();
        assert_eq!(quarters.len(), 4, "eight frames see each quarter of the pixel");
    }
}
