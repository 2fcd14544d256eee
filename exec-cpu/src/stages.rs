//! Stages of the pipeline, each in its own file: core's formulas over lanes, distributed over
//! threads.

pub mod bin;
pub(crate) mod blend;
mod blend_in_order;
pub mod blend_vjp;
pub(crate) mod densify;
pub(crate) mod expose;
pub(crate) mod gaussians_vjp;
pub(crate) mod illuminate;
pub(crate) mod light_network;
pub(crate) mod lookup;
pub mod loss;
pub(crate) mod median_depths;
mod occlusion;
pub(crate) mod optimise;
pub mod prefilter;
pub mod project;
mod response_batch;
pub(crate) mod sampling;
pub mod shade;
pub(crate) mod shade_pixels;
mod splat_batch;
pub(crate) mod surface;
pub(crate) mod trace;
