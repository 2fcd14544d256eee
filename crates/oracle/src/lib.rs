//! The whole pipeline from core's formulas in plain loops, over any number type.
//!
//! It has no tiles, lanes or culling beyond the definition of the picture: the reference for an
//! executor's stages, in `f64` for its error. The stages have core's names; [`loss_and_gradient`]
//! is one step of training up to the gradients. Layouts are core's, over `Vec<R>` instead of
//! `Vec<f32>`. [`independent`] is a renderer that shares no formula with any of this. [`scenes`]
//! and [`stress`] are test scenes.
#![forbid(unsafe_code)]

mod cloud;
mod illuminate;
pub mod independent;
mod light;
mod losses;
pub mod number;
mod picture;
pub mod scenes;
mod shade_pixels;
mod smoothness;
mod split_sum;
pub mod stress;

pub use cloud::{lift, lift_environment, lift_gaussians};
pub use illuminate::Lamps;
pub use light::{Light, LightGrad, Operator, look_up, prefilter, prefilter_vjp};
pub use losses::{
    FrozenWeights, Target, attribute_loss, attribute_loss_vjp, frame_loss, frame_loss_vjp, freeze_weights,
};
pub use picture::{
    Frame, blend, blend_in_order, blend_vjp, blend_within, composite, front_to_back, front_to_back_within,
};
pub use shade_pixels::{shade_pixels, shade_pixels_vjp};

use crate::{
    cloud::{AddedGrads, gaussian},
    number::Number,
};
use specula_core::{
    attributes::{
        AttributeGrads, AttributePlanes, GaussianShading, LayerChannels, LightSample, LookupGrad, PoseGrad,
        ShadedGaussian, shape_vjp,
    },
    camera::{Camera, CameraOf},
    cutoffs::{BlendOrder, Cutoffs, ProjectionModel},
    loss::LossWeights,
    near_field::NearField,
    order::{ResponseDepth, response_depth},
    perspective::{Perspective, perspective},
    project,
    rules::{Channels, RenderRules, channel},
    scene::{Environment, Gaussians, MEAN, QUAT},
    shade::Terms,
    splat::{Splat, SplatGrad},
};
use std::sync::Arc;

/// Gaussians to splats.
pub fn project<R: Number>(gaussians: &Gaussians<Vec<R>>, camera: &Camera) -> Vec<Splat<R>> {
    let camera = camera.lift(R::of(0.0));
    (0..gaussians.count)
        .map(|index| project::project(&gaussian(gaussians, index).shape(gaussians.layout), &camera))
        .collect()
}

/// Gaussians to splats by another projection, with their perspective if it is not affine.
pub fn project_within<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    camera: &Camera,
    projection: ProjectionModel,
) -> (Vec<Splat<R>>, Option<Vec<Perspective<R>>>) {
    if projection == ProjectionModel::Affine {
        return (project(gaussians, camera), None);
    }
    let camera = camera.lift(R::of(0.0)).for_projection(projection);
    let of = |index: usize| {
        let shape = gaussian(gaussians, index).shape(gaussians.layout);
        let splat = project::project(&shape, &camera);
        (splat, perspective(projection, &shape, &splat, &camera))
    };
    let (splats, perspectives) = (0..gaussians.count).map(of).unzip();
    (splats, Some(perspectives))
}

/// Depths of the largest responses of Gaussians.
pub fn response_depths<R: Number>(gaussians: &Gaussians<Vec<R>>, camera: &Camera) -> Vec<ResponseDepth<R>> {
    let camera = camera.lift(R::of(0.0));
    (0..gaussians.count)
        .map(|index| response_depth(&gaussian(gaussians, index).shape(gaussians.layout), &camera))
        .collect()
}

/// Splats to channels, one list for each Gaussian. Without a light there is no specular term.
///
/// The authors' form of shading is not supported.
pub fn shade<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    camera: &Camera,
    light: Option<&Light<R>>,
    rules: &RenderRules,
) -> Vec<Vec<R>> {
    let shading = shading(gaussians, rules);
    let camera = camera.lift(R::of(0.0));
    let channels = |index: usize| {
        let planes = gaussian(gaussians, index);
        let channels = if gaussians.layout.is_shaded() {
            let (shaded, terms) = shaded_and_terms(&shading, &planes, &camera, light);
            shading.surface_channels(&shaded, &terms, &camera)
        } else {
            shading.color_channels(&planes, &camera).0
        };
        channels.0[..blended(&shading).count()].to_vec()
    };
    (0..gaussians.count).map(channels).collect()
}

fn shading<R>(gaussians: &Gaussians<Vec<R>>, rules: &RenderRules) -> GaussianShading {
    GaussianShading { layout: gaussians.layout, rules: *rules }
}

/// Moves splats with attributes that are not finite behind the eye, so that they are not drawn.
fn leave_out<R: Number>(splats: &mut [Splat<R>], gaussians: &Gaussians<Vec<R>>, camera: &Camera, rules: &RenderRules) {
    let shading = shading(gaussians, rules);
    let eye = camera.lift(R::of(0.0)).position;
    for (index, splat) in splats.iter_mut().enumerate() {
        let planes = gaussian(gaussians, index);
        let is_finite = match gaussians.layout.is_shaded() {
            true => shading.shaded(&planes, eye).is_finite(),
            false => shading.harmonics(&planes, eye).sum.is_finite(),
        };
        if !is_finite {
            splat.depth = R::of(-1.0);
        }
    }
}

/// Blended channels, including the complete surface.
fn blended(shading: &GaussianShading) -> Channels {
    match shading.channels() {
        Channels::Lit => Channels::Surface,
        channels => channels,
    }
}

/// A Gaussian and the terms of its colour, with the light if it is looked up per Gaussian.
fn shaded_and_terms<R: Number>(
    shading: &GaussianShading,
    planes: &impl AttributePlanes<R>,
    camera: &CameraOf<R>,
    light: Option<&Light<R>>,
) -> (ShadedGaussian<R>, Terms<R>) {
    let shaded = shading.shaded(planes, camera.position);
    let mut sample = LightSample::none(camera.near);
    if let Some(light) = light.filter(|_| shading.looks_light_up()) {
        let direction = camera.light.to_light(shaded.surface.reflection_dir);
        sample.specular = look_up(light, direction, shaded.surface.roughness);
    }
    let terms = shaded.terms(&sample);
    (shaded, terms)
}

/// Gradient of [`shade()`]: adds those of the Gaussians and of the light's texels. That of the
/// depth belongs to [`project_vjp`]; plain Gaussians only pass on the gradient of their colour.
pub fn shade_vjp<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    camera: &Camera,
    light: Option<&Light<R>>,
    rules: &RenderRules,
    grad_channels: &[Vec<R>],
    out: &mut Gaussians<Vec<R>>,
    mut light_grad: Option<&mut LightGrad<R>>,
) {
    let shading = shading(gaussians, rules);
    let camera = camera.lift(R::of(0.0));
    let eye = camera.position;
    for (index, grads) in grad_channels.iter().enumerate() {
        let mut channels = LayerChannels([R::of(0.0); Channels::Layers.count()]);
        channels.0[..grads.len()].copy_from_slice(grads);
        let planes = gaussian(gaussians, index);
        let mut out = AddedGrads { gaussians: out, index };
        let pose = if gaussians.layout.is_shaded() {
            let (shaded, terms) = shaded_and_terms(&shading, &planes, &camera, light);
            let grad = shading.terms_vjp(&terms, &channels);
            let mut lookup = LookupGrad { specular: None, ambient: None };
            let light = light.filter(|_| shading.looks_light_up());
            if let (Some(light), Some(light_grad)) = (light, light_grad.as_deref_mut()) {
                let direction = camera.light.to_light(shaded.surface.reflection_dir);
                let roughness = shaded.surface.roughness;
                let found = light.view().look_up(direction, roughness);
                let (direction, roughness) =
                    light.view().look_up_vjp(&found, roughness, grad.specular_light, &mut light_grad.texels);
                lookup.specular = Some((camera.light.to_light_vjp(direction), roughness));
            }
            shading.surface_vjp(&planes, eye, &shaded, &grad, &channels, &lookup, &mut out)
        } else {
            shading.radiance_vjp(&planes, eye, &channels, &mut out)
        };
        out.set3(MEAN, pose.mean);
        for k in 0..4 {
            out.set(QUAT + k, pose.quat[k]);
        }
    }
}

/// Gradient of [`project()`], added to that of the Gaussians.
pub fn project_vjp<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    camera: &Camera,
    grads: &[SplatGrad<R>],
    out: &mut Gaussians<Vec<R>>,
) {
    let camera = camera.lift(R::of(0.0));
    for (index, grad) in grads.iter().enumerate() {
        let none = PoseGrad::zero(grad.opacity);
        let shape = gaussian(gaussians, index).shape(gaussians.layout);
        shape_vjp(&shape, &camera, grad, &none, &mut AddedGrads { gaussians: out, index });
    }
}

/// A picture of Gaussians under a light.
pub fn render<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    light: Option<&Light<R>>,
    camera: &Camera,
    rules: &RenderRules,
) -> Frame<R> {
    render_within(gaussians, light, camera, rules, &Cutoffs::DEFAULT)
}

/// [`render`] with other cutoffs.
pub fn render_within<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    light: Option<&Light<R>>,
    camera: &Camera,
    rules: &RenderRules,
    cutoffs: &Cutoffs,
) -> Frame<R> {
    render_occluded(gaussians, light, camera, rules, None, cutoffs)
}

/// [`render_within`] behind surfaces of another renderer: one depth for each pixel
/// ([`mod@specula_core::occlusion`]).
pub fn render_occluded<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    light: Option<&Light<R>>,
    camera: &Camera,
    rules: &RenderRules,
    occlusion: Option<&[f32]>,
    cutoffs: &Cutoffs,
) -> Frame<R> {
    let (mut splats, perspectives) = project_within(gaussians, camera, cutoffs.projection());
    let colors = shade(gaussians, camera, light, rules);
    leave_out(&mut splats, gaussians, camera, rules);
    let order = front_to_back_within(&splats, cutoffs);
    let responses = (cutoffs.order() != BlendOrder::Mean).then(|| response_depths(gaussians, camera));
    let (perspectives, responses) = (perspectives.as_deref(), responses.as_deref());
    let frame = blend_in_order(&splats, perspectives, responses, &colors, &order, camera, occlusion, cutoffs);
    if rules.is_deferred(gaussians.layout) { shade_pixels(&frame, light, camera, rules) } else { frame }
}

/// Inputs of a training step other than the scene.
#[derive(Clone, Copy, Debug)]
pub struct View<'a, R> {
    /// Camera of the picture.
    pub camera: &'a Camera,
    /// Ground truth of that camera.
    pub target: &'a Target<R>,
    /// Rendering rules.
    pub rules: &'a RenderRules,
    /// Weights of the losses.
    pub weights: &'a LossWeights,
    /// Surface that reflected rays may hit.
    pub near_field: Option<&'a NearField<Vec<f32>>>,
}

/// The weighted loss of a scene in one view. `frozen` has the weights that the losses treat as
/// constants; by default they are those of this picture.
pub fn loss<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    light: Option<&Light<R>>,
    view: &View<'_, R>,
    frozen: Option<&FrozenWeights>,
) -> R {
    let frame = render(gaussians, light, view.camera, view.rules);
    let weights = view.weights.of_form(view.rules.shading.form);
    let own_weights;
    let frozen = if let Some(frozen) = frozen {
        frozen
    } else {
        let is_deferred = view.rules.is_deferred(gaussians.layout) && weights.smoothness != 0.0;
        let unlit = is_deferred.then(|| render(gaussians, None, view.camera, view.rules));
        own_weights = freeze_weights(&frame, unlit.as_ref(), view.camera);
        &own_weights
    };
    let frame_value = frame_loss(&frame, view.target, view.camera, &weights, frozen);
    frame_value + attribute_loss(gaussians, view.weights)
}

/// The gradient of a scene.
#[derive(Clone, Debug)]
pub struct Gradient<R> {
    /// Gradient of the Gaussians.
    pub gaussians: Gaussians<Vec<R>>,
    /// Gradient of the environment's numbers, if there is one.
    pub environment: Option<Vec<R>>,
}

/// Picture of a scene, and the stages before it.
struct Pass<R> {
    light: Option<Light<R>>,
    splats: Vec<Splat<R>>,
    colors: Vec<Vec<R>>,
    order: Vec<usize>,
    /// Blended surface, before light is added pixel by pixel.
    surface: Frame<R>,
    picture: Frame<R>,
}

impl<R: Number> Pass<R> {
    fn new(gaussians: &Gaussians<Vec<R>>, light: Option<Light<R>>, camera: &Camera, rules: &RenderRules) -> Self {
        let mut splats = project(gaussians, camera);
        let colors = shade(gaussians, camera, light.as_ref(), rules);
        leave_out(&mut splats, gaussians, camera, rules);
        let order = front_to_back(&splats);
        let surface = blend(&splats, &colors, &order, camera);
        let is_deferred = rules.is_deferred(gaussians.layout);
        let picture = if is_deferred { shade_pixels(&surface, light.as_ref(), camera, rules) } else { surface.clone() };
        Self { light, splats, colors, order, surface, picture }
    }

    /// Gradients of the Gaussians and of the light under a cotangent of the picture.
    fn vjp(
        &self,
        gaussians: &Gaussians<Vec<R>>,
        environment: Option<(&Environment<Vec<R>>, &Operator)>,
        camera: &Camera,
        rules: &RenderRules,
        mut cotangent: Frame<R>,
    ) -> Gradient<R> {
        let Self { light, splats, colors, order, surface, .. } = self;
        let mut light_grad = light.as_ref().map(LightGrad::zero);
        if rules.is_deferred(gaussians.layout) {
            shade_pixels_vjp(surface, light.as_ref(), camera, rules, &mut cotangent, light_grad.as_mut());
        }
        let (mut splat_grads, color_grads) = blend_vjp(splats, colors, order, surface, &cotangent);
        if blended(&shading(gaussians, rules)) != Channels::Color {
            for (splat, channels) in splat_grads.iter_mut().zip(&color_grads) {
                splat.depth = splat.depth + channels[channel::DEPTH];
            }
        }
        let mut out = Gaussians { values: vec![R::of(0.0); gaussians.values.len()], ..*gaussians };
        shade_vjp(gaussians, camera, light.as_ref(), rules, &color_grads, &mut out, light_grad.as_mut());
        project_vjp(gaussians, camera, &splat_grads, &mut out);
        let environment = environment
            .zip(light_grad)
            .map(|((environment, operator), light_grad)| prefilter_vjp(environment, operator, &light_grad));
        Gradient { gaussians: out, environment }
    }
}

/// Gradients of [`render`] under a cotangent of its frame, plane by plane, with a light that is
/// filtered by an operator.
pub fn render_vjp<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    environment: Option<(&Environment<Vec<R>>, &Operator)>,
    camera: &Camera,
    rules: &RenderRules,
    cotangent: &[R],
) -> Gradient<R> {
    let environment = environment.filter(|_| rules.is_lit);
    let light = environment.map(|(environment, operator)| prefilter(environment, operator));
    let pass = Pass::new(gaussians, light, camera, rules);
    let cotangent = Frame { values: cotangent.to_vec(), ..pass.picture.clone() };
    pass.vjp(gaussians, environment, camera, rules, cotangent)
}

/// [`loss`], the gradient of every parameter, and the weights that were constants in it.
pub fn loss_and_gradient<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    environment: Option<(&Environment<Vec<R>>, &Operator)>,
    view: &View<'_, R>,
) -> (R, Gradient<R>, FrozenWeights) {
    let near_field = view.near_field.map(|near_field| Arc::new(near_field.clone()));
    let light = environment.map(|(environment, operator)| Light { near_field, ..prefilter(environment, operator) });
    let pass = Pass::new(gaussians, light, view.camera, view.rules);
    let weights = view.weights.of_form(view.rules.shading.form);
    let is_unlit_needed = view.rules.is_deferred(gaussians.layout) && weights.smoothness != 0.0;
    let unlit = is_unlit_needed.then(|| shade_pixels(&pass.surface, None, view.camera, view.rules));
    let frozen = freeze_weights(&pass.picture, unlit.as_ref(), view.camera);
    let frame_value = frame_loss(&pass.picture, view.target, view.camera, &weights, &frozen);
    let value = frame_value + attribute_loss(gaussians, view.weights);

    let cotangent = frame_loss_vjp(&pass.picture, view.target, view.camera, view.weights, &frozen);
    let mut gradient = pass.vjp(gaussians, environment, view.camera, view.rules, cotangent);
    attribute_loss_vjp(gaussians, view.weights, &mut gradient.gaussians);
    (value, gradient, frozen)
}
