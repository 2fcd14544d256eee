//! The gradient of blending.

use crate::{
    bin::Tiles, blend::Frame, device::GpuError, machine::Machine, memory::Array, project::Splats, shade::Colors,
};
use specula_core::camera::Camera;

/// Numbers of a splat's gradient before those of its channels: mean2d (2), root of the conic (3), opacity (1).
pub(crate) const GEOMETRY: usize = 6;

/// Gradient of a [`Frame`], plane by plane: what is blended, then the transmittance.
#[derive(Debug)]
pub struct FrameGrad {
    pub(crate) size: [usize; 2],
    pub(crate) channels: usize,
    pub(crate) values: Array,
}

/// Gradients of splats and their channels, in blocks as Gaussians are: [`GEOMETRY`] planes, then the channels.
#[derive(Debug)]
pub struct SplatGrads {
    pub(crate) channels: usize,
    pub(crate) values: Array,
}

pub(crate) fn blend_vjp(
    _machine: &mut Machine,
    _splats: &Splats,
    _colors: &Colors,
    _tiles: &Tiles,
    _frame: &Frame,
    _grad: &FrameGrad,
    _camera: &Camera,
) -> Result<SplatGrads, GpuError> {
    unimplemented!()
}
