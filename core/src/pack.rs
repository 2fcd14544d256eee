//! Half precision for stored scenes: f32 to compute, f16 to store.
//!
//! Half storage keeps the mean and the scales of a Gaussian in `f32` and packs pairs of its other
//! planes into words. Gaussians are packed on the host, light in integers on the device, so all
//! devices and the CPU round in the same way.

use crate::scene::{BLOCK, Gaussians, Layout, QUAT};
use half::f16;

/// Storage of the numbers of Gaussians and of the texels of a filtered light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Storage {
    /// Full `f32`; training needs it.
    #[default]
    F32,
    /// Pairs of `f16` in `u32`; means and scales stay `f32`. Render only.
    F16,
}

/// First planes of a Gaussian, which are always stored as `f32`: its mean and its scales. At a
/// distance of 4 from the origin halves are 2⁻⁸ apart, more than a pixel of most pictures; and if
/// two scales are nearly equal, rounding can change the shortest axis and so the normal.
pub const FULL_PLANES: usize = QUAT;

impl Storage {
    /// Words of 32 bits that a Gaussian takes.
    pub const fn words(self, layout: Layout) -> usize {
        match self {
            Self::F32 => layout.plane_count(),
            Self::F16 => FULL_PLANES + (layout.plane_count() - FULL_PLANES).div_ceil(2),
        }
    }

    /// Texel after a round trip through the storage format.
    pub fn texel(self, texel: [f32; 4]) -> [f32; 4] {
        match self {
            Self::F32 => texel,
            Self::F16 => texel.map(rounded),
        }
    }

    /// Rounds every number of Gaussians to the storage format.
    pub fn round<A: AsMut<[f32]>>(self, gaussians: &mut Gaussians<A>) {
        if self == Self::F16 {
            let block_len = gaussians.block_len();
            let blocks = gaussians.values.as_mut().chunks_mut(block_len);
            blocks.flat_map(|block| &mut block[FULL_PLANES * BLOCK..]).for_each(|number| *number = rounded(*number));
        }
    }
}

/// Nearest half, ties to even. Finite numbers are clamped to ±65504; infinities and NaN are
/// kept.
fn half(number: f32) -> f16 {
    let limit = f32::from(f16::MAX);
    f16::from_f32(if number.is_finite() { number.clamp(-limit, limit) } else { number })
}

fn rounded(number: f32) -> f32 {
    half(number).to_f32()
}

/// Two numbers as the nearest halves in one word, the first in the low bits, like WGSL's
/// `pack2x16float`.
pub fn pack2(a: f32, b: f32) -> u32 {
    u32::from(half(a).to_bits()) | u32::from(half(b).to_bits()) << 16
}

/// The two numbers of [`pack2`], exactly.
pub fn unpack2(word: u32) -> [f32; 2] {
    let low = f16::from_bits((word & 0xffff) as u16);
    let high = f16::from_bits((word >> 16) as u16);
    [low.to_f32(), high.to_f32()]
}

/// Gaussians as halves. A block of words has the unchanged [`FULL_PLANES`], then one plane of words
/// for each pair of planes; a last odd one is paired with zeros. There are [`Storage::words`] for
/// each Gaussian of each block.
pub fn pack<A: AsRef<[f32]>>(gaussians: &Gaussians<A>, words: &mut [u32]) {
    let words_of_block = BLOCK * Storage::F16.words(gaussians.layout);
    let blocks = gaussians.values.as_ref().chunks(gaussians.block_len());
    for (numbers, words) in blocks.zip(words.chunks_mut(words_of_block)) {
        let (full, halves) = numbers.split_at(FULL_PLANES * BLOCK);
        let (full_words, half_words) = words.split_at_mut(FULL_PLANES * BLOCK);
        full.iter().zip(full_words).for_each(|(number, word)| *word = number.to_bits());
        for (planes, words) in halves.chunks(2 * BLOCK).zip(half_words.chunks_mut(BLOCK)) {
            let (first, second) = planes.split_at(BLOCK);
            for (k, word) in words.iter_mut().enumerate() {
                *word = pack2(first[k], second.get(k).copied().unwrap_or(0.0));
            }
        }
    }
}

/// Number of values that [`unpack`] makes of this many words.
pub const fn unpacked_len(words: usize, layout: Layout) -> usize {
    words / Storage::F16.words(layout) * layout.plane_count()
}

/// Numbers of Gaussians in the order of [`Gaussians`], [`unpacked_len`] of them, from the words of
/// [`pack`].
pub fn unpack(words: &[u32], layout: Layout, values: &mut [f32]) {
    let words_of_block = BLOCK * Storage::F16.words(layout);
    for (numbers, words) in values.chunks_mut(BLOCK * layout.plane_count()).zip(words.chunks(words_of_block)) {
        let (full, halves) = numbers.split_at_mut(FULL_PLANES * BLOCK);
        let (full_words, half_words) = words.split_at(FULL_PLANES * BLOCK);
        full.iter_mut().zip(full_words).for_each(|(number, word)| *number = f32::from_bits(*word));
        for (plane, numbers) in halves.chunks_mut(BLOCK).enumerate() {
            let words = &half_words[plane / 2 * BLOCK..];
            numbers.iter_mut().zip(words).for_each(|(number, word)| *number = unpack2(*word)[plane % 2]);
        }
    }
}
