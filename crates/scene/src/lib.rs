//! Models as scenes: training, opening with the shading model of the training, rendering on any
//! executor, relighting, saving and export.
//!
//! Attributes in a file are raw numbers; their colours depend on the [`ShadingModel`] that the file
//! names. [`OpenedModel::open`] reads both, so that [`Scene::renderer`] draws the pictures of
//! `specula render`, bit for bit:
//!
//! ```no_run
//! use specula_core::rules::Channels;
//! use specula_cpu::CpuExecutor;
//! use specula_io::picture;
//! use specula_scene::OpenedModel;
//! use std::path::Path;
//!
//! let model = OpenedModel::open(Path::new("out/vase"))?;
//! let mut renderer = model.scene.renderer(CpuExecutor::new(), Channels::Color)?;
//! for (name, camera) in model.test_cameras()? {
//!     let picture = renderer.picture(&camera, model.background())?;
//!     picture::write(Path::new(&format!("{name}.png")), &picture)?;
//! }
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```
//!
//! [`SceneRenderer::new`] renders on an executor chosen at run time ([`ExecutorChoice`]); GPUs need
//! the feature `gpu`. Beyond that:
//!
//! | module | content |
//! |---|---|
//! | [`training`] | trainings with checkpoints, resuming, and the CPU as a fallback |
//! | [`dataset`], [`orientation`], [`foreground`], [`following_light`] | inputs of trainings |
//! | [`camera_set`], [`orbit`] | cameras of a model, of a file, or around a scene |
//! | [`backdrop`], [`layer`], [`rendering`], [`picture_folder`] | pictures as files |
//! | [`light_file`], [`environment`], [`prefiltered`] | lights from files, and for other programs |
//! | [`FrameRequest`], [`Similarity`] | frames in an engine's memory; moved Gaussians |
//! | [`number`], [`text`] | numbers and names as they are shown |
//! | [`Lighting`], [`lamps`], [`ground`] | environments, suns, lamps, and their shadows |
//! | [`export`], [`bake`], [`fusion`], [`upright`] | Gaussians and meshes for other programs |

pub mod backdrop;
pub mod bake;
pub mod camera_set;
pub mod capture;
pub mod crop;
pub mod dataset;
pub mod device;
pub mod environment;
mod error;
pub mod export;
pub mod following_light;
pub mod foreground;
mod frame;
mod framing;
pub mod fusion;
pub mod ground;
pub mod import;
mod insert;
pub mod lamps;
pub mod layer;
pub mod light_file;
pub mod light_fit;
pub mod light_turn;
mod lighting;
pub mod number;
mod opened;
pub mod orbit;
pub mod orientation;
pub mod overlap;
pub mod picture_folder;
mod plain;
pub mod prefiltered;
mod renderer;
pub mod rendering;
mod scene;
mod shading_model;
mod similarity;
mod surroundings;
pub mod text;
pub mod training;
pub mod upright;

pub use device::{Device, ExecutorChoice, RenderOptions};
pub use error::SceneError;
pub use frame::{Behind, FrameRequest, Surfaces, Target};
pub use half::f16;
pub use layer::Layer;
pub use lighting::Lighting;
pub use opened::OpenedModel;
pub use overlap::overlap;
pub use renderer::{RenderBackend, SceneRenderer, UploadedScene};
pub use scene::Scene;
pub use shading_model::{Shading, ShadingModel};
pub use similarity::Similarity;
pub use specula_mesh::surface::Surface;

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
