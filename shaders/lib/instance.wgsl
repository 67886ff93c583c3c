// Unpacking of tree instances. CPU twin: src/forest/instance.rs.
#define_import_path bevy_treeline::instance

#import bevy_treeline::hash::{mix_bits, unit_from_bits}
#import bevy_treeline::types::{TreeLook, TreePlace}

const HAS_MESH: u32 = 0x1000u;
const NOT_RESIDENT: u32 = 0xfffu;

// A tree, whose parts lie in two buffers.
struct TreeInstance {
    position: vec3<f32>,
    scale: f32,
    look: TreeLook,
}

fn tree_instance(place: TreePlace, look: TreeLook) -> TreeInstance {
    return TreeInstance(vec3(place.x, place.y, place.z), scale_of(look), look);
}

fn species_of(look: TreeLook) -> u32 {
    return look.species_scale & NOT_RESIDENT;
}

fn has_mesh(look: TreeLook) -> bool {
    return (look.species_scale & HAS_MESH) != 0u;
}

// Twin of `math::compact::scale_from_bits`.
fn scale_of(look: TreeLook) -> f32 {
    let bits = look.species_scale >> 16u;
    return select(bitcast<f32>((bits + 0x37800u) << 12u), 0.0, bits == 0u);
}

fn seed_of(look: TreeLook) -> u32 {
    return look.tint_seed >> 24u;
}

// A number in [0, 1) that a tree keeps whatever else comes and goes, and wherever in the buffer it lies.
fn hash_of(instance: TreeInstance) -> f32 {
    let position = bitcast<vec3<u32>>(instance.position);
    let seed = mix_bits(seed_of(instance.look) ^ 0x51ed270bu);
    return unit_from_bits(position.x ^ mix_bits(position.y ^ mix_bits(position.z ^ seed)));
}

// Twin of `math::compact::rotation_from_bits`.
fn rotation_of(look: TreeLook) -> vec4<f32> {
    let low = bitcast<i32>(look.rotation);
    // Ten bits of the third part and its sign, which is the first of the upper bits.
    let third = extractBits(bitcast<i32>((look.rotation >> 22u) | ((look.species_scale >> 3u) & 0x400u)), 0u, 11u);
    let kept = vec3<f32>(vec3(extractBits(low, 0u, 11u), extractBits(low, 11u, 11u), third)) * (0.70710678 / 1023.0);
    let largest = sqrt(max(1.0 - dot(kept, kept), 0.0));
    let left_out = (look.species_scale >> 14u) & 3u;
    var q = vec4(kept, largest);
    q = select(q, vec4(kept.xy, largest, kept.z), left_out == 2u);
    q = select(q, vec4(kept.x, largest, kept.yz), left_out == 1u);
    q = select(q, vec4(largest, kept), left_out == 0u);
    return normalize(q);
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
fn tint_of(look: TreeLook) -> vec3<f32> {
    return unpack4x8unorm(look.tint_seed).rgb * (255.0 / 128.0);
}
