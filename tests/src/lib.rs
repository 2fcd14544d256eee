//! Shared parts of the tests of every executor: comparisons, random input, exact derivatives, and
//! two renderers to compare with.
//!
//! * [`conformance`]: what every executor must do, with its comparisons, random input and extreme
//!   scenes
//! * [`derivative`]: gradients by dual numbers, to check every `_vjp`
//! * [`plain`]: the whole pipeline from core's formulas, one loop after the other, over any number
//! * [`formulas`]: formulas on a device against the same formulas on the host
//! * [`pixels`]: pixels under light that is a formula
//! * [`prefilter_error`]: how far filtered light is from its integral
//! * [`brute`]: plain Gaussian splatting in INRIA's conventions, [`independent`]: Gaussians exactly
//!   along rays; both in `f64`, sharing no formula with core

pub mod brute;
pub mod derivative;
pub mod device;
pub mod formulas;
pub mod pixels;
pub mod prefilter_error;

pub use specula_conformance::{self as conformance, compare, near_fields, strategies, stress};
pub use specula_oracle as plain;
pub use specula_oracle::{independent, independent::lobe, number};
