//! Fingerprints of numbers, to distinguish arrays.

/// Hash of numbers by their bits (FNV-1a over words).
pub(crate) fn fingerprint(numbers: &[f32]) -> u64 {
    const START: u64 = 0xcbf2_9ce4_8422_2325;
    const PRIME: u64 = 0x0100_0000_01b3;
    numbers.iter().fold(START, |sum, number| (sum ^ u64::from(number.to_bits())).wrapping_mul(PRIME))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_with_other_bits_have_another_fingerprint() {
        assert_eq!(fingerprint(&[1.0, 2.0]), fingerprint(&[1.0, 2.0]));
        for other in [[2.0, 1.0], [1.0, 2.000_000_2], [-1.0, 2.0]] {
            assert_ne!(fingerprint(&[1.0, 2.0]), fingerprint(&other), "{other:?}");
        }
        assert_ne!(fingerprint(&[0.0]), fingerprint(&[-0.0]), "zeros have signs");
    }
}
