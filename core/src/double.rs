//! `f64` as a [`Real`]: the reference of every error figure.

use crate::{math, real::Real};
use core::ops::{Add, Div, Mul, Neg, Sub};

/// An `f64` that also computes with `f32` literals.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct Double(pub f64);

impl From<Double> for f64 {
    fn from(number: Double) -> Self {
        number.0
    }
}

impl From<f64> for Double {
    fn from(value: f64) -> Self {
        Self(value)
    }
}

impl From<f32> for Double {
    fn from(value: f32) -> Self {
        Self(f64::from(value))
    }
}

macro_rules! operators {
    ($($trait:ident $method:ident $operator:tt;)*) => {$(
        impl $trait for Double {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0 $operator other.0)
            }
        }
        impl $trait<f32> for Double {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f32) -> Self {
                Self(self.0 $operator f64::from(other))
            }
        }
    )*};
}
operators! { Add add +; Sub sub -; Mul mul *; Div div /; }

impl Neg for Double {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl Real for Double {
    type Mask = bool;

    #[inline(always)]
    fn constant(self, value: f32) -> Self {
        Self(f64::from(value))
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        self * factor + addend
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(math::sqrt64(self.0))
    }
    #[inline(always)]
    fn exp2(self) -> Self {
        Self(math::exp264(self.0.clamp(-126.0, 127.0)))
    }
    #[inline(always)]
    fn log2(self) -> Self {
        Self(math::log264(self.0))
    }
    #[inline(always)]
    fn exp(self) -> Self {
        Self(math::exp264((self.0 * core::f64::consts::LOG2_E).clamp(-126.0, 127.0)))
    }
    #[inline(always)]
    fn ln(self) -> Self {
        Self(math::ln64(self.0))
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Self(math::floor64(self.0))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        if self.0 < 0.0 { -self } else { self }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self.0 < other.0 { self } else { other }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self.0 > other.0 { self } else { other }
    }
    #[inline(always)]
    fn less(self, other: Self) -> bool {
        self.0 < other.0
    }
    #[inline(always)]
    fn less_or_equal(self, other: Self) -> bool {
        self.0 <= other.0
    }
    #[inline(always)]
    fn select(mask: bool, if_true: Self, if_false: Self) -> Self {
        if mask { if_true } else { if_false }
    }
}
