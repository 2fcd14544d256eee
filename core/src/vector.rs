//! Vectors of three and matrices of three rows, over any number; `From` and to glam at the border.
//!
//! A closure passed to `array::map` or `from_fn` is compiled without the vector features of the
//! machine, and each operation in it becomes a call. Formulas that run on SIMD lanes are therefore
//! expanded in place, by `each!`.

use crate::real::Real;
use core::ops::{Add, Div, Mul, Neg, Sub};

/// Three numbers: a point, a direction or a colour.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Vec3<R> {
    /// First component, or red.
    pub x: R,
    /// Second component, or green.
    pub y: R,
    /// Third component, or blue.
    pub z: R,
}

/// Each component of a vector through an expression: `each!(v, x => x + 1.0)`.
///
/// The expression is expanded in place; a closure or a function argument is compiled separately,
/// without the vector features of the machine, and costs a call for every operation.
#[macro_export]
macro_rules! each {
    ($vector:expr, $component:ident => $result:expr) => {{
        let vector = $vector;
        let x = {
            let $component = vector.x;
            $result
        };
        let y = {
            let $component = vector.y;
            $result
        };
        let z = {
            let $component = vector.z;
            $result
        };
        $crate::vector::vec3(x, y, z)
    }};
}

/// The vector (x, y, z).
#[inline(always)]
pub const fn vec3<R>(x: R, y: R, z: R) -> Vec3<R> {
    Vec3 { x, y, z }
}

impl<R: Real> Vec3<R> {
    /// The same number three times.
    #[inline(always)]
    pub fn splat(value: R) -> Self {
        vec3(value, value, value)
    }
    /// A constant vector of numbers of the same kind as `like`.
    #[inline(always)]
    pub fn constant(like: R, value: glam::Vec3) -> Self {
        vec3(like.constant(value.x), like.constant(value.y), like.constant(value.z))
    }
    /// The zero vector of the same kind as `like`.
    #[inline(always)]
    pub fn zero(like: R) -> Self {
        Self::splat(like.zero())
    }
    /// Scalar product.
    #[inline(always)]
    pub fn dot(self, other: Self) -> R {
        self.x.mul_add(other.x, self.y.mul_add(other.y, self.z * other.z))
    }
    /// Vector product.
    #[must_use]
    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        vec3(
            self.y * other.z - self.z * other.y,
            self.z * other.x - self.x * other.z,
            self.x * other.y - self.y * other.x,
        )
    }
    /// Component by component.
    #[must_use]
    #[inline(always)]
    pub fn times(self, other: Self) -> Self {
        vec3(self.x * other.x, self.y * other.y, self.z * other.z)
    }
    /// Squared length.
    #[inline(always)]
    pub fn length_squared(self) -> R {
        self.dot(self)
    }
    /// Sum of the components.
    #[inline(always)]
    pub fn sum(self) -> R {
        self.x + self.y + self.z
    }
    /// Each component through `f`.
    #[inline(always)]
    pub fn map<T>(self, mut f: impl FnMut(R) -> T) -> Vec3<T> {
        vec3(f(self.x), f(self.y), f(self.z))
    }
    /// self + factor · other.
    #[must_use]
    #[inline(always)]
    pub fn add_scaled(self, factor: R, other: Self) -> Self {
        vec3(factor.mul_add(other.x, self.x), factor.mul_add(other.y, self.y), factor.mul_add(other.z, self.z))
    }
    /// `if_true` where the mask holds, `if_false` elsewhere.
    #[inline(always)]
    pub fn select(mask: R::Mask, if_true: Self, if_false: Self) -> Self {
        vec3(
            R::select(mask, if_true.x, if_false.x),
            R::select(mask, if_true.y, if_false.y),
            R::select(mask, if_true.z, if_false.z),
        )
    }
    /// Components of `self` where those of `number` are below `limit` in magnitude, zero elsewhere:
    /// the gradient of a clamped number.
    #[inline(always)]
    pub(crate) fn keep_below(self, number: Self, limit: f32) -> Self {
        let limit = number.x.constant(limit);
        vec3(
            self.x.keep(number.x.abs().less(limit)),
            self.y.keep(number.y.abs().less(limit)),
            self.z.keep(number.z.abs().less(limit)),
        )
    }
    /// Mask of vectors whose components are all finite.
    #[inline(always)]
    pub fn is_finite(self) -> R::Mask {
        self.x.is_finite() & self.y.is_finite() & self.z.is_finite()
    }
    /// The components as an array.
    #[inline(always)]
    pub fn to_array(self) -> [R; 3] {
        [self.x, self.y, self.z]
    }
}

/// Length up to which vectors have no direction: the smallest number with a normal square.
pub const LENGTH_MIN: f32 = 1e-18;

/// `v` / |v|, or `fallback` if |v| is below [`LENGTH_MIN`], with a zero gradient there.
#[inline(always)]
pub fn normalize_or<R: Real>(v: Vec3<R>, fallback: Vec3<R>) -> Vec3<R> {
    let (unit, _, has_direction) = unit_and_mask(v);
    Vec3::select(has_direction, unit, fallback)
}

/// Gradient of [`normalize_or`] with respect to `v`: (I − v̂ v̂ᵀ) g / |v|.
#[inline(always)]
pub fn normalize_or_vjp<R: Real>(v: Vec3<R>, grad: Vec3<R>) -> Vec3<R> {
    let (unit, inverse, has_direction) = unit_and_mask(v);
    let tangent = (grad - unit * unit.dot(grad)) * inverse;
    Vec3::select(has_direction, tangent, Vec3::zero(v.x))
}

/// `v` / |v|, 1 / |v|, and the mask of vectors with a direction; `v` and 1 for others.
#[inline(always)]
fn unit_and_mask<R: Real>(v: Vec3<R>) -> (Vec3<R>, R, R::Mask) {
    let length_squared = v.length_squared();
    let has_direction = v.x.constant(LENGTH_MIN * LENGTH_MIN).less(length_squared);
    let inverse = R::select(has_direction, length_squared, v.x.constant(1.0)).sqrt().recip();
    (v * inverse, inverse, has_direction)
}

impl<R: Real> Add for Vec3<R> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        vec3(self.x + other.x, self.y + other.y, self.z + other.z)
    }
}
impl<R: Real> Sub for Vec3<R> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        vec3(self.x - other.x, self.y - other.y, self.z - other.z)
    }
}
impl<R: Real> Neg for Vec3<R> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        vec3(-self.x, -self.y, -self.z)
    }
}
impl<R: Real> Mul<R> for Vec3<R> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: R) -> Self {
        vec3(self.x * factor, self.y * factor, self.z * factor)
    }
}
impl<R: Real> Div<R> for Vec3<R> {
    type Output = Self;
    #[inline(always)]
    fn div(self, divisor: R) -> Self {
        let factor = divisor.recip();
        vec3(self.x * factor, self.y * factor, self.z * factor)
    }
}

impl From<glam::Vec3> for Vec3<f32> {
    fn from(v: glam::Vec3) -> Self {
        vec3(v.x, v.y, v.z)
    }
}
impl From<Vec3<f32>> for glam::Vec3 {
    fn from(v: Vec3<f32>) -> Self {
        Self::new(v.x, v.y, v.z)
    }
}

/// A 3×3 matrix, by rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mat3<R> {
    /// The rows.
    pub rows: [Vec3<R>; 3],
}

impl<R: Real> Mat3<R> {
    /// A constant matrix of numbers of the same kind as `like`.
    #[inline(always)]
    pub fn constant(like: R, matrix: glam::Mat3) -> Self {
        let row = |k: usize| Vec3::constant(like, matrix.row(k));
        Self { rows: [row(0), row(1), row(2)] }
    }
    /// Matrix times column vector.
    #[inline(always)]
    pub fn transform(&self, v: Vec3<R>) -> Vec3<R> {
        vec3(self.rows[0].dot(v), self.rows[1].dot(v), self.rows[2].dot(v))
    }
    /// Transposed matrix times column vector.
    #[inline(always)]
    pub fn transform_transposed(&self, v: Vec3<R>) -> Vec3<R> {
        let [a, b, c] = self.rows;
        (a * v.x).add_scaled(v.y, b).add_scaled(v.z, c)
    }
    /// A column.
    #[inline(always)]
    pub fn column(&self, index: usize) -> Vec3<R> {
        let [a, b, c] = self.rows;
        vec3(a.to_array()[index], b.to_array()[index], c.to_array()[index])
    }
    /// All columns.
    #[inline(always)]
    pub fn columns(&self) -> [Vec3<R>; 3] {
        [self.column(0), self.column(1), self.column(2)]
    }
    /// The matrix with these columns.
    #[inline(always)]
    pub fn from_columns(columns: [Vec3<R>; 3]) -> Self {
        let [a, b, c] = columns;
        Self { rows: [vec3(a.x, b.x, c.x), vec3(a.y, b.y, c.y), vec3(a.z, b.z, c.z)] }
    }
}
