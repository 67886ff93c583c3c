// Unpacking of tree instances. CPU twin: src/forest/instance.rs.
#define_import_path bevy_treeline::instance

#import bevy_treeline::types::TreeInstance

const HAS_MESH: u32 = 0x01000000u;
const NOT_RESIDENT: u32 = 0xffffu;

fn species_of(instance: TreeInstance) -> u32 {
    return instance.species_seed_flags & 0xffffu;
}

fn seed_of(instance: TreeInstance) -> u32 {
    return (instance.species_seed_flags >> 16u) & 0xffu;
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

// Colour factor: 128 is 1.
fn tint_of(instance: TreeInstance) -> vec3<f32> {
    return unpack4x8unorm(instance.tint).rgb * (255.0 / 128.0);
}
