//! Order of the stages, in one place for all executors.

use crate::{
    camera::{Camera, CameraGrad},
    double::Double,
    executor::{Executor, OwnLoss, ReadBack, Renderer, StepPicture, StepReport, TrainingStep, Unsupported},
    loss::LossWeights,
    rules::{Channels, RenderRules},
    scene::{Environment, Gaussians, Layout},
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

/// [`render`] behind opaque surfaces of another renderer ([`mod@crate::occlusion`]), given by one
/// depth for each pixel.
///
/// # Errors
///
/// The error of the stage that failed; [`Unsupported`] by executors
/// without [`Feature::Occlusions`](crate::executor::Feature::Occlusions).
pub fn render_occluded<E: Renderer>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    light: Option<&E::Light>,
    camera: &Camera,
    rules: &RenderRules,
    occlusion: &E::Array,
) -> Result<E::Frame, E::Error> {
    let light = light.filter(|_| rules.is_lit);
    let (splats, colors) = project_and_shade(exec, gaussians, light, camera, rules, &mut ())?;
    let tiles = exec.bin(&splats, camera)?;
    let frame = exec.blend_occluded(&splats, &colors, &tiles, camera, occlusion)?;
    light_pixels(exec, gaussians.layout, frame, light, camera, rules, &mut ())
}

/// Median depth of each pixel of a view ([`Renderer::median_depths`]).
///
/// # Errors
///
/// The error of the stage that failed; [`Unsupported`] by executors
/// without [`Feature::MedianDepths`](crate::executor::Feature::MedianDepths).
pub fn median_depths<E: Renderer>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    camera: &Camera,
    rules: &RenderRules,
) -> Result<E::Array, E::Error> {
    let rules = RenderRules { channels: Channels::Color, is_lit: false, ..*rules };
    let (splats, _) = project_and_shade(exec, gaussians, None, camera, &rules, &mut ())?;
    let tiles = exec.bin(&splats, camera)?;
    exec.median_depths(&splats, &tiles, camera)
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
    let shaded = project_and_shade(exec, gaussians, light, camera, rules, observer)?;
    blend_pass(exec, gaussians.layout, shaded, light, camera, rules, bin, observer)
}

/// Stages of a picture after shading.
fn blend_pass<E: Renderer>(
    exec: &mut E,
    layout: Layout,
    (splats, colors): (E::Splats, E::Colors),
    light: Option<&E::Light>,
    camera: &Camera,
    rules: &RenderRules,
    bin: impl FnOnce(&mut E, &E::Splats, &Camera) -> Result<E::Tiles, E::Error>,
    observer: &mut impl StageObserver<E>,
) -> Result<Pass<E>, E::Error> {
    let tiles = bin(exec, &splats, camera)?;
    observer.on_stage(Stage::Bin(&tiles));
    let frame = exec.blend(&splats, &colors, &tiles, camera)?;
    observer.on_stage(Stage::Blend(&splats, &frame));
    let frame = light_pixels(exec, layout, frame, light, camera, rules, observer)?;
    Ok(Pass { splats, colors, tiles, frame })
}

/// Stages of a picture after blending.
fn light_pixels<E: Renderer>(
    exec: &mut E,
    layout: Layout,
    mut frame: E::Frame,
    light: Option<&E::Light>,
    camera: &Camera,
    rules: &RenderRules,
    observer: &mut impl StageObserver<E>,
) -> Result<E::Frame, E::Error> {
    if rules.is_deferred(layout) {
        if let Some(light) = light.filter(|_| rules.traces_near) {
            frame = exec.trace(frame, light, camera)?;
            observer.on_stage(Stage::Trace(&frame));
        }
        if let Some(light) = light.filter(|_| rules.is_illuminated(layout)) {
            frame = exec.illuminate(frame, light, camera)?;
            observer.on_stage(Stage::Illuminate(&frame));
        }
        frame = exec.shade_pixels(frame, light, camera, rules)?;
        observer.on_stage(Stage::ShadePixels(&frame));
    }
    Ok(frame)
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
    let StepVjp { splats, light, splat_vjp } = step_vjp(exec, gaussians, environment, step)?;
    let SplatVjp { grads, light_grad } = splat_vjp;
    if step.is_observed {
        exec.observe(statistics, &splats, &grads, step.camera)?;
    }
    let gaussian_light_grad = exec.update(gaussians, moments, &splats, light.as_ref(), &grads, step)?;
    let light_grad = light_grad.or(gaussian_light_grad);
    if let (Some((environment, moments)), Some(light), Some(light_grad)) = (fitted_light, &light, &light_grad) {
        let grad = exec.prefilter_vjp(environment, light, light_grad)?;
        let TrainingStep { environment_rate, radiance_max, light_number, .. } = *step;
        exec.optimise_environment(environment, moments, grad, environment_rate, radiance_max, light_number)?;
    }
    Ok(())
}

/// Results of a step up to the gradients of its splats.
struct StepVjp<E: Executor> {
    splats: E::Splats,
    light: Option<E::Light>,
    splat_vjp: SplatVjp<E>,
}

/// Picture of a step, its losses, and the gradients of its splats. The picture is dropped on
/// return.
fn step_vjp<E: Executor>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    environment: Option<&Environment<E::Array>>,
    step: &TrainingStep<'_, E>,
) -> Result<StepVjp<E>, E::Error> {
    let light = filtered(exec, environment, step.near_field, step.rules)?;
    let pass = forward_pass(exec, gaussians, light.as_ref(), step.camera, step.rules, E::bin_for_step, &mut ())?;
    let mut tape = Tape::new(pass, light, step.camera, step.rules);
    if let Some(exposure) = step.exposure {
        tape.frame = exec.expose(tape.frame, exposure)?;
    }
    let weights = step.weights.of_form(step.rules.shading.form);
    let mut cotangent = exec.loss(&tape.frame, step.target, step.camera, &weights, step.background)?;
    if let Some(OwnLoss { loss, view }) = step.own_loss {
        let picture = StepPicture { frame: &tape.frame, layout: gaussians.layout, view, step };
        cotangent = loss.add_grad(exec, &picture, cotangent)?;
    }
    if let Some(exposure) = step.exposure {
        cotangent = exec.expose_vjp(&tape.frame, exposure, cotangent)?;
    }
    let splat_vjp = splats_vjp(exec, &tape, gaussians.layout, cotangent)?;
    Ok(StepVjp { splats: tape.splats, light: tape.light, splat_vjp })
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
        let StepVjp { splats, light, splat_vjp: SplatVjp { grads, light_grad } } =
            step_vjp(exec, gaussians, environment, step)?;
        if let Some(statistics) = &mut statistics {
            exec.observe(statistics, &splats, &grads, step.camera)?;
        }
        let (grad, gaussian_light_grad) =
            exec.gaussians_vjp(gaussians, step.camera, &splats, light.as_ref(), step.rules, step.weights, &grads)?;
        let light_grad = light_grad.or(gaussian_light_grad);
        let light = environment_vjp(exec, environment, light.as_ref(), light_grad.as_ref())?;
        if let Some(report) = exec.report()? {
            return Ok((ViewGradient { gaussians: grad, light, statistics }, report));
        }
    }
}

/// Picture with the results of the stages that its gradient reads.
#[derive(Debug)]
pub struct Tape<E: Renderer> {
    /// Projected Gaussians.
    pub splats: E::Splats,
    /// Their channels.
    pub colors: E::Colors,
    /// Splats of each tile.
    pub tiles: E::Tiles,
    /// Picture.
    pub frame: E::Frame,
    /// Filtered light of the lookups; `None` without a light, or under rules that are unlit.
    pub light: Option<E::Light>,
    /// Camera of the picture.
    pub camera: Camera,
    /// Rules of the picture.
    pub rules: RenderRules,
}

impl<E: Renderer> Tape<E> {
    fn new(pass: Pass<E>, light: Option<E::Light>, camera: &Camera, rules: &RenderRules) -> Self {
        let Pass { splats, colors, tiles, frame } = pass;
        Self { splats, colors, tiles, frame, light, camera: *camera, rules: *rules }
    }
}

/// Gradients of a scene under a cotangent of its picture.
#[derive(Debug)]
pub struct Gradients<E: Executor> {
    /// Gradient of the Gaussians, in their layout.
    pub gaussians: Gaussians<E::Array>,
    /// Gradient of the light's numbers; `None` if no light was looked up.
    pub environment: Option<E::Array>,
    /// Gradients of the splats and of their channels.
    pub splats: E::SplatGrads,
}

/// Renders Gaussians under a light that is filtered on the way, and keeps what the gradient needs.
/// The picture equals that of [`render`] to the last bit.
///
/// `near_field` surrounds the light, for rules that trace it. Lamps have no gradient: they need
/// [`Renderer::add_lamps`] and [`render`].
///
/// # Errors
///
/// The error of the stage that failed.
pub fn render_taped<E: Executor>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    environment: Option<&Environment<E::Array>>,
    near_field: Option<&E::NearField>,
    camera: &Camera,
    rules: &RenderRules,
) -> Result<Tape<E>, E::Error> {
    let light = filtered(exec, environment, near_field, rules)?;
    let pass = forward_pass(exec, gaussians, light.as_ref(), camera, rules, E::bin, &mut ())?;
    Ok(Tape::new(pass, light, camera, rules))
}

/// [`render_taped`] without light, of Gaussians whose colours the caller gives: red, green and blue
/// of each, of any sign, blended as they are. Their gradients are those of the first three channels
/// ([`ReadBack::read_channel_grads`] of [`Gradients::splats`]).
///
/// The layout should have no harmonics: theirs are evaluated and replaced.
///
/// # Errors
///
/// The error of the stage that failed; [`Unsupported`], where the
/// executor takes no colours from the host.
pub fn render_colors_taped<E: ReadBack>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    rgb: &[[f32; 3]],
    camera: &Camera,
    rules: &RenderRules,
) -> Result<Tape<E>, E::Error> {
    let rules = RenderRules { is_lit: false, ..*rules };
    let (splats, mut colors) = project_and_shade(exec, gaussians, None, camera, &rules, &mut ())?;
    exec.write_colors(&mut colors, rgb)?;
    let pass = blend_pass(exec, gaussians.layout, (splats, colors), None, camera, &rules, E::bin, &mut ())?;
    Ok(Tape::new(pass, None, camera, &rules))
}

/// Gradients of a picture of [`render_taped`] under any cotangent of its frame, such as one of
/// [`ReadBack::upload_frame_grad`]. Gaussians and light are those that the picture was rendered
/// from. Losses on attributes have no part in it.
///
/// # Errors
///
/// The error of the stage that failed.
pub fn render_vjp<E: Executor>(
    exec: &mut E,
    tape: &Tape<E>,
    gaussians: &Gaussians<E::Array>,
    environment: Option<&Environment<E::Array>>,
    cotangent: E::FrameGrad,
) -> Result<Gradients<E>, E::Error> {
    let Tape { splats, light, camera, rules, .. } = tape;
    let SplatVjp { grads, light_grad } = splats_vjp(exec, tape, gaussians.layout, cotangent)?;
    let (grad, gaussian_light_grad) =
        exec.gaussians_vjp(gaussians, camera, splats, light.as_ref(), rules, &LossWeights::NONE, &grads)?;
    let light_grad = light_grad.or(gaussian_light_grad);
    let environment = environment_vjp(exec, environment, light.as_ref(), light_grad.as_ref())?;
    Ok(Gradients { gaussians: grad, environment, splats: grads })
}

/// [`render_vjp`] and the gradient of the camera's pose.
///
/// # Errors
///
/// The error of the stage that failed; [`Unsupported`], where the executor has no gradient of the
/// camera, and for pixels that look light up.
pub fn render_and_camera_vjp<E: Executor>(
    exec: &mut E,
    tape: &Tape<E>,
    gaussians: &Gaussians<E::Array>,
    environment: Option<&Environment<E::Array>>,
    cotangent: E::FrameGrad,
) -> Result<(Gradients<E>, CameraGrad<Double>), E::Error> {
    let Tape { splats, light, camera, rules, .. } = tape;
    if light.is_some() && rules.is_deferred(gaussians.layout) {
        return Err(Unsupported { what: "gradients of cameras whose pixels look light up" }.into());
    }
    let SplatVjp { grads, light_grad } = splats_vjp(exec, tape, gaussians.layout, cotangent)?;
    let (grad, gaussian_light_grad, camera_grad) =
        exec.gaussians_and_camera_vjp(gaussians, camera, splats, light.as_ref(), rules, &grads)?;
    let light_grad = light_grad.or(gaussian_light_grad);
    let environment = environment_vjp(exec, environment, light.as_ref(), light_grad.as_ref())?;
    Ok((Gradients { gaussians: grad, environment, splats: grads }, camera_grad))
}

/// Filters a light under rules that are lit, and surrounds it with its near field.
fn filtered<E: Renderer>(
    exec: &mut E,
    environment: Option<&Environment<E::Array>>,
    near_field: Option<&E::NearField>,
    rules: &RenderRules,
) -> Result<Option<E::Light>, E::Error> {
    let Some(environment) = environment.filter(|_| rules.is_lit) else { return Ok(None) };
    let light = exec.prefilter(environment, rules.scheme, rules.levels)?;
    Ok(Some(match near_field {
        Some(near_field) => exec.surround(light, near_field)?,
        None => light,
    }))
}

/// Gradients of a picture up to its splats.
struct SplatVjp<E: Executor> {
    grads: E::SplatGrads,
    /// Gradient of the light, if pixels looked it up.
    light_grad: Option<E::LightGrad>,
}

/// Last stages of a picture, backward: pixels and blending.
fn splats_vjp<E: Executor>(
    exec: &mut E,
    tape: &Tape<E>,
    layout: Layout,
    mut cotangent: E::FrameGrad,
) -> Result<SplatVjp<E>, E::Error> {
    let Tape { splats, colors, tiles, frame, light, camera, rules } = tape;
    let mut light_grad = None;
    if rules.is_deferred(layout) {
        (cotangent, light_grad) = exec.shade_pixels_vjp(frame, light.as_ref(), camera, rules, cotangent)?;
    }
    let grads = exec.blend_vjp(splats, colors, tiles, frame, &cotangent, camera)?;
    Ok(SplatVjp { grads, light_grad })
}

/// Gradient of the light's numbers, if it was looked up.
fn environment_vjp<E: Executor>(
    exec: &mut E,
    environment: Option<&Environment<E::Array>>,
    light: Option<&E::Light>,
    grad: Option<&E::LightGrad>,
) -> Result<Option<E::Array>, E::Error> {
    match (environment, light, grad) {
        (Some(environment), Some(light), Some(grad)) => exec.prefilter_vjp(environment, light, grad).map(Some),
        _ => Ok(None),
    }
}
