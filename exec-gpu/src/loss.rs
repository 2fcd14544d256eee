//! A picture against what it should be.

use crate::{blend::Frame, blend_vjp::FrameGrad, device::GpuError, machine::Machine};
use specula_core::{
    camera::Camera,
    loss::{LossReport, LossWeights},
};

/// A picture to compare with: 8-bit sRGB with straight alpha.
#[derive(Debug)]
pub struct Target {}

impl Target {
    pub(crate) fn new(_machine: &mut Machine, _size: [usize; 2], _rgba: &[u8]) -> Result<Self, GpuError> {
        unimplemented!()
    }
}

pub(crate) fn loss(
    _machine: &mut Machine,
    _frame: &Frame,
    _target: &Target,
    _camera: &Camera,
    _weights: &LossWeights,
    _background: [f32; 3],
) -> Result<(LossReport, FrameGrad), GpuError> {
    unimplemented!()
}
