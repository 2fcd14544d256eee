//! Median depths of pixels ([`specula_core::blend::is_median`]). Splats are in the order of their
//! means.

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
        bin::Tiles,
        blend::pixels,
        blend_in_order::formulas::{AlphaOf, PIXEL},
        camera::{CameraUniform, camera},
        project::{Splats, splat},
    },
};
use formulas::MedianStep;
use specula_core::camera::Camera;

pub mod formulas;

fn source() -> String {
    let source = Source::new().real().bits().part(camera).part(splat).part(|source| pixels(source, PIXEL));
    source.formula(&AlphaOf).formula(&MedianStep).with(include_str!("median_depths.wgsl")).text()
}

/// Finds the median depth of each pixel, row by row.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn median_depths(
    context: &mut Context,
    splats: &Splats,
    tiles: &Tiles,
    eye: &Camera,
) -> Result<Array, GpuError> {
    let view = CameraUniform::new(eye, splats.count);
    let medians = context.allocate("median depths", view.pixel_count())?;
    let [listed, ranges, gaussians] = [&splats.splats, &tiles.ranges, &tiles.gaussians].map(Buffer);
    let bindings = [Uniform(view.bytes()), listed, ranges, gaussians, Buffer(&medians)];
    context.dispatch("", "median_depths", &source, &bindings, Dispatch::Grid(view.tiles()))?;
    Ok(medians)
}
