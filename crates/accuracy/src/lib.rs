//! Errors of rendered pictures against exact ones, the cost of settings, and the cheapest setting
//! within an error.
//!
//! * [`subject`]: a scene with its views; [`mod@reference`]: its exact pictures in `f64`
//! * [`setting`]: the parameters of rendering and their values
//! * [`trial`]: a scene under a setting: pictures, stage times, operation counts
//! * [`error`]: metrics of a picture against the exact one ([`mod@flip`])
//! * `lpips`, with the feature of that name: perceptual distance by a network whose weights are in
//!   a file
//! * [`front`]: Pareto-optimal settings
//! * [`budget`]: the cheapest setting within an error, validated on other views
//! * [`verify`]: pictures within an error, each compared with the most exact one in `f32`
//! * [`mod@off_axis`]: error of projected alphas by the angle off the axis
//! * [`mod@sort`]: error and run time of orders of splats against a sort per pixel
//! * [`stability`]: guarantees for scenes at the limits of valid input
#![forbid(unsafe_code)]

pub mod budget;
pub mod error;
pub mod flip;
pub mod front;
#[cfg(feature = "lpips")]
pub mod lpips;
pub mod off_axis;
pub mod reference;
pub mod setting;
pub mod sort;
pub mod stability;
pub mod subject;
pub mod trial;
pub mod verify;
#[cfg(feature = "lpips")]
mod wire;
