// Bindings of every splat pass.
#define_import_path bevy_treeline::splat_bindings

#import bevy_render::view::View
#import bevy_treeline::types::{Counters, SelectSettings, Species, SplatItem, SurfelHot, TreeLook, TreePlace}

@group(0) @binding(0) var<uniform> view: View;
// Of this phase.
@group(0) @binding(1) var<uniform> settings: SelectSettings;
@group(0) @binding(2) var<storage, read> species: array<Species>;
@group(0) @binding(3) var<storage, read> places: array<TreePlace>;
@group(0) @binding(4) var<storage, read> looks: array<TreeLook>;
@group(0) @binding(5) var<storage, read> splat_items: array<SplatItem>;
@group(0) @binding(6) var<storage, read> surfels_hot: array<SurfelHot>;
// Samples of groves, two a word: `grove_sample`.
@group(0) @binding(7) var<storage, read> samples: array<u32>;
@group(0) @binding(8) var<storage, read_write> counters: Counters;

// Payload of the visibility buffer: 0 is "no point", else item << 6 | lane, plus 1.
fn payload_of(item: u32, lane: u32) -> u32 {
    return ((item << 6u) | lane) + 1u;
}

// Work items of this phase: of groves, or of trees.
fn phase_items() -> u32 {
#ifdef SPLAT_GROVES
    return atomicLoad(&counters.phase_grove_items);
#else
    return atomicLoad(&counters.phase_items);
#endif
}

// Columns and rows of the visibility buffer: samples, of which a pixel has one or 2 × 2.
fn grid_size() -> vec2<u32> {
    return settings.size * settings.samples_per_side;
}
