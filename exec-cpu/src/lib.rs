//! specula's stages on rayon, with SIMD lanes: how the core's formulas are scheduled on a CPU.
//!
//! Files are named for stages, as in the core. Gaussians go through [`project`] and [`shade`] sixteen at a time, tiles
//! through [`mod@bin`] and [`blend`] a quad of four by four pixels at a time. Pictures are kept tile by tile, and only
//! tiles that a splat touches ([`frame`]). Stages take their memory from pools, and their results give it back.
//! Nothing depends on the number of threads: work is divided into parts of fixed size, and sums run over the parts in
//! order.

pub mod bin;
pub mod blend;
mod buffer;
mod densify;
mod executor;
pub mod frame;
pub mod lanes;
mod light;
pub mod loss;
mod machine;
mod optimise;
pub mod order;
mod parts;
mod pixel;
mod planes;
pub mod prefilter;
pub mod project;
pub mod shade;
mod stamps;
mod viewer;

pub use executor::{CpuError, CpuExecutor};
pub use viewer::CpuViewer;
