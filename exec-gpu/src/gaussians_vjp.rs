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
    pieces::{Piece, Pieces},
    prefilter::{Light, LightGrad},
    source,
    view::View,
};
use bytemuck::{Pod, Zeroable};
use specula_core::{
    camera::Camera,
    loss::LossWeights,
    rules::RenderRules,
    scene::{BLOCK, Gaussians},
};

/// What the way back reads beside the Gaussians and the camera.
#[derive(Debug)]
pub(crate) struct Way<'a> {
    pub(crate) light: Option<&'a Light>,
    pub(crate) rules: &'a RenderRules,
    pub(crate) weights: &'a LossWeights,
    pub(crate) grads: &'a SplatGrads,
}

pub(crate) fn gaussians_vjp(
    machine: &mut Machine,
    gaussians: &Gaussians<Pieces>,
    camera: &Camera,
    way: &Way<'_>,
) -> Result<(Gaussians<Pieces>, Option<LightGrad>), GpuError> {
    let layout = gaussians.layout;
    let shading = ShadingOf { layout, rules: *way.rules };
    debug_assert_eq!(way.grads.channels, shading.blended().count(), "gradients are of what was blended");
    let light = way.light.filter(|_| shading.looks_light_up());
    let sums = light.map(|light| LightSums::new(machine, light)).transpose()?;
    let planes = PlanesVjp { shading, is_lit: light.is_some() };
    let values = machine.take_like("gradients", &gaussians.values)?;
    let light_layout = light.map(|light| &light.layout);
    let key = format!("{planes:?} {light_layout:?}");
    let source = || source::gaussians_vjp(&planes, light_layout);
    for (piece, grads) in pairs(gaussians, &values) {
        let (of_splats, first) = way.grads.values.around(&piece);
        let view = View::of(camera, piece.gaussians.start - first..piece.gaussians.end - first);
        let mut bound = vec![Uniform(view.bytes()), Of(piece.array), Of(of_splats), Of(grads)];
        if let (Some(light), Some(sums)) = (light, &sums) {
            bound.extend([Of(&light.texels), Of(&light.split_sum), Of(sums.array())]);
        }
        let lanes = piece.gaussians.len().next_multiple_of(BLOCK);
        machine.run(&key, "gaussians_vjp", &source, &bound, Groups::For(lanes))?;
    }
    add_attribute_losses(machine, gaussians, way.weights, &values)?;
    let light_grad = sums.map(|sums| sums.finish(machine)).transpose()?;
    Ok((gaussians.with_values(values), light_grad))
}

/// Pieces of Gaussians, each with that of their gradients.
fn pairs<'a>(gaussians: &'a Gaussians<Pieces>, grads: &'a Pieces) -> impl Iterator<Item = (Piece<'a>, &'a Array)> {
    let beside = Pieces::side_by_side([&gaussians.values, grads]).map(|[_, grads]| grads);
    gaussians.values.of(gaussians.count).zip(beside)
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
    gaussians: &Gaussians<Pieces>,
    weights: &LossWeights,
    grads: &Pieces,
) -> Result<(), GpuError> {
    let LossWeights { sparse, residual, .. } = *weights;
    let losses = AttributeLosses {
        layout: gaussians.layout,
        is_sparse: sparse != 0.0,
        has_residual: residual != 0.0 && gaussians.layout.is_shaded(),
    };
    if !losses.is_sparse && !losses.has_residual {
        return Ok(());
    }
    let share = 1.0 / gaussians.count as f32;
    let (key, source) = (format!("{losses:?}"), || source::attribute_losses(&losses));
    for (piece, grads) in pairs(gaussians, grads) {
        let count = piece.gaussians.len();
        let attributes =
            Attributes { gaussian_count: count as u32, sparse: sparse * share, residual: 2.0 * residual * share };
        let bound = [Uniform(bytemuck::bytes_of(&attributes)), Of(piece.array), Of(grads)];
        machine.run(&key, "attribute_losses", &source, &bound, Groups::For(count))?;
    }
    Ok(())
}
