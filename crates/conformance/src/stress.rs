//! Scenes at the limits of valid input, and results of executors for them.

pub mod results;

use specula_core::{
    camera::Camera,
    scene::{Gaussians, LOG_SCALE, Layout},
};
use specula_oracle::scenes::{camera, random_cloud};
pub use specula_oracle::stress::{Case, LAYOUT, every_case};

/// Gaussians that cover a large view, each of them, and so have more splats in its tiles than 32
/// bits count.
pub fn too_many_splats() -> (Gaussians<Vec<f32>>, Camera) {
    const COUNT: usize = 70_000;
    let mut cloud = random_cloud(COUNT, Layout::radiance(0), 1);
    (0..COUNT).for_each(|gaussian| cloud.set(gaussian, LOG_SCALE, [10.0; 3]));
    (cloud, camera(4096, 4096))
}

/// Non-finite values of a Gaussian, and finite ones that overflow.
const POISON: [f32; 5] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 3e38, -3e38];
/// The Gaussians whose numbers are changed.
const POISONED: [usize; 3] = [0, 17, 39];

/// A number for each plane of Gaussians of [`LAYOUT`].
pub fn poison() -> impl Iterator<Item = (usize, f32)> {
    (0..LAYOUT.plane_count()).map(|plane| (plane, POISON[plane % POISON.len()]))
}

/// Random Gaussians, some with this number in a plane, and those of them that are finite.
pub fn poisoned(plane: usize, number: f32) -> [Gaussians<Vec<f32>>; 2] {
    let mut cloud = random_cloud(40, LAYOUT, 61);
    POISONED.into_iter().for_each(|gaussian| cloud.set(gaussian, plane, [number]));
    let kept: Vec<usize> = (0..cloud.count).filter(|k| number.is_finite() || !POISONED.contains(k)).collect();
    let mut rest = random_cloud(kept.len(), LAYOUT, 0);
    for (to, from) in kept.into_iter().enumerate() {
        (0..LAYOUT.plane_count()).for_each(|plane| rest.set(to, plane, cloud.get::<1>(from, plane)));
    }
    [cloud, rest]
}
