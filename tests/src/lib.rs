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

/// The examples of READMEs, except those of programs with files of their own.
#[cfg(doctest)]
mod readmes {
    #[doc = include_str!("../../core/README.md")]
    struct Core;
    #[doc = include_str!("../../exec-cpu/README.md")]
    struct Cpu;
    #[doc = include_str!("../../exec-gpu/README.md")]
    struct Gpu;
    #[doc = include_str!("../../crates/accuracy/README.md")]
    struct Accuracy;
    #[doc = include_str!("../../crates/mesh/README.md")]
    struct Mesh;
    #[doc = include_str!("../../crates/oracle/README.md")]
    struct Oracle;
    #[doc = include_str!("../../crates/prefilter/README.md")]
    struct Prefilter;
    #[doc = include_str!("../../crates/train/README.md")]
    struct Train;
}
