// Level of detail. CPU twins: src/lod/{prefix_count,fade,splat_size,thinning,window}.rs, statement for statement.
#define_import_path bevy_treeline::lod

const PI: f32 = 3.14159265;
const CLOSED_OVERLAP: f32 = 2.0;
const FACTORS_LAST: f32 = 31.0;
// As EACH in src/lod/thinning.rs.
const FACTORS_EACH: f32 = 12.0;
const GROVE_WINDOW: u32 = 64u;
// Bit of WorkItem.count: samples of a grove instead of points of a tree; its window stands above bit 8.
const OF_GROVE: u32 = 0x80000000u;
const WINDOW_CYCLE: u32 = 8u;

struct FadeBand {
    near: f32,
    middle: f32,
    far: f32,
}

struct FadeState {
    mesh: f32,
    points: f32,
}

fn d_zero(s: f32, z0: f32) -> f32 {
    return s * z0;
}

const FULL_POINTS: f32 = 4096.0;
const LEAST_SHARE: f32 = 0.125;

fn thinned(n: f32) -> f32 {
    return n * clamp(sqrt(n / FULL_POINTS), LEAST_SHARE, 1.0);
}

fn prefix_count(n0: f32, s: f32, z0: f32, d: f32, quality: f32) -> f32 {
    let ratio = d_zero(s, z0) / max(d, 1e-6);
    return min(thinned(n0 * quality * ratio * ratio), n0);
}

fn round_count(wanted: f32, hash: f32) -> u32 {
    return u32(wanted + hash);
}

fn fade_band(d0: f32, min_mesh_distance: f32, width: f32, jitter: f32, hash: f32) -> FadeBand {
    let far = max(d0, min_mesh_distance) * (1.0 - jitter * hash);
    return FadeBand(far * (1.0 - width), far * (1.0 - 0.5 * width), far);
}

fn ramp(d: f32, start: f32, end: f32) -> f32 {
    if end - start < 1e-6 {
        return select(0.0, 1.0, d >= end);
    }
    return clamp((d - start) / (end - start), 0.0, 1.0);
}

fn fade_state(band: FadeBand, d: f32) -> FadeState {
    return FadeState(1.0 - ramp(d, band.middle, band.far), ramp(d, band.near, band.middle));
}

// Share of the points within a view range.
fn range_share(d: f32, begin: f32, end: f32) -> f32 {
    return 1.0 - ramp(d, begin, end);
}

fn disc_radius(area: f32, n: f32) -> f32 {
    return sqrt(area / max(n, 1e-6) / PI);
}

// The view scale `k`: `quality` times the pixels of a world unit, squared, at distance `d`. Twin of `view_scale` in
// src/forest/grove.rs.
fn view_scale(quality: f32, pixels_per_unit: f32, d: f32) -> f32 {
    let pixels = pixels_per_unit / max(d, 1e-6);
    return quality * pixels * pixels;
}

// Where `n` of `n0` points stand in a table of factors.
fn factor_place(n: f32, n0: f32) -> f32 {
    let octaves = log2(max(n0 / FACTORS_EACH, 2.0));
    let many = FACTORS_EACH - 1.0 + (FACTORS_LAST + 1.0 - FACTORS_EACH) * log2(max(n, 1.0) / FACTORS_EACH) / octaves;
    return min(select(many, max(n, 1.0) - 1.0, n <= FACTORS_EACH), FACTORS_LAST);
}

// Number of the factor below a place: it is between that and the next.
fn factor_below(place: f32) -> u32 {
    return min(u32(place), u32(FACTORS_LAST) - 1u);
}

// The words of a table with the factors below and above a place: two share one. Whoever has the table reads those, and not all.
fn factor_words(place: f32) -> vec2<u32> {
    let below = factor_below(place);
    return vec2(below >> 1u, (below + 1u) >> 1u);
}

fn factor_at(word: u32, step: u32) -> f32 {
    return f32((word >> (16u * (step & 1u))) & 0xffffu) / 16384.0;
}

// The factor at a place, out of its words.
fn factor_between(low: u32, high: u32, place: f32) -> f32 {
    let below = factor_below(place);
    return mix(factor_at(low, below), factor_at(high, below + 1u), place - f32(below));
}

// What leaves grow by for their size alone.
fn leaf_overlap(radius: f32, leaf_area: f32, gain: f32) -> f32 {
    if leaf_area > 0.0 {
        let a = PI * radius * radius;
        return 1.0 + gain * (1.0 - 1.0 / (1.0 + leaf_area / (4.0 * a)));
    }
    return 1.0 + gain;
}

// `half_inverse_spacing`: 1 / (2 spacing), constant in an item.
fn overlap(leaf_overlap: f32, thickness: u32, is_one_sided: bool, half_inverse_spacing: f32) -> f32 {
    // Twigs are one-sided and thinner than a splat: they get nothing.
    let leaf = select(leaf_overlap, 1.0, is_one_sided);
    // TRUSTED_THICKNESS: 1, 3, 8, 24 pixels, or 0, 0, 0, 6.
    var trusted = select(0.0, 6.0, thickness == 3u);
    if is_one_sided {
        trusted = select(select(1.0, 3.0, thickness == 1u), select(8.0, 24.0, thickness == 3u), thickness >= 2u);
    }
    let closed = clamp(trusted * half_inverse_spacing - 1.0, 0.0, 1.0);
    return leaf + (CLOSED_OVERLAP - leaf) * closed;
}

// Clusters. CPU twin: src/lod/clusters.rs, where the constants are explained.
const LEVEL_POINTS: vec2<u32> = vec2<u32>(256u, 2048u);
const LIST_POINTS: vec2<u32> = vec2<u32>(2048u, 16384u);

// The level that a draw of `count` points is taken from.
fn level_of(count: u32, level_count: u32) -> u32 {
    var level = 0u;
    if count > LEVEL_POINTS.x {
        level = 1u;
    }
    if count > LEVEL_POINTS.y {
        level = 2u;
    }
    return min(level, level_count - 1u);
}

// Place of a level's first cluster among those of a species, and how many it has.
fn level_clusters(level: u32) -> vec2<u32> {
    if level == 0u {
        return vec2(0u, 1u);
    }
    return select(vec2(9u, 32u), vec2(1u, 8u), level == 1u);
}

// Points in all lists of a level.
fn list_points(level: u32, level_count: u32, n0: u32) -> u32 {
    if level + 1u == level_count {
        return n0;
    }
    return min(n0, select(LIST_POINTS.y, LIST_POINTS.x, level == 0u));
}

// Points that a draw of `count` takes from a cluster of `size`, of `all` in its level.
fn cluster_points(count: u32, size: u32, all: u32) -> u32 {
    let share = f32(size) / f32(all);
    return min(u32(f32(count) * share + 0.5), size);
}

fn window_start(count: u32, total: u32, turn: u32) -> u32 {
    if count == 0u || count >= total {
        return 0u;
    }
    let bits = firstLeadingBit(total / count);
    let slots = min(1u << bits, WINDOW_CYCLE);
    let slot = turn % slots;
    if (turn / slots) % 2u == 1u && slots < WINDOW_CYCLE {
        return (((slot + 1u) * total) >> bits) - count;
    }
    return (slot * total) >> bits;
}

// A sample of a grove, of which a word holds two: rank of the point, and place of the tree in its block << 8.
fn grove_sample(word: u32, index: u32) -> u32 {
    return (word >> ((index & 1u) * 16u)) & 0xffffu;
}

// The point that a sample of a grove of rank `rank` shows: trees of a grove have few points, and windows (`window` as in
// SelectSettings) begin GROVE_WINDOW points apart in their first list.
fn grove_point(rank: u32, window: u32, n0: u32) -> u32 {
    return (rank + max(window, 1u) * GROVE_WINDOW - GROVE_WINDOW) % min(n0, LIST_POINTS.x);
}
