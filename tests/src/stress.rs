//! Scenes at the limits of valid input, and results of executors for them.

pub mod results;

use crate::{formulas::camera, strategies::random_cloud};
use specula_core::{
    camera::Camera,
    scene::{Gaussians, LOG_SCALE, Layout},
};
pub use specula_oracle::stress::{Case, LAYOUT, every_case};

/// Gaussians that cover a large view, each of them, and so have more splats in its tiles than 32
/// bits count.
pub fn too_many_splats() -> (Gaussians<Vec<f32>>, Camera) {
    const COUNT: usize = 70_000;
    let mut cloud = random_cloud(COUNT, Layout::radiance(0), 1);
    (0..COUNT).for_each(|gaussian| cloud.set(gaussian, LOG_SCALE, [10.0; 3]));
    (cloud, camera(4096, 4096))
}
