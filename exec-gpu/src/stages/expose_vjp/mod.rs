//! Gradient of exposure.

use crate::{
    codegen::source::Source,
    device::{
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
        memory::Array,
    },
    stages::{
        expose::{ExposureSettings, exposure as exposure_part},
        frame::{Frame, FrameGrad},
    },
};
use core::array;
use formulas::ExposeVjp;
use specula_core::{
    bin::{TILE_SIZE, tile_count},
    expose::Exposure,
};

pub mod formulas;

/// Numbers of an exposure.
const LEN: usize = 12;
/// Invocations of a tile; each processes four pixels.
const SUM_GROUP: usize = (TILE_SIZE * TILE_SIZE / 4) as usize;

pub(crate) fn source(channels: usize) -> String {
    let source = Source::new().part(|source| exposure_part(source, channels)).count("SUM_GROUP", SUM_GROUP);
    source.formula(&ExposeVjp).with(include_str!("expose_vjp.wgsl")).text()
}

/// Gradient of an exposure, summed over each tile.
#[derive(Debug)]
pub(crate) struct ExposureSums(Array);

impl ExposureSums {
    /// The sums on the device.
    pub(crate) fn array(&self) -> &Array {
        &self.0
    }

    /// Sum over all tiles, in their order, from the downloaded sums.
    pub(crate) fn total(sums: &[f32]) -> Exposure<f64> {
        let add = |sum: Exposure<f64>, tile: &[f32]| -> Exposure<f64> {
            array::from_fn(|row| array::from_fn(|k| sum[row][k] + f64::from(tile[4 * row + k])))
        };
        sums.chunks_exact(LEN).fold([[0.0; 4]; 3], add)
    }
}

/// Gradient of the frame before exposure, which replaces `grad`, and of the exposure.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn expose_vjp(
    context: &mut Context,
    frame: &Frame,
    exposure: &Exposure<f32>,
    grad: FrameGrad,
) -> Result<(FrameGrad, ExposureSums), GpuError> {
    let settings = ExposureSettings::new(exposure, frame);
    let [columns, rows] = settings.size.map(tile_count);
    let sums = context.allocate("gradients of an exposure", LEN * (columns * rows) as usize)?;
    let bindings = [
        Uniform(settings.bytes()),
        Buffer(&frame.blended),
        Buffer(frame.color_before_exposure()),
        Buffer(&grad.values),
        Buffer(&sums),
    ];
    let channels = frame.channels;
    let (key, source) = (format!("{channels} channels"), || source(channels));
    context.dispatch(&key, "expose_vjp", &source, &bindings, Dispatch::Grid([columns, rows]))?;
    Ok((grad, ExposureSums(sums)))
}
