//! WGSL from core's formulas: a number that records operations, functions made of the record,
//! structures of uniforms, and the builder of kernels' sources.
//!
//! Nothing here depends on a stage of the pipeline.

pub mod formula;
pub mod real;
pub(crate) mod source;
pub(crate) mod trace;
pub(crate) mod uniform;
