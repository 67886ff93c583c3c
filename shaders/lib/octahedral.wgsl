// Octahedral unit vectors: a direction in two numbers. Twin of src/math/octahedral.rs.
// Source: Cigolle et al. 2014, "A Survey of Efficient Representations for Independent Unit Vectors".
#define_import_path bevy_treeline::octahedral

// 1 for +0, -1 for negative numbers: unlike sign(), never 0, so the fold loses nothing at the seam.
fn sign_not_zero(v: vec2<f32>) -> vec2<f32> {
    return select(vec2<f32>(-1.0), vec2<f32>(1.0), v >= vec2<f32>(0.0));
}

// Maps a unit vector to the square [-1, 1]². A zero vector maps to the direction +Z.
fn encode(direction: vec3<f32>) -> vec2<f32> {
    let sum = abs(direction.x) + abs(direction.y) + abs(direction.z);
    if !(sum > 0.0) {
        return vec2<f32>(0.0);
    }
    let p = direction / sum;
    if p.z >= 0.0 {
        return p.xy;
    }
    return (1.0 - abs(p.yx)) * sign_not_zero(p.xy);
}

// The direction of a point of the square [-1, 1]², of any length.
fn decode_direction(e: vec2<f32>) -> vec3<f32> {
    var v = vec3<f32>(e, 1.0 - abs(e.x) - abs(e.y));
    let fold = max(-v.z, 0.0);
    v.x += select(fold, -fold, v.x >= 0.0);
    v.y += select(fold, -fold, v.y >= 0.0);
    return v;
}

// The unit vector of a point of the square [-1, 1]²: the inverse of encode.
fn decode(e: vec2<f32>) -> vec3<f32> {
    return normalize(decode_direction(e));
}

// Steps from -1 to 0 of a number of `bits` bits. The grid has an even number of steps, so 0 (and every axis) is exact.
fn half_steps(bits: u32) -> f32 {
    return f32((1u << bits) - 2u) * 0.5;
}

// encode in two numbers of `x_bits` and `y_bits` bits (1 to 16), rounded to nearest, halves upwards as in Rust.
fn encode_bits(direction: vec3<f32>, x_bits: u32, y_bits: u32) -> vec2<u32> {
    let e = encode(direction);
    let steps = vec2<f32>(half_steps(x_bits), half_steps(y_bits));
    return vec2<u32>(floor((e + 1.0) * steps + 0.5));
}

// The inverse of encode_bits.
fn decode_bits(q: vec2<u32>, x_bits: u32, y_bits: u32) -> vec3<f32> {
    return normalize(decode_direction_bits(q, x_bits, y_bits));
}

// The same, of any length.
fn decode_direction_bits(q: vec2<u32>, x_bits: u32, y_bits: u32) -> vec3<f32> {
    let steps = vec2<f32>(half_steps(x_bits), half_steps(y_bits));
    return decode_direction(clamp(vec2<f32>(q) / steps - 1.0, vec2<f32>(-1.0), vec2<f32>(1.0)));
}
