//! The whole pipeline from core's formulas, one plain loop after the other, over any number.
//!
//! No tiles, lanes or culling beyond what defines the picture: what an executor's stages are compared with, in `f64` as
//! the oracle of its error. The stages have core's names; [`loss_and_gradient`] is one step of training up to the
//! gradients. Layouts are core's, over `Vec<R>` instead of `Vec<f32>`. [`independent`] is a renderer that shares no formula
//! with any of this. [`scenes`] and [`stress`] are what is looked at.
#![forbid(unsafe_code)]

pub mod independent;
mod light;
mod losses;
pub mod number;
mod picture;
mod pixels;
pub mod scenes;
pub mod stress;

pub use light::{Light, LightGrad, Operator, look_up, look_up_vjp, prefilter, prefilter_vjp};
pub use losses::{
    FrozenWeights, Target, attribute_loss, attribute_loss_vjp, frame_loss, frame_loss_vjp, freeze_weights,
};
pub use picture::{Frame, blend, blend_vjp, blend_within, composite, front_to_back, front_to_back_within};
pub use pixels::{shade_pixels, shade_pixels_vjp};

use crate::number::Number;
use specula_core::{
    camera::Camera,
    covariance,
    cutoffs::{Cutoffs, ProjectionModel},
    loss::LossWeights,
    normal::{AxisRule, axis, facing},
    perspective::{Perspective, perspective},
    project::{self, Shape},
    rules::{Channels, RenderRules, channel},
    scene::{
        DIFFUSE, Environment, Gaussians, LOG_SCALE, Layout, MEAN, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY, QUAT,
        ROUGHNESS, TINT,
    },
    sh,
    shade::{self, Material, Surface, SurfaceGrad, Terms},
    splat::{Splat, SplatGrad},
    vector::{Vec3, vec3},
};

/// A cloud in other numbers.
pub fn lift_gaussians<R: Number>(gaussians: &Gaussians<Vec<f32>>) -> Gaussians<Vec<R>> {
    Gaussians { count: gaussians.count, layout: gaussians.layout, values: lift(&gaussians.values) }
}

/// A light in other numbers.
pub fn lift_environment<R: Number>(environment: &Environment<Vec<f32>>) -> Environment<Vec<R>> {
    Environment {
        resolution: environment.resolution,
        activation: environment.activation,
        values: lift(&environment.values),
    }
}

/// Numbers as other numbers.
pub fn lift<R: Number>(values: &[f32]) -> Vec<R> {
    values.iter().map(|&x| R::of(f64::from(x))).collect()
}

/// `N` neighbouring planes of one Gaussian.
pub fn planes<R: Number, const N: usize>(gaussians: &Gaussians<Vec<R>>, gaussian: usize, first: usize) -> [R; N] {
    core::array::from_fn(|k| gaussians.values[gaussians.index_of(gaussian, first + k)])
}

fn planes3<R: Number>(gaussians: &Gaussians<Vec<R>>, gaussian: usize, first: usize) -> Vec3<R> {
    let [x, y, z] = planes(gaussians, gaussian, first);
    vec3(x, y, z)
}

/// Adds to `N` neighbouring planes of one Gaussian.
fn add<R: Number, const N: usize>(gaussians: &mut Gaussians<Vec<R>>, gaussian: usize, first: usize, numbers: [R; N]) {
    for (k, number) in numbers.into_iter().enumerate() {
        let index = gaussians.index_of(gaussian, first + k);
        gaussians.values[index] = gaussians.values[index] + number;
    }
}

/// What of a Gaussian decides its splat.
pub fn shape<R: Number>(gaussians: &Gaussians<Vec<R>>, gaussian: usize) -> Shape<R> {
    let [opacity_logit] = planes(gaussians, gaussian, OPACITY);
    Shape {
        mean: planes3(gaussians, gaussian, MEAN),
        log_scales: planes3(gaussians, gaussian, LOG_SCALE),
        quat: planes(gaussians, gaussian, QUAT),
        opacity_logit,
    }
}

fn material<R: Number>(gaussians: &Gaussians<Vec<R>>, gaussian: usize) -> Material<R> {
    let [roughness] = planes(gaussians, gaussian, ROUGHNESS);
    Material {
        mean: planes3(gaussians, gaussian, MEAN),
        quat: planes(gaussians, gaussian, QUAT),
        log_scales: planes3(gaussians, gaussian, LOG_SCALE),
        diffuse: planes3(gaussians, gaussian, DIFFUSE),
        tint: planes3(gaussians, gaussian, TINT),
        roughness,
        normal_residuals: [NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2].map(|first| planes3(gaussians, gaussian, first)),
    }
}

/// Gaussians to splats.
pub fn project<R: Number>(gaussians: &Gaussians<Vec<R>>, camera: &Camera) -> Vec<Splat<R>> {
    let camera = camera.lift(R::of(0.0));
    (0..gaussians.count).map(|gaussian| project::project(&shape(gaussians, gaussian), &camera)).collect()
}

/// Gaussians to splats, in another projection; the perspective inside of them, where it is not affine.
pub fn project_within<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    camera: &Camera,
    projection: ProjectionModel,
) -> (Vec<Splat<R>>, Option<Vec<Perspective<R>>>) {
    if projection == ProjectionModel::Affine {
        return (project(gaussians, camera), None);
    }
    let camera = camera.lift(R::of(0.0)).for_projection(projection);
    let of = |gaussian: usize| {
        let shape = shape(gaussians, gaussian);
        let splat = project::project(&shape, &camera);
        (splat, perspective(projection, &shape, &splat, &camera))
    };
    let (splats, perspectives) = (0..gaussians.count).map(of).unzip();
    (splats, Some(perspectives))
}

/// Splats to channels, one list for each Gaussian. Without a light there is no specular term.
///
/// The authors' form of shading is not among what is written plainly here.
pub fn shade<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    camera: &Camera,
    light: Option<&Light<R>>,
    rules: &RenderRules,
) -> Vec<Vec<R>> {
    (0..gaussians.count).map(|gaussian| shade_one(gaussians, gaussian, camera, light, rules)).collect()
}

/// Puts splats whose attributes are not finite behind the eye, where nothing is drawn.
fn leave_out<R: Number>(splats: &mut [Splat<R>], gaussians: &Gaussians<Vec<R>>, camera: &Camera, rules: &RenderRules) {
    let eye = camera.lift(R::of(0.0)).position;
    for (gaussian, splat) in splats.iter_mut().enumerate() {
        let is_finite = Harmonics::new(gaussians, gaussian, eye, rules).sum.is_finite();
        let is_material = !gaussians.layout.is_shaded() || material(gaussians, gaussian).is_finite();
        if !(is_finite && is_material) {
            splat.depth = R::of(-1.0);
        }
    }
}

/// What is blended; nothing of a surface is left out.
fn blended(rules: &RenderRules, layout: Layout) -> Channels {
    match rules.blended(layout) {
        Channels::Lit => Channels::Surface,
        channels => channels,
    }
}

fn shade_one<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    gaussian: usize,
    camera: &Camera,
    light: Option<&Light<R>>,
    rules: &RenderRules,
) -> Vec<R> {
    let zero = R::of(0.0);
    let mut channels = vec![zero; Channels::Layers.count()];
    let mut put = |first: usize, v: Vec3<R>| channels[first..first + 3].copy_from_slice(&v.to_array());
    let eye = camera.lift(zero).position;
    let mean = planes3(gaussians, gaussian, MEAN);
    let harmonics = Harmonics::new(gaussians, gaussian, eye, rules);
    if gaussians.layout.is_shaded() {
        let (surface, terms) = surface_and_terms(gaussians, gaussian, eye, light, rules);
        put(channel::COLOR, shade::shade(rules.shading.form, &terms));
        put(channel::NORMAL, surface.facing.normal);
        put(channel::DIFFUSE, terms.diffuse);
        put(channel::SPECULAR, terms.tint.times(terms.specular_light));
        put(channel::RESIDUAL, terms.residual);
        put(channel::TINT, terms.tint);
        put(channel::LIGHT, terms.specular_light);
        channels[channel::RESIDUAL_SIZE] = surface.facing.residual_squared;
        channels[channel::ROUGHNESS] = surface.roughness;
    } else {
        put(channel::COLOR, sh::radiance(harmonics.sum));
        let rotation = covariance::rotation(planes(gaussians, gaussian, QUAT));
        let axis = axis(AxisRule::Shortest, &rotation, planes3(gaussians, gaussian, LOG_SCALE));
        let none = Vec3::zero(zero);
        put(channel::NORMAL, facing(axis, shade::view_dir(mean, eye), [none; 2], true).normal);
    }
    channels[channel::DEPTH] = camera.lift(zero).to_camera(mean).z;
    channels.truncate(blended(rules, gaussians.layout).count());
    channels
}

/// Spherical harmonics of a Gaussian along the ray from the eye, as many as the rules let through.
struct Harmonics<R> {
    count: usize,
    ray_dir: Vec3<R>,
    basis: [R; sh::MAX_COUNT],
    coefficients: Vec<Vec3<R>>,
    sum: Vec3<R>,
}

impl<R: Number> Harmonics<R> {
    fn new(gaussians: &Gaussians<Vec<R>>, gaussian: usize, eye: Vec3<R>, rules: &RenderRules) -> Self {
        let count = match (rules.sh_degree, gaussians.layout.sh_degree) {
            (Some(wanted), Some(present)) => (usize::from(wanted.min(present)) + 1).pow(2),
            _ => 0,
        };
        let ray_dir = -shade::view_dir(planes3(gaussians, gaussian, MEAN), eye);
        let basis = sh::basis(ray_dir, count);
        let start = gaussians.layout.sh_start();
        let coefficients: Vec<_> = (0..count).map(|k| planes3(gaussians, gaussian, start + 3 * k)).collect();
        let zero = Vec3::zero(ray_dir.x);
        let sum = coefficients.iter().zip(basis).fold(zero, |sum, (c, value)| sum.add_scaled(value, *c));
        Self { count, ray_dir, basis, coefficients, sum }
    }

    /// Adds the coefficients' gradients; returns that of the direction to the eye.
    fn vjp(&self, grad: Vec3<R>, gaussian: usize, out: &mut Gaussians<Vec<R>>) -> Vec3<R> {
        let mut grad_basis = [grad.x.zero(); sh::MAX_COUNT];
        let start = out.layout.sh_start();
        for (k, (slot, coefficient)) in grad_basis.iter_mut().zip(&self.coefficients).enumerate() {
            add(out, gaussian, start + 3 * k, (grad * self.basis[k]).to_array());
            *slot = grad.dot(*coefficient);
        }
        -sh::basis_vjp(self.ray_dir, self.count, &grad_basis)
    }
}

/// The light, if Gaussians look it up.
fn own_light<'a, R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    light: Option<&'a Light<R>>,
    rules: &RenderRules,
) -> Option<&'a Light<R>> {
    light.filter(|_| !rules.is_deferred(gaussians.layout))
}

fn surface_and_terms<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    gaussian: usize,
    eye: Vec3<R>,
    light: Option<&Light<R>>,
    rules: &RenderRules,
) -> (Surface<R>, Terms<R>) {
    let surface = shade::surface(&material(gaussians, gaussian), eye, rules.shading);
    let none = Vec3::zero(eye.x);
    let terms = Terms {
        diffuse: surface.diffuse,
        tint: surface.tint,
        specular_light: own_light(gaussians, light, rules)
            .map_or(none, |light| look_up(light, surface.reflection_dir, surface.roughness)),
        residual: Harmonics::new(gaussians, gaussian, eye, rules).sum,
        ambient_light: none,
        split_sum: [none.x; 2],
    };
    (surface, terms)
}

/// Gradient of [`shade()`]: adds those of the Gaussians and of the light's texels. That of the depth belongs to
/// [`project_vjp`]; plain Gaussians pass on the gradient of their colour alone.
pub fn shade_vjp<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    camera: &Camera,
    light: Option<&Light<R>>,
    rules: &RenderRules,
    grad_channels: &[Vec<R>],
    out: &mut Gaussians<Vec<R>>,
    mut light_grad: Option<&mut LightGrad<R>>,
) {
    let zero = R::of(0.0);
    let eye = camera.lift(zero).position;
    for (gaussian, channels) in grad_channels.iter().enumerate() {
        let take = |first: usize| vec3(channels[first], channels[first + 1], channels[first + 2]);
        let harmonics = Harmonics::new(gaussians, gaussian, eye, rules);
        if !gaussians.layout.is_shaded() {
            let grad_sum = sh::radiance_vjp(harmonics.sum, take(channel::COLOR));
            let grad_view = harmonics.vjp(grad_sum, gaussian, out);
            let mean = planes3(gaussians, gaussian, MEAN);
            add(out, gaussian, MEAN, shade::view_dir_vjp(mean, eye, grad_view).to_array());
            continue;
        }
        let (surface, terms) = surface_and_terms(gaussians, gaussian, eye, light, rules);
        let grad = shade::shade_vjp(rules.shading.form, &terms, take(channel::COLOR));
        let (grad_reflection, grad_roughness) = match (own_light(gaussians, light, rules), light_grad.as_deref_mut()) {
            (Some(light), Some(light_grad)) => {
                look_up_vjp(light, surface.reflection_dir, surface.roughness, grad.specular_light, light_grad)
            }
            _ => (Vec3::zero(zero), zero),
        };
        let geometry = channels.len() > channel::NORMAL;
        let has_surface = channels.len() > channel::ROUGHNESS;
        let grad_surface = SurfaceGrad {
            normal: if geometry { take(channel::NORMAL) } else { Vec3::zero(zero) },
            residual_squared: if geometry { channels[channel::RESIDUAL_SIZE] } else { zero },
            reflection_dir: grad_reflection,
            view_dir: harmonics.vjp(grad.residual, gaussian, out),
            n_dot_v: zero,
            diffuse: grad.diffuse,
            tint: if has_surface { grad.tint + take(channel::TINT) } else { grad.tint },
            roughness: if has_surface { grad_roughness + channels[channel::ROUGHNESS] } else { grad_roughness },
        };
        let material = material(gaussians, gaussian);
        let grad = shade::surface_vjp(&material, eye, rules.shading, &surface, &grad_surface);
        add(out, gaussian, MEAN, grad.mean.to_array());
        add(out, gaussian, QUAT, grad.quat);
        add(out, gaussian, LOG_SCALE, grad.log_scales.to_array());
        add(out, gaussian, DIFFUSE, grad.diffuse.to_array());
        add(out, gaussian, TINT, grad.tint.to_array());
        add(out, gaussian, ROUGHNESS, [grad.roughness]);
        add(out, gaussian, NORMAL_RESIDUAL_1, grad.normal_residuals[0].to_array());
        add(out, gaussian, NORMAL_RESIDUAL_2, grad.normal_residuals[1].to_array());
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
    for (gaussian, grad) in grads.iter().enumerate() {
        let grad = project::project_vjp(&shape(gaussians, gaussian), &camera, grad);
        add(out, gaussian, MEAN, grad.mean.to_array());
        add(out, gaussian, LOG_SCALE, grad.log_scales.to_array());
        add(out, gaussian, QUAT, grad.quat);
        add(out, gaussian, OPACITY, [grad.opacity_logit]);
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
    let (mut splats, perspectives) = project_within(gaussians, camera, cutoffs.projection());
    let colors = shade(gaussians, camera, light, rules);
    leave_out(&mut splats, gaussians, camera, rules);
    let order = front_to_back_within(&splats, cutoffs);
    let frame = blend_within(&splats, perspectives.as_deref(), &colors, &order, camera, cutoffs);
    if rules.is_deferred(gaussians.layout) { shade_pixels(&frame, light, camera) } else { frame }
}

/// What a step of training sees and wants, beside the scene itself.
#[derive(Clone, Copy, Debug)]
pub struct View<'a, R> {
    /// From where.
    pub camera: &'a Camera,
    /// The picture that was taken there.
    pub target: &'a Target<R>,
    /// How it is rendered.
    pub rules: &'a RenderRules,
    /// What is minimised.
    pub weights: &'a LossWeights,
}

/// The weighted loss of a scene in one view. `frozen` holds the weights that the losses treat as constants; without
/// it they are those of this very picture.
pub fn loss<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    light: Option<&Light<R>>,
    view: &View<'_, R>,
    frozen: Option<&FrozenWeights>,
) -> R {
    let frame = render(gaussians, light, view.camera, view.rules);
    let own = freeze_weights(&frame);
    let of_frame = frame_loss(&frame, view.target, view.camera, view.weights, frozen.unwrap_or(&own));
    of_frame + attribute_loss(gaussians, view.weights)
}

/// The gradient of a scene.
#[derive(Clone, Debug)]
pub struct Gradient<R> {
    /// Of the Gaussians.
    pub gaussians: Gaussians<Vec<R>>,
    /// Of the environment's numbers, if there is one.
    pub environment: Option<Vec<R>>,
}

/// [`loss`], the gradient of every parameter, and the weights that were constants in it.
pub fn loss_and_gradient<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    environment: Option<(&Environment<Vec<R>>, &Operator)>,
    view: &View<'_, R>,
) -> (R, Gradient<R>, FrozenWeights) {
    let light = environment.map(|(environment, operator)| prefilter(environment, operator));
    let mut splats = project(gaussians, view.camera);
    let colors = shade(gaussians, view.camera, light.as_ref(), view.rules);
    leave_out(&mut splats, gaussians, view.camera, view.rules);
    let order = front_to_back(&splats);
    let frame = blend(&splats, &colors, &order, view.camera);
    let is_deferred = view.rules.is_deferred(gaussians.layout);
    let picture = if is_deferred { shade_pixels(&frame, light.as_ref(), view.camera) } else { frame.clone() };
    let frozen = freeze_weights(&picture);
    let of_frame = frame_loss(&picture, view.target, view.camera, view.weights, &frozen);
    let value = of_frame + attribute_loss(gaussians, view.weights);

    let mut light_grad = light.as_ref().map(LightGrad::zero);
    let mut frame_grad = frame_loss_vjp(&picture, view.target, view.camera, view.weights, &frozen);
    if is_deferred {
        shade_pixels_vjp(&frame, light.as_ref(), view.camera, &mut frame_grad, light_grad.as_mut());
    }
    let (mut splat_grads, color_grads) = blend_vjp(&splats, &colors, &order, &frame, &frame_grad);
    if blended(view.rules, gaussians.layout) != Channels::Color {
        for (splat, channels) in splat_grads.iter_mut().zip(&color_grads) {
            splat.depth = splat.depth + channels[channel::DEPTH];
        }
    }

    let mut out = Gaussians { values: vec![R::of(0.0); gaussians.values.len()], ..*gaussians };
    shade_vjp(gaussians, view.camera, light.as_ref(), view.rules, &color_grads, &mut out, light_grad.as_mut());
    project_vjp(gaussians, view.camera, &splat_grads, &mut out);
    attribute_loss_vjp(gaussians, view.weights, &mut out);
    let environment = environment
        .zip(light_grad)
        .map(|((environment, operator), light_grad)| prefilter_vjp(environment, operator, &light_grad));
    (value, Gradient { gaussians: out, environment }, frozen)
}
