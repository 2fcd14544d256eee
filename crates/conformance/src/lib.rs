//! Tests for executors: types that implement the traits of [`specula_core::executor`].
//!
//! * [`renderer_tests!`](crate::renderer_tests), [`executor_tests!`](crate::executor_tests) and
//!   [`read_back_tests!`](crate::read_back_tests) write one `#[test]` for each requirement;
//!   [`check_renderer`], [`check_executor`] and [`check_read_back`] return a [`Report`] of them.
//! * [`check_agreement`] compares two renderers with each other.
//! * [`compare`]: named tolerances and comparisons that can fail; [`strategies`]: random
//!   directions, cameras and scenes, for `proptest`; [`variants`]: every way of shading;
//!   [`stress`]: scenes at the limits of valid input; [`near_fields`]: triangles that reflected
//!   rays may hit
//!
//! The reference is `specula_oracle`, the formulas of core as plain loops in `f64`. Executors skip
//! the requirements of a [`Feature`](specula_core::executor::Feature) that they do not have; they
//! must refuse it by name.
//!
//! ```no_run
//! # use specula_core::executor::Renderer;
//! # fn of<MyExecutor: Renderer>(new: impl Fn() -> MyExecutor) {
//! use specula_conformance::{Subject, check_renderer};
//!
//! let report = check_renderer(&Subject::new(&new));
//! assert!(report.failed().is_empty(), "{report}");
//! # }
//! ```
#![forbid(unsafe_code)]

mod agreement;
pub mod compare;
pub mod executor;
pub mod near_fields;
pub mod read_back;
pub mod renderer;
mod report;
pub mod strategies;
pub mod stress;
pub mod variants;
pub mod view;

pub use agreement::check_agreement;
pub use executor::check_executor;
pub use read_back::check_read_back;
pub use renderer::check_renderer;
pub use report::{Check, Report, Subject};
