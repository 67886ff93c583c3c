//! Quality by budget: a camera says what its trees may cost, and the quality follows.
//!
//! In: [`QualityGovernor`] of cameras, and what finished frames cost: counters of views, frame times, GPU times of passes. Out:
//! [`QualityFactor`], which multiplies [`TreelineSettings::quality`]. The controller is
//! [`lod::governor`](crate::lod::governor). Cost: a few operations a camera.
//!
//! ```no_run
//! # use bevy::prelude::*;
//! use bevy_treeline::{GovernorBudget, QualityFactor, QualityGovernor};
//!
//! fn add_camera(mut commands: Commands) {
//!     let governor = QualityGovernor::new(GovernorBudget::Points(2_000_000));
//!     commands.spawn((Camera3d::default(), Msaa::Off, governor));
//! }
//!
//! fn print_factor(cameras: Query<&QualityFactor>) {
//!     for factor in &cameras {
//!         println!("quality × {:.2}", factor.get());
//!     }
//! }
//! ```

use crate::{
    forest::{QualityFactor, TreelineSettings},
    lod::governor::{Governor, GovernorLimits, Measured},
    render::TreelineCounters,
};
use bevy::{diagnostic::DiagnosticsStore, prelude::*, time::Real};
use std::{collections::VecDeque, time::Instant};

/// What a camera's trees may cost.
#[derive(Clone, Copy, Debug, PartialEq, Reflect)]
pub enum GovernorBudget {
    /// Points that this camera draws in a frame. The surest: it depends on the scene alone, not on the machine or on what else
    /// runs.
    Points(u32),
    /// Milliseconds from frame to frame, everything included. With vertical sync frames never take less than the screen's
    /// refresh, so that neither time to spare nor a budget below it can be seen: turn it off, or take another budget.
    FrameMillis(f32),
    /// Milliseconds that this crate's passes take on the GPU, of all cameras together. Needs Bevy's
    /// `RenderDiagnosticsPlugin`, and an adapter with timestamps: without them, quality stays as it is.
    GpuMillis(f32),
}

/// Keeps what a camera's trees cost within a budget: it lowers [`TreelineSettings::quality`] by the [`QualityFactor`] while
/// they cost more, and raises it again when they do not. It never goes above the settings' quality.
#[derive(Component, Clone, Debug, PartialEq, Reflect)]
#[reflect(Component)]
#[require(QualityFactor, GovernorState)]
pub struct QualityGovernor {
    /// What to stay within.
    pub budget: GovernorBudget,
    /// Least factor, 0.001 to 1. A budget that this cannot meet is exceeded. Default: 0.1.
    pub min_factor: f32,
    /// Octaves (doublings) by which the factor may rise in a second. Default: 0.5, which nobody sees.
    pub rise_per_second: f32,
    /// Octaves by which it may fall in a second. Default: 3.
    pub fall_per_second: f32,
}

impl QualityGovernor {
    /// With a budget and the defaults.
    pub fn new(budget: GovernorBudget) -> Self {
        let GovernorLimits { min_factor, rise_per_second, fall_per_second } =
            GovernorLimits::default();
        Self { budget, min_factor, rise_per_second, fall_per_second }
    }

    fn limits(&self) -> GovernorLimits {
        let &Self { min_factor, rise_per_second, fall_per_second, .. } = self;
        GovernorLimits { min_factor, rise_per_second, fall_per_second }
    }
}

/// Frames after which times are known, about: that of the main world, that of the render world, and one in between.
const TIMES_LATE_BY: usize = 2;

/// What a governor remembers.
#[derive(Component, Clone, Debug, Default)]
struct GovernorState {
    governor: Governor,
    /// Newest counters looked at.
    counted_frame: Option<u64>,
    /// Newest GPU time looked at.
    timed_at: Option<Instant>,
    /// Factors of the last frames, newest last.
    factors: VecDeque<f32>,
}

/// Governs cameras. Part of `TreelinePlugin`.
pub(crate) struct GovernorPlugin;

impl Plugin for GovernorPlugin {
    fn build(&self, app: &mut App) {
        app.register_type::<QualityGovernor>().add_systems(
            PostUpdate,
            (reset_ungoverned, govern_quality.run_if(resource_exists::<Time<Real>>)).chain(),
        );
    }
}

/// A camera whose governor was removed is drawn in full again.
fn reset_ungoverned(mut removed: RemovedComponents<QualityGovernor>, mut commands: Commands) {
    for entity in removed.read() {
        if let Ok(mut camera) = commands.get_entity(entity) {
            camera.try_remove::<(QualityFactor, GovernorState)>();
        }
    }
}

fn govern_quality(
    mut cameras: Query<(
        Entity,
        &QualityGovernor,
        &mut QualityFactor,
        &mut GovernorState,
        Option<&TreelineSettings>,
    )>,
    counters: Res<TreelineCounters>,
    time: Res<Time<Real>>,
    diagnostics: Option<Res<DiagnosticsStore>>,
) {
    let seconds = time.delta_secs();
    for (camera, settings, mut factor, mut state, view_settings) in &mut cameras {
        let own_quality = view_settings.map_or(TreelineSettings::default().quality, |s| s.quality);
        let late_factor = state.factors.front().copied().unwrap_or(1.0);
        let (budget, measured) = match settings.budget {
            GovernorBudget::Points(points) => {
                let new = counters.of(camera).filter(|c| state.counted_frame != Some(c.frame));
                state.counted_frame = new.map_or(state.counted_frame, |c| Some(c.frame));
                let measured = new
                    .map(|c| Measured { cost: c.points as f32, factor: c.quality / own_quality });
                (points as f32, measured)
            }
            GovernorBudget::FrameMillis(millis) => {
                // The first frame has no time yet.
                let measured = Measured { cost: seconds * 1e3, factor: late_factor };
                (millis, (seconds > 0.0).then_some(measured))
            }
            GovernorBudget::GpuMillis(millis) => {
                let new = diagnostics.as_ref().and_then(|store| pass_millis(store));
                let new = new.filter(|(_, at)| state.timed_at != Some(*at));
                state.timed_at = new.map_or(state.timed_at, |(_, at)| Some(at));
                (millis, new.map(|(cost, _)| Measured { cost, factor: late_factor }))
            }
        };
        let next = state.governor.step(&settings.limits(), budget, measured, seconds);
        factor.set_if_neq(QualityFactor(next));
        state.factors.push_back(next);
        if state.factors.len() > TIMES_LATE_BY {
            state.factors.pop_front();
        }
    }
}

/// Newest GPU time of this crate's passes together, and when it came. `None` without times.
fn pass_millis(diagnostics: &DiagnosticsStore) -> Option<(f32, Instant)> {
    let of_pass = |path: &str| {
        let pass = path.strip_prefix("render/treeline_")?.strip_suffix("/elapsed_gpu")?;
        (!pass.contains('/')).then_some(())
    };
    let passes = diagnostics.iter().filter(|d| of_pass(d.path().as_str()).is_some());
    let newest = passes.filter_map(|d| d.measurement());
    newest.fold(None, |sum: Option<(f32, Instant)>, m| {
        let (cost, at) = sum.unwrap_or((0.0, m.time));
        Some((cost + m.value as f32, at.max(m.time)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::{
        diagnostic::{Diagnostic, DiagnosticMeasurement, DiagnosticPath},
        time::TimeUpdateStrategy,
    };
    use std::time::Duration;

    /// An app of the main world alone, whose frames take `millis`.
    fn app(millis: u64) -> App {
        let mut app = App::new();
        app.add_plugins((MinimalPlugins, GovernorPlugin))
            .init_resource::<TreelineCounters>()
            .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_millis(millis)));
        app
    }

    fn factor_after(app: &mut App, camera: Entity, frames: usize) -> f32 {
        for _ in 0..frames {
            app.update();
        }
        app.world().get::<QualityFactor>(camera).map_or(f32::NAN, |factor| factor.get())
    }

    #[test]
    fn frames_that_take_too_long_lower_the_quality_to_its_least() {
        let mut app = app(40);
        let governor = QualityGovernor::new(GovernorBudget::FrameMillis(20.0));
        let camera = app.world_mut().spawn(QualityGovernor { min_factor: 0.25, ..governor }).id();
        assert_eq!(factor_after(&mut app, camera, 1), 1.0);
        assert!((factor_after(&mut app, camera, 60) - 0.25).abs() < 1e-3);
        // In time again: slowly back.
        *app.world_mut().resource_mut() =
            TimeUpdateStrategy::ManualDuration(Duration::from_millis(5));
        assert!(factor_after(&mut app, camera, 40) < 0.5);
        assert_eq!(factor_after(&mut app, camera, 2000), 1.0);
    }

    #[test]
    fn a_camera_without_its_governor_is_drawn_in_full() {
        let mut app = app(40);
        let governor = QualityGovernor::new(GovernorBudget::FrameMillis(20.0));
        let camera = app.world_mut().spawn(governor).id();
        assert!(factor_after(&mut app, camera, 60) < 0.9);
        app.world_mut().entity_mut(camera).remove::<QualityGovernor>();
        assert!(factor_after(&mut app, camera, 1).is_nan());
    }

    #[test]
    fn without_costs_nothing_changes() {
        let mut app = app(40);
        for budget in [GovernorBudget::Points(1), GovernorBudget::GpuMillis(0.1)] {
            let camera = app.world_mut().spawn(QualityGovernor::new(budget)).id();
            assert_eq!(factor_after(&mut app, camera, 60), 1.0);
        }
    }

    #[test]
    fn gpu_times_of_this_crates_passes_are_added_up() {
        let mut store = DiagnosticsStore::default();
        let time = Instant::now();
        for (path, value) in [
            ("render/treeline_select/elapsed_gpu", 1.5),
            ("render/treeline_splat/elapsed_gpu", 2.0),
            ("render/treeline_splat/inner/elapsed_gpu", 1.0),
            ("render/treeline_splat/elapsed_cpu", 1.0),
            ("render/main_opaque_pass_3d/elapsed_gpu", 8.0),
        ] {
            let mut diagnostic = Diagnostic::new(DiagnosticPath::new(path));
            diagnostic.add_measurement(DiagnosticMeasurement { time, value });
            store.add(diagnostic);
        }
        assert_eq!(pass_millis(&store), Some((3.5, time)));
        assert_eq!(pass_millis(&DiagnosticsStore::default()), None);
    }
}
