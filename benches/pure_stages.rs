//! Pure stages of a bake on this project's oak at LDI 512 (about 420,000 points): what a user waits for.
//!
//! `cargo bench --all-features` (profile `bench`: Bevy is compiled once more), or `cargo bench --profile release`.
use bevy_treeline::bake::{
    BakeSettings, OrderMethod, order, peel,
    source::{self, SourceModel},
};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::{hint::black_box, path::Path};

fn oak() -> SourceModel {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/trees/oak.glb");
    source::load_model(&path).expect("the trees of this project load")
}

fn bake_stages(c: &mut Criterion) {
    let model = oak();
    let settings = BakeSettings::default();
    let directions = peel::directions(settings.directions);
    let viewports = peel::viewports(&model.bounds(), settings.ldi_size, &directions);
    let output = peel::cpu::peel(&model, &viewports, &settings, &|_| ());
    let mut group = c.benchmark_group("bake");
    group.sample_size(10).throughput(Throughput::Elements(output.samples.len() as u64));
    group.bench_function("peel/oak_512", |b| {
        b.iter(|| peel::cpu::peel(black_box(&model), &viewports, &settings, &|_| ()));
    });
    for (name, method) in [("random", OrderMethod::Random), ("lattice", OrderMethod::Lattice)] {
        group.bench_function(format!("order_{name}/oak_512"), |b| {
            b.iter(|| order::order(black_box(&output.samples), method, 1, &|_| ()));
        });
    }
    group.finish();
}

criterion_group!(benches, bake_stages);
criterion_main!(benches);
