//! What densification sees, and does.

use crate::{blend_vjp::SplatGrads, device::GpuError, machine::Machine, memory::Array, project::Splats};
use specula_core::{
    camera::Camera,
    densify::DensifyRules,
    executor::{DensifyReport, Moments, RandomKey, Statistics},
    scene::Gaussians,
};

pub(crate) fn observe(
    _machine: &mut Machine,
    _statistics: &mut Statistics<Array>,
    _splats: &Splats,
    _grads: &SplatGrads,
    _camera: &Camera,
) -> Result<(), GpuError> {
    unimplemented!()
}

pub(crate) fn densify(
    _machine: &mut Machine,
    _gaussians: &mut Gaussians<Array>,
    _moments: &mut Moments<Array>,
    _statistics: &mut Statistics<Array>,
    _rules: &DensifyRules,
    _count_max: usize,
    _key: RandomKey,
) -> Result<DensifyReport, GpuError> {
    unimplemented!()
}

pub(crate) fn limit_plane(
    _machine: &mut Machine,
    _gaussians: &mut Gaussians<Array>,
    _moments: &mut Moments<Array>,
    _plane: usize,
    _ceiling: f32,
) -> Result<(), GpuError> {
    unimplemented!()
}
