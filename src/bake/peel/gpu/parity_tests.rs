//! The GPU peeler against its CPU twin.

use super::tests::{bounds, cube, model_of, peeler, quad, settings, thicket};
use super::*;
use crate::bake::peel::{PeelSample, cpu, directions, viewports};
use crate::bake::source::{SourceMaterial, SourceWrap, load_model};
use bevy::math::Vec3;
use std::{collections::HashMap, path::Path, time::Instant};

/// Peels with both, prints what they found, and demands that they agree.
fn assert_twins_agree(
    peeler: &GpuPeeler,
    name: &str,
    model: &SourceModel,
    settings: &BakeSettings,
) {
    let viewports = viewports(&bounds(model), settings.ldi_size, &directions(settings.directions));
    let start = Instant::now();
    let gpu = peeler.peel(model, &viewports, settings, &|_| ()).expect("it peels");
    let gpu_secs = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let cpu = cpu::peel(model, &viewports, settings, &|_| ());
    let cpu_secs = start.elapsed().as_secs_f64();

    let key = |s: &PeelSample| (s.direction, s.layer, s.cell);
    let twins: HashMap<_, _> = cpu.samples.iter().map(|s| (key(s), s)).collect();
    let pairs: Vec<_> =
        gpu.samples.iter().filter_map(|s| Some((s, *twins.get(&key(s))?))).collect();
    let share = |count: usize| count as f64 / gpu.samples.len().max(1) as f64;
    let far = |(a, b): &&(&PeelSample, &PeelSample)| {
        a.position.distance(b.position) > 0.5 * viewports[usize::from(a.direction)].pixel
    };
    let off_color = |(a, b): &&(&PeelSample, &PeelSample)| {
        std::iter::zip(a.albedo, b.albedo).any(|(a, b)| a.abs_diff(b) > 2)
    };
    let off_normal = |(a, b): &&(&PeelSample, &PeelSample)| a.normal.distance(b.normal) > 0.01;
    let unpaired = gpu.samples.len() - pairs.len();
    let [far, off_color, off_normal] = [
        pairs.iter().filter(far).count(),
        pairs.iter().filter(off_color).count(),
        pairs.iter().filter(off_normal).count(),
    ];
    println!(
        "{name} {}: layers gpu {:?} cpu {:?}, fragments gpu {:?} cpu {:?}, left over {:?} {:?}, samples gpu {} cpu {} ({:.1} MB \
         read back), unpaired {unpaired}, far {far}, off colour {off_color}, off normal {off_normal}; gpu {gpu_secs:.3} s, cpu {cpu_secs:.3} s",
        settings.ldi_size,
        gpu.layers,
        cpu.layers,
        gpu.fragments,
        cpu.fragments,
        gpu.left_over,
        cpu.left_over,
        gpu.samples.len(),
        cpu.samples.len(),
        gpu.samples.len() as f64 * readback::RECORD_BYTES as f64 / 1e6,
    );
    assert!((gpu.samples.len() as f64 / cpu.samples.len() as f64 - 1.0).abs() < 0.002, "{name}");
    for (gpu, cpu) in std::iter::zip(&gpu.fragments, &cpu.fragments) {
        assert!(gpu.abs_diff(*cpu) as f64 <= 0.002 * *cpu as f64, "{name}");
    }
    assert!(
        share(unpaired) < 0.01
            && share(far) < 0.01
            && share(off_color) < 0.01
            && share(off_normal) < 0.01,
        "{name}"
    );
}

#[test]
fn gpu_and_cpu_agree_on_hand_made_models() {
    let Some(peeler) = peeler("gpu_and_cpu_agree_on_hand_made_models") else { return };
    assert_twins_agree(&peeler, "cube", &cube(), &settings(37));
    let sheet = |z: f32, x: f32| quad(Vec3::new(x, x, z), Vec3::X, Vec3::Y, 0);
    let overlapping = (0..20).map(|i| sheet(i as f32 * 0.05, (i % 7) as f32 * 0.1)).collect();
    let overlapping = model_of(overlapping, vec![SourceMaterial::default()]);
    assert_twins_agree(&peeler, "overlapping quads", &overlapping, &settings(64));
    for wrap in [SourceWrap::Repeat, SourceWrap::MirroredRepeat, SourceWrap::ClampToEdge] {
        assert_twins_agree(&peeler, "thicket", &thicket(300, wrap), &settings(256));
    }
    let thicket = thicket(300, SourceWrap::Repeat);
    assert_twins_agree(
        &peeler,
        "9 directions",
        &thicket,
        &BakeSettings { directions: 9, ..settings(100) },
    );
    assert_twins_agree(
        &peeler,
        "5 layers",
        &thicket,
        &BakeSettings { max_layers: 5, ..settings(100) },
    );
    let partitioned = BakeSettings { partition_triangles: true, ..settings(100) };
    assert_twins_agree(&peeler, "partitioned", &thicket, &partitioned);
}

#[test]
fn gpu_and_cpu_agree_on_real_models() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    if !data.is_dir() {
        println!("SKIPPED gpu_and_cpu_agree_on_real_models: no ../shared/data");
        return;
    }
    let Some(peeler) = peeler("gpu_and_cpu_agree_on_real_models") else { return };
    let files = ["meshes/cow.obj", "trees/sapling_quaking_aspen.glb", "trees/eztree_oak_large.glb"];
    for file in files {
        let model = load_model(&data.join(file)).expect("it loads");
        assert_twins_agree(&peeler, file, &model, &settings(100));
    }
}
