//! Integer hashes: seeded, stable across versions and platforms. The WGSL twin is `shaders/lib/hash.wgsl`.

/// Mixes the bits of `x` (a murmur3-like finaliser): equal inputs give equal outputs on CPU and GPU.
pub const fn mix_bits(x: u32) -> u32 {
    let mut h = x.wrapping_mul(0x9E37_79B1);
    h = (h ^ (h >> 15)).wrapping_mul(0x85EB_CA6B);
    h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
    h ^ (h >> 16)
}

/// A number in [0, 1) from 24 bits of the hash of `x`: exact in `f32`, so CPU and GPU agree to the bit.
pub fn unit_from_bits(x: u32) -> f32 {
    (mix_bits(x) >> 8) as f32 / 16_777_216.0
}

/// A small deterministic generator (SplitMix64, Steele et al. 2014) for seeded settings; not for secrets.
#[derive(Clone, Debug)]
pub struct SplitMix64(pub u64);

impl SplitMix64 {
    /// The next 64 bits.
    pub fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub fn next_f32(&mut self) -> f32 {
        (self.next_u64() >> 40) as f32 / 16_777_216.0
    }

    /// Uniform in [low, high).
    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.next_f32()
    }

    /// Uniform in 0..bound (bound > 0), by the multiply-shift method.
    pub fn below(&mut self, bound: usize) -> usize {
        ((u128::from(self.next_u64()) * bound as u128) >> 64) as usize
    }

    /// Fisher–Yates shuffle. O(n).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            let j = self.below(i + 1);
            items.swap(i, j);
        }
    }
}
