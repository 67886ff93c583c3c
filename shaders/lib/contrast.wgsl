// The contrast correction. CPU twin: src/lod/contrast.rs, where the formulas are explained.
#define_import_path bevy_treeline::contrast

#import bevy_treeline::lod::PI

const LOST_BY_DISPLAY: f32 = 0.12;

fn leaves_in_pixel(leaf_area: f32, unit: f32) -> f32 {
    return select(1.0, 1.0 + unit * unit / max(0.5 * leaf_area, 1e-20), leaf_area > 0.0);
}

fn contrast_factor(leaves: f32, samples: f32) -> f32 {
    return sqrt(samples / (leaves + samples - 1.0));
}

fn own_share(factor: f32, strength: f32) -> f32 {
    return 1.0 - strength * (1.0 - factor);
}

fn averaged_after_display(own: f32) -> f32 {
    return 1.0 - LOST_BY_DISPLAY * (1.0 - own * own);
}

fn mean_shade(cos_angle: f32) -> f32 {
    let cosine = clamp(cos_angle, -1.0, 1.0);
    let angle = acos(cosine);
    return 2.0 / (3.0 * PI) * (sin(angle) + (PI - angle) * cosine);
}

// Species.seen_mean: the mean colour in light of 1, and by what mean_shade is to be multiplied.
fn unpack_seen_mean(words: vec2<u32>) -> vec4<f32> {
    return vec4(unpack2x16unorm(words.x), unpack2x16unorm(words.y)) * vec4(1.0, 1.0, 1.0, 2.0);
}
