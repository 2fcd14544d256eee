//! Adam.

use crate::{device::GpuError, machine::Machine, memory::Array};
use specula_core::{
    executor::Moments,
    scene::{Environment, Gaussians},
};

pub(crate) fn optimise(
    _machine: &mut Machine,
    _gaussians: &mut Gaussians<Array>,
    _moments: &mut Moments<Array>,
    _grad: &Gaussians<Array>,
    _rates: &[f32],
    _step: u32,
) -> Result<usize, GpuError> {
    unimplemented!()
}

pub(crate) fn optimise_environment(
    _machine: &mut Machine,
    _environment: &mut Environment<Array>,
    _moments: &mut Moments<Array>,
    _grad: &Array,
    _rate: f32,
    _radiance_max: f32,
    _step: u32,
) -> Result<usize, GpuError> {
    unimplemented!()
}
