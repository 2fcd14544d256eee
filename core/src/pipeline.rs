//! Order of the stages, in one place for all executors.

use crate::{
    camera::Camera,
    executor::{Executor, Renderer, StepReport, TrainingStep},
    rules::RenderRules,
    scene::{Environment, Gaussians},
    state::{SceneState, Statistics},
};

/// Stage of a picture that has just run, with its results.
#[derive(Debug)]
pub enum Stage<'a, E: Renderer> {
    /// Gaussians were projected.
    Project(&'a E::Splats),
    /// Splats were shaded.
    Shade(&'a E::Colors),
    /// Splats were sorted into tiles.
    Bin(&'a E::Tiles),
    /// Tiles were blended.
    Blend(&'a E::Splats, &'a E::Frame),
    /// Reflected rays were traced.
    Trace(&'a E::Frame),
    /// Direct light from lamps was evaluated.
    Illuminate(&'a E::Frame),
    /// Light was added pixel by pixel.
    ShadePixels(&'a E::Frame),
}

/// Observer of the stages of a picture, such as a stopwatch. `()` observes nothing, at no cost.
pub trait StageObserver<E: Renderer> {
    /// Called after each stage.
    fn on_stage(&mut self, stage: Stage<'_, E>);
}

impl<E: Renderer> StageObserver<E> for () {
    #[inline(always)]
    fn on_stage(&mut self, _: Stage<'_, E>) {}
}

/// Renders Gaussians under a light.
///
/// # Errors
///
/// The error of the stage that failed.
pub fn render<E: Renderer>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    light: Option<&E::Light>,
    camera: &Camera,
    rules: &RenderRules,
) -> Result<E::Frame, E::Error> {
    render_observed(exec, gaussians, light, camera, rules, &mut ())
}

/// [`render`] under an observer of its stages.
///
/// # Errors
///
/// The error of the stage that failed.
pub fn render_observed<E: Renderer>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    light: Option<&E::Light>,
    camera: &Camera,
    rules: &RenderRules,
    observer: &mut impl StageObserver<E>,
) -> Result<E::Frame, E::Error> {
    Ok(render_pass(exec, gaussians, light, camera, rules, observer)?.frame)
}

/// Results of all stages of a picture.
#[derive(Debug)]
pub struct Pass<E: Renderer> {
    /// Projected Gaussians.
    pub splats: E::Splats,
    /// Their channels.
    pub colors: E::Colors,
    /// Splats of each tile.
    pub tiles: E::Tiles,
    /// Picture.
    pub frame: E::Frame,
}

/// [`render_observed`] with the results of all stages, for the gradient of the picture.
///
/// # Errors
///
/// The error of the stage that failed.
pub fn render_pass<E: Renderer>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    light: Option<&E::Light>,
    camera: &Camera,
    rules: &RenderRules,
    observer: &mut impl StageObserver<E>,
) -> Result<Pass<E>, E::Error> {
    forward_pass(exec, gaussians, light.filter(|_| rules.is_lit), camera, rules, E::bin, observer)
}

/// Stages of a picture under a filtered light, binned by `bin`.
fn forward_pass<E: Renderer>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    light: Option<&E::Light>,
    camera: &Camera,
    rules: &RenderRules,
    bin: impl FnOnce(&mut E, &E::Splats, &Camera) -> Result<E::Tiles, E::Error>,
    observer: &mut impl StageObserver<E>,
) -> Result<Pass<E>, E::Error> {
    let (splats, colors) = project_and_shade(exec, gaussians, light, camera, rules, observer)?;
    let tiles = bin(exec, &splats, camera)?;
    observer.on_stage(Stage::Bin(&tiles));
    let mut frame = exec.blend(&splats, &colors, &tiles, camera)?;
    observer.on_stage(Stage::Blend(&splats, &frame));
    if rules.is_deferred(gaussians.layout) {
        if let Some(light) = light.filter(|_| rules.traces_near) {
            frame = exec.trace(frame, light, camera)?;
            observer.on_stage(Stage::Trace(&frame));
        }
        if let Some(light) = light.filter(|_| rules.is_illuminated(gaussians.layout)) {
            frame = exec.illuminate(frame, light, camera)?;
            observer.on_stage(Stage::Illuminate(&frame));
        }
        frame = exec.shade_pixels(frame, light, camera, rules)?;
        observer.on_stage(Stage::ShadePixels(&frame));
    }
    Ok(Pass { splats, colors, tiles, frame })
}

/// First stages of a picture: splats of Gaussians and their channels.
///
/// # Errors
///
/// The error of the stage that failed.
pub fn shade_gaussians<E: Renderer>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    light: Option<&E::Light>,
    camera: &Camera,
    rules: &RenderRules,
    observer: &mut impl StageObserver<E>,
) -> Result<(E::Splats, E::Colors), E::Error> {
    project_and_shade(exec, gaussians, light.filter(|_| rules.is_lit), camera, rules, observer)
}

/// Splats and their channels under a filtered light.
fn project_and_shade<E: Renderer>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    light: Option<&E::Light>,
    camera: &Camera,
    rules: &RenderRules,
    observer: &mut impl StageObserver<E>,
) -> Result<(E::Splats, E::Colors), E::Error> {
    let mut splats = exec.project(gaussians, camera)?;
    observer.on_stage(Stage::Project(&splats));
    let colors = exec.shade(gaussians, camera, &mut splats, light, rules)?;
    observer.on_stage(Stage::Shade(&colors));
    Ok((splats, colors))
}

/// One step of training: forward, backward, update.
///
/// # Errors
///
/// The error of the stage that failed.
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
    let environment = fitted_light.as_ref().map(|(environment, _)| environment);
    let Backward { splats, light, grads, light_grad } = backward(exec, gaussians, environment, step)?;
    if step.is_observed {
        exec.observe(statistics, &splats, &grads, step.camera)?;
    }
    let gaussian_light_grad = exec.update(gaussians, moments, &splats, light.as_ref(), &grads, step)?;
    let light_grad = light_grad.or(gaussian_light_grad);
    if let (Some((environment, moments)), Some(light), Some(light_grad)) = (fitted_light, &light, &light_grad) {
        let grad = exec.prefilter_vjp(environment, light, light_grad)?;
        exec.optimise_environment(environment, moments, grad, step.environment_rate, step.radiance_max, step.number)?;
    }
    Ok(())
}

/// Results of the stages of a step up to the gradients of splats.
struct Backward<E: Executor> {
    splats: E::Splats,
    /// Filtered light of the lookups.
    light: Option<E::Light>,
    grads: E::SplatGrads,
    /// Gradient of the light, if pixels looked it up.
    light_grad: Option<E::LightGrad>,
}

/// Picture of a step, its losses, and the gradients of its splats.
fn backward<E: Executor>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    environment: Option<&Environment<E::Array>>,
    step: &TrainingStep<'_, E>,
) -> Result<Backward<E>, E::Error> {
    let RenderRules { scheme, levels, is_lit, .. } = *step.rules;
    let light = match environment {
        Some(environment) if is_lit => {
            let light = exec.prefilter(environment, scheme, levels)?;
            Some(match step.near_field {
                Some(near_field) => exec.surround(light, near_field),
                None => light,
            })
        }
        _ => None,
    };
    let Pass { splats, colors, tiles, mut frame } =
        forward_pass(exec, gaussians, light.as_ref(), step.camera, step.rules, E::bin_for_step, &mut ())?;
    if let Some(exposure) = step.exposure {
        frame = exec.expose(frame, exposure)?;
    }
    let weights = step.weights.of_form(step.rules.shading.form);
    let mut frame_grad = exec.loss(&frame, step.target, step.camera, &weights, step.background)?;
    if let Some(exposure) = step.exposure {
        frame_grad = exec.expose_vjp(&frame, exposure, frame_grad)?;
    }
    let mut light_grad = None;
    if step.rules.is_deferred(gaussians.layout) {
        (frame_grad, light_grad) =
            exec.shade_pixels_vjp(&frame, light.as_ref(), step.camera, step.rules, frame_grad)?;
    }
    let grads = exec.blend_vjp(&splats, &colors, &tiles, &frame, &frame_grad, step.camera)?;
    Ok(Backward { splats, light, grads, light_grad })
}

/// Gradient of one view, or the sum of several.
#[derive(Debug)]
pub struct ViewGradient<A> {
    /// Gradient of the Gaussians.
    pub gaussians: Gaussians<A>,
    /// Gradient of the light's numbers; `None` if no light was looked up.
    pub light: Option<A>,
    /// Share in the statistics of densification; `None` for a step that is not observed.
    pub statistics: Option<Statistics<A>>,
}

/// Gradient of one view of a batch, at the parameters before the batch; nothing is updated.
/// `statistics` are zeros that the view adds its share to.
///
/// # Errors
///
/// The error of the stage that failed.
pub fn view_gradient<E: Executor>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    environment: Option<&Environment<E::Array>>,
    mut statistics: Option<Statistics<E::Array>>,
    step: &TrainingStep<'_, E>,
) -> Result<(ViewGradient<E::Array>, StepReport), E::Error> {
    loop {
        let Backward { splats, light, grads, light_grad } = backward(exec, gaussians, environment, step)?;
        if let Some(statistics) = &mut statistics {
            exec.observe(statistics, &splats, &grads, step.camera)?;
        }
        let (grad, gaussian_light_grad) =
            exec.gaussians_vjp(gaussians, step.camera, &splats, light.as_ref(), step.rules, step.weights, &grads)?;
        let light_grad = light_grad.or(gaussian_light_grad);
        let environment_grad = match (environment, &light, &light_grad) {
            (Some(environment), Some(light), Some(grad)) => Some(exec.prefilter_vjp(environment, light, grad)?),
            _ => None,
        };
        if let Some(report) = exec.report()? {
            return Ok((ViewGradient { gaussians: grad, light: environment_grad, statistics }, report));
        }
    }
}
