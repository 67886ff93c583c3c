// Sizes the dispatch that looks at near trees cluster by cluster.
//
// One thread.
#import bevy_treeline::select_bindings::{counters, grid}
#import bevy_treeline::types::IndirectArgs

@group(1) @binding(0) var<storage, read_write> args: IndirectArgs;

@compute @workgroup_size(1)
fn size_clusters() {
    args.clusters = grid(atomicLoad(&counters.near_trees));
}
