//! Numbers that come from `f64` and go back to it, so that one text serves every precision.

use specula_core::{
    double::Double,
    dual::Dual,
    real::Real,
    vector::{Mat3, Vec3, vec3},
};

/// A single [`Real`], not several side by side.
pub trait Number: Real<Mask = bool> + Into<f64> {
    /// The nearest number of this kind.
    fn of(value: f64) -> Self;
    /// Its value as `f64`; exact.
    fn value(self) -> f64 {
        self.into()
    }
}

impl Number for f32 {
    fn of(value: f64) -> Self {
        value as Self
    }
}

impl Number for Double {
    fn of(value: f64) -> Self {
        Self(value)
    }
}

impl Number for Dual {
    fn of(value: f64) -> Self {
        Self::constant_from(value)
    }
}

/// Three numbers as a vector.
pub fn vector<R: Number>(values: [f64; 3]) -> Vec3<R> {
    let [x, y, z] = values.map(R::of);
    vec3(x, y, z)
}

/// The values of a vector.
pub fn values_of<R: Number>(v: Vec3<R>) -> [f64; 3] {
    v.to_array().map(R::value)
}

/// The first three numbers of a slice as a vector.
pub fn take3<R: Number>(numbers: &[R]) -> Vec3<R> {
    vec3(numbers[0], numbers[1], numbers[2])
}

/// The first nine numbers of a slice as a matrix, by rows.
pub fn take9<R: Number>(numbers: &[R]) -> Mat3<R> {
    Mat3 { rows: [take3(numbers), take3(&numbers[3..]), take3(&numbers[6..])] }
}

/// The numbers of a matrix, by rows.
pub fn numbers_of<R: Number>(matrix: &Mat3<R>) -> Vec<R> {
    matrix.rows.iter().flat_map(|row| row.to_array()).collect()
}
