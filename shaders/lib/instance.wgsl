// Unpacking of tree instances. CPU twin: src/forest/instance.rs.
#define_import_path bevy_treeline::instance

#import bevy_treeline::hash::{mix_bits, unit_from_bits}
#import bevy_treeline::types::TreeInstance

const HAS_MESH: u32 = 0x01000000u;
const NOT_RESIDENT: u32 = 0xffffu;

fn species_of(instance: TreeInstance) -> u32 {
    return instance.species_seed_flags & 0xffffu;
}

fn seed_of(instance: TreeInstance) -> u32 {
    return (instance.species_seed_flags >> 16u) & 0xffu;
}

// A number in [0, 1) that a tree keeps whatever else comes and goes, and wherever in the buffer it lies.
fn hash_of(instance: TreeInstance) -> f32 {
    let position = bitcast<vec3<u32>>(instance.position);
    let seed = mix_bits(seed_of(instance) ^ 0x51ed270bu);
    return unit_from_bits(position.x ^ mix_bits(position.y ^ mix_bits(position.z ^ seed)));
}

fn has_mesh(instance: TreeInstance) -> bool {
    return (instance.species_seed_flags & HAS_MESH) != 0u;
}

fn rotation_of(instance: TreeInstance) -> vec4<f32> {
    return normalize(vec4(unpack2x16snorm(instance.rotation.x), unpack2x16snorm(instance.rotation.y)));
}

fn rotate(q: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    let t = 2.0 * cross(q.xyz, v);
    return v + q.w * t + cross(q.xyz, t);
}

fn matrix_of(q: vec4<f32>) -> mat3x3<f32> {
    let twice = q.xyz + q.xyz;
    let x = twice * q.x;
    let y = twice * q.y;
    let z = twice * q.z;
    let w = twice * q.w;
    return mat3x3<f32>(
        vec3(1.0 - (y.y + z.z), x.y + w.z, x.z - w.y),
        vec3(x.y - w.z, 1.0 - (x.x + z.z), y.z + w.x),
        vec3(x.z + w.y, y.z - w.x, 1.0 - (x.x + y.y)),
    );
}

// Colour factor: 128 is 1.
fn tint_of(instance: TreeInstance) -> vec3<f32> {
    return unpack4x8unorm(instance.tint).rgb * (255.0 / 128.0);
}
