//! Gradient of the prefilter.

use crate::{
    codegen::{source::Source, uniform::Count},
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
        light::{
            LightGrad, TEXEL_LEN,
            matrix::{Matrix, Out},
        },
        light_network::evaluate_vjp,
        prefilter::{Light, LightSource, apply_parts, radiance, texel_count},
    },
};
use formulas::RadianceVjp;
use specula_core::{
    pack::Storage,
    scene::{Environment, RadianceActivation},
};

pub mod formulas;

pub(crate) fn source(activation: RadianceActivation) -> String {
    let source = Source::new().part(|source| radiance(source, activation)).formula(&RadianceVjp { activation });
    source.with(include_str!("activate_vjp.wgsl")).text()
}

/// Gradient of an environment from that of its filtered light.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn prefilter_vjp(
    context: &mut Context,
    environment: &Environment<&Array>,
    light: &Light,
    grad: &LightGrad,
) -> Result<Array, GpuError> {
    let weights = match &light.source {
        LightSource::Weights(weights) => weights,
        LightSource::Network(network) => return evaluate_vjp(context, network, environment, grad),
    };
    let operator = &weights.operator;
    let transposed = weights.transposed(context)?;
    let nodes = context.allocate("gradient of a light", TEXEL_LEN * (operator.node_count() + operator.row_count()))?;
    transposed.aprons.apply(context, &grad.texels, 0, Out::Other(&nodes, Storage::F32))?;
    let first_row = operator.node_count();
    match &transposed.rows {
        Some(rows) => rows.apply(context, &nodes, first_row, Out::AddedTexels(0))?,
        None => apply_parts(context, operator, |context, first, part| {
            let transposed = Matrix::new(context, &part.transpose(first_row))?;
            transposed.apply(context, &nodes, first_row + first, Out::AddedTexels(0))
        })?,
    }
    for (([fine, coarse], _), matrix) in operator.reductions().rev().zip(transposed.reductions.iter().rev()) {
        matrix.apply(context, &nodes, coarse, Out::AddedTexels(fine))?;
    }
    let out = context.allocate("gradient of an environment", environment.values.len())?;
    let size = Count::new(texel_count(environment));
    let bindings = [Uniform(size.bytes()), Buffer(environment.values), Buffer(&nodes), Buffer(&out)];
    let groups = Dispatch::Invocations(texel_count(environment));
    let (key, source) = (format!("{:?}", environment.activation), || source(environment.activation));
    context.dispatch(&key, "activate_texels_vjp", &source, &bindings, groups)?;
    Ok(out)
}
