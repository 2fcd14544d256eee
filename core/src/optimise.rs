//! One step of Adam (Kingma and Ba 2015), and the decay of learning rates.

use crate::{math, real::Real};

/// Decay of the mean gradient.
pub const BETA1: f32 = 0.9;
/// Decay of the mean squared gradient.
pub const BETA2: f32 = 0.999;
/// Added to the root of the mean squared gradient (INRIA's value: practically nothing).
pub const EPSILON: f32 = 1e-15;

/// Largest magnitude of a usable gradient; larger ones count as not finite, because their squares
/// overflow an `f32`.
pub const GRAD_MAX: f32 = 1e18;

/// Learning rate of numbers at rest: a step changes neither them nor their moments. A rate of zero
/// only keeps the numbers.
pub const AT_REST: f32 = -1.0;

/// A parameter with its running means.
#[derive(Clone, Copy, Debug)]
pub struct Moment<R> {
    /// The parameter.
    pub value: R,
    /// Running mean of its gradient.
    pub mean: R,
    /// Running mean of its squared gradient.
    pub square: R,
}

/// Step size with both bias corrections: rate · √(1 − β₂ᵗ) / (1 − β₁ᵗ), for the t-th step, t ≥ 1.
pub fn corrected_rate(rate: f32, step: u32) -> f32 {
    let power = |beta: f32| 1.0 - math::pow64(f64::from(beta), f64::from(step));
    (f64::from(rate) * math::sqrt64(power(BETA2)) / power(BETA1)) as f32
}

/// [`EPSILON`] under the same correction: ε √(1 − β₂ᵗ).
pub fn corrected_epsilon(step: u32) -> f32 {
    (f64::from(EPSILON) * math::sqrt64(1.0 - math::pow64(f64::from(BETA2), f64::from(step)))) as f32
}

/// Mask of usable gradients: finite, and no larger than [`GRAD_MAX`].
#[inline(always)]
pub fn is_usable<R: Real>(grad: R) -> R::Mask {
    grad.abs().less_or_equal(grad.constant(GRAD_MAX))
}

/// One step against the gradient. A zero gradient with no history changes nothing.
#[inline(always)]
pub fn adam<R: Real>(moment: Moment<R>, grad: R, corrected_rate: R, corrected_epsilon: R) -> Moment<R> {
    let mean = moment.mean * BETA1 + grad * (1.0 - BETA1);
    let square = moment.square * BETA2 + grad * grad * (1.0 - BETA2);
    let step = corrected_rate * mean / (square.sqrt() + corrected_epsilon);
    Moment { value: moment.value - step, mean, square }
}

/// Learning rate that decays exponentially from `first` to `last` over `steps` steps, then stays
/// constant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Schedule {
    /// Rate at the start.
    pub first: f32,
    /// Rate from the end on.
    pub last: f32,
    /// Number of steps between both rates; ignored if they are equal.
    pub steps: u32,
}

impl Schedule {
    /// A rate that never changes.
    pub const fn constant(rate: f32) -> Self {
        Self { first: rate, last: rate, steps: 1 }
    }

    /// Schedule with the same rate at step `from` and the last rate from step `to` on.
    #[must_use]
    pub fn ending_at(self, from: u32, to: u32) -> Self {
        if self.first == self.last || self.first <= 0.0 || self.last <= 0.0 || from >= to {
            return self;
        }
        let u = f64::from(from) / f64::from(to);
        let [now, last] = [self.at(from), self.last].map(|rate| math::ln64(f64::from(rate)));
        Self { first: math::exp64((now - u * last) / (1.0 - u)) as f32, steps: to, ..self }
    }

    /// The rate at a step: first^(1−u) · last^u, u = step / steps.
    pub fn at(&self, step: u32) -> f32 {
        if self.first == self.last || self.first <= 0.0 || self.last <= 0.0 {
            return if step < self.steps { self.first } else { self.last };
        }
        let u = (f64::from(step) / f64::from(self.steps.max(1))).min(1.0);
        let log = (1.0 - u) * math::ln64(f64::from(self.first)) + u * math::ln64(f64::from(self.last));
        math::exp64(log) as f32
    }
}
