//! The gradient of shading and projection.

use crate::{
    blend_vjp::SplatGrads,
    device::GpuError,
    machine::Machine,
    memory::Array,
    prefilter::{Light, LightGrad},
    project::Splats,
};
use specula_core::{camera::Camera, executor::RenderRules, loss::LossWeights, scene::Gaussians};

/// What the way back reads beside the Gaussians and the camera.
#[derive(Debug)]
pub(crate) struct Way<'a> {
    pub(crate) splats: &'a Splats,
    pub(crate) light: Option<&'a Light>,
    pub(crate) rules: &'a RenderRules,
    pub(crate) weights: &'a LossWeights,
    pub(crate) grads: &'a SplatGrads,
}

pub(crate) fn gaussians_vjp(
    _machine: &mut Machine,
    _gaussians: &Gaussians<Array>,
    _camera: &Camera,
    _way: &Way<'_>,
) -> Result<(Gaussians<Array>, Option<LightGrad>), GpuError> {
    unimplemented!()
}
