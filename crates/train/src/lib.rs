//! The optimisation loop: profiles, schedules, densification, evaluation. It is generic over
//! executors.
//!
//! Fifty steps on the CPU learn a grey picture; [`evaluate`] computes metrics of held-out views.
//!
//! ```
//! use glam::Vec3;
//! use specula_core::camera::Camera;
//! use specula_cpu::CpuExecutor;
//! use specula_train::{profile::by_name, trainer::{Settings, Trainer}, view::View};
//!
//! let camera = Camera::look_at(Vec3::new(0.0, -3.0, 0.5), Vec3::ZERO, Vec3::Z, 0.7, 32, 32);
//! let rgba = [100, 100, 100, 255].repeat(32 * 32);
//! let views = [View { name: "grey".into(), camera, rgba, unclipped: None, normals: None }];
//! let profile = by_name("specula", 50).expect("a profile that there is");
//! let (iterations, background) = (50, [1.0; 3]);
//! let settings = Settings { profile, iterations, seed: 0, background, random_points: 500 };
//! let mut trainer = Trainer::new(CpuExecutor::new(), settings, &views, &[])?;
//! while !trainer.is_finished() {
//!     trainer.step()?;
//! }
//! let model = trainer.download()?;
//! assert!(model.gaussians.count > 0);
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```

mod batch;
mod error;
pub mod evaluate;
pub mod exchange;
mod exposure;
mod fingerprint;
mod initial_state;
pub mod light_fit;
mod light_scale;
pub mod near_field;
pub mod own_loss;
mod physical;
mod picture_schedule;
pub mod picture_store;
pub mod pictures;
pub mod profile;
pub mod ranks;
mod schedule;
pub mod start;
mod targets;
pub mod trainer;
mod transfer;
pub mod view;
