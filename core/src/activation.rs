//! Activation functions of the stored numbers of a Gaussian.

use crate::real::Real;

/// Logistic function 1 / (1 + e^−x), in \[0, 1\]. Evaluated through e^−|x|, so no argument
/// overflows.
#[inline(always)]
pub fn sigmoid<R: Real>(x: R) -> R {
    let small = (-x.abs()).exp();
    let smaller_half = small / (small + 1.0);
    R::select(x.less(x.zero()), smaller_half, -smaller_half + 1.0)
}

/// Gradient of [`sigmoid`] from its value: σ(1 − σ) g.
#[inline(always)]
pub fn sigmoid_vjp<R: Real>(value: R, grad: R) -> R {
    value * (-value + 1.0) * grad
}

/// Inverse of [`sigmoid`] for a host: ln(p / (1 − p)), with p kept in \[1e-7, 1 − 1e-7\].
pub fn logit(p: f32) -> f32 {
    let p = f64::from(p).clamp(1e-7, 1.0 - 1e-7);
    crate::math::ln64(p / (1.0 - p)) as f32
}

/// ln(1 + e^x) without overflow: max(x, 0) + ln(1 + e^−|x|).
#[inline(always)]
pub fn softplus<R: Real>(x: R) -> R {
    x.max(x.zero()) + ((-x.abs()).exp() + 1.0).ln()
}

/// Gradient of [`softplus`]: σ(x) g.
#[inline(always)]
pub fn softplus_vjp<R: Real>(x: R, grad: R) -> R {
    sigmoid(x) * grad
}
