//! Streams of numbers, byte plane by byte plane.

use serde::{Deserialize, Serialize};

/// Bits of whole numbers that an `f32` represents.
const WHOLE_BITS: u8 = 24;
/// Bits of a shortened `f32`: its sign, its exponent, and 15 of its mantissa.
const SHORT_BITS: u32 = 24;

/// Encoding of a stream.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Stream {
    /// All bits.
    Exact,
    /// The upper bits of `f32`.
    Shortened,
    /// Whole numbers, as distances below the first one that is larger than all before.
    Whole,
    /// Whole steps from the smallest number.
    Steps {
        least: f32,
        step: f64,
        bits: u8,
        /// True if steps are stored as differences from the previous number.
        differs: bool,
    },
}

impl Stream {
    fn bits(&self) -> u8 {
        match self {
            Self::Exact => 32,
            Self::Shortened => SHORT_BITS as u8,
            Self::Whole => WHOLE_BITS,
            Self::Steps { bits, .. } => *bits,
        }
    }

    fn bytes(&self) -> usize {
        usize::from(self.bits().div_ceil(8))
    }

    /// Largest stored number, a mask of its bits.
    fn mask(&self) -> u32 {
        u32::MAX >> (32 - u32::from(self.bits()))
    }
}

/// Writer of streams.
#[derive(Debug, Default)]
pub(super) struct Writer {
    pub(super) bytes: Vec<u8>,
}

impl Writer {
    pub(super) fn exact(&mut self, numbers: impl Iterator<Item = f32>) -> Stream {
        self.put(Stream::Exact, &numbers.map(f32::to_bits).collect::<Vec<_>>())
    }

    /// Rounds to 15 bits of mantissa.
    pub(super) fn shortened(&mut self, numbers: impl Iterator<Item = f32>) -> Stream {
        const HALF: u32 = 1 << (31 - SHORT_BITS);
        let short = |number: f32| {
            let bits = number.to_bits();
            let rounded = bits.saturating_add(HALF);
            let is_finite = f32::from_bits(rounded).is_finite() || !number.is_finite();
            (if is_finite { rounded } else { bits }) >> (32 - SHORT_BITS)
        };
        self.put(Stream::Shortened, &numbers.map(short).collect::<Vec<_>>())
    }

    /// Whole numbers below 2²⁴, such as corners of triangles: if these are numbered in the order of
    /// their first use, a new one is stored as zero, and a recent one as a small number.
    pub(super) fn whole(&mut self, numbers: &[f32]) -> Stream {
        let mask = Stream::Whole.mask();
        let mut next = 0_u32;
        let below = |number: &f32| {
            let number = *number as u32;
            let distance = next.wrapping_sub(number) & mask;
            next = next.max(number + 1);
            distance
        };
        let distances: Vec<u32> = numbers.iter().map(below).collect();
        self.put(Stream::Whole, &distances)
    }

    /// Rounds to steps of a size, or larger ones if the range has more steps than [`WHOLE_BITS`]
    /// can count. Numbers that are not finite become the smallest.
    pub(super) fn stepped(&mut self, numbers: &[f32], step: f64, differs: bool) -> Stream {
        let [least, most] = range(numbers);
        let span = f64::from(most) - f64::from(least);
        let step = step.min(span).max(span / f64::from((1_u32 << WHOLE_BITS) - 1));
        let last = (span / step).round() as u32;
        let bits = (u32::BITS - last.leading_zeros()).max(1) as u8;
        let stream = Stream::Steps { least, step, bits, differs };
        let index =
            |number: f32| ((f64::from(number) - f64::from(least)) / step).round().clamp(0.0, last.into()) as u32;
        let steps: Vec<u32> = numbers.iter().map(|number| index(*number)).collect();
        if !differs {
            return self.put(stream, &steps);
        }
        let before = |index: usize| if index == 0 { 0 } else { steps[index - 1] };
        let difference = |index: usize| step_from(before(index), steps[index], stream.mask());
        let differences: Vec<u32> = (0..steps.len()).map(difference).collect();
        self.put(stream, &differences)
    }

    fn put(&mut self, stream: Stream, numbers: &[u32]) -> Stream {
        for byte in (0..stream.bytes()).rev() {
            self.bytes.extend(numbers.iter().map(|number| (number >> (8 * byte)) as u8));
        }
        stream
    }
}

/// Smallest and largest finite number; zeros without any.
pub(super) fn range(numbers: &[f32]) -> [f32; 2] {
    let finite = || numbers.iter().copied().filter(|number| number.is_finite());
    let (least, most) = (finite().fold(f32::MAX, f32::min), finite().fold(f32::MIN, f32::max));
    if least <= most { [least, most] } else { [0.0; 2] }
}

/// Zigzag-encoded difference of two numbers modulo the mask's range.
const fn step_from(before: u32, now: u32, mask: u32) -> u32 {
    let apart = now.wrapping_sub(before) & mask;
    let signed = if apart <= mask / 2 { apart as i32 } else { apart as i32 - mask as i32 - 1 };
    folded(signed) & mask
}

/// Signed numbers as unsigned ones, small for small magnitudes.
const fn folded(number: i32) -> u32 {
    ((number << 1) ^ (number >> 31)) as u32
}

const fn unfolded(number: u32) -> i32 {
    (number >> 1) as i32 ^ -((number & 1) as i32)
}

/// Reader of streams.
#[derive(Debug)]
pub(super) struct Reader<'a> {
    /// Remaining bytes.
    pub(super) bytes: &'a [u8],
}

impl Reader<'_> {
    /// Numbers of the next stream; `None` if it is cut short or has no bits.
    pub(super) fn numbers(&mut self, stream: &Stream, count: usize) -> Option<Vec<f32>> {
        if !(1..=32).contains(&stream.bits()) {
            return None;
        }
        let (planes, rest) = self.bytes.split_at_checked(count.checked_mul(stream.bytes())?)?;
        self.bytes = rest;
        let mut stored = vec![0_u32; count];
        for plane in planes.chunks_exact(count.max(1)) {
            stored.iter_mut().zip(plane).for_each(|(number, byte)| *number = *number << 8 | u32::from(*byte));
        }
        Some(decoded(stream, stored))
    }
}

fn decoded(stream: &Stream, mut stored: Vec<u32>) -> Vec<f32> {
    match *stream {
        Stream::Exact => stored.into_iter().map(f32::from_bits).collect(),
        Stream::Shortened => stored.into_iter().map(|bits| f32::from_bits(bits << (32 - SHORT_BITS))).collect(),
        Stream::Whole => {
            let mut next = 0_u32;
            let above = |distance: u32| {
                let number = next.wrapping_sub(distance) & stream.mask();
                next = next.max(number + 1);
                number as f32
            };
            stored.into_iter().map(above).collect()
        }
        Stream::Steps { least, step, differs, .. } => {
            let mask = stream.mask();
            if differs {
                let mut last = 0_u32;
                for number in &mut stored {
                    last = last.wrapping_add(unfolded(*number) as u32) & mask;
                    *number = last;
                }
            }
            stored.into_iter().map(|number| (f64::from(least) + step * f64::from(number)) as f32).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(count: usize) -> Vec<f32> {
        (0..count).map(|k| (0.37 * k as f32).sin() * 5.0 + 0.01 * k as f32).collect()
    }

    fn there_and_back(write: impl FnOnce(&mut Writer) -> Stream, count: usize) -> Vec<f32> {
        let mut writer = Writer::default();
        let stream = write(&mut writer);
        let mut reader = Reader { bytes: &writer.bytes };
        let read = reader.numbers(&stream, count).expect("all is there");
        assert!(reader.bytes.is_empty());
        assert!(Reader { bytes: &writer.bytes[1..] }.numbers(&stream, count).is_none(), "a byte is missing");
        read
    }

    #[test]
    fn exact_numbers_keep_every_bit() {
        let mut all = numbers(40);
        all.extend([f32::NEG_INFINITY, -0.0, f32::MIN_POSITIVE]);
        let read = there_and_back(|writer| writer.exact(all.iter().copied()), all.len());
        assert!(all.iter().zip(&read).all(|(a, b)| a.to_bits() == b.to_bits()));
    }

    #[test]
    fn shortened_numbers_have_a_small_relative_error() {
        /// Half a step of 15 bits of mantissa.
        const HALF_STEP: f32 = 1.0 / 65536.0;
        let all = [1.0, -3.7, 1e-20, 65504.0, 3.0e38, 0.0];
        let read = there_and_back(|writer| writer.shortened(all.iter().copied()), all.len());
        for (a, b) in all.iter().zip(&read) {
            assert!((a - b).abs() <= HALF_STEP * a.abs(), "{a} became {b}");
        }
    }

    #[test]
    fn stepped_numbers_are_within_half_a_step() {
        /// Rounding of the result to `f32`, in a range of about 20.
        const ROUNDING: f32 = 2e-6;
        let all = numbers(1000);
        for differs in [false, true] {
            for step in [0.1, 0.01, 1e-3, 1e-5] {
                let read = there_and_back(|writer| writer.stepped(&all, step, differs), all.len());
                let apart = all.iter().zip(&read).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(apart <= 0.5 * step as f32 + ROUNDING, "{apart} apart with steps of {step}");
            }
        }
        let one = there_and_back(|writer| writer.stepped(&[2.5, 2.5, f32::NAN], 0.1, true), 3);
        assert_eq!(one, [2.5; 3]);
        let far = there_and_back(|writer| writer.stepped(&[-1e9, 0.25, 1e9], 1e-6, true), 3);
        assert!((far[1] - 0.25).abs() < 100.0, "the number of steps is limited");
    }

    #[test]
    fn corners_of_triangles_are_whole() {
        let all: Vec<f32> = [0, 1, 2, 16_777_215, 0, 5, 3, 9_000_000, 16_777_214].map(|x| x as f32).into();
        assert_eq!(there_and_back(|writer| writer.whole(&all), all.len()), all);
    }
}
