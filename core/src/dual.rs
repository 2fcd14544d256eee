//! Dual numbers: a value and its exact derivative along one direction, the reference of every
//! `_vjp`.

use crate::{math, real::Real};
use core::ops::{Add, Div, Mul, Neg, Sub};

/// value + slope·ε with ε² = 0: `slope` is the derivative of any formula that is evaluated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Dual {
    /// The value.
    pub value: f64,
    /// The derivative of the value along the chosen direction.
    pub slope: f64,
}

impl Dual {
    /// A number that does not depend on the direction of derivation.
    pub fn constant_from(value: f64) -> Self {
        Self { value, slope: 0.0 }
    }
    /// Variable of the derivative.
    pub fn variable(value: f64) -> Self {
        Self { value, slope: 1.0 }
    }
    #[inline(always)]
    fn map(self, value: f64, derivative: f64) -> Self {
        Self { value, slope: self.slope * derivative }
    }
}

impl From<Dual> for f64 {
    /// The value, without its derivative.
    fn from(number: Dual) -> Self {
        number.value
    }
}

impl From<f64> for Dual {
    fn from(value: f64) -> Self {
        Self::constant_from(value)
    }
}

impl Add for Dual {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, slope: self.slope + other.slope }
    }
}
impl Sub for Dual {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, slope: self.slope - other.slope }
    }
}
impl Mul for Dual {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self { value: self.value * other.value, slope: self.slope * other.value + self.value * other.slope }
    }
}
impl Div for Dual {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        Self { value, slope: (self.slope - value * other.slope) / other.value }
    }
}
impl Neg for Dual {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { value: -self.value, slope: -self.slope }
    }
}

macro_rules! with_literals {
    ($($trait:ident $method:ident;)*) => {$(
        impl $trait<f32> for Dual {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f32) -> Self {
                $trait::$method(self, Self::constant_from(f64::from(other)))
            }
        }
    )*};
}
with_literals! { Add add; Sub sub; Mul mul; Div div; }

impl Real for Dual {
    type Mask = bool;

    #[inline(always)]
    fn constant(self, value: f32) -> Self {
        Self::constant_from(f64::from(value))
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        self * factor + addend
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = math::sqrt64(self.value);
        self.map(root, 0.5 / root)
    }
    #[inline(always)]
    fn exp2(self) -> Self {
        let power = math::exp264(self.value.clamp(-126.0, 127.0));
        self.map(power, power * core::f64::consts::LN_2)
    }
    #[inline(always)]
    fn log2(self) -> Self {
        self.map(math::log264(self.value), core::f64::consts::LOG2_E / self.value)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        let power = math::exp264((self.value * core::f64::consts::LOG2_E).clamp(-126.0, 127.0));
        self.map(power, power)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.map(math::ln64(self.value), 1.0 / self.value)
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Self::constant_from(math::floor64(self.value))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        if self.value < 0.0 { -self } else { self }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self.value < other.value { self } else { other }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self.value > other.value { self } else { other }
    }
    #[inline(always)]
    fn less(self, other: Self) -> bool {
        self.value < other.value
    }
    #[inline(always)]
    fn less_or_equal(self, other: Self) -> bool {
        self.value <= other.value
    }
    #[inline(always)]
    fn select(mask: bool, if_true: Self, if_false: Self) -> Self {
        if mask { if_true } else { if_false }
    }
}
