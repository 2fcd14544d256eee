//! Gradients of shading and projection.

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
        memory::Array,
    },
    stages::{
        blend_vjp::{SplatGrads, formulas::GEOMETRY},
        camera::{CameraUniform, camera},
        gaussians::planes,
        light::{LightGrad, LightLayout, split_sums_vjp, sums::LightSums},
        prefilter::Light,
        shade::{formulas::SurfaceOf, gaussian_light},
    },
};
use formulas::{AttributeLossesVjp, LookupVjp, PlanesVjp};
use specula_core::{
    attributes::{AttributeLosses, GaussianShading},
    camera::Camera,
    loss::LossWeights,
    rules::RenderRules,
    scene::{BLOCK, Gaussians, NORMAL_RESIDUAL_1, OPACITY},
};

pub mod formulas;

const UNLIT_PLANES: &str = "fn store_plane_grads() {\n    planes_vjp();\n}\n";

/// Kernel of a shading; without a light, Gaussians looked up none.
pub(crate) fn source(planes_vjp: &PlanesVjp, light: Option<&LightLayout>) -> String {
    let PlanesVjp { shading, is_turned, .. } = planes_vjp;
    let surface = SurfaceOf { shading: *shading, is_turned: *is_turned };
    let source = Source::new()
        .real()
        .part(camera)
        .part(|source| planes(source, shading.layout))
        .count("SPLAT_PLANES", GEOMETRY + shading.channels().count())
        .formula(planes_vjp);
    let source = match light {
        Some(light) => gaussian_light(light.lookup_vjp(source), &surface)
            .formula(&LookupVjp(*shading))
            .part(split_sums_vjp)
            .with(include_str!("gaussian_light_vjp.wgsl")),
        None => source.with(UNLIT_PLANES),
    };
    source.with(include_str!("gaussians_vjp.wgsl")).text()
}

pub(crate) fn attribute_source(losses: &AttributeLossesVjp) -> String {
    Source::new()
        .real()
        .part(|source| planes(source, losses.layout))
        .count("OPACITY_PLANE", OPACITY)
        .count("RESIDUAL_PLANE", NORMAL_RESIDUAL_1)
        .count("METALNESS_PLANE", losses.losses.metalness_plane.unwrap_or_default())
        .formula(losses)
        .uniform::<Attributes>()
        .with(include_str!("attribute_losses.wgsl"))
        .text()
}

/// Inputs of the backward pass, besides the Gaussians and the camera.
#[derive(Debug)]
pub(crate) struct BackwardInputs<'a> {
    pub(crate) light: Option<&'a Light>,
    pub(crate) rules: &'a RenderRules,
    pub(crate) weights: &'a LossWeights,
    pub(crate) grads: &'a SplatGrads,
}

/// Gradients of Gaussians, and of the light that they looked up.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn gaussians_vjp(
    context: &mut Context,
    gaussians: &Gaussians<ChunkedArray>,
    camera: &Camera,
    inputs: &BackwardInputs<'_>,
) -> Result<(Gaussians<ChunkedArray>, Option<LightGrad>), GpuError> {
    let layout = gaussians.layout;
    let shading = GaussianShading { layout, rules: *inputs.rules };
    debug_assert_eq!(inputs.grads.channels, shading.channels().count(), "gradients have the blended channels");
    let light = inputs.light.filter(|_| shading.looks_light_up());
    let sums = light.map(|light| LightSums::new(context, &light.layout)).transpose()?;
    let is_turned = light.is_some() && camera.light_from_world.is_some();
    let planes = PlanesVjp { shading, is_lit: light.is_some(), is_turned };
    let values = context.allocate_like("gradients", &gaussians.values)?;
    let light_layout = light.map(|light| &light.layout);
    let key = format!("{planes:?} {light_layout:?}");
    let source = || source(&planes, light_layout);
    for (chunk, grads) in pairs(gaussians, &values) {
        let (splat_grads, first) = inputs.grads.values.around(&chunk);
        let view = CameraUniform::with_range(camera, chunk.gaussians.start - first..chunk.gaussians.end - first);
        let mut bindings = vec![Uniform(view.bytes()), Buffer(chunk.array), Buffer(splat_grads), Buffer(grads)];
        if let (Some(light), Some(sums)) = (light, &sums) {
            bindings.extend([Buffer(&light.texels), Buffer(&light.split_sum), Buffer(sums.array())]);
        }
        let lanes = chunk.gaussians.len().next_multiple_of(BLOCK);
        context.dispatch(&key, "gaussians_vjp", &source, &bindings, Dispatch::Invocations(lanes))?;
    }
    add_attribute_losses(context, gaussians, inputs.weights, &values)?;
    let light_grad = sums.map(|sums| sums.finish(context)).transpose()?;
    Ok((gaussians.with_values(values), light_grad))
}

/// Chunks of Gaussians, each with the array of their gradients.
fn pairs<'a>(
    gaussians: &'a Gaussians<ChunkedArray>,
    grads: &'a ChunkedArray,
) -> impl Iterator<Item = (Chunk<'a>, &'a Array)> {
    let beside = ChunkedArray::side_by_side([&gaussians.values, grads]).map(|[_, grads]| grads);
    gaussians.values.chunks(gaussians.count).zip(beside)
}

uniform! {
    /// Weights of the losses for each Gaussian.
    struct Attributes {
        gaussian_count: u32,
        sparse: f32,
        residual: f32,
        metalness: f32,
        mean_light: f32,
    }
}

/// Adds the gradients of the losses on attributes.
fn add_attribute_losses(
    context: &mut Context,
    gaussians: &Gaussians<ChunkedArray>,
    weights: &LossWeights,
    grads: &ChunkedArray,
) -> Result<(), GpuError> {
    let losses = AttributeLosses::new(weights, gaussians.layout);
    if !losses.is_any() {
        return Ok(());
    }
    let losses = AttributeLossesVjp { layout: gaussians.layout, losses };
    let [sparse, residual, metalness, mean_light] = AttributeLosses::factors(weights, gaussians.count);
    let (key, source) = (format!("{losses:?}"), || attribute_source(&losses));
    for (chunk, grads) in pairs(gaussians, grads) {
        let count = chunk.gaussians.len();
        let attributes = Attributes { gaussian_count: count as u32, sparse, residual, metalness, mean_light };
        let bindings = [Uniform(attributes.bytes()), Buffer(chunk.array), Buffer(grads)];
        context.dispatch(&key, "attribute_losses", &source, &bindings, Dispatch::Invocations(count))?;
    }
    Ok(())
}
