//! Sums of gradients: one array is added to another.

use crate::{
    codegen::{source::Source, uniform::Count},
    device::{
        chunks::ChunkedArray,
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
    },
};

fn source() -> String {
    Source::new().uniform::<Count>().with(include_str!("add.wgsl")).text()
}

/// Adds the numbers of an array to those of another with the same division.
///
/// # Errors
///
/// See [`Context::dispatch`].
pub(crate) fn add(context: &mut Context, sum: &ChunkedArray, term: &ChunkedArray) -> Result<(), GpuError> {
    for [sum, term] in ChunkedArray::side_by_side([sum, term]) {
        let size = Count::new(sum.len());
        let bindings = [Uniform(size.bytes()), Buffer(term), Buffer(sum)];
        context.dispatch("add", "add", &source, &bindings, Dispatch::Invocations(sum.len()))?;
    }
    Ok(())
}
