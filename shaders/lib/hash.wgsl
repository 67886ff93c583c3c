// Integer hashes, equal to the bit on CPU and GPU. Twin of src/math/hash.rs.
#define_import_path bevy_treeline::hash

// Mixes the bits of `x` (a murmur3-like finaliser).
fn mix_bits(x: u32) -> u32 {
    var h = x * 0x9E3779B1u;
    h = (h ^ (h >> 15u)) * 0x85EBCA6Bu;
    h = (h ^ (h >> 13u)) * 0xC2B2AE35u;
    return h ^ (h >> 16u);
}

// A number in [0, 1) from 24 bits of the hash of `x`: exact in f32.
fn unit_from_bits(x: u32) -> f32 {
    return f32(mix_bits(x) >> 8u) / 16777216.0;
}
