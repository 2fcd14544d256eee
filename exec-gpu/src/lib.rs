//! specula's stages on wgpu: any GPU, or a software driver.
//!
//! Formulas are not written twice: [`trace`] evaluates core's own with a number that writes itself down, and
//! [`formula`] makes functions of WGSL from the record. The files in `shaders/` schedule them: which invocation does
//! what, and what is read and written. Nothing but the limits and features of WebGPU is asked of an adapter.
#![forbid(unsafe_code)]

pub mod bin;
pub mod blend;
pub mod blend_vjp;
pub mod ceilings;
pub mod compose;
mod densify;
pub mod device;
pub mod executor;
mod expose;
pub mod formula;
pub mod formulas;
mod gaussians_vjp;
mod kernel;
mod ledger;
mod light_sums;
pub mod loss;
mod machine;
pub mod memory;
mod optimise;
pub mod pieces;
mod pixel;
pub mod prefilter;
mod probe;
pub mod project;
pub mod shade;
mod sort;
mod source;
pub mod stopwatch;
pub mod trace;
mod view;
pub mod viewer;

pub use compose::Composer;
pub use device::{Gpu, GpuError};
pub use executor::GpuExecutor;
pub use viewer::GpuViewer;
