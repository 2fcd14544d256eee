//! Reflected rays of a blended surface, traced against the near field of a light.

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
        camera::{CameraUniform, camera},
        frame::Frame,
    },
};
use bytemuck::{Pod, Zeroable};
use formulas::{BoxSpan, CrossingOf, FarReflection, InverseDirection, NearReflection, REFLECTION_LEN, RayOfPixel};
use specula_core::{
    camera::Camera,
    near_field::{BACK_DEPTH, CULL_BACKFACES, NODE_LEN, NearField, T_MISS, TRIANGLE_LEN, VERTEX_LEN},
    rules::{Channels, channel},
};
use std::sync::Arc;

pub mod formulas;

/// Numbers of a vector, in which the numbers of a near field are read.
const VECTOR: usize = 4;
const _: () = assert!(NODE_LEN == 2 * VECTOR, "a kernel reads a node as two vectors");

pub(crate) fn source(blended: Channels) -> String {
    Source::new()
        .real()
        .part(camera)
        .number("T_MISS", T_MISS)
        .part(traversal)
        .formula(&RayOfPixel(blended))
        .formula(&FarReflection)
        .formula(&NearReflection)
        .with(include_str!("trace.wgsl"))
        .text()
}

/// Appends the near field at the bindings 1 and 3, and the triangle that a ray hits first.
pub(crate) fn traversal(source: Source) -> Source {
    source
        .number("BACK_DEPTH", BACK_DEPTH)
        .number("CULL_BACKFACES", CULL_BACKFACES)
        .count("NODE_VECTORS", NODE_LEN / VECTOR)
        .count("TRIANGLE_VECTORS", TRIANGLE_LEN / VECTOR)
        .count("VERTEX_VECTORS", VERTEX_LEN / VECTOR)
        .formula(&InverseDirection)
        .formula(&BoxSpan)
        .formula(&CrossingOf)
        .with(include_str!("near_field.wgsl"))
}

/// `NearField` of `near_field.wgsl`; without nodes rays hit nothing.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct NearFieldUniform {
    node_count: u32,
    first_triangle: u32,
    first_vertex: u32,
    offset: f32,
}

impl NearFieldUniform {
    pub(crate) fn new<A>(near_field: &NearField<A>) -> Self {
        Self {
            node_count: near_field.node_count as u32,
            first_triangle: (near_field.triangles_start() / VECTOR) as u32,
            first_vertex: (near_field.vertices_start() / VECTOR) as u32,
            offset: near_field.offset,
        }
    }
}

/// Uploads a near field.
///
/// # Errors
///
/// [`GpuError::NearField`] if it has a fault; see also [`Context::upload`].
pub(crate) fn upload_near_field(
    context: &mut Context,
    near_field: &NearField<&[f32]>,
) -> Result<Arc<NearField<Array>>, GpuError> {
    near_field.check().map_err(GpuError::NearField)?;
    let values = context.upload("numbers of a near field", near_field.values)?;
    Ok(Arc::new(near_field.with_values(values)))
}

/// Traces the reflected rays of all pixels. A frame without depths, or of a light without a near
/// field, is returned unchanged.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn trace(
    context: &mut Context,
    mut frame: Frame,
    near_field: Option<&NearField<Array>>,
    camera: &Camera,
) -> Result<Frame, GpuError> {
    let blended = Channels::of_count(frame.channels);
    let has_depth = blended.contain(channel::DEPTH);
    let Some(near_field) = near_field.filter(|_| has_depth) else { return Ok(frame) };
    let (view, numbers) = (CameraUniform::new(camera, 0), NearFieldUniform::new(near_field));
    let reflections = context.allocate("reflections", REFLECTION_LEN * frame.pixel_count())?;
    let bindings = [
        Uniform(view.bytes()),
        Uniform(bytemuck::bytes_of(&numbers)),
        Buffer(&frame.blended),
        Buffer(&near_field.values),
        Buffer(&reflections),
    ];
    let (key, source) = (format!("{blended:?}"), || source(blended));
    context.dispatch(&key, "trace", &source, &bindings, Dispatch::Invocations(frame.pixel_count()))?;
    frame.reflections = Some(reflections);
    Ok(frame)
}
