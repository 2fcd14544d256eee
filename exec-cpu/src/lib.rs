//! specula's stages on rayon, with SIMD lanes: schedules of core's formulas on a CPU.
//!
//! Files are named for stages, as in the core. Gaussians go through `project` and `shade` sixteen
//! at a time, tiles through `bin` and `blend` a quad of four by four pixels at a time. Pictures are
//! stored tile by tile, only for tiles that a splat touches ([`frame`]). Stages take their memory
//! from pools, and dropped results return it. Results do not depend on the number of threads: work
//! is divided into parts of fixed size, and sums run over the parts in order.
//!
//! A white Gaussian on black, from the front:
//!
//! ```
//! use glam::Vec3;
//! use specula_core::{
//!     camera::Camera,
//!     executor::Renderer,
//!     pipeline::render,
//!     prefilter::PrefilterScheme,
//!     rules::{Channels, RenderRules},
//!     scene::{DIFFUSE, Gaussians, LOG_SCALE, Layout, OPACITY, QUAT, len_of_values},
//!     shade::ShadingRules,
//! };
//! use specula_cpu::CpuExecutor;
//!
//! let layout = Layout::radiance(0);
//! let mut gaussians = Gaussians { count: 1, layout, values: vec![0.0; len_of_values(1, layout)] };
//! gaussians.set(0, LOG_SCALE, [-1.0; 3]);
//! gaussians.set(0, QUAT, [1.0, 0.0, 0.0, 0.0]);
//! gaussians.set(0, OPACITY, [3.0]); // a logit
//! gaussians.set(0, DIFFUSE, [1.77; 3]); // the first band of the harmonics
//!
//! let mut exec = CpuExecutor::new();
//! let scene = exec.upload_gaussians(&gaussians)?;
//! let camera = Camera::look_at(Vec3::new(0.0, -3.0, 0.0), Vec3::ZERO, Vec3::Z, 0.8, 32, 32);
//! let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
//! let frame = render(&mut exec, &scene, None, &camera, &RenderRules { is_lit: false, ..rules })?;
//! // Three planes of colour, then the transmittance.
//! let mut planes = vec![0.0; 4 * 32 * 32];
//! exec.read_frame(&frame, &mut planes)?;
//! let [middle, corner] = [16 * 32 + 16, 0];
//! assert!(planes[middle] > 0.9 && planes[corner] < 0.01);
//! assert!(planes[3 * 32 * 32 + middle] < 0.1, "little passes through it");
//! # Ok::<(), specula_cpu::CpuError>(())
//! ```

mod block;
mod buffer;
mod context;
mod error;
mod executor;
pub mod frame;
pub mod lanes;
pub mod morton;
mod parts;
mod planes;
mod read_back;
pub mod stages;
mod texel;

pub use buffer::OutOfMemory;
pub use error::CpuError;
pub use executor::{CpuExecutor, CpuViewer};
