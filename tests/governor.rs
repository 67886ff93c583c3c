//! A governed camera draws within its budget of points, and in full again once it may.

mod common;

use bevy::{prelude::*, time::TimeUpdateStrategy};
use bevy_treeline::{
    Forest, GovernorBudget, QualityFactor, QualityGovernor, SplatPath, TreeInstance,
};
use common::{Stage, before};
use std::time::Duration;

#[test]
fn a_budget_of_points_is_kept_and_given_back() {
    let test = "a_budget_of_points_is_kept_and_given_back";
    let Some(mut stage) = Stage::new(test, SplatPath::Auto) else { return };
    let frame = Duration::from_millis(33);
    stage.world().insert_resource(TimeUpdateStrategy::ManualDuration(frame));
    let tree = stage.tree("oak", false);
    let trees = (0..40).map(|i| {
        let (column, row) = ((i % 8) as f32, (i / 8) as f32);
        TreeInstance::at(Vec3::new(column * 5.0 - 17.5, 0.0, row * -6.0))
    });
    stage.world().spawn(Forest::new([tree]).with(trees));
    let (camera, _image) = stage.view(UVec2::new(64, 48), before("oak", 60.0));
    stage.step(6);
    let full = stage.counters(camera);

    let budget = full.points / 3;
    let governor = QualityGovernor::new(GovernorBudget::Points(budget));
    stage.world().entity_mut(camera).insert(governor);
    stage.step(60);
    let counters = stage.counters(camera);
    let error = counters.points as f32 / budget as f32 - 1.0;
    assert!(error.abs() < 0.08, "{} points of {budget}", counters.points);
    let factor = stage.world().get::<QualityFactor>(camera).map_or(f32::NAN, |f| f.get());
    assert!((counters.quality / full.quality - factor).abs() < 1e-3);
    // It rests.
    stage.step(20);
    assert_eq!(stage.counters(camera).points, counters.points);

    stage.world().entity_mut(camera).remove::<QualityGovernor>();
    stage.step(4);
    assert_eq!(stage.counters(camera).points, full.points);
}
