//! The gradient of shading and projection.

use crate::{
    blend_vjp::SplatGrads,
    device::GpuError,
    formulas::{
        ShadingOf,
        gaussians_vjp::{AttributeLosses, PlanesVjp},
    },
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    light_sums::LightSums,
    machine::Machine,
    memory::Array,
    prefilter::{Light, LightGrad},
    project::Splats,
    source,
    view::View,
};
use bytemuck::{Pod, Zeroable};
use specula_core::{
    camera::Camera,
    executor::RenderRules,
    loss::LossWeights,
    scene::{BLOCK, Gaussians, len_of_values},
};

/// What the way back reads beside the Gaussians and the camera.
#[derive(Debug)]
pub(crate) struct Way<'a> {
    pub(crate) splats: &'a Splats,
    pub(crate) light: Option<&'a Light>,
    pub(crate) rules: &'a RenderRules,
    pub(crate) weights: &'a LossWeights,
    pub(crate) grads: &'a SplatGrads,
}

pub(crate) fn gaussians_vjp(
    machine: &mut Machine,
    gaussians: &Gaussians<Array>,
    camera: &Camera,
    way: &Way<'_>,
) -> Result<(Gaussians<Array>, Option<LightGrad>), GpuError> {
    let Gaussians { count, layout, .. } = *gaussians;
    let shading = ShadingOf { layout, rules: *way.rules };
    debug_assert_eq!(way.grads.channels, shading.blended().count(), "gradients are of what was blended");
    let light = way.light.filter(|_| shading.looks_light_up());
    let sums = light.map(|light| LightSums::new(machine, light)).transpose()?;
    let planes = PlanesVjp { shading, is_lit: light.is_some() };
    let values = machine.take("gradients", len_of_values(count, layout))?;
    let view = View::new(camera, way.splats.count);
    let mut bound = vec![Uniform(view.bytes()), Of(&gaussians.values), Of(&way.grads.values), Of(&values)];
    if let (Some(light), Some(sums)) = (light, &sums) {
        bound.extend([Of(&light.texels), Of(&light.split_sum), Of(sums.array())]);
    }
    let light_layout = light.map(|light| &light.layout);
    let key = format!("{planes:?} {light_layout:?}");
    let source = || source::gaussians_vjp(&planes, light_layout);
    machine.run(&key, "gaussians_vjp", &source, &bound, Groups::For(count.next_multiple_of(BLOCK)))?;
    add_attribute_losses(machine, gaussians, way.weights, &values)?;
    let light_grad = sums.map(|sums| sums.finish(machine)).transpose()?;
    Ok((Gaussians { count, layout, values }, light_grad))
}

/// `Attributes` of `attributes.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Attributes {
    gaussian_count: u32,
    sparse: f32,
    residual: f32,
}

/// Adds the losses that look at attributes to the gradients of Gaussians.
fn add_attribute_losses(
    machine: &mut Machine,
    Gaussians { count, layout, values }: &Gaussians<Array>,
    weights: &LossWeights,
    grads: &Array,
) -> Result<(), GpuError> {
    let LossWeights { sparse, residual, .. } = *weights;
    let losses = AttributeLosses {
        layout: *layout,
        is_sparse: sparse != 0.0,
        has_residual: residual != 0.0 && layout.is_shaded(),
    };
    if !losses.is_sparse && !losses.has_residual {
        return Ok(());
    }
    let share = 1.0 / *count as f32;
    let attributes =
        Attributes { gaussian_count: *count as u32, sparse: sparse * share, residual: 2.0 * residual * share };
    let bound = [Uniform(bytemuck::bytes_of(&attributes)), Of(values), Of(grads)];
    let source = || source::attribute_losses(&losses);
    machine.run(&format!("{losses:?}"), "attribute_losses", &source, &bound, Groups::For(*count))
}
