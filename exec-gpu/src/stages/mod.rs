//! Stages of the pipeline, each with its dispatches, formulas and kernels, in the pipeline's order.
//!
//! ```text
//! scene → plan → prefilter → project → shade → bin → blend ┐
//!   ┌── (expose) ← (shade_pixels) ← (illuminate) ← (trace) ┘
//!   └→ loss → blend_vjp → gaussians_vjp → prefilter_vjp → optimise → densify
//! ```

pub mod bin;
pub mod blend;
pub mod blend_in_order;
pub mod expose;
pub mod illuminate;
pub mod loss;
pub mod median_depths;
pub mod prefilter;
pub mod project;
pub mod response;
pub mod shade;
pub mod shade_pixels;
pub mod trace;

pub(crate) mod add;
pub mod blend_vjp;
pub mod expose_vjp;
pub mod gaussians_vjp;
pub mod observe;
pub mod optimise;
pub mod prefilter_vjp;
pub mod shade_pixels_vjp;

pub mod densify;
pub mod limit_plane;
pub mod sampling;

// Shared by several stages.
pub(crate) mod camera;
pub mod frame;
pub(crate) mod gaussians;
pub mod light;
pub mod light_network;
pub mod outline;
pub(crate) mod sort;
pub(crate) mod step_counters;
