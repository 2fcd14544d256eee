//! Gradients of shading and projection.

use crate::{
    codegen::{
        source::{Source, WORKGROUP_SIZE},
        uniform::uniform,
    },
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
use formulas::{AttributeLossesVjp, CAMERA_GRADS, LookupVjp, PlanesVjp};
use specula_core::{
    attributes::{AttributeLosses, GaussianShading},
    camera::{Camera, CameraGrad},
    double::Double,
    loss::LossWeights,
    rules::RenderRules,
    scene::{BLOCK, Gaussians, NORMAL_RESIDUAL_1, OPACITY},
    vector::vec3,
};

pub mod formulas;

const UNLIT_PLANES: &str = "fn store_plane_grads() {\n    planes_vjp();\n}\n";
const NO_CAMERA: &str = "fn add_up_camera_grads(group: u32, local: u32) {}\n";

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
    let source = if planes_vjp.moves_camera {
        // Behind the bindings of the kernel and of its light.
        let binding = if light.is_some() { 7 } else { 4 };
        source
            .count("CAMERA_GRADS", CAMERA_GRADS)
            .with(&format!("@group(0) @binding({binding}) var<storage, read_write> camera_sums: array<f32>;\n"))
            .with(include_str!("camera_grads.wgsl"))
    } else {
        source.with(NO_CAMERA)
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

/// Gradients of Gaussians, of the light that they looked up, and of the camera, if it is wanted.
#[derive(Debug)]
pub(crate) struct Gradients {
    pub(crate) gaussians: Gaussians<ChunkedArray>,
    pub(crate) light: Option<LightGrad>,
    camera: Vec<Array>,
}

impl Gradients {
    /// Gradient of the camera: the sum over all workgroups, in their order. Blocks until the device
    /// is done.
    ///
    /// # Errors
    ///
    /// See [`Context::download`].
    pub(crate) fn camera(&self, context: &mut Context) -> Result<CameraGrad<Double>, GpuError> {
        let mut total = [0.0; CAMERA_GRADS];
        for sums in &self.camera {
            let mut numbers = vec![0.0_f32; sums.len()];
            context.download(sums, 0, &mut numbers)?;
            for group in numbers.as_chunks::<CAMERA_GRADS>().0 {
                total.iter_mut().zip(group).for_each(|(sum, x)| *sum += f64::from(*x));
            }
        }
        let row = |k: usize| vec3(Double(total[3 * k]), Double(total[3 * k + 1]), Double(total[3 * k + 2]));
        Ok(CameraGrad::from_rows([0, 1, 2, 3].map(row)))
    }
}

/// Gradients of Gaussians, and of what they depend on.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn gaussians_vjp(
    context: &mut Context,
    gaussians: &Gaussians<ChunkedArray>,
    camera: &Camera,
    inputs: &BackwardInputs<'_>,
    moves_camera: bool,
) -> Result<Gradients, GpuError> {
    let layout = gaussians.layout;
    let shading = GaussianShading { layout, rules: *inputs.rules };
    debug_assert_eq!(inputs.grads.channels, shading.channels().count(), "gradients have the blended channels");
    let light = inputs.light.filter(|_| shading.looks_light_up());
    let sums = light.map(|light| LightSums::new(context, &light.layout)).transpose()?;
    let is_turned = light.is_some() && camera.light_from_world.is_some();
    let planes = PlanesVjp { shading, is_lit: light.is_some(), is_turned, moves_camera };
    let values = context.allocate_like("gradients", &gaussians.values)?;
    let light_layout = light.map(|light| &light.layout);
    let key = format!("{planes:?} {light_layout:?}");
    let source = || source(&planes, light_layout);
    let mut camera_sums = Vec::new();
    for (chunk, grads) in pairs(gaussians, &values) {
        let (splat_grads, first) = inputs.grads.values.around(&chunk);
        let view = CameraUniform::with_range(camera, chunk.gaussians.start - first..chunk.gaussians.end - first);
        let mut bindings = vec![Uniform(view.bytes()), Buffer(chunk.array), Buffer(splat_grads), Buffer(grads)];
        if let (Some(light), Some(sums)) = (light, &sums) {
            bindings.extend([Buffer(&light.texels), Buffer(&light.split_sum), Buffer(sums.array())]);
        }
        let lanes = chunk.gaussians.len().next_multiple_of(BLOCK);
        if moves_camera {
            let groups = lanes.div_ceil(WORKGROUP_SIZE as usize);
            camera_sums.push(context.allocate("gradients of a camera", groups * CAMERA_GRADS)?);
            bindings.extend(camera_sums.last().map(Buffer));
        }
        context.dispatch(&key, "gaussians_vjp", &source, &bindings, Dispatch::Invocations(lanes))?;
    }
    add_attribute_losses(context, gaussians, inputs.weights, &values)?;
    let light = sums.map(|sums| sums.finish(context)).transpose()?;
    Ok(Gradients { gaussians: gaussians.with_values(values), light, camera: camera_sums })
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
