//! Depths of the largest responses of Gaussians, for orders other than those of tiles.

use crate::{
    codegen::source::Source,
    device::{
        chunks::ChunkedArray,
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
        memory::Array,
    },
    stages::{
        camera::{CameraUniform, camera},
        gaussians::stored_planes,
    },
};
use formulas::ResponseOf;
use specula_core::{
    camera::Camera,
    cutoffs::BlendOrder,
    pack::Storage,
    scene::{Gaussians, Layout},
};

pub mod formulas;

/// Numbers of a response in memory.
const RESPONSE_LEN: usize = 8;

/// Appends the structure `Response`.
pub(crate) fn response(source: Source) -> Source {
    source.with(include_str!("record.wgsl"))
}

pub(crate) fn source(layout: Layout, storage: Storage) -> String {
    Source::new()
        .real()
        .part(camera)
        .part(response)
        .part(|source| stored_planes(source, layout, storage))
        .formula(&ResponseOf { layout })
        .with(include_str!("response.wgsl"))
        .text()
}

/// Responses of all Gaussians; `None` for the order of means.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn respond(
    context: &mut Context,
    gaussians: &Gaussians<ChunkedArray>,
    camera: &Camera,
    order: BlendOrder,
) -> Result<Option<Array>, GpuError> {
    if order == BlendOrder::Mean {
        return Ok(None);
    }
    let Gaussians { count, layout, ref values } = *gaussians;
    let storage = values.storage();
    let responses = context.allocate("responses", RESPONSE_LEN * count)?;
    let (key, source) = (format!("{layout:?} {storage:?}"), || source(layout, storage));
    for chunk in values.chunks(count) {
        let view = CameraUniform::with_range(camera, chunk.gaussians.clone());
        let bindings = [Uniform(view.bytes()), Buffer(chunk.array), Buffer(&responses)];
        context.dispatch(&key, "respond", &source, &bindings, Dispatch::Invocations(chunk.gaussians.len()))?;
    }
    Ok(Some(responses))
}
