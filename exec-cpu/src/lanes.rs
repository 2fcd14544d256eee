//! Sixteen `f32` as a number type of core, on the machine's widest vectors.

use core::{
    fmt,
    ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub},
};
use fearless_simd::{Simd, f32x16, mask32x16, prelude::*, u32x16};
use specula_core::{
    real::{AnyLane, EXP2_MAX, EXP2_MIN, ROUND_MAGIC, Real, exp2_fraction, log2_mantissa},
    scene::BLOCK,
    vector::{Vec3, vec3},
};

/// Sixteen numbers.
#[derive(Clone, Copy)]
pub struct Lanes<S: Simd>(pub f32x16<S>);

/// Mask of sixteen lanes.
#[derive(Clone, Copy)]
pub struct LaneMask<S: Simd>(mask32x16<S>);

impl<S: Simd> Lanes<S> {
    /// The same number in every lane.
    #[inline(always)]
    pub fn splat(simd: S, value: f32) -> Self {
        Self(f32x16::splat(simd, value))
    }
    /// The first sixteen numbers of a slice.
    #[inline(always)]
    pub fn load(simd: S, values: &[f32]) -> Self {
        Self(f32x16::from_slice(simd, &values[..BLOCK]))
    }
    /// Loads each of the first `N` arrays. A loop: closures lose the machine's vectors.
    #[inline(always)]
    pub(crate) fn load_each<const N: usize>(simd: S, arrays: &[[f32; BLOCK]]) -> [Self; N] {
        let mut all = [Self::splat(simd, 0.0); N];
        for (lanes, array) in all.iter_mut().zip(&arrays[..N]) {
            *lanes = Self::load(simd, array);
        }
        all
    }
    /// Lanes of an array.
    #[inline(always)]
    pub fn from_array(simd: S, values: [f32; BLOCK]) -> Self {
        Self(f32x16::simd_from(simd, values))
    }
    /// Stores the lanes into the first sixteen numbers of a slice.
    #[inline(always)]
    pub fn store(self, values: &mut [f32]) {
        self.0.store_slice(&mut values[..BLOCK]);
    }
    /// The lanes as an array.
    #[inline(always)]
    pub fn to_array(self) -> [f32; BLOCK] {
        self.0.into()
    }
    /// Sum of the lanes, in a fixed order.
    #[inline(always)]
    pub fn sum(self) -> f32 {
        let (low, high) = self.0.split();
        let (a, b) = (low + high).split();
        let [w, x, y, z]: [f32; 4] = (a + b).into();
        (w + y) + (x + z)
    }
    /// Whether any lane is positive.
    #[inline(always)]
    pub fn any_positive(self) -> bool {
        self.0.simd_gt(f32x16::splat(self.0.simd, 0.0)).any_true()
    }
    /// The first `count` lanes, followed by zeros.
    #[inline(always)]
    pub(crate) fn keep_first(self, count: usize) -> Self {
        if count >= BLOCK {
            return self;
        }
        let mut lanes = self.to_array();
        lanes[count..].fill(0.0);
        Self::from_array(self.0.simd, lanes)
    }
    /// Three planes of a block, from `plane` on.
    #[inline(always)]
    pub fn load3(simd: S, block: &[f32], plane: usize) -> Vec3<Self> {
        let at = |k: usize| Self::load(simd, &block[(plane + k) * BLOCK..]);
        vec3(at(0), at(1), at(2))
    }
}

/// Three planes of a block.
#[inline(always)]
pub fn store3<S: Simd>(v: Vec3<Lanes<S>>, block: &mut [f32], plane: usize) {
    v.x.store(&mut block[plane * BLOCK..]);
    v.y.store(&mut block[(plane + 1) * BLOCK..]);
    v.z.store(&mut block[(plane + 2) * BLOCK..]);
}

/// Sums of several lanes, in a fixed order, one number for each.
///
/// Neighbours are added pairwise until each lane contains one of the sums: a quarter of the work of
/// separate sums.
#[inline(always)]
pub(crate) fn sum_each<S: Simd>(all: &[Lanes<S>], out: &mut [f32]) {
    for (lanes, out) in all.chunks(BLOCK).zip(out.chunks_mut(BLOCK)) {
        let zero = lanes[0].zero();
        let mut folded = [zero; BLOCK];
        folded[..lanes.len()].copy_from_slice(lanes);
        let mut count = lanes.len();
        for _ in 0..BLOCK.ilog2() {
            for k in 0..count.div_ceil(2) {
                let (a, b) = (folded[2 * k].0, if 2 * k + 1 < count { folded[2 * k + 1].0 } else { zero.0 });
                folded[k] = Lanes(a.unzip_low(b) + a.unzip_high(b));
            }
            count = count.div_ceil(2);
        }
        out.copy_from_slice(&folded[0].to_array()[..lanes.len()]);
    }
}

impl<S: Simd> fmt::Debug for Lanes<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.to_array().fmt(f)
    }
}

impl<S: Simd> LaneMask<S> {
    /// A bit for each lane, the first in the lowest.
    #[inline(always)]
    pub(crate) fn bits(self) -> u64 {
        self.0.to_bitmask()
    }
}

impl<S: Simd> AnyLane for LaneMask<S> {
    #[inline(always)]
    fn any(self) -> bool {
        self.0.any_true()
    }
}

impl<S: Simd> fmt::Debug for LaneMask<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("LaneMask")
    }
}

macro_rules! operators {
    ($($trait:ident $method:ident $operator:tt;)*) => {$(
        impl<S: Simd> $trait for Lanes<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0 $operator other.0)
            }
        }
        impl<S: Simd> $trait<f32> for Lanes<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f32) -> Self {
                Self(self.0 $operator other)
            }
        }
    )*};
}
operators! { Add add +; Sub sub -; Mul mul *; Div div /; }

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

macro_rules! mask_operators {
    ($($trait:ident $method:ident $operator:tt;)*) => {$(
        impl<S: Simd> $trait for LaneMask<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0 $operator other.0)
            }
        }
    )*};
}
mask_operators! { BitAnd bitand &; BitOr bitor |; }

impl<S: Simd> Not for LaneMask<S> {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}

impl<S: Simd> Real for Lanes<S> {
    type Mask = LaneMask<S>;

    #[inline(always)]
    fn constant(self, value: f32) -> Self {
        Self::splat(self.0.simd, value)
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        Self(self.0.mul_add(factor.0, addend.0))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }
    #[inline(always)]
    fn exp2(self) -> Self {
        self.clamp(EXP2_MIN, EXP2_MAX).exp2_of_small()
    }
    #[inline(always)]
    fn exp2_of_small(self) -> Self {
        let x = self;
        let shifted = x + ROUND_MAGIC;
        let whole = shifted - ROUND_MAGIC;
        let bits: u32x16<S> = shifted.0.bitcast();
        // The fraction's power is near one, so the whole number is added to its exponent.
        let fraction: u32x16<S> = exp2_fraction(x - whole).0.bitcast();
        Self((fraction + (bits << 23)).bitcast())
    }
    #[inline(always)]
    fn log2(self) -> Self {
        let bits: u32x16<S> = self.0.bitcast();
        let offset = bits - core::f32::consts::FRAC_1_SQRT_2.to_bits();
        let offset: fearless_simd::i32x16<S> = offset.bitcast();
        let exponent = offset >> 23;
        let shift: u32x16<S> = exponent.bitcast();
        let mantissa: f32x16<S> = (bits - (shift << 23)).bitcast();
        log2_mantissa(Self(mantissa)) + Self(f32x16::float_from(exponent))
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Self(self.0.floor())
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs())
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }
    #[inline(always)]
    fn less(self, other: Self) -> Self::Mask {
        LaneMask(self.0.simd_lt(other.0))
    }
    #[inline(always)]
    fn less_or_equal(self, other: Self) -> Self::Mask {
        LaneMask(self.0.simd_le(other.0))
    }
    #[inline(always)]
    fn select(mask: Self::Mask, if_true: Self, if_false: Self) -> Self {
        Self(mask.0.select(if_true.0, if_false.0))
    }
}
