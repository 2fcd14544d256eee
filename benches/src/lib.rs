//! Scenes and meters for benches of executors.
//!
//! [`torus`] makes Gaussians that are the same on every machine, [`scene`] puts them under a sky on
//! any executor, and [`stages`] runs each stage of a picture or of a training step under a
//! [`Meter`](stages::Meter). [`Groups`](groups::Groups) is a meter of criterion; one's own takes a
//! few lines:
//!
//! ```
//! use specula_benches::{
//!     scene::{Scene, View},
//!     stages::{Meter, Stage, measure_picture},
//! };
//! use specula_core::{
//!     executor::Renderer,
//!     loss::LossWeights,
//!     prefilter::PrefilterScheme,
//!     rules::{Channels, RenderRules},
//!     scene::Layout,
//!     shade::ShadingRules,
//! };
//! use specula_cpu::CpuExecutor;
//!
//! struct Once(Vec<(Stage, std::time::Duration)>);
//!
//! impl<E: Renderer> Meter<E> for Once {
//!     fn measure<I, O>(
//!         &mut self,
//!         exec: &mut E,
//!         stage: Stage,
//!         mut prepare: impl FnMut(&mut E) -> Result<I, E::Error>,
//!         mut run: impl FnMut(&mut E, I) -> Result<O, E::Error>,
//!     ) -> Result<(), E::Error> {
//!         let input = prepare(exec)?;
//!         let start = std::time::Instant::now();
//!         run(exec, input)?;
//!         Ok(self.0.push((stage, start.elapsed())))
//!     }
//! }
//!
//! let mut exec = CpuExecutor::new();
//! let layout = Layout::shaded(None);
//! let rules = RenderRules::full(ShadingRules::DEFERRED, PrefilterScheme::Exact, Channels::Color);
//! let scene = Scene::new(&mut exec, layout, &rules, &LossWeights::NONE, 64, 500)?;
//! let light = scene.filtered(&mut exec)?;
//! let cloud = &scene.state.gaussians;
//! let view = View { cloud, light: light.as_ref(), camera: &scene.camera, rules: &rules };
//! let mut times = Once(Vec::new());
//! measure_picture(&mut exec, &view, &mut times)?;
//! assert_eq!(times.0.len(), 6, "project, shade, bin, blend, shade_pixels, and the whole frame");
//! # Ok::<(), specula_cpu::CpuError>(())
//! ```

pub use criterion;

pub mod groups;
pub mod scene;
pub mod stages;

use core::f32::consts::TAU;
use specula_core::{
    activation::logit,
    camera::Camera,
    morton::Bounds,
    random::uniform,
    scene::{
        ALBEDO, AMBIENT, DIFFUSE, Environment, Gaussians, LOG_SCALE, Layout, MEAN, METALNESS, OPACITY, QUAT, ROUGHNESS,
        RadianceActivation, TINT, len_of_values,
    },
    sh,
    vector::vec3,
};

const SEED: u64 = 7;
const RADIUS: [f32; 2] = [1.0, 0.4];

/// Flattened Gaussians on a torus, their shortest axes along its normal, opacities uniform in
/// 0.3–0.98; of one colour, rough, in Morton order.
pub fn torus(count: usize, layout: Layout) -> Gaussians<Vec<f32>> {
    let mut cloud = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    let points: Vec<_> = (0..count as u64).map(point_on_torus).collect();
    let bounds = points.iter().fold(Bounds::NOTHING, |bounds, (position, _)| bounds.with(*position));
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_key(|index| bounds.code(points[*index].0));
    let spacing = (TAU * TAU * RADIUS[0] * RADIUS[1] / count as f32).sqrt();
    for (index, number) in order.into_iter().enumerate() {
        let (position, normal) = points[number];
        let turn = glam::Quat::from_rotation_arc(glam::Vec3::Z, glam::Vec3::from(normal));
        cloud.set(index, MEAN, position);
        cloud.set(index, LOG_SCALE, [spacing.ln(), (0.7 * spacing).ln(), (0.1 * spacing).ln()]);
        cloud.set(index, QUAT, [turn.w, turn.x, turn.y, turn.z]);
        cloud.set(index, OPACITY, [logit(0.3 + 0.68 * uniform(SEED, 2, number as u64))]);
        set_material(&mut cloud, index);
    }
    cloud
}

/// Brown and rough: attributes as a training starts with.
fn set_material(cloud: &mut Gaussians<Vec<f32>>, index: usize) {
    const ALBEDO_SHARE: [f32; 3] = [0.26, 0.11, 0.06];
    const TINT_SHARE: f32 = 0.15;
    if cloud.layout.is_shaded() {
        cloud.set(index, DIFFUSE, ALBEDO_SHARE.map(logit));
        cloud.set(index, TINT, [logit(TINT_SHARE); 3]);
        cloud.set(index, ROUGHNESS, [0.0]);
    } else {
        let first = sh::basis(vec3(0.0_f32, 0.0, 1.0), 0)[0];
        cloud.set(index, cloud.layout.sh_start(), [0.6, 0.4, 0.3].map(|color: f32| (color - 0.5) / first));
    }
    if let Some(first) = cloud.layout.physical_planes() {
        cloud.set(index, first + ALBEDO, ALBEDO_SHARE.map(logit));
        cloud.set(index, first + METALNESS, [logit(TINT_SHARE)]);
        cloud.set(index, first + AMBIENT, [1.0; 3]);
    }
}

fn point_on_torus(number: u64) -> ([f32; 3], [f32; 3]) {
    at_angles(TAU * uniform(SEED, 0, number), TAU * uniform(SEED, 1, number))
}

/// Position and normal of the torus at angles around the axis and across the tube.
pub fn at_angles(around: f32, across: f32) -> ([f32; 3], [f32; 3]) {
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
