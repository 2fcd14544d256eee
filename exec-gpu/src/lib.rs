//! specula's stages on wgpu: any GPU, or a software driver.
//!
//! * `device`: adapters, memory, compilation and recording of kernels;
//! * `codegen`: WGSL functions from core's formulas, traced with a number that records its
//!   operations;
//! * `stages`: for each stage of the pipeline its dispatches, formulas and kernels. Kernels only
//!   schedule formulas: they assign work to invocations, load and store;
//! * [`GpuExecutor`]: the stages under core's contract; [`Composer`]: frames in another program's
//!   render pass.
//!
//! Adapters need nothing beyond WebGPU's limits and features.
//!
//! The bindings of a kernel are parsed from its source; its variants are compiled on first use and
//! cached. Arrays return to a pool when dropped.
#![forbid(unsafe_code)]
#![cfg_attr(
    not(feature = "testing"),
    expect(unreachable_pub, reason = "formulas are public for tests, which compare them with the host")
)]

#[cfg(feature = "testing")]
pub mod codegen;
#[cfg(not(feature = "testing"))]
mod codegen;
mod compose;
mod device;
mod executor;
mod read_back;
#[cfg(feature = "testing")]
pub mod stages;
#[cfg(not(feature = "testing"))]
mod stages;
#[cfg(feature = "testing")]
mod testing;

pub use compose::{Composer, DepthReader, Mixing, PassFormat};
pub use device::{
    adapter::{AdapterPlace, AdapterReport, adapters},
    ceilings::Ceilings,
    chunks::ChunkedArray,
    error::GpuError,
    gpu::Gpu,
    kernel_set::KernelSet,
    timer::KernelTime,
};
pub use executor::{FrameCapacity, FrameStatus, Full, GpuExecutor, LaterFrame, Precision};
pub use stages::{
    bin::Tiles,
    blend_vjp::SplatGrads,
    frame::{Frame, FrameContent, FrameGrad},
    light::LightGrad,
    loss::Target,
    prefilter::Light,
    project::Splats,
    shade::Colors,
};
pub use wgpu;
