//! Device infrastructure: adapters, memory, and kernels that are compiled once and recorded into
//! submissions.
//!
//! Nothing here depends on a stage of the pipeline.

pub(crate) mod adapter;
pub(crate) mod cache;
pub(crate) mod ceilings;
pub(crate) mod chunks;
pub(crate) mod context;
pub(crate) mod error;
pub(crate) mod gpu;
pub(crate) mod kernel_set;
pub(crate) mod kernels;
pub(crate) mod memory;
pub(crate) mod timer;
