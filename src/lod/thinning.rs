//! Factors that follow how many of its points a tree shows: on the area of their splats and on their colour
//! ([`TreeData::area_factors`](crate::asset::TreeData::area_factors)).
//!
//! A table has [`FACTOR_STEPS`] numbers from one point to all: for each number of few points, where every point shows, and
//! then at equal steps of the logarithm, of half an octave or so. A prefix between two levels of the lattice covers 1 to 2 %
//! less than either, which whole octaves would miss.

/// Numbers of a table: from one point to all points of a tree.
pub const FACTOR_STEPS: usize = 32;

/// Up to so many points, each number has its own: every point more or less shows there.
const EACH: usize = 12;

/// The most that a factor may be, and a step of it: 16 bits hold it on the GPU.
pub const FACTOR_LIMIT: f32 = 2.5;
const STEPS_OF_ONE: f32 = 16_384.0;

/// Where `n` of `n0` points stand in a table, 0 to [`FACTOR_STEPS`] − 1.
pub fn factor_place(n: f32, n0: f32) -> f32 {
    let (last, few) = ((FACTOR_STEPS - 1) as f32, EACH as f32);
    if n <= few {
        return n.max(1.0) - 1.0;
    }
    let octaves = (n0 / few).max(2.0).log2();
    (few - 1.0 + (last + 1.0 - few) * (n / few).log2() / octaves).min(last)
}

/// Points that number `step` of a table is for: the inverse of [`factor_place`].
pub fn factor_points(step: usize, n0: f32) -> f32 {
    let few = EACH as f32;
    if step < EACH {
        return step as f32 + 1.0;
    }
    let octaves = (n0 / few).max(2.0).log2();
    few * (octaves * (step + 1 - EACH) as f32 / (FACTOR_STEPS - EACH) as f32).exp2()
}

/// The factor of `n` of `n0` points.
pub fn factor_of(factors: &[f32; FACTOR_STEPS], n: f32, n0: f32) -> f32 {
    let place = factor_place(n, n0);
    let below = (place as usize).min(FACTOR_STEPS - 2);
    let (low, high) = (factors[below], factors[below + 1]);
    low + (high - low) * (place - below as f32)
}

/// A factor as the GPU has it.
pub fn round_factor(factor: f32) -> f32 {
    (factor.clamp(0.0, FACTOR_LIMIT) * STEPS_OF_ONE).round() / STEPS_OF_ONE
}

/// A table for the GPU: two numbers a word, the even one in the low half.
pub fn pack_factors(factors: &[f32; FACTOR_STEPS]) -> [u32; FACTOR_STEPS / 2] {
    let bits = |factor: f32| (round_factor(factor) * STEPS_OF_ONE) as u32;
    std::array::from_fn(|i| bits(factors[2 * i]) | bits(factors[2 * i + 1]) << 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_lie_between_those_of_their_step() {
        let factors = std::array::from_fn(|step| step as f32 / 16.0);
        let n0 = 12.0 * 2f32.powi(20);
        let found = [0.0, 0.3, 1.0, 2.5, 12.0].map(|n| factor_of(&factors, n, n0) * 16.0);
        assert_eq!(found, [0.0, 0.0, 0.0, 1.5, 11.0]);
        let many = [18.0, 24.0, n0, 1e12].map(|n| factor_of(&factors, n, n0) * 16.0);
        assert!((many[0] - (11.0 + 1.5f32.log2())).abs() < 1e-5 && (many[1] - 12.0).abs() < 1e-5);
        assert_eq!(many[2..], [31.0, 31.0]);
        // A tree of a single point has one factor.
        assert_eq!(factor_of(&factors, 1.0, 1.0), 0.0);
    }

    #[test]
    fn every_step_is_for_a_number_of_points() {
        for n0 in [24.0, 100.0, 33_476.0, 786_438.0] {
            assert_eq!(factor_points(0, n0), 1.0);
            for step in 0..FACTOR_STEPS {
                let place = factor_place(factor_points(step, n0), n0);
                assert!((place - step as f32).abs() < 1e-3, "{step} of {n0}");
            }
        }
    }

    #[test]
    fn packed_factors_are_the_rounded_ones() {
        let factors = std::array::from_fn(|step| 0.05 + step as f32 * 0.079);
        for (i, word) in pack_factors(&factors).into_iter().enumerate() {
            let unpacked = [word & 0xffff, word >> 16].map(|bits| bits as f32 / STEPS_OF_ONE);
            assert_eq!(unpacked, [factors[2 * i], factors[2 * i + 1]].map(round_factor));
            assert!((unpacked[0] - factors[2 * i]).abs() <= 0.5 / STEPS_OF_ONE);
        }
    }
}
