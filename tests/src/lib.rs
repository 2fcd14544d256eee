//! Shared parts of the tests of every executor: comparisons, random input, exact derivatives, and
//! two renderers to compare with.
//!
//! * [`compare`]: named tolerances and comparisons that can fail; [`strategies`]: random
//!   directions, cameras, scenes
//! * [`derivative`]: gradients by dual numbers, to check every `_vjp`
//! * [`plain`]: the whole pipeline from core's formulas, one loop after the other, over any number
//! * [`formulas`]: formulas on a device against the same formulas on the host
//! * [`stress`]: scenes at the limits of valid input, by name
//! * [`near_fields`]: triangles that reflected rays may hit
//! * [`pixels`]: pixels under light that is a formula
//! * [`prefilter_error`]: how far filtered light is from its integral
//! * [`brute`]: plain Gaussian splatting in INRIA's conventions, [`independent`]: Gaussians exactly
//!   along rays; both in `f64`, sharing no formula with core

pub mod brute;
pub mod compare;
pub mod derivative;
pub mod device;
pub mod formulas;
pub mod near_fields;
pub mod pixels;
pub mod prefilter_error;
pub mod strategies;
pub mod stress;

pub use specula_oracle as plain;
pub use specula_oracle::{independent, independent::lobe, number};
