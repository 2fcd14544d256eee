//! Pictures as photographs show them.

use crate::{
    blend::Frame,
    blend_vjp::FrameGrad,
    device::GpuError,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    source,
};
use bytemuck::{Pod, Zeroable};
use core::array;
use specula_core::{bin::tile_count, expose::Exposure};

/// Numbers of an exposure.
const LEN: usize = 12;

/// `ExposureSettings` of `exposure.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct ExposureSettings {
    exposure: Exposure<f32>,
    size: [u32; 2],
    padding: [u32; 2],
}

impl ExposureSettings {
    fn new(exposure: &Exposure<f32>, frame: &Frame) -> Self {
        Self { exposure: *exposure, size: frame.size.map(|pixels| pixels as u32), padding: [0; 2] }
    }
}

pub(crate) fn expose(machine: &mut Machine, mut frame: Frame, exposure: &Exposure<f32>) -> Result<Frame, GpuError> {
    let exposed = machine.take("colours of a photograph", 3 * frame.pixel_count())?;
    let settings = ExposureSettings::new(exposure, &frame);
    let bound =
        [Uniform(bytemuck::bytes_of(&settings)), Of(&frame.blended), Of(frame.color_before_exposure()), Of(&exposed)];
    let channels = frame.channels;
    let (key, source) = (format!("{channels} channels"), || source::expose(channels));
    machine.run(&key, "expose", &source, &bound, Groups::For(frame.pixel_count()))?;
    frame.exposed = Some(exposed);
    Ok(frame)
}

pub(crate) fn expose_vjp(
    machine: &mut Machine,
    frame: &Frame,
    exposure: &Exposure<f32>,
    grad: FrameGrad,
) -> Result<FrameGrad, GpuError> {
    let settings = ExposureSettings::new(exposure, frame);
    let [columns, rows] = settings.size.map(tile_count);
    let sums = machine.take("gradients of an exposure", LEN * (columns * rows) as usize)?;
    let bound = [
        Uniform(bytemuck::bytes_of(&settings)),
        Of(&frame.blended),
        Of(frame.color_before_exposure()),
        Of(&grad.values),
        Of(&sums),
    ];
    let channels = frame.channels;
    let (key, source) = (format!("{channels} channels"), || source::expose_vjp(channels));
    machine.run(&key, "expose_vjp", &source, &bound, Groups::Grid([columns, rows]))?;
    machine.exposure_sums = Some(sums);
    Ok(grad)
}

/// The gradient of an exposure: what its tiles came to, added in their order.
pub(crate) fn sum_of_tiles(sums: &[f32]) -> Exposure<f64> {
    let add = |sum: Exposure<f64>, own: &[f32]| -> Exposure<f64> {
        array::from_fn(|row| array::from_fn(|k| sum[row][k] + f64::from(own[4 * row + k])))
    };
    sums.chunks_exact(LEN).fold([[0.0; 4]; 3], add)
}
