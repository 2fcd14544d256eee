//! How far pictures are from exact ones, what that saves, and the cheapest setting for an error.
//!
//! * [`subject`]: a scene and the views in which it is looked at; [`mod@reference`]: its exact pictures, in `f64`
//! * [`setting`]: the knobs, and what they can be turned to
//! * [`trial`]: a scene under a setting: pictures, times stage by stage, counts of the work
//! * [`error`]: measures of a picture against the exact one ([`mod@flip`])
//! * [`mod@lpips`]: how different pictures look to a network whose weights a file holds
//! * [`front`]: settings that no other beats
//! * [`budget`]: the cheapest setting for an error, tried on views that it was not chosen by
//! * [`verify`]: pictures within an error, each compared with the most exact one that `f32` has
//! * [`mod@off_axis`]: how far alphas are from those along rays, by the angle
//! * [`mod@sort`]: how far one order for a whole picture is from an order for each pixel
//! * [`stability`]: what holds of scenes at the edges of what is valid
#![forbid(unsafe_code)]

pub mod budget;
pub mod error;
pub mod flip;
pub mod front;
pub mod lpips;
pub mod off_axis;
pub mod reference;
pub mod setting;
pub mod sort;
pub mod stability;
pub mod subject;
pub mod trial;
pub mod verify;
mod wire;
