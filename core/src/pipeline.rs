//! The order of the stages, written once.

use crate::{
    camera::Camera,
    executor::{Executor, Renderer, StepReport, TrainingStep},
    rules::RenderRules,
    scene::Gaussians,
    state::SceneState,
};

/// A picture of Gaussians under a light.
pub fn render<E: Renderer>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    light: Option<&E::Light>,
    camera: &Camera,
    rules: &RenderRules,
) -> Result<E::Frame, E::Error> {
    let light = light.filter(|_| rules.is_lit);
    let mut splats = exec.project(gaussians, camera)?;
    let colors = exec.shade(gaussians, camera, &mut splats, light, rules)?;
    let tiles = exec.bin(&splats, camera)?;
    let frame = exec.blend(&splats, &colors, &tiles, camera)?;
    if rules.is_deferred(gaussians.layout) { exec.shade_pixels(frame, light, camera) } else { Ok(frame) }
}

/// One step of training: forward, backward, update.
pub fn train_step<E: Executor>(
    exec: &mut E,
    scene: &mut SceneState<E::Array>,
    step: &TrainingStep<'_, E>,
) -> Result<StepReport, E::Error> {
    loop {
        take_step(exec, scene, step)?;
        if let Some(report) = exec.report()? {
            return Ok(report);
        }
    }
}

fn take_step<E: Executor>(
    exec: &mut E,
    scene: &mut SceneState<E::Array>,
    step: &TrainingStep<'_, E>,
) -> Result<(), E::Error> {
    let SceneState { gaussians, moments, statistics, light: fitted_light } = scene;
    let RenderRules { scheme, levels, is_lit, .. } = *step.rules;
    let light = match fitted_light {
        Some((environment, _)) if is_lit => Some(exec.prefilter(environment, scheme, levels)?),
        _ => None,
    };
    let mut splats = exec.project(gaussians, step.camera)?;
    let colors = exec.shade(gaussians, step.camera, &mut splats, light.as_ref(), step.rules)?;
    let tiles = exec.bin_for_step(&splats, step.camera)?;
    let mut frame = exec.blend(&splats, &colors, &tiles, step.camera)?;
    let is_deferred = step.rules.is_deferred(gaussians.layout);
    if is_deferred {
        frame = exec.shade_pixels(frame, light.as_ref(), step.camera)?;
    }
    if let Some(exposure) = step.exposure {
        frame = exec.expose(frame, exposure)?;
    }
    let mut frame_grad = exec.loss(&frame, step.target, step.camera, step.weights, step.background)?;
    if let Some(exposure) = step.exposure {
        frame_grad = exec.expose_vjp(&frame, exposure, frame_grad)?;
    }
    let mut light_grad = None;
    if is_deferred {
        (frame_grad, light_grad) = exec.shade_pixels_vjp(&frame, light.as_ref(), step.camera, frame_grad)?;
    }

    let grads = exec.blend_vjp(&splats, &colors, &tiles, &frame, &frame_grad, step.camera)?;
    exec.observe(statistics, &splats, &grads, step.camera)?;
    let of_light = exec.update(gaussians, moments, &splats, light.as_ref(), &grads, step)?;
    let light_grad = light_grad.or(of_light);
    if let (Some((environment, moments)), Some(light), Some(light_grad)) = (fitted_light, &light, &light_grad) {
        let grad = exec.prefilter_vjp(environment, light, light_grad)?;
        exec.optimise_environment(environment, moments, grad, step.environment_rate, step.radiance_max, step.number)?;
    }
    Ok(())
}
