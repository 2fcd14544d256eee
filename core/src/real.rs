//! Number type of the formulas.

use core::{
    fmt::Debug,
    ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub},
};

/// A real number, or several side by side: `f32`, SIMD lanes, [`crate::double::Double`],
/// [`crate::dual::Dual`].
///
/// Arithmetic also takes `f32` literals. There are no branches on values: comparisons return a
/// mask, and [`Real::select`] chooses lane by lane. Both sides of a choice are evaluated, so both
/// must be harmless.
pub trait Real:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f32, Output = Self>
    + Sub<f32, Output = Self>
    + Mul<f32, Output = Self>
    + Div<f32, Output = Self>
{
    /// The result of a comparison, lane by lane.
    type Mask: Copy + Debug + BitAnd<Output = Self::Mask> + BitOr<Output = Self::Mask> + Not<Output = Self::Mask>;

    /// `value` as a number of the same type as `self`, which is otherwise ignored.
    #[must_use]
    fn constant(self, value: f32) -> Self;
    /// self · factor + addend; fused if the machine supports it without cost.
    #[must_use]
    fn mul_add(self, factor: Self, addend: Self) -> Self;
    /// Square root.
    #[must_use]
    fn sqrt(self) -> Self;
    /// 2 to the power `self`; below −126 the result is that of −126, above 127 that of 127.
    #[must_use]
    fn exp2(self) -> Self;
    /// 2^x for |x| ≤ [`EXP2_SMALL`]; unspecified for larger arguments.
    #[must_use]
    #[inline(always)]
    fn exp2_of_small(self) -> Self {
        self.exp2()
    }
    /// Logarithm to base two, for positive normal numbers.
    #[must_use]
    fn log2(self) -> Self;
    /// Largest whole number not above `self`.
    #[must_use]
    fn floor(self) -> Self;
    /// Absolute value.
    #[must_use]
    fn abs(self) -> Self;
    /// The smaller of the two.
    #[must_use]
    fn min(self, other: Self) -> Self;
    /// The larger of the two.
    #[must_use]
    fn max(self, other: Self) -> Self;
    /// Mask of `self` < `other`; false if either is NaN.
    fn less(self, other: Self) -> Self::Mask;
    /// Mask of `self` ≤ `other`; false if either is NaN.
    fn less_or_equal(self, other: Self) -> Self::Mask;
    /// `if_true` where the mask holds, `if_false` elsewhere.
    fn select(mask: Self::Mask, if_true: Self, if_false: Self) -> Self;

    /// Mask of finite numbers in the range of `f32`: no NaN, no infinity.
    #[inline(always)]
    fn is_finite(self) -> Self::Mask {
        self.abs().less_or_equal(self.constant(f32::MAX))
    }
    /// 1 / self.
    #[must_use]
    #[inline(always)]
    fn recip(self) -> Self {
        self.constant(1.0) / self
    }
    /// self · self.
    #[must_use]
    #[inline(always)]
    fn squared(self) -> Self {
        self * self
    }
    /// `self` clamped to `[low, high]`.
    #[must_use]
    #[inline(always)]
    fn clamp(self, low: f32, high: f32) -> Self {
        self.max(self.constant(low)).min(self.constant(high))
    }
    /// Power of e, for |self| up to 87.
    #[must_use]
    #[inline(always)]
    fn exp(self) -> Self {
        (self * core::f32::consts::LOG2_E).exp2()
    }
    /// Power of e over the whole range of the numbers: for `f32` the library's, which underflows to
    /// zero and overflows to infinity.
    #[must_use]
    #[inline(always)]
    fn exp_wide(self) -> Self {
        self.exp()
    }
    /// Natural logarithm, for positive normal numbers.
    #[must_use]
    #[inline(always)]
    fn ln(self) -> Self {
        self.log2() * core::f32::consts::LN_2
    }
    /// A constant zero of the same kind.
    #[must_use]
    #[inline(always)]
    fn zero(self) -> Self {
        self.constant(0.0)
    }
    /// `self` where the mask holds, zero elsewhere.
    #[must_use]
    #[inline(always)]
    fn keep(self, mask: Self::Mask) -> Self {
        Self::select(mask, self, self.zero())
    }
}

/// Divisor above which it and its dividend are scaled down first; a power of two.
const DIVISOR_LARGE: f32 = (1_u64 << 63) as f32;

/// Power of two by which to multiply a positive divisor and its dividend before a division: 1
/// except for divisors above 2⁶³, because a GPU's quotient may be zero beyond 2¹²⁶.
#[inline(always)]
pub(crate) fn divisor_scale<R: Real>(divisor: R) -> R {
    let is_large = divisor.constant(DIVISOR_LARGE).less(divisor);
    R::select(is_large, divisor.constant(DIVISOR_LARGE.recip()), divisor.constant(1.0))
}

/// Mask that a branch may test; masks of traced formulas do not support this.
pub trait AnyLane {
    /// Whether any lane is set.
    fn any(self) -> bool;
}

impl AnyLane for bool {
    #[inline(always)]
    fn any(self) -> bool {
        self
    }
}

/// Coefficients of 2^x on [−½, ½], lowest first: the polynomial of degree 5 with the least relative
/// error, 7.5e-8, about that of `f32` itself.
const EXP2_COEFFICIENTS: [f32; 6] =
    [1.000_000_1, 0.693_146_94, 0.240_221_2, 0.055_507_13, 0.009_675_541, 0.001_327_647_2];
/// Exponents below this give denormal numbers, which cost an order of magnitude in time.
pub const EXP2_MIN: f32 = -126.0;
/// Exponents above this would give infinity.
pub const EXP2_MAX: f32 = 127.0;
/// Exponents up to this need no limit.
pub const EXP2_SMALL: f32 = 100.0;
/// Adding this number rounds an `f32` below 2²² to the nearest whole number.
pub const ROUND_MAGIC: f32 = 12_582_912.0; // 1.5 · 2^23

/// 2 / ((2k+1) ln 2), k = 0…4: log2(m) = Σ cₖ s^(2k+1) with s = (m−1)/(m+1), to 4e-10 for m in [√½,
/// √2].
const LOG2_COEFFICIENTS: [f32; 5] = [2.885_39, 0.961_796_7, 0.577_078, 0.412_198_6, 0.320_598_9];

/// The polynomial of [`Real::exp2`], on [−½, ½]; in pairs (Estrin), for short dependency chains.
#[inline(always)]
pub fn exp2_fraction<R: Real>(x: R) -> R {
    let c = EXP2_COEFFICIENTS;
    let first = x.constant(c[1]).mul_add(x, x.constant(c[0]));
    let second = x.constant(c[3]).mul_add(x, x.constant(c[2]));
    let third = x.constant(c[5]).mul_add(x, x.constant(c[4]));
    let x2 = x * x;
    third.mul_add(x2, second).mul_add(x2, first)
}

/// The polynomial of [`Real::log2`], for a mantissa in [√½, √2].
#[inline(always)]
pub fn log2_mantissa<R: Real>(mantissa: R) -> R {
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let s2 = s * s;
    let c = |k: usize| s.constant(LOG2_COEFFICIENTS[k]);
    c(4).mul_add(s2, c(3)).mul_add(s2, c(2)).mul_add(s2, c(1)).mul_add(s2, c(0)) * s
}

impl Real for f32 {
    type Mask = bool;

    #[inline(always)]
    fn constant(self, value: f32) -> Self {
        value
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        self * factor + addend
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        crate::math::sqrt(self)
    }
    #[inline(always)]
    fn exp2(self) -> Self {
        let x = Real::clamp(self, EXP2_MIN, EXP2_MAX);
        let shifted = x + ROUND_MAGIC;
        let whole = shifted - ROUND_MAGIC;
        let exponent = (shifted.to_bits() << 23).wrapping_add(127 << 23);
        exp2_fraction(x - whole) * Self::from_bits(exponent)
    }
    #[inline(always)]
    fn exp_wide(self) -> Self {
        crate::math::exp(self)
    }
    #[inline(always)]
    fn log2(self) -> Self {
        let bits = self.to_bits();
        let exponent = bits.wrapping_sub(core::f32::consts::FRAC_1_SQRT_2.to_bits()) as i32 >> 23;
        let mantissa = Self::from_bits(bits.wrapping_sub((exponent as u32) << 23));
        log2_mantissa(mantissa) + exponent as Self
    }
    #[inline(always)]
    fn floor(self) -> Self {
        crate::math::floor(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self::from_bits(self.to_bits() & 0x7fff_ffff)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    #[inline(always)]
    fn less(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn less_or_equal(self, other: Self) -> bool {
        self <= other
    }
    #[inline(always)]
    fn select(mask: bool, if_true: Self, if_false: Self) -> Self {
        if mask { if_true } else { if_false }
    }
}
