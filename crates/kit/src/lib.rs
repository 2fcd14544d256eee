//! Specula as one dependency.
//!
//! [`Rasterizer`] renders Gaussians from plain columns and pulls gradients of any loss back to them.
//! The libraries that it is made of are re-exported:
//!
//! | feature | module | content |
//! |---|---|---|
//! | | [`core`](specula_core) | formulas, pipeline, its gradient ([`specula_core::pipeline::render_vjp`]) |
//! | `cpu` (default) | `cpu` | executor on threads and SIMD lanes |
//! | `gpu` | `gpu` | executor on wgpu |
//! | `io` | `io` | data sets, PLY, pictures, model folders |
//! | `train` | `train` | profiles, densification, evaluation |
//! | `scene` | `scene` | models: training with checkpoints, relighting, export |
//! | `mesh` | `mesh` | surfaces from depths |
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
//! let view_matrix = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
//! let intrinsics = [[32.0, 0.0, 16.0], [0.0, 32.0, 16.0], [0.0, 0.0, 1.0]];
//! let view = PinholeView { view_matrix, intrinsics, width: 32, height: 32, background: [0.0; 3] };
//! let mut rasterizer = Rasterizer::new(Options::default());
//! let (images, context) = rasterizer.forward(&inputs, &[view])?;
//! assert!(images[0].rgb[3 * (16 * 32 + 16)] > 0.8);
//!
//! // Gradient of the sum of all numbers of the picture.
//! let rgb = vec![1.0; 3 * 32 * 32];
//! let gradients = rasterizer.backward(&context, &[Cotangents { rgb: &rgb, ..Cotangents::default() }])?;
//! assert!(gradients.opacities[0] > 0.0, "more opacity, more light");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Conventions
//!
//! The rasteriser follows gsplat's `rasterization`: world-to-camera matrices and axes of OpenCV,
//! pixel centres at + ½, quats (w, x, y, z) of any length, harmonics of the direction from the camera
//! with + ½ and a floor of zero, 0.3 px² added to the covariance of a splat, alpha below 1/255
//! skipped. It differs in these points:
//!
//! | point | here | gsplat | difference |
//! |---|---|---|---|
//! | largest alpha of a splat | 0.99 | 0.999 | at most 0.009 of a pixel, behind splats with a strength above 0.99 |
//! | end of a pixel | transmittance below 1e-4 | at 1e-4 or below | none but at equality |
//! | limit of the slopes x/z and y/z in the Jacobian | 1.3 × the larger of both sides of the principal point | 0.15 of the picture beyond each edge | none for a centred principal point; else only splats whose mean is beyond an edge by more than 0.15 of the picture |
//! | opacity | kept in [1e-7, 1 − 1e-7] | any | at most 1e-7 |
//! | compensation of antialiasing | at least 1/1000 | at least 0 | alpha below 1/255 either way |
//! | colour of harmonics | at most 10⁶ | no limit | none below |
//! | reach of splats | as far as alpha is at least 1/255 | 3.33 standard deviations or fewer | none above 1/255 |
//! | order of equal depths | order of the Gaussians | order of the sort | ties only |
//! | mean at the near plane | not drawn | drawn | equality only |
//! | arithmetic | logarithms of scales, logits of opacities in `f32` | as given | about 1e-6, relative |
//!
//! Not available, and an error by name where it can be asked for: other low-passes than 0.3 px² (and
//! 0.1 px² with antialiasing), skewed or distorted cameras, matrices that scale, colours of other
//! than three channels. There are no absolute sums of the gradients of centres (`absgrad`), and no
//! gradients of intrinsics.

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
pub use rasterizer::{Context, RasterExecutor, RasterizeResult, Rasterizer};

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
