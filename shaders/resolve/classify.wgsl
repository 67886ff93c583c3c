// Lists the 16×16 blocks that show a point, so that resolve draws one quad for each and shades nothing else.
//
// One thread per block.
#import bevy_treeline::types::{Counters, SelectSettings}

@group(0) @binding(0) var<uniform> settings: SelectSettings;
@group(0) @binding(1) var<storage, read> visibility: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read_write> blocks: array<u32>;
@group(0) @binding(3) var<storage, read_write> counters: Counters;

const BLOCK: u32 = #{RESOLVE_BLOCK}u;

// Whether any sample of a pixel shows a point.
fn is_covered(pixel: vec2<u32>) -> bool {
    let side = settings.samples_per_side;
    for (var i = 0u; i < side * side; i++) {
        let sample = pixel * side + vec2(i % side, i / side);
        if visibility[sample.y * settings.size.x * side + sample.x].x != 0u {
            return true;
        }
    }
    return false;
}

@compute @workgroup_size(64)
fn classify(@builtin(global_invocation_id) id: vec3<u32>) {
    let columns = (settings.size.x + BLOCK - 1u) / BLOCK;
    let rows = (settings.size.y + BLOCK - 1u) / BLOCK;
    if id.x >= columns * rows {
        return;
    }
    let first = vec2(id.x % columns, id.x / columns) * BLOCK;
    let end = min(first + BLOCK, settings.size);
    var covered = 0u;
    for (var y = first.y; y < end.y; y++) {
        for (var x = first.x; x < end.x; x++) {
            covered += select(0u, 1u, is_covered(vec2(x, y)));
        }
    }
    if covered == 0u {
        return;
    }
    atomicAdd(&counters.covered_pixels, covered);
    // The order of the list does not show in the picture: quads do not overlap.
    blocks[atomicAdd(&counters.covered_blocks, 1u)] = first.x | (first.y << 16u);
}
