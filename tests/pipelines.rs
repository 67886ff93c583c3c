//! Every pipeline becomes ready for every kind of view. A shader that does not compile, or an import that is missing,
//! draws nothing and says little: this test says it.

mod common;

use bevy::{
    camera::{Hdr, ScalingMode},
    core_pipeline::prepass::{DeferredPrepass, DepthPrepass, MotionVectorPrepass, NormalPrepass},
    prelude::*,
};
use bevy_treeline::{DebugView, SplatPath, TreeImpostor, TreelineSettings, TreelineTaa};
use common::{Stage, before, coverage};

const SIZE: UVec2 = UVec2::new(48, 36);

/// Compute pipelines of a view: nine of selection for each phase, two of the depth pyramid, two around the draw, the clearing one, and
/// those that splat.
fn compute_pipelines(path: SplatPath) -> usize {
    23 + splat_pipelines(path)
}

/// Those that splat trees (in the first phase, in the second) and groves. Parallel views have their own.
fn splat_pipelines(path: SplatPath) -> usize {
    match path {
        SplatPath::U32 => 6,
        _ => 3,
    }
}

/// The name of a change to a plain camera, the change, and the draw pipelines that it takes: those it may share with
/// cameras of earlier kinds, and its own.
type Kind = (&'static str, fn(&mut EntityWorldMut), [usize; 2]);

/// Each has a resolve pipeline of its own; one with a prepass writes that, and a deferred one lights near meshes, too.
const KINDS: [Kind; 14] = [
    ("LDR", |_| (), [0, 1]),
    (
        "HDR",
        |camera| {
            camera.insert(Hdr);
        },
        [0, 1],
    ),
    (
        "MSAA 4x",
        |camera| {
            camera.insert(Msaa::Sample4);
        },
        [0, 1],
    ),
    (
        "HDR and MSAA 4x",
        |camera| {
            camera.insert((Hdr, Msaa::Sample4));
        },
        [0, 1],
    ),
    (
        "depth prepass",
        |camera| {
            camera.insert(DepthPrepass);
        },
        [0, 2],
    ),
    (
        "depth prepass and MSAA 4x",
        |camera| {
            camera.insert((DepthPrepass, Msaa::Sample4));
        },
        [0, 2],
    ),
    (
        "normal and motion prepass",
        |camera| {
            camera.insert((DepthPrepass, NormalPrepass, MotionVectorPrepass));
        },
        [0, 2],
    ),
    (
        "deferred",
        |camera| {
            camera.insert((DepthPrepass, DeferredPrepass));
        },
        [1, 2],
    ),
    (
        "fog",
        |camera| {
            camera.insert(DistanceFog::default());
        },
        [0, 1],
    ),
    (
        "fog that glows",
        |camera| {
            let falloff = FogFalloff::ExponentialSquared { density: 0.01 };
            camera.insert(DistanceFog {
                directional_light_color: Color::WHITE,
                falloff,
                ..default()
            });
        },
        [0, 1],
    ),
    (
        "a debug view",
        |camera| {
            let debug_view = DebugView::FadeBand;
            camera.insert(TreelineSettings { debug_view, ..default() });
        },
        [0, 1],
    ),
    (
        "orthographic",
        |camera| {
            let scaling_mode = ScalingMode::FixedVertical { viewport_height: 16.0 };
            let parallel = OrthographicProjection::default_3d();
            let parallel = OrthographicProjection { scaling_mode, ..parallel };
            camera.insert(Projection::Orthographic(parallel));
        },
        [0, 1],
    ),
    (
        "four samples",
        |camera| {
            camera.insert(TreelineSettings { samples: 4, ..default() });
        },
        [0, 2],
    ),
    (
        "temporal antialiasing",
        |camera| {
            camera.insert(TreelineTaa::default());
        },
        [0, 3],
    ),
];

/// A stage with a tree, a box and a light.
fn planted(path: SplatPath, shadows: bool) -> Option<Stage> {
    let mut stage = Stage::new("every_pipeline_becomes_ready", path)?;
    let tree = stage.tree("birch", false);
    stage.world().spawn(TreeImpostor::new(tree));
    stage.cuboid(Vec3::splat(0.5), default(), Vec3::ZERO);
    stage.light(Vec3::new(-0.4, -0.8, -0.4), shadows);
    Some(stage)
}

fn every_pipeline_becomes_ready(path: SplatPath) {
    let compute = compute_pipelines(path);
    let without_shadows = KINDS[..2].iter().map(|kind| (kind, false));
    for ((name, change, draws), shadows) in
        KINDS.iter().map(|kind| (kind, true)).chain(without_shadows)
    {
        let Some(mut stage) = planted(path, shadows) else { return };
        let (camera, image) = stage.view(SIZE, before("birch", 20.0));
        change(&mut stage.world().entity_mut(camera));
        let picture = stage.shoot(&image, 3);
        let what = format!("{path:?}, {name}, shadows {shadows}");
        assert_eq!(stage.pipelines(), (compute + draws[0] + draws[1], vec![]), "{what}");
        assert!(coverage(&picture) > 30.0, "{what}: no tree is drawn");
        assert_eq!(stage.counters(camera).instances_seen, 1, "{what}");
    }
}

#[test]
fn every_pipeline_of_the_64_bit_path_becomes_ready() {
    every_pipeline_becomes_ready(SplatPath::U64);
}

#[test]
fn every_pipeline_of_the_32_bit_path_becomes_ready() {
    every_pipeline_becomes_ready(SplatPath::U32);
}

#[test]
fn cameras_of_every_kind_share_an_app() {
    for path in [SplatPath::U64, SplatPath::U32] {
        let Some(mut stage) = planted(path, true) else { continue };
        for (name, change, _) in KINDS {
            let (camera, _) = stage.view(SIZE, before("birch", 20.0));
            change(stage.world().entity_mut(camera).insert(Name::new(name)));
        }
        // A camera like another needs no pipeline.
        stage.view(SIZE, before("birch", 30.0));
        stage.step(4);
        let draws: usize = KINDS.iter().map(|(_, _, draws)| draws[1]).sum();
        let all = compute_pipelines(path) + splat_pipelines(path) + draws;
        assert_eq!(stage.pipelines(), (all, vec![]), "{path:?}");
    }
}
