// Number of quads that resolve draws. One thread.
#import bevy_treeline::types::{Counters, IndirectArgs}

@group(0) @binding(0) var<storage, read_write> counters: Counters;
@group(0) @binding(1) var<storage, read_write> args: IndirectArgs;

@compute @workgroup_size(1)
fn size_resolve() {
    args.resolve.y = atomicLoad(&counters.covered_blocks);
}
