//! Short programs that use specula as a library, in the folder above:
//!
//! * `shade`: the colour of one Gaussian, with only core, which needs neither std nor an allocator
//! * `prefilter`: light in levels of roughness, with the numbers that a loader of an engine wants
//! * `render`: a PLY of Gaussians to a picture
//! * `engine`: frames in an engine's memory, behind its depth buffer, while Gaussians move
//! * `texture`: a frame in the pass of another program on wgpu, behind its depth texture
//! * `fit`: a picture as Gaussians, under a loss that is written on the spot
//! * `train`: a data set to a model, with a word about how it goes
//!
//! `cargo run --release -p specula-examples --example shade` runs one.

use specula_core::{
    random,
    scene::{DIFFUSE, Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT, len_of_values},
};

/// A ring of coloured Gaussians around the origin.
pub fn ring() -> Gaussians<Vec<f32>> {
    let (count, layout) = (2000, Layout::radiance(0));
    let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    for k in 0..count {
        let draw = |index: u64| random::normal(0, k as u64, index);
        let (sin, cos) = (k as f32 / count as f32 * core::f32::consts::TAU).sin_cos();
        let mean = [cos + 0.1 * draw(0), sin + 0.1 * draw(1), 0.1 * draw(2)];
        gaussians.set(k, MEAN, mean);
        gaussians.set(k, LOG_SCALE, [-3.5, -3.5, -4.5]);
        gaussians.set(k, QUAT, [draw(3), draw(4), draw(5), draw(6)]);
        gaussians.set(k, OPACITY, [2.0]);
        // Without a shading function, the first band of the harmonics is the colour.
        gaussians.set(k, DIFFUSE, [1.5 * cos, 1.5 * sin, 1.0]);
    }
    gaussians
}
