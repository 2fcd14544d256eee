//! Gradient of deferred shading.

use crate::{
    codegen::formula::{call, fields, formula},
    stages::{
        camera::{camera_fields, take_camera},
        shade_pixels::formulas::{SurfaceOfPixel, physical_fields, take_physical},
    },
};
use specula_core::{
    physical::{self, PixelFacing, pixel_facing_vjp},
    shade_pixels::{PixelSurface, pixel_color_vjp, pixel_surface, pixel_surface_vjp},
    vector::Vec3,
};

/// Gradient of [`ColorOfPixel`](crate::stages::shade_pixels::formulas::ColorOfPixel)
/// ([`specula_core::shade_pixels::pixel_color_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct ColorOfPixelVjp;

formula!(ColorOfPixelVjp, |_, inputs| color_of_pixel_vjp(
    base: 3, tint: 3, light: 3, coverage: 1, grad: 3
) -> (
    base: 3, tint: 3, light: 3, coverage: 1
) {
    let (base, tint, light, coverage) = (inputs.vec3(), inputs.vec3(), inputs.vec3(), inputs.number());
    let surface = PixelSurface { base, tint, roughness: coverage.zero(), reflection_dir: Vec3::zero(coverage) };
    let (grad_surface, grad_light, grad_coverage) = pixel_color_vjp(&surface, light, coverage, inputs.vec3());
    (grad_surface.base, grad_surface.tint, grad_light, [grad_coverage])
});

/// Gradient of [`SurfaceOfPixel`] with respect to the blended channels
/// ([`specula_core::shade_pixels::pixel_surface_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct SurfaceOfPixelVjp(pub SurfaceOfPixel);

formula!(SurfaceOfPixelVjp, |this, inputs| surface_of_pixel_vjp(
    ..[call("blended", this.0.blended.count() + 1)], point: 2, ..camera_fields(),
    grad_base: 3, grad_tint: 3, grad_roughness: 1, grad_reflection_dir: 3
) -> (
    base: 3, normal: 3, tint: 3, roughness: 1, coverage: 1
) {
    let pixel = this.0.pixel(inputs.slice(this.0.blended.count() + 1));
    let [x, y] = inputs.array();
    let view_dir = take_camera(inputs).view_dir(x, y);
    let grad = PixelSurface {
        base: inputs.vec3(),
        tint: inputs.vec3(),
        roughness: inputs.number(),
        reflection_dir: inputs.vec3(),
    };
    let surface = pixel_surface(&pixel, view_dir);
    let grad_pixel = pixel_surface_vjp(&pixel, view_dir, &surface, &grad);
    (grad_pixel.base, grad_pixel.normal, grad_pixel.tint, [grad_pixel.roughness, grad_pixel.coverage])
});

/// Gradient of
/// [`PhysicalColorOfPixel`](crate::stages::shade_pixels::formulas::PhysicalColorOfPixel)
/// ([`specula_core::physical::pixel_color_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct PhysicalColorOfPixelVjp;

formula!(PhysicalColorOfPixelVjp, |_, inputs| physical_color_of_pixel_vjp(..physical_fields(), ..fields!(grad: 3)) -> (
    base: 3, tint: 3, specular_light: 3, irradiance: 3, split_sum: 2, coverage: 1
) {
    let (surface, light, coverage) = take_physical(inputs);
    let (grad_surface, grad_light, grad_coverage) = physical::pixel_color_vjp(&surface, &light, coverage, inputs.vec3());
    (grad_surface.base, grad_surface.tint, grad_light.specular, grad_light.irradiance, grad_light.split_sum, [grad_coverage])
});

/// Gradient of [`FacingOfPixel`](crate::stages::shade_pixels::formulas::FacingOfPixel) with respect
/// to the blended normal ([`specula_core::physical::pixel_facing_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct FacingOfPixelVjp(pub SurfaceOfPixel);

formula!(FacingOfPixelVjp, |this, inputs| facing_of_pixel_vjp(
    ..[call("blended", this.0.blended.count() + 1)], point: 2, ..camera_fields(), grad_normal: 3, grad_n_dot_v: 1
) -> (normal: 3) {
    let pixel = this.0.pixel(inputs.slice(this.0.blended.count() + 1));
    let [x, y] = inputs.array();
    let view_dir = take_camera(inputs).view_dir(x, y);
    pixel_facing_vjp(&pixel, view_dir, &PixelFacing { normal: inputs.vec3(), n_dot_v: inputs.number() })
});
