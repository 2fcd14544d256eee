//! A generated scene for the benches: Gaussians on a torus, the same on every machine; what there
//! is to do in it, and what measures it on any executor.

pub mod groups;
pub mod scene;
pub mod stages;
pub mod trained;
pub mod work;

use core::f32::consts::TAU;
use specula_core::{
    activation::logit,
    camera::Camera,
    near_field::NearField,
    random::uniform,
    scene::{Environment, Gaussians, LOG_SCALE, MEAN, OPACITY, QUAT, RadianceActivation},
};
use specula_cpu::morton::sort_in_space;
use specula_mesh::{Mesh, near_field::SurfaceMeans};
use specula_train::{
    profile::Profile,
    start::{Point, gaussians},
};

const SEED: u64 = 7;
const RADIUS: [f32; 2] = [1.0, 0.4];

/// Flattened Gaussians on a torus, their shortest axes along its normal, opacities uniform in
/// 0.3–0.98; in the order that a training keeps them in.
pub fn torus(count: usize, profile: &Profile) -> Gaussians<Vec<f32>> {
    let points: Vec<Point> =
        (0..count).map(|k| Point { position: point_on_torus(k).0, color: [0.6, 0.4, 0.3] }).collect();
    let mut cloud = gaussians(&points, profile, SEED);
    let spacing = (TAU * TAU * RADIUS[0] * RADIUS[1] / count as f32).sqrt();
    for index in 0..count {
        let (position, normal) = point_on_torus(index);
        let turn = glam::Quat::from_rotation_arc(glam::Vec3::Z, glam::Vec3::from(normal));
        cloud.set(index, MEAN, position);
        cloud.set(index, LOG_SCALE, [spacing.ln(), (0.7 * spacing).ln(), (0.1 * spacing).ln()]);
        cloud.set(index, QUAT, [turn.w, turn.x, turn.y, turn.z]);
        cloud.set(index, OPACITY, [logit(0.3 + 0.68 * uniform(SEED, 2, index as u64))]);
    }
    sort_in_space(&mut cloud);
    cloud
}

/// Surface of the torus as rays hit it: a mesh of 2 · 512 · 128 triangles.
pub fn near_field() -> NearField<Vec<f32>> {
    const AROUND: u32 = 512;
    const ACROSS: u32 = 128;
    let mut mesh = Mesh::default();
    for (k, l) in (0..AROUND).flat_map(|k| (0..ACROSS).map(move |l| (k, l))) {
        let [around, across] = [k as f32 / AROUND as f32, l as f32 / ACROSS as f32].map(|share| TAU * share);
        let (position, normal) = at_angles(around, across);
        mesh.positions.push(position);
        mesh.normals.push(normal);
        mesh.colors.push([0.6, 0.4, 0.3]);
        let at = |k: u32, l: u32| k % AROUND * ACROSS + l % ACROSS;
        let [a, b, c, d] = [at(k, l), at(k + 1, l), at(k + 1, l + 1), at(k, l + 1)];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    SurfaceMeans::new(mesh, 0.01).near_field().expect("there are triangles")
}

fn point_on_torus(index: usize) -> ([f32; 3], [f32; 3]) {
    at_angles(TAU * uniform(SEED, 0, index as u64), TAU * uniform(SEED, 1, index as u64))
}

/// Position and normal at angles around the axis and across the tube.
fn at_angles(around: f32, across: f32) -> ([f32; 3], [f32; 3]) {
    let normal = [across.cos() * around.cos(), across.cos() * around.sin(), across.sin()];
    let centre = [RADIUS[0] * around.cos(), RADIUS[0] * around.sin(), 0.0];
    (core::array::from_fn(|k| centre[k] + RADIUS[1] * normal[k]), normal)
}

/// A camera at distance 3.2 with a field of view of 45°.
pub fn camera(size: u32) -> Camera {
    let position = glam::Vec3::new(2.2, 1.2, 2.0).normalize() * 3.2;
    Camera::look_at(position, glam::Vec3::ZERO, glam::Vec3::Z, 45_f32.to_radians(), size, size)
}

/// A sky with a bright patch.
pub fn environment(resolution: usize) -> Environment<Vec<f32>> {
    let texels = 6 * resolution * resolution;
    let values = (0..texels).flat_map(|k| [if k % 97 == 0 { 8.0 } else { 0.4 }; 3]).collect();
    Environment { resolution, activation: RadianceActivation::Identity, values }
}
