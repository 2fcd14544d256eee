//! Specula as one dependency.
//!
//! [`Rasterizer`] renders Gaussians from plain columns and pulls gradients of any loss back to
//! them. The libraries that it is made of are re-exported:
//!
//! * [`core`](specula_core): formulas, pipeline, and its gradient
//!   ([`render_vjp`](specula_core::pipeline::render_vjp))
//! * `cpu`, by the feature `cpu` (default): executor on threads and SIMD lanes
//! * `gpu`, by `gpu`: executor on wgpu
//! * `io`, by `io`: data sets, PLY, pictures, model folders
//! * `train`, by `train`: profiles, densification, evaluation
//! * `scene`, by `scene`: models, trained with checkpoints, relit and exported
//! * `mesh`, by `mesh`: surfaces from depths
//!
//! A red Gaussian, two units in front of a camera:
//!
#![cfg_attr(feature = "cpu", doc = "```")]
#![cfg_attr(not(feature = "cpu"), doc = "```ignore")]
//! use specula_kit::prelude::*;
//!
//! let inputs = Inputs {
//!     means: &[[0.0, 0.0, 2.0]],
//!     quats: &[[1.0, 0.0, 0.0, 0.0]],
//!     scales: &[[0.3, 0.2, 0.1]],
//!     opacities: &[0.9],
//!     colors: Colors::Rgb(&[[1.0, 0.0, 0.0]]),
//! };
//! let axis = |k: usize| core::array::from_fn(|column| if column == k { 1.0 } else { 0.0 });
//! let view_matrix = [axis(0), axis(1), axis(2), axis(3)];
//! let intrinsics = [[32.0, 0.0, 16.0], [0.0, 32.0, 16.0], [0.0, 0.0, 1.0]];
//! let view = PinholeView { view_matrix, intrinsics, width: 32, height: 32, background: [0.0; 3] };
//! let mut rasterizer = Rasterizer::new(Options::default());
//! let (images, context) = rasterizer.forward(&inputs, &[view])?;
//! assert!(images[0].rgb[3 * (16 * 32 + 16)] > 0.8);
//!
//! // Gradient of the sum of all numbers of the picture.
//! let rgb = vec![1.0; 3 * 32 * 32];
//! let cotangents = Cotangents { rgb: &rgb, ..Cotangents::default() };
//! let gradients = rasterizer.backward(&context, &[cotangents])?;
//! assert!(gradients.opacities[0] > 0.0, "more opacity, more light");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Conventions
//!
//! The rasteriser follows gsplat's `rasterization`: world-to-camera matrices and axes of OpenCV,
//! pixel centres at + ½, quats (w, x, y, z) of any length, harmonics of the direction from the
//! camera with + ½ and a floor of zero, 0.3 px² added to the covariance of a splat, alpha below
//! 1/255 skipped. It differs in these points:
//!
//! * The largest alpha of a splat is 0.99, not 0.999: a pixel differs by 0.009 at most, for each
//!   splat whose strength in it is above 0.99.
//! * A pixel ends where its transmittance would fall below 1e-4, not at 1e-4.
//! * The slopes x/z and y/z of the Jacobian end at 1.3 times those of the picture's farther edge,
//!   not at 0.15 of the picture beyond each edge. Both are the same for a principal point in the
//!   centre; otherwise only splats differ whose mean lies beyond an edge by more than 0.15 of the
//!   picture.
//! * Opacities are kept in \[1e-7, 1 − 1e-7\].
//! * The compensation of antialiasing is at least 1/1000, not 0; such splats are fainter than 1/255
//!   either way.
//! * Colours of harmonics end at 10⁶.
//! * Splats reach as far as their alpha is 1/255 or more, not to 3.33 standard deviations at most.
//! * Gaussians of equal depth keep their order.
//! * A mean in the near plane is not drawn.
//! * Scales and opacities are computed from logarithms and logits in `f32`: about 1e-6, relative.
//!
//! Unavailable options are errors by name: low-passes other than 0.3 px² (and 0.1 px² with
//! antialiasing), skewed or distorted cameras, matrices that scale, gradients of view matrices and
//! absolute gradients (`absgrad`) on an executor without them; the GPU has no absolute ones.
//! Colours have three channels. There are no gradients of intrinsics.

pub use glam;
pub use specula_core as core;
#[cfg(feature = "cpu")]
pub use specula_cpu as cpu;
#[cfg(feature = "gpu")]
pub use specula_gpu as gpu;
#[cfg(feature = "io")]
pub use specula_io as io;
#[cfg(feature = "mesh")]
pub use specula_mesh as mesh;
#[cfg(feature = "scene")]
pub use specula_scene as scene;
#[cfg(feature = "train")]
pub use specula_train as train;

mod cloud;
mod error;
mod inputs;
mod rasterizer;

pub use error::{Column, InputError, RasterizeError};
pub use inputs::{Colors, Cotangents, DepthMode, Images, InputGradients, Inputs, Options, PinholeView, ViewGradients};
pub use rasterizer::{Context, RasterizeResult, Rasterizer};

/// Names that a program with a picture and its gradient needs.
pub mod prelude {
    #[cfg(feature = "cpu")]
    pub use crate::cpu::CpuExecutor;
    #[cfg(feature = "gpu")]
    pub use crate::gpu::GpuExecutor;
    pub use crate::{
        Colors, Cotangents, DepthMode, Images, InputGradients, Inputs, Options, PinholeView, RasterizeError,
        Rasterizer, ViewGradients,
    };
    pub use glam::{Mat3, Vec3};
    pub use specula_core::{
        camera::Camera,
        executor::{Executor, ReadBack, Renderer},
        pipeline::{render, render_taped, render_vjp},
        rules::{Channels, RenderRules},
        scene::{Environment, Gaussians, Layout},
    };
}

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
