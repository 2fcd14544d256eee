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
    machine::Machine,
    memory::Array,
    prefilter::{Light, LightGrad},
    project::Splats,
    source,
    view::View,
};
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
    let LossWeights { sparse, residual, .. } = *way.weights;
    let planes = PlanesVjp { shading: ShadingOf { layout, rules: *way.rules }, is_lit: false };
    let losses = AttributeLosses { layout, is_sparse: sparse != 0.0, has_residual: residual != 0.0 };
    let values = machine.take("gradients", len_of_values(count, layout))?;
    let view = View::new(camera, count);
    let share = 1.0 / count as f32;
    let attributes = [sparse * share, 2.0 * residual * share];
    let bound = [
        Uniform(view.bytes()),
        Uniform(bytemuck::cast_slice(&attributes)),
        Of(&gaussians.values),
        Of(&way.grads.values),
        Of(&values),
    ];
    let key = format!("{planes:?} {losses:?}");
    let source = || source::gaussians_vjp(&planes, &losses, None);
    machine.run(&key, "gaussians_vjp", &source, &bound, Groups::For(count.next_multiple_of(BLOCK)))?;
    Ok((Gaussians { count, layout, values }, None))
}
