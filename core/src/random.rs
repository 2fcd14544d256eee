//! Random numbers from counters: (seed, stream, index) always gives the same number, on any machine
//! and any thread.

/// 64 well mixed bits of a seed and two counters (the finaliser of SplitMix64, Steele et al. 2014).
pub const fn bits(seed: u64, stream: u64, index: u64) -> u64 {
    mix(mix(mix(seed ^ GOLDEN) ^ stream.wrapping_mul(GOLDEN)).wrapping_add(index.wrapping_mul(GOLDEN)))
}

/// A number in [0, 1), a multiple of 2⁻²⁴.
pub fn uniform(seed: u64, stream: u64, index: u64) -> f32 {
    (bits(seed, stream, index) >> 40) as f32 * (1.0 / 16_777_216.0)
}

/// A number from the normal distribution (Box and Muller 1958). Uses the indices 2·index and
/// 2·index + 1.
pub fn normal(seed: u64, stream: u64, index: u64) -> f32 {
    let radius = crate::math::sqrt(-2.0 * crate::math::ln(1.0 - uniform(seed, stream, 2 * index)));
    let angle = core::f32::consts::TAU * uniform(seed, stream, 2 * index + 1);
    radius * crate::math::cos(angle)
}

const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15; // 2^64 / golden ratio, odd

const fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
