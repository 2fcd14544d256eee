//! Formulas of specula as pure functions of values: no allocation, no threads, no files, no
//! `unsafe`.
//!
//! Modules of the pipeline in its order, and of the formulas of its stages:
//!
//! ```text
//! scene → plan → prefilter → project → shade → bin → blend ┐
//!   ┌── (expose) ← (shade_pixels) ← (illuminate) ← (trace) ┘
//!   └→ loss → blend_vjp → gaussians_vjp → prefilter_vjp → optimise → densify
//! ```
//!
//! * [`scene`]: Gaussians, environments, images, over any storage; [`camera`]: pinhole cameras
//! * [`rules`]: rendering rules and channels; [`cutoffs`]: culling and early-termination
//!   thresholds; [`plan`]: rules without unneeded terms
//! * [`environment`]: radiance of a light; [`prefilter`]: light into roughness levels ([`ggx`],
//!   [`cubemap`]); [`light_network`]: levels from a network
//! * [`splat`]: two-dimensional splats; [`project`]: Gaussians to splats ([`covariance`],
//!   [`perspective`], [`antialias`]); [`cull`]: reasons why Gaussians are not drawn
//! * [`attributes`]: stored planes to material, harmonics and channels, over any executor's memory
//! * [`shade`]: materials and light to colours ([`normal`], [`sh`], [`split_sum`], [`color`]);
//!   [`shade_pixels`], [`physical`]: the same pixel by pixel; [`near_field`]: surfaces that
//!   reflected rays hit; [`lamps`]: suns and spheres that cast shadows; [`light_frame`]: lights
//!   that turn from picture to picture
//! * [`bin`]: tiles that a splat touches; [`order`]: the order of splats in a pixel; [`blend`]: one
//!   compositing step; [`occlusion`]: surfaces of other renderers in front of splats
//! * [`expose`]: affine maps of a photograph's colours
//! * [`loss`], [`depth_normal`]: losses; [`optimise`], [`densify`]: updates; [`metrics`]: measures
//! * [`morton`]: Morton order; [`pack`]: half precision; [`region`]: parts of space
//! * [`sh_fit`], [`sh_turn`], [`tsdf`]: harmonics and surfaces for other programs
//! * [`eigen`]: symmetric matrices; [`sphere`]: directions; [`least_squares`]: normal equations
//! * [`executor`], [`pipeline`]: the stages as a contract, and their order, written once
//!
//! Formulas are generic over [`real::Real`]: `f32`, SIMD lanes, [`double::Double`] as the oracle of
//! every error figure, and [`dual::Dual`] to check every `_vjp`. A `_vjp` pulls the gradient of a
//! function's result back to its arguments and follows the function.
//!
//! One Gaussian, from its stored attributes to the colour seen by the eye, `c = γ(c_d + s ⊙ L_s +
//! c_r)`, without any executor:
//!
//! ```
//! use specula_core::{
//!     activation::logit,
//!     shade::{Material, ShadingRules, Terms, shade, surface},
//!     vector::{Vec3, vec3},
//! };
//!
//! // Flat along z, so that its normal is ±z; red, with a mirror on top of it.
//! let material = Material {
//!     mean: vec3(0.0_f32, 0.0, 0.0),
//!     quat: [1.0, 0.0, 0.0, 0.0],
//!     log_scales: vec3(-2.0, -2.0, -5.0),
//!     diffuse: vec3(logit(0.4), logit(0.1), logit(0.1)),
//!     tint: Vec3::splat(logit(0.3)),
//!     roughness: logit(0.2),
//!     normal_residuals: [Vec3::splat(0.0); 2],
//! };
//! let rules = ShadingRules::PAPER;
//! let surface = surface(&material, vec3(1.0, 0.0, 1.0), rules);
//! // Seen from +x and +z, it mirrors what is at −x and +z.
//! let reflected = surface.reflection_dir;
//! assert!((reflected.x + reflected.z).abs() < 1e-6 && reflected.z > 0.7);
//!
//! let color_under = |radiance: f32| {
//!     let unlit = Terms::unlit(surface.diffuse, Vec3::splat(0.0));
//!     let specular_light = Vec3::splat(radiance);
//!     shade(rules.form, &Terms { tint: surface.tint, specular_light, ..unlit })
//! };
//! assert!(color_under(1.0).y > color_under(0.0).y, "light is added");
//! assert!(color_under(0.0).x > color_under(0.0).y, "and without it, it is red");
//! ```
#![no_std]
#![forbid(unsafe_code)]

#[cfg(feature = "std")]
extern crate std;

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("specula-core needs the feature `std` or the feature `libm` for its mathematics");

pub use glam;

pub mod activation;
pub mod antialias;
pub mod attributes;
pub mod bin;
pub mod blend;
pub mod camera;
pub mod color;
pub mod covariance;
pub mod cubemap;
pub mod cull;
pub mod cutoffs;
pub mod densify;
pub mod depth_normal;
pub mod double;
pub mod dual;
pub mod eigen;
pub mod environment;
pub mod executor;
pub mod expose;
pub mod ggx;
pub mod lamps;
pub mod least_squares;
pub mod light_frame;
pub mod light_network;
pub mod light_view;
pub mod loss;
pub mod math;
pub mod metrics;
pub mod morton;
pub mod near_field;
pub mod normal;
pub mod occlusion;
pub mod optimise;
pub mod order;
pub mod pack;
pub mod perspective;
pub mod physical;
pub mod pipeline;
pub mod pixel_light;
pub mod plan;
pub mod prefilter;
pub mod project;
pub mod random;
pub mod real;
pub mod region;
pub mod rules;
pub mod scene;
pub mod sh;
pub mod sh_fit;
pub mod sh_turn;
pub mod shade;
pub mod shade_pixels;
pub mod smoothness;
pub mod sphere;
pub mod splat;
pub mod split_sum;
pub mod state;
pub mod tsdf;
pub mod vector;
