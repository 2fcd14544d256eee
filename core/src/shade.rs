//! The colour of a Gaussian towards a viewer: the shading functions of the paper and of the
//! authors' code.
//!
//! Shading runs in three steps, because the light in between is read from memory: [`surface`] turns
//! attributes into directions and activated colours; the executor looks the light up along
//! `surface.reflection_dir`; [`shade`] puts the terms together. Each step has its `_vjp`.

use crate::{
    activation::{sigmoid, sigmoid_vjp},
    color::{limited, limited_vjp, srgb_color, srgb_color_vjp},
    covariance::{Quat, rotation, rotation_vjp},
    each,
    normal::{AxisRule, Facing, axis, axis_vjp, facing, facing_vjp},
    real::Real,
    vector::{Vec3, normalize_or, normalize_or_vjp},
};

/// Equation of the colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ShadingForm {
    /// γ(c_d + s ⊙ L_s + c_r), γ the sRGB curve (paper, eq. 3).
    Paper,
    /// σ(k_d − ln 3) + E(n)(1 − s) + L_s ⊙ (s F_x + F_y) + c_r: the equation of the authors' code.
    /// No γ; an ambient term E from an irradiance map; a split-sum table (F_x, F_y) of n·v and
    /// roughness.
    Official,
    /// c_d + c_r, linear: the base colour that is blended if light is added per pixel
    /// ([`crate::shade_pixels`]).
    Deferred,
    /// a (1 − m), linear: the diffuse albedo that is blended with F₀ if irradiance and reflected
    /// light are added per pixel ([`mod@crate::physical`]).
    Physical,
}

/// Options in which implementations of this method differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ShadingRules {
    /// Equation of the colour.
    pub form: ShadingForm,
    /// Base axis of the normal.
    pub axis: AxisRule,
    /// Whether a flipped normal is −(v + Δn₂), as the paper says, or −v + Δn₂.
    pub negate_second_residual: bool,
}

impl ShadingRules {
    /// The paper's equations.
    pub const PAPER: Self = Self { form: ShadingForm::Paper, axis: AxisRule::Shortest, negate_second_residual: true };
    /// The paper's equations, their light looked up pixel by pixel.
    pub const DEFERRED: Self = Self { form: ShadingForm::Deferred, ..Self::PAPER };
    /// Physical materials, their light looked up pixel by pixel.
    pub const PHYSICAL: Self = Self { form: ShadingForm::Physical, ..Self::PAPER };
    /// The authors' code.
    pub const OFFICIAL: Self =
        Self { form: ShadingForm::Official, axis: AxisRule::SortedRow, negate_second_residual: false };

    /// Shift subtracted from the raw diffuse colour before the sigmoid: ln 3 in the authors' code.
    pub const fn diffuse_shift(&self) -> f32 {
        match self.form {
            ShadingForm::Paper | ShadingForm::Deferred | ShadingForm::Physical => 0.0,
            ShadingForm::Official => 1.098_612_3,
        }
    }
}

/// Attributes of shading, before activation.
#[derive(Clone, Copy, Debug)]
pub struct Material<R> {
    /// Centre, in world space.
    pub mean: Vec3<R>,
    /// Orientation.
    pub quat: Quat<R>,
    /// Logarithms of the scales; only their order matters.
    pub log_scales: Vec3<R>,
    /// Diffuse colour before activation.
    pub diffuse: Vec3<R>,
    /// Specular tint before the sigmoid.
    pub tint: Vec3<R>,
    /// Roughness before the sigmoid.
    pub roughness: R,
    /// Δn₁ and Δn₂.
    pub normal_residuals: [Vec3<R>; 2],
}

impl<R: Real> Material<R> {
    /// Mask of finite attributes, except those of a [`project::Shape`](crate::project::Shape).
    #[inline(always)]
    pub fn is_finite(&self) -> R::Mask {
        let [first, second] = self.normal_residuals;
        self.diffuse.is_finite()
            & self.tint.is_finite()
            & self.roughness.is_finite()
            & first.is_finite()
            & second.is_finite()
    }
}

/// Surface of a Gaussian seen from one position: directions and activated colours.
#[derive(Clone, Copy, Debug)]
pub struct Surface<R: Real> {
    /// Unit direction from the Gaussian to the eye.
    pub view_dir: Vec3<R>,
    /// The normal, turned to the viewer.
    pub facing: Facing<R>,
    /// r = 2(ω_o·n)n − ω_o.
    pub reflection_dir: Vec3<R>,
    /// ω_o · n, at least [`N_DOT_V_MIN`]; for the split-sum table.
    pub n_dot_v: R,
    /// Diffuse colour in (0, 1).
    pub diffuse: Vec3<R>,
    /// Specular tint in (0, 1).
    pub tint: Vec3<R>,
    /// Perceptual roughness in (0, 1).
    pub roughness: R,
}

/// Smallest n·v in the split-sum table; below it a surface is seen edge on.
pub const N_DOT_V_MIN: f32 = 1e-4;

/// Gradient of the parts of a [`Surface`] that colours and losses depend on.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceGrad<R> {
    /// Gradient of the unit normal.
    pub normal: Vec3<R>,
    /// Gradient of |Δn|².
    pub residual_squared: R,
    /// Gradient of the reflected direction.
    pub reflection_dir: Vec3<R>,
    /// Gradient of the direction to the eye, without the part through the reflection.
    pub view_dir: Vec3<R>,
    /// Gradient of n·v.
    pub n_dot_v: R,
    /// Gradient of the activated diffuse colour.
    pub diffuse: Vec3<R>,
    /// Gradient of the activated tint.
    pub tint: Vec3<R>,
    /// Gradient of the activated roughness.
    pub roughness: R,
}

/// The direction from a Gaussian to the eye. A Gaussian at the eye counts as seen along +z.
#[inline(always)]
pub fn view_dir<R: Real>(mean: Vec3<R>, eye: Vec3<R>) -> Vec3<R> {
    normalize_or(eye - mean, Vec3::constant(mean.x, glam::Vec3::Z))
}

/// Gradient of [`view_dir`] with respect to the mean.
#[inline(always)]
pub fn view_dir_vjp<R: Real>(mean: Vec3<R>, eye: Vec3<R>, grad: Vec3<R>) -> Vec3<R> {
    -normalize_or_vjp(eye - mean, grad)
}

/// The activated diffuse colour, in (0, 1).
#[inline(always)]
pub fn diffuse<R: Real>(raw: Vec3<R>, rules: ShadingRules) -> Vec3<R> {
    let shift = rules.diffuse_shift();
    each!(raw, x => sigmoid(x - shift))
}

/// Directions and activated colours of a Gaussian seen from `eye`.
#[inline(always)]
pub fn surface<R: Real>(material: &Material<R>, eye: Vec3<R>, rules: ShadingRules) -> Surface<R> {
    let view_dir = view_dir(material.mean, eye);
    let axis = axis(rules.axis, &rotation(material.quat), material.log_scales);
    let facing = facing(axis, view_dir, material.normal_residuals, rules.negate_second_residual);
    Surface {
        view_dir,
        reflection_dir: reflect(view_dir, facing.normal),
        n_dot_v: view_dir.dot(facing.normal).max(material.roughness.constant(N_DOT_V_MIN)),
        facing,
        diffuse: diffuse(material.diffuse, rules),
        tint: each!(material.tint, x => sigmoid(x)),
        roughness: sigmoid(material.roughness),
    }
}

/// Gradient of [`surface`] with respect to the attributes. Scales have none: their order is locally
/// constant.
#[inline(always)]
pub fn surface_vjp<R: Real>(
    material: &Material<R>,
    eye: Vec3<R>,
    rules: ShadingRules,
    surface: &Surface<R>,
    grad: &SurfaceGrad<R>,
) -> Material<R> {
    let normal = surface.facing.normal;
    let (grad_view, grad_normal) = reflect_vjp(surface.view_dir, normal, grad.reflection_dir);
    let is_open = material.roughness.constant(N_DOT_V_MIN).less(surface.view_dir.dot(normal));
    let grad_cosine = grad.n_dot_v.keep(is_open);
    let grad_view = (grad_view + grad.view_dir).add_scaled(grad_cosine, normal);
    let grad_normal = (grad_normal + grad.normal).add_scaled(grad_cosine, surface.view_dir);

    let (grad_axis, normal_residuals) =
        facing_vjp(&surface.facing, rules.negate_second_residual, grad_normal, grad.residual_squared);
    Material {
        mean: view_dir_vjp(material.mean, eye, grad_view),
        quat: rotation_vjp(material.quat, &axis_vjp(rules.axis, material.log_scales, grad_axis)),
        log_scales: Vec3::zero(material.roughness),
        diffuse: sigmoid_vjp3(surface.diffuse, grad.diffuse),
        tint: sigmoid_vjp3(surface.tint, grad.tint),
        roughness: sigmoid_vjp(surface.roughness, grad.roughness),
        normal_residuals,
    }
}

/// r = 2(ω·n)n − ω.
#[inline(always)]
pub fn reflect<R: Real>(view_dir: Vec3<R>, normal: Vec3<R>) -> Vec3<R> {
    normal * (view_dir.dot(normal) * 2.0) - view_dir
}

/// Gradient of [`reflect`] with respect to the view direction and the normal.
#[inline(always)]
pub fn reflect_vjp<R: Real>(view_dir: Vec3<R>, normal: Vec3<R>, grad: Vec3<R>) -> (Vec3<R>, Vec3<R>) {
    let along = grad.dot(normal) * 2.0;
    let cosine = view_dir.dot(normal) * 2.0;
    (normal * along - grad, view_dir * along + grad * cosine)
}

/// Terms of the shading function ([`shade`]).
#[derive(Clone, Copy, Debug)]
pub struct Terms<R> {
    /// Diffuse colour.
    pub diffuse: Vec3<R>,
    /// Specular tint.
    pub tint: Vec3<R>,
    /// Prefiltered radiance L_s along the reflected direction.
    pub specular_light: Vec3<R>,
    /// Residual colour c_r.
    pub residual: Vec3<R>,
    /// Irradiance / π along the normal; read by [`ShadingForm::Official`] only.
    pub ambient_light: Vec3<R>,
    /// (F_x, F_y) of the split-sum table; read by [`ShadingForm::Official`] only.
    pub split_sum: [R; 2],
}

impl<R: Real> Terms<R> {
    /// Terms of a Gaussian without light: diffuse and residual colour.
    #[inline(always)]
    pub fn unlit(diffuse: Vec3<R>, residual: Vec3<R>) -> Self {
        let none = Vec3::zero(diffuse.x);
        Self { diffuse, tint: none, specular_light: none, residual, ambient_light: none, split_sum: [none.x; 2] }
    }
}

/// The colour of a Gaussian; sRGB-encoded except for [`ShadingForm::Deferred`] and
/// [`ShadingForm::Physical`]. Residuals are clamped ([`crate::color::COLOR_MAX`]), light is not.
#[inline(always)]
pub fn shade<R: Real>(form: ShadingForm, terms: &Terms<R>) -> Vec3<R> {
    let residual = limited(terms.residual);
    match form {
        ShadingForm::Paper => srgb_color(terms.diffuse + terms.tint.times(terms.specular_light) + residual),
        ShadingForm::Official => {
            let specular = reflectance(terms).times(terms.specular_light);
            terms.diffuse + terms.ambient_light.times(each!(terms.tint, s => -s + 1.0)) + specular + residual
        }
        ShadingForm::Deferred => terms.diffuse + residual,
        ShadingForm::Physical => terms.diffuse,
    }
}

/// Specular part of the colour of a Gaussian, linear: its layer of a picture.
#[inline(always)]
pub fn specular<R: Real>(form: ShadingForm, terms: &Terms<R>) -> Vec3<R> {
    match form {
        ShadingForm::Paper | ShadingForm::Deferred | ShadingForm::Physical => terms.tint.times(terms.specular_light),
        ShadingForm::Official => {
            let none = Vec3::zero(terms.diffuse.x);
            shade(form, &Terms { diffuse: none, residual: none, ..*terms })
        }
    }
}

/// Gradient of [`shade`]; that of a residual is zero where it was clamped.
#[inline(always)]
pub fn shade_vjp<R: Real>(form: ShadingForm, terms: &Terms<R>, grad: Vec3<R>) -> Terms<R> {
    let grad = unlimited_vjp(form, terms, grad);
    Terms { residual: limited_vjp(terms.residual, grad.residual), ..grad }
}

/// Gradient of [`shade`] without the clamp of residuals.
#[inline(always)]
fn unlimited_vjp<R: Real>(form: ShadingForm, terms: &Terms<R>, grad: Vec3<R>) -> Terms<R> {
    match form {
        ShadingForm::Paper => {
            let linear = terms.diffuse + terms.tint.times(terms.specular_light) + limited(terms.residual);
            let grad_linear = srgb_color_vjp(linear, srgb_color(linear), grad);
            Terms {
                diffuse: grad_linear,
                tint: grad_linear.times(terms.specular_light),
                specular_light: grad_linear.times(terms.tint),
                residual: grad_linear,
                ambient_light: Vec3::zero(grad.x),
                split_sum: [grad.x.zero(); 2],
            }
        }
        ShadingForm::Official => {
            let by_light = grad.times(terms.specular_light);
            Terms {
                diffuse: grad,
                tint: by_light * terms.split_sum[0] - grad.times(terms.ambient_light),
                specular_light: grad.times(reflectance(terms)),
                residual: grad,
                ambient_light: grad.times(each!(terms.tint, s => -s + 1.0)),
                split_sum: [by_light.dot(terms.tint), by_light.sum()],
            }
        }
        ShadingForm::Deferred | ShadingForm::Physical => {
            let none = Vec3::zero(grad.x);
            Terms {
                diffuse: grad,
                tint: none,
                specular_light: none,
                residual: if form == ShadingForm::Deferred { grad } else { none },
                ambient_light: none,
                split_sum: [none.x; 2],
            }
        }
    }
}

/// s F_x + F_y.
#[inline(always)]
fn reflectance<R: Real>(terms: &Terms<R>) -> Vec3<R> {
    terms.tint * terms.split_sum[0] + Vec3::splat(terms.split_sum[1])
}

#[inline(always)]
fn sigmoid_vjp3<R: Real>(value: Vec3<R>, grad: Vec3<R>) -> Vec3<R> {
    Vec3 { x: sigmoid_vjp(value.x, grad.x), y: sigmoid_vjp(value.y, grad.y), z: sigmoid_vjp(value.z, grad.z) }
}
