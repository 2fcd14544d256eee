//! Half precision for what is only looked at: f32 to compute, f16 to store.

use half::f16;

/// Two numbers as halves in one word, the first in the low bits: WGSL's `pack2x16float`. Rounds to nearest even;
/// what exceeds 65504 becomes infinite, so callers limit first.
pub fn pack2(a: f32, b: f32) -> u32 {
    u32::from(f16::from_f32(a).to_bits()) | u32::from(f16::from_f32(b).to_bits()) << 16
}

/// The two numbers of [`pack2`], exactly.
pub fn unpack2(word: u32) -> [f32; 2] {
    let low = f16::from_bits((word & 0xffff) as u16);
    let high = f16::from_bits((word >> 16) as u16);
    [low.to_f32(), high.to_f32()]
}

/// Packs numbers two by two; a last odd one is paired with zero. `words` holds half as many, rounded up.
pub fn pack(values: &[f32], words: &mut [u32]) {
    for (pair, word) in values.chunks(2).zip(words) {
        *word = pack2(pair[0], pair.get(1).copied().unwrap_or(0.0));
    }
}

/// Unpacks what [`pack`] has packed.
pub fn unpack(words: &[u32], values: &mut [f32]) {
    for (pair, word) in values.chunks_mut(2).zip(words) {
        let unpacked = unpack2(*word);
        pair.copy_from_slice(&unpacked[..pair.len()]);
    }
}
