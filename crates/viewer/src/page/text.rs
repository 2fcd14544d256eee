//! Bytes as text of an HTML file: twenty bytes become 23 letters, 15 % more, where base64 has 33 %.
//!
//! Twenty bytes, the least significant first, are a number of 23 digits to the base 125, the most
//! significant first; the last block is filled with zeros, so a reader needs the number of bytes.
//! Letters are ASCII without NUL, carriage return and `<`, which HTML changes or interprets. They
//! are the same in UTF-8 and in every charset of the web that contains ASCII; `text.js` is the
//! reader.

use core::array;

/// Bytes of a block, and letters of its text.
const BLOCK: usize = 20;
const LETTERS: usize = 23;
/// Words of a block.
const WORDS: usize = BLOCK / 4;
/// Number of letters, and of groups of three.
const BASE: u64 = 125;
const GROUP: u64 = BASE * BASE * BASE;

/// Letter of a digit: ASCII from 1, without carriage return and `<`.
fn letter(digit: u64) -> u8 {
    let after = |letter: u8, left_out: u8| if letter >= left_out { letter + 1 } else { letter };
    after(after(digit as u8 + 1, b'\r'), b'<')
}

/// Text of bytes: 23 letters for each 20 of them, the last block filled with zeros.
pub fn text_of(bytes: &[u8]) -> String {
    let mut text = Vec::with_capacity(bytes.len().div_ceil(BLOCK) * LETTERS);
    for block in bytes.chunks(BLOCK) {
        let byte = |index: usize| block.get(index).copied().unwrap_or(0);
        let mut words: [u32; WORDS] = array::from_fn(|k| u32::from_le_bytes(array::from_fn(|j| byte(4 * k + j))));
        let mut digits = [0_u64; LETTERS + 1];
        // The last group has an unused digit, zero.
        for three in digits.as_chunks_mut::<3>().0.iter_mut().rev() {
            let group = remainder(&mut words, GROUP);
            *three = [group / (BASE * BASE), group / BASE % BASE, group % BASE];
        }
        text.extend(digits[1..].iter().map(|digit| letter(*digit)));
    }
    text.into_iter().map(char::from).collect()
}

/// Divides a number with its least significant word first; returns the remainder.
fn remainder(words: &mut [u32; WORDS], divisor: u64) -> u64 {
    words.iter_mut().rev().fold(0, |rest, word| {
        let number = rest << u32::BITS | u64::from(*word);
        *word = (number / divisor) as u32;
        number % divisor
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes of a text, digit by digit: a slow reader to test the encoder.
    fn bytes_of(text: &str, count: usize) -> Vec<u8> {
        let digits: Vec<u64> = text
            .bytes()
            .map(|found| (0..BASE).find(|digit| letter(*digit) == found).expect("it is one of the letters"))
            .collect();
        let (blocks, rest) = digits.as_chunks::<LETTERS>();
        assert!(rest.is_empty(), "blocks are whole");
        let block = |digits: &[u64; LETTERS]| {
            let mut bytes = [0_u8; BLOCK];
            for digit in digits {
                let over = bytes.iter_mut().fold(*digit, |carry, byte| {
                    let number = u64::from(*byte) * BASE + carry;
                    *byte = number as u8;
                    number >> 8
                });
                assert_eq!(over, 0, "a block is below 2¹⁶⁰");
            }
            bytes
        };
        let mut bytes = blocks.iter().flat_map(block).collect::<Vec<u8>>();
        assert!(bytes.split_off(count).iter().all(|byte| *byte == 0), "the rest is filled with zeros");
        bytes
    }

    #[test]
    fn every_byte_string_round_trips() {
        let mut state = 1_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 56) as u8
        };
        for count in (0..3 * BLOCK).chain([1000, 4096]) {
            let random: Vec<u8> = (0..count).map(|_| next()).collect();
            for bytes in [random, vec![0; count], vec![u8::MAX; count], (0..count).map(|k| k as u8).collect()] {
                assert_eq!(bytes_of(&text_of(&bytes), count), bytes);
            }
        }
        for byte in 0..=u8::MAX {
            assert_eq!(bytes_of(&text_of(&[byte]), 1), [byte]);
        }
    }

    #[test]
    fn text_is_at_most_fifteen_percent_longer_and_needs_no_escapes() {
        let bytes: Vec<u8> = (0..40_000_u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let text = text_of(&bytes);
        assert_eq!(100 * text.len(), 115 * bytes.len());
        assert!(text.bytes().all(|letter| letter.is_ascii() && ![0, b'\r', b'<'].contains(&letter)));
        let mut letters: Vec<u8> = (0..BASE).map(letter).collect();
        letters.dedup();
        assert_eq!((letters.len() as u64, letters[0], letters[124]), (BASE, 1, 127));
    }
}
