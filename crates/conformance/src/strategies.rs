//! Random input for property tests.

use core::{f64::consts::TAU, str::FromStr};
use glam::{Mat3, Quat, Vec3};
use proptest::{prelude::*, test_runner::RngSeed};
use specula_core::{
    camera::Camera,
    scene::{Gaussians, Layout},
};
pub use specula_oracle::scenes::{random_cloud, random_environment};
use std::env;

/// The same input in every run, so that a test that passes keeps passing; failures need no file to
/// be found again.
pub fn same_every_time() -> ProptestConfig {
    ProptestConfig { rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() }
}

/// Cases that are the same in every run, unless the environment asks for others:
/// `SPECULA_FUZZ_SEED` and `SPECULA_FUZZ_CASES`, which `scripts/fuzz` sets.
pub fn as_many_as_wanted(default: u32) -> ProptestConfig {
    let cases = from_env("SPECULA_FUZZ_CASES").unwrap_or(default);
    let seed = from_env("SPECULA_FUZZ_SEED").unwrap_or(1);
    ProptestConfig { cases, rng_seed: RngSeed::Fixed(seed), ..same_every_time() }
}

fn from_env<T: FromStr>(name: &str) -> Option<T> {
    env::var(name).ok()?.parse().ok()
}

/// Uniformly distributed direction.
pub fn unit_vector() -> impl Strategy<Value = [f64; 3]> {
    (-1.0..1.0_f64, 0.0..TAU).prop_map(|(z, angle)| {
        let radius = (1.0 - z * z).sqrt();
        [radius * angle.cos(), radius * angle.sin(), z]
    })
}

/// The same camera in a picture whose light is turned against the world.
pub fn under_turned_light(camera: Camera) -> Camera {
    let turn = Quat::from_array([0.3, -0.5, 0.2, 0.7]).normalize();
    Camera { light_from_world: Some(Mat3::from_quat(turn)), ..camera }
}

/// A vector of moderate length, never zero.
pub fn any_vector() -> impl Strategy<Value = [f64; 3]> {
    (unit_vector(), -1.0..1.0_f64).prop_map(|(d, log_length)| d.map(|c| c * log_length.exp()))
}

/// Uniformly distributed rotation.
pub fn rotation() -> impl Strategy<Value = Mat3> {
    quat().prop_map(|[w, x, y, z]| {
        let numbers = [x, y, z, w].map(|c| c as f32);
        Mat3::from_quat(Quat::from_array(numbers).normalize())
    })
}

/// A quat (w, x, y, z) of a length between a tenth and ten.
pub fn quat() -> impl Strategy<Value = [f64; 4]> {
    (unit_quat(), -2.3..2.3_f64).prop_map(|(quat, log_length)| quat.map(|c| c * log_length.exp()))
}

/// A unit quat: two points on circles (Shoemake 1992).
fn unit_quat() -> impl Strategy<Value = [f64; 4]> {
    (0.0..1.0_f64, 0.0..TAU, 0.0..TAU).prop_map(|(share, a, b)| {
        let (first, second) = ((1.0 - share).sqrt(), share.sqrt());
        [first * a.cos(), first * a.sin(), second * b.cos(), second * b.sin()]
    })
}

/// Three logarithms of scales in so wide a range, further apart than a difference of derivatives
/// would notice.
pub fn log_scales(range: core::ops::Range<f64>) -> impl Strategy<Value = [f64; 3]> {
    const APART: f64 = 1e-3;
    [range.clone(), range.clone(), range].prop_filter("scales of a clear order", |[a, b, c]| {
        (a - b).abs() > APART && (a - c).abs() > APART && (b - c).abs() > APART
    })
}

/// A camera at a distance of 3 to 6 that looks near the origin, with pixels that need not be
/// square.
pub fn camera() -> impl Strategy<Value = Camera> {
    let views = (unit_vector(), 3.0..6.0_f64, unit_vector());
    let lenses = (0.4..1.2_f32, 0.9..1.1_f32, -4.0..4.0_f32, -4.0..4.0_f32);
    (views, lenses).prop_map(|((from, distance, towards), (fov, aspect, right, below))| {
        let position = glam_of(from) * distance as f32;
        let up = if position.normalize().z.abs() < 0.9 { Vec3::Z } else { Vec3::X };
        let mut camera = Camera::look_at(position, glam_of(towards) * 0.3, up, fov, 24, 20);
        camera.focal_px[1] *= aspect;
        camera.principal_px[0] += right;
        camera.principal_px[1] += below;
        camera
    })
}

/// A small cloud of `count` Gaussians around the origin, of any shape and orientation.
pub fn cloud(count: core::ops::Range<usize>, layout: Layout) -> impl Strategy<Value = Gaussians<Vec<f32>>> {
    (count, any::<u64>()).prop_map(move |(count, seed)| random_cloud(count, layout, seed))
}

fn glam_of(v: [f64; 3]) -> Vec3 {
    Vec3::from_array(v.map(|c| c as f32))
}
