//! 3D filters, from the sampling intervals of views.

use crate::{
    codegen::{source::Source, uniform::uniform},
    device::{
        chunks::ChunkedArray,
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
    },
    stages::camera::{CameraUniform, camera},
};
use formulas::{DeviationOf, IntervalOf, LeastInterval};
use specula_core::{
    antialias::SamplingInterval,
    camera::Camera,
    scene::{Gaussians, Layout, MEAN},
};

pub mod formulas;

pub(crate) fn source(layout: Layout, filter_plane: usize) -> String {
    Source::new()
        .part(camera)
        .count("PLANES", layout.plane_count())
        .count("MEAN", MEAN)
        .count("FILTER", filter_plane)
        .number("FARTHEST", SamplingInterval::none(0.0).seen)
        .formula(&IntervalOf)
        .formula(&LeastInterval)
        .formula(&DeviationOf)
        .uniform::<Counts>()
        .with(include_str!("sampling.wgsl"))
        .text()
}

uniform! {
    /// Numbers of Gaussians and views.
    struct Counts {
        gaussians: u32,
        views: u32,
    }
}

/// Sets the filters of all Gaussians, if they have one.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn sampling(
    context: &mut Context,
    gaussians: &mut Gaussians<ChunkedArray>,
    views: &[Camera],
) -> Result<(), GpuError> {
    let Gaussians { count, layout, ref values } = *gaussians;
    let Some(filter_plane) = layout.filter_plane() else { return Ok(()) };
    let cameras: Vec<CameraUniform> = views.iter().map(|view| CameraUniform::new(view, count)).collect();
    let cameras = context.upload("views", &cameras)?;
    let (key, source) = (format!("{layout:?}"), || source(layout, filter_plane));
    for chunk in values.chunks(count) {
        let counts = Counts { gaussians: chunk.gaussians.len() as u32, views: views.len() as u32 };
        let bindings = [Uniform(counts.bytes()), Buffer(&cameras), Buffer(chunk.array)];
        context.dispatch(&key, "sampling", &source, &bindings, Dispatch::Invocations(chunk.gaussians.len()))?;
    }
    Ok(())
}
