//! Projection of Gaussians to splats.

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
        outline::outline,
        response::respond,
    },
};
use formulas::SplatOf;
use specula_core::{
    camera::Camera,
    cutoffs::BlendOrder,
    pack::Storage,
    scene::{Gaussians, Layout},
};

pub mod formulas;

/// Depth key of a Gaussian that is not drawn: after every depth.
const NOT_DRAWN: u32 = u32::MAX;

/// Numbers of a splat in memory, in the order of `splat.wgsl`.
pub(crate) const SPLAT_LEN: usize = 12;

/// Projected Gaussians.
#[derive(Debug)]
pub struct Splats {
    pub(crate) count: usize,
    /// Gaussians in each chunk of their array.
    pub(crate) chunk_len: usize,
    /// `Splat` of `splat.wgsl`, one for each Gaussian.
    pub(crate) splats: Array,
    /// Bits of the depths, which sort like depths; [`NOT_DRAWN`] for Gaussians that are not drawn.
    pub(crate) depth_keys: Array,
    /// Number of tiles that each splat touches.
    pub(crate) tile_counts: Array,
    /// Depths of their largest responses, if they are not blended by the depths of their means.
    pub(crate) responses: Option<Array>,
}

/// Appends the structure `Splat`, and the constants of splats.
pub(crate) fn splat(source: Source) -> Source {
    source.count("NOT_DRAWN", NOT_DRAWN as usize).with(include_str!("splat.wgsl"))
}

pub(crate) fn source(layout: Layout, storage: Storage) -> String {
    Source::new()
        .real()
        .part(camera)
        .part(splat)
        .part(outline)
        .part(|source| stored_planes(source, layout, storage))
        .formula(&SplatOf { layout })
        .with(include_str!("project.wgsl"))
        .text()
}

/// Projects all Gaussians, with the inputs of the order of their splats.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn project(
    context: &mut Context,
    gaussians: &Gaussians<ChunkedArray>,
    camera: &Camera,
    order: BlendOrder,
) -> Result<Splats, GpuError> {
    let Gaussians { count, layout, ref values } = *gaussians;
    let storage = values.storage();
    let splats = Splats {
        count,
        chunk_len: values.chunk_len(),
        splats: context.allocate("splats", SPLAT_LEN * count)?,
        depth_keys: context.allocate("depths", count)?,
        tile_counts: context.allocate("numbers of tiles", count)?,
        responses: respond(context, gaussians, camera, order)?,
    };
    let (key, source) = (format!("{layout:?} {storage:?}"), || source(layout, storage));
    for chunk in values.chunks(count) {
        let view = CameraUniform::with_range(camera, chunk.gaussians.clone());
        let bindings = [
            Uniform(view.bytes()),
            Buffer(chunk.array),
            Buffer(&splats.splats),
            Buffer(&splats.depth_keys),
            Buffer(&splats.tile_counts),
        ];
        context.dispatch(&key, "project", &source, &bindings, Dispatch::Invocations(chunk.gaussians.len()))?;
    }
    Ok(splats)
}
