//! The way back through a light that is looked up, and through pixels that look it up.

use super::{SurfaceOfPixel, camera_fields, flat, take_camera};
use crate::formula::{Field, Formula, Inputs, call, field};
use specula_core::{
    cubemap::{bilinear, bilinear_vjp, bilinear_weights, project, project_vjp},
    pixel::{PixelSurface, pixel_color_vjp, pixel_surface, pixel_surface_vjp},
    prefilter::{Level, level_of_roughness_vjp},
    real::Real,
    vector::Vec3,
};

/// Shares of the four texels of a footprint ([`specula_core::cubemap::bilinear_weights`]).
#[derive(Clone, Copy, Debug)]
pub struct TexelShares;

impl Formula for TexelShares {
    fn name(&self) -> String {
        "texel_shares".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("right", 1), field("lower", 1)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("shares", 4)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        bilinear_weights(inputs.number(), inputs.number()).to_vec()
    }
}

/// The mean of a footprint's four texels, and the gradient of its point on the face
/// ([`specula_core::cubemap::bilinear_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct TexelsVjp;

impl Formula for TexelsVjp {
    fn name(&self) -> String {
        "texels_vjp".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![
            field("upper_left", 3),
            field("upper_right", 3),
            field("lower_left", 3),
            field("lower_right", 3),
            field("right", 1),
            field("lower", 1),
            field("resolution", 1),
            field("grad", 3),
        ]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("radiance", 3), field("point", 2)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let texels = [inputs.vec3(), inputs.vec3(), inputs.vec3(), inputs.vec3()];
        let (right, lower, half) = (inputs.number(), inputs.number(), inputs.number() * 0.5);
        let (grad_right, grad_lower) = bilinear_vjp(texels, right, lower, inputs.vec3());
        let mut numbers = flat(bilinear(texels, right, lower)).to_vec();
        numbers.extend([grad_right * half, grad_lower * half]);
        numbers
    }
}

/// From a point on a face to its direction ([`specula_core::cubemap::project_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct DirectionVjp;

impl Formula for DirectionVjp {
    fn name(&self) -> String {
        "direction_vjp".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("direction", 3), field("grad", 2)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("direction", 3)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let (point, [grad_u, grad_v]) = (project(inputs.vec3()), inputs.array());
        flat(project_vjp(&point, grad_u, grad_v)).to_vec()
    }
}

/// From the radiance of two neighbouring levels to the roughness between them
/// ([`specula_core::prefilter::level_of_roughness_vjp`]).
#[derive(Clone, Debug, PartialEq)]
pub struct RoughnessVjp {
    /// The levels.
    pub levels: Vec<Level>,
}

impl Formula for RoughnessVjp {
    fn name(&self) -> String {
        "roughness_vjp".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("roughness", 1), field("sharp", 3), field("blurred", 3), field("grad", 3)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("roughness", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let (roughness, sharp, blurred, grad) = (inputs.number(), inputs.vec3(), inputs.vec3(), inputs.vec3());
        vec![level_of_roughness_vjp(roughness, &self.levels, grad.dot(blurred - sharp))]
    }
}

/// Gradient of [`super::ColorOfPixel`] ([`specula_core::pixel::pixel_color_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct ColorOfPixelVjp;

impl Formula for ColorOfPixelVjp {
    fn name(&self) -> String {
        "color_of_pixel_vjp".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("base", 3), field("tint", 3), field("light", 3), field("coverage", 1), field("grad", 3)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("base", 3), field("tint", 3), field("light", 3), field("coverage", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let (base, tint, light, coverage) = (inputs.vec3(), inputs.vec3(), inputs.vec3(), inputs.number());
        let surface = PixelSurface { base, tint, roughness: coverage.zero(), reflection_dir: Vec3::zero(coverage) };
        let (of_surface, of_light, of_coverage) = pixel_color_vjp(&surface, light, coverage, inputs.vec3());
        let mut numbers = [of_surface.base, of_surface.tint, of_light].map(flat).as_flattened().to_vec();
        numbers.push(of_coverage);
        numbers
    }
}

/// Gradient of [`SurfaceOfPixel`] with respect to what was blended ([`specula_core::pixel::pixel_surface_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct SurfaceOfPixelVjp(pub SurfaceOfPixel);

impl Formula for SurfaceOfPixelVjp {
    fn name(&self) -> String {
        "surface_of_pixel_vjp".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        let mut fields = vec![call("blended", self.0.blended.count() + 1), field("point", 2)];
        fields.extend(camera_fields());
        fields.extend([
            field("grad_base", 3),
            field("grad_tint", 3),
            field("grad_roughness", 1),
            field("grad_reflection_dir", 3),
        ]);
        fields
    }
    fn results(&self) -> Vec<Field> {
        vec![field("base", 3), field("normal", 3), field("tint", 3), field("roughness", 1), field("coverage", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let pixel = self.0.pixel(inputs.slice(self.0.blended.count() + 1));
        let [x, y] = inputs.array();
        let view_dir = take_camera(inputs).view_dir(x, y);
        let grad = PixelSurface {
            base: inputs.vec3(),
            tint: inputs.vec3(),
            roughness: inputs.number(),
            reflection_dir: inputs.vec3(),
        };
        let surface = pixel_surface(&pixel, view_dir);
        let own = pixel_surface_vjp(&pixel, view_dir, &surface, &grad);
        let mut numbers = [own.base, own.normal, own.tint].map(flat).as_flattened().to_vec();
        numbers.extend([own.roughness, own.coverage]);
        numbers
    }
}
