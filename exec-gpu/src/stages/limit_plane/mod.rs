//! Upper bound of a plane.

use crate::{
    codegen::{source::Source, uniform::uniform},
    device::{
        chunks::{Chunk, ChunkedArray},
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
    },
};
use specula_core::{
    region::Ball,
    scene::{Gaussians, Layout, MEAN},
    state::AdamMoments,
};

pub(crate) fn source(layout: Layout) -> String {
    let source = Source::new().count("PLANES", layout.plane_count()).count("MEAN", MEAN);
    source.uniform::<Limit>().with(include_str!("limit_plane.wgsl")).text()
}

/// Limits one plane to at most `ceiling` and clears its moments: outside of a ball, or everywhere.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn limit_plane(
    context: &mut Context,
    gaussians: &mut Gaussians<ChunkedArray>,
    moments: &mut AdamMoments<ChunkedArray>,
    plane: usize,
    ceiling: f32,
    outside: Option<Ball>,
) -> Result<(), GpuError> {
    let Gaussians { count, layout, values } = gaussians;
    let (key, source) = (format!("{layout:?}"), || source(*layout));
    let arrays = ChunkedArray::side_by_side([values, &moments.mean, &moments.square]);
    for (Chunk { gaussians, .. }, [values, mean, square]) in values.chunks(*count).zip(arrays) {
        let limit = Limit::new(gaussians.len(), plane, ceiling, outside);
        let bindings = [Uniform(limit.bytes()), Buffer(values), Buffer(mean), Buffer(square)];
        context.dispatch(&key, "limit_plane", &source, &bindings, Dispatch::Invocations(gaussians.len()))?;
    }
    Ok(())
}

uniform! {
    /// Ceiling of a plane, outside of a ball.
    struct Limit {
        center: [f32; 3],
        /// Negative without a ball: then every Gaussian lies outside.
        radius_squared: f32,
        count: u32,
        plane: u32,
        ceiling: f32,
        padding: u32,
    }
}

impl Limit {
    fn new(count: usize, plane: usize, ceiling: f32, outside: Option<Ball>) -> Self {
        let (center, radius_squared) =
            outside.map_or(([0.0; 3], -1.0), |ball| (ball.center, ball.radius * ball.radius));
        Self { center, radius_squared, count: count as u32, plane: plane as u32, ceiling, padding: 0 }
    }
}
