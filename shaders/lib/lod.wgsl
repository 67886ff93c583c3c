// Level of detail. CPU twins: src/lod/{prefix_count,fade,splat_size,window}.rs, statement for statement.
#define_import_path bevy_treeline::lod

const PI: f32 = 3.14159265;
const CLOSED_OVERLAP: f32 = 2.0;
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

fn prefix_count(n0: f32, s: f32, z0: f32, d: f32, quality: f32) -> f32 {
    let ratio = d_zero(s, z0) / max(d, 1e-6);
    return min(n0 * quality * ratio * ratio, n0);
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

fn overlap(radius: f32, leaf_area: f32, gain: f32, thickness: u32, is_one_sided: bool, spacing: f32) -> f32 {
    // Twigs are one-sided and thinner than a splat: they get nothing.
    var leaf = select(1.0 + gain, 1.0, is_one_sided);
    if !is_one_sided && leaf_area > 0.0 {
        let a = PI * radius * radius;
        leaf = 1.0 + gain * (1.0 - 1.0 / (1.0 + leaf_area / (4.0 * a)));
    }
    // TRUSTED_THICKNESS: 1, 3, 8, 24 pixels, or 0, 0, 0, 6.
    var trusted = select(0.0, 6.0, thickness == 3u);
    if is_one_sided {
        trusted = select(select(1.0, 3.0, thickness == 1u), select(8.0, 24.0, thickness == 3u), thickness >= 2u);
    }
    let closed = clamp(trusted / (2.0 * spacing) - 1.0, 0.0, 1.0);
    return leaf + (CLOSED_OVERLAP - leaf) * closed;
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
