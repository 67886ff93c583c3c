// Sums over the threads of a workgroup of WORKGROUP threads.
//
// Rows of threads first, then the sums of rows: two short loops, where a scan in log2(256) steps (Hillis and Steele 1986) has
// 16 barriers, each of which a software driver pays for with a change of context for every eight threads (measured:
// most of `emit_runs`).
#define_import_path bevy_treeline::prefix_sum

#import bevy_treeline::select_bindings::WORKGROUP

// Threads of a row, whose sum one thread makes.
const ROW: u32 = 16u;

var<workgroup> lane_sums: array<vec2<u32>, #{SELECT_WORKGROUP}>;
// And the sum of all behind that of the last row.
var<workgroup> row_sums: array<vec2<u32>, 17>;

struct PrefixSum {
    // Of the threads before.
    before: vec2<u32>,
    // Of all threads.
    all: vec2<u32>,
}

// Two sums of what each thread brings. Called by all threads of the workgroup, as often as needed.
fn prefix_sum(lane: u32, own: vec2<u32>) -> PrefixSum {
    lane_sums[lane] = own;
    workgroupBarrier();
    if lane < WORKGROUP / ROW {
        var sum = vec2(0u);
        for (var i = lane * ROW; i < (lane + 1u) * ROW; i++) {
            let next = lane_sums[i];
            lane_sums[i] = sum;
            sum += next;
        }
        row_sums[lane] = sum;
    }
    workgroupBarrier();
    if lane == 0u {
        var sum = vec2(0u);
        for (var i = 0u; i < WORKGROUP / ROW; i++) {
            let next = row_sums[i];
            row_sums[i] = sum;
            sum += next;
        }
        row_sums[WORKGROUP / ROW] = sum;
    }
    workgroupBarrier();
    return PrefixSum(lane_sums[lane] + row_sums[lane / ROW], row_sums[WORKGROUP / ROW]);
}
