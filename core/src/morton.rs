//! Morton order of Gaussians in memory: neighbours in space are neighbours in memory, so tiles read
//! coherently.

use crate::real::Real;
use core::{
    array,
    ops::{BitAnd, BitOr, Shl},
};

/// Bits of a cell's number along each axis.
const BITS: u32 = 10;
/// Bits of a code.
pub const CODE_BITS: u32 = 3 * BITS;

/// The box around some points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    low: [f32; 3],
    high: [f32; 3],
}

impl Bounds {
    /// Empty box.
    pub const NOTHING: Self = Self { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };

    /// The box extended to `point`; coordinates that are not finite are ignored.
    #[must_use]
    pub fn with(mut self, point: [f32; 3]) -> Self {
        for axis in 0..3 {
            if point[axis].is_finite() {
                self.low[axis] = self.low[axis].min(point[axis]);
                self.high[axis] = self.high[axis].max(point[axis]);
            }
        }
        self
    }

    /// The number of a point's cell along the Z-order curve (Morton 1966) through 1024³ cells of
    /// the box. Points outside are in the nearest cell, and NaN in the first.
    pub fn code(&self, point: [f32; 3]) -> u32 {
        interleave(array::from_fn(|axis| cell(point[axis], self.low[axis], self.high[axis]) as u32))
    }
}

/// Cell of a coordinate, of 1024 between two bounds, with the position in the cell as the fraction;
/// zero for NaN, as in a flat box.
#[inline(always)]
pub fn cell<R: Real>(x: R, low: R, high: R) -> R {
    let cells = (1 << BITS) as f32;
    ((x - low) / (high - low) * cells).clamp(0.0, cells - 1.0)
}

/// Bits of a word: `u32`, or a word that records its operations.
pub trait Bits: Copy + From<u32> + BitAnd<Output = Self> + BitOr<Output = Self> + Shl<u32, Output = Self> {}

impl<B: Copy + From<u32> + BitAnd<Output = Self> + BitOr<Output = Self> + Shl<u32, Output = Self>> Bits for B {}

/// Morton code of a cell: the bits of its three numbers, each below 1024, interleaved; x has the
/// lowest.
#[inline(always)]
pub fn interleave<B: Bits>([x, y, z]: [B; 3]) -> B {
    spread(x) | spread(y) << 1 | spread(z) << 2
}

/// Ten bits, each followed by two zeros.
#[inline(always)]
fn spread<B: Bits>(cell: B) -> B {
    let step = |bits: B, shift: u32, mask: u32| (bits | bits << shift) & B::from(mask);
    let bits = step(cell & B::from(0x3ff), 16, 0x0300_00ff);
    let bits = step(bits, 8, 0x0300_f00f);
    let bits = step(bits, 4, 0x030c_30c3);
    step(bits, 2, 0x0924_9249)
}

#[cfg(test)]
mod tests {
    use super::Bounds;

    #[test]
    fn codes_interleave_the_bits_of_cells() {
        let bounds = Bounds::NOTHING.with([0.0; 3]).with([1024.0; 3]);
        assert_eq!(bounds.code([1.5, 0.5, 0.5]), 0b001, "x is the lowest bit");
        assert_eq!(bounds.code([0.5, 1.5, 0.5]), 0b010, "then y");
        assert_eq!(bounds.code([3.5, 2.5, 1.5]), 0b011_101, "bit by bit");
        assert_eq!(bounds.code([1024.0; 3]), (1 << 30) - 1, "the far corner belongs to the last cell");
    }

    #[test]
    fn nonfinite_points_have_a_code() {
        let bounds = Bounds::NOTHING.with([2.0, f32::NAN, 0.0]).with([2.0, 5.0, f32::INFINITY]);
        assert_eq!(bounds.code([2.0, 5.0, 0.0]), 0, "a flat box has one cell");
        assert_eq!(bounds.code([f32::NAN; 3]), 0, "NaN comes first");
    }
}
