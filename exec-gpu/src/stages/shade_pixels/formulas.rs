//! Deferred shading of a pixel.

use crate::{
    codegen::formula::{Field, Inputs, call, fields, formula},
    stages::camera::{camera_fields, take_camera},
};
use specula_core::{
    physical::{self, PixelLight, pixel_facing, reflected},
    real::Real,
    rules::{Channels, channel},
    shade_pixels::{Pixel, PixelSurface, pixel_color, pixel_surface},
    vector::Vec3,
};

/// Mean surface of a pixel ([`specula_core::shade_pixels::pixel_surface`]), from its blended
/// channels.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceOfPixel {
    /// Blended channels.
    pub blended: Channels,
}

impl SurfaceOfPixel {
    /// The pixel of a list of blended channels and the transmittance.
    pub(crate) fn pixel<R: Real>(&self, numbers: &[R]) -> Pixel<R> {
        let transmittance = numbers[self.blended.count()];
        let at = |channel: usize| self.blended.index_of(channel).map_or(transmittance.zero(), |index| numbers[index]);
        let vec3 = |first: usize| Vec3 { x: at(first), y: at(first + 1), z: at(first + 2) };
        Pixel {
            base: vec3(channel::COLOR),
            normal: vec3(channel::NORMAL),
            tint: vec3(channel::TINT),
            roughness: at(channel::ROUGHNESS),
            coverage: -transmittance + 1.0,
        }
    }
}

formula!(SurfaceOfPixel, |this, inputs| surface_of_pixel(
    ..[call("blended", this.blended.count() + 1)], point: 2, ..camera_fields()
) -> (
    base: 3, tint: 3, roughness: 1, reflection_dir: 3, coverage: 1
) {
    let pixel = this.pixel(inputs.slice(this.blended.count() + 1));
    let [x, y] = inputs.array();
    let view_dir = take_camera(inputs).view_dir(x, y);
    let PixelSurface { base, tint, roughness, reflection_dir } = pixel_surface(&pixel, view_dir);
    (base, tint, [roughness], reflection_dir, [pixel.coverage])
});

/// Colour of a pixel under the light that it looked up
/// ([`specula_core::shade_pixels::pixel_color`]).
#[derive(Clone, Copy, Debug)]
pub struct ColorOfPixel;

formula!(ColorOfPixel, |_, inputs| color_of_pixel(base: 3, tint: 3, light: 3, coverage: 1) -> (color: 3) {
    let (base, tint, light, coverage) = (inputs.vec3(), inputs.vec3(), inputs.vec3(), inputs.number());
    let surface = PixelSurface { base, tint, roughness: coverage.zero(), reflection_dir: Vec3::zero(coverage) };
    pixel_color(&surface, light, coverage)
});

/// Orientation of a pixel's surface ([`specula_core::physical::pixel_facing`]).
#[derive(Clone, Copy, Debug)]
pub struct FacingOfPixel(pub SurfaceOfPixel);

formula!(FacingOfPixel, |this, inputs| facing_of_pixel(
    ..[call("blended", this.0.blended.count() + 1)], point: 2, ..camera_fields()
) -> (
    normal: 3, n_dot_v: 1
) {
    let pixel = this.0.pixel(inputs.slice(this.0.blended.count() + 1));
    let [x, y] = inputs.array();
    let facing = pixel_facing(&pixel, take_camera(inputs).view_dir(x, y));
    (facing.normal, [facing.n_dot_v])
});

/// Physical material of a pixel and the light that reaches it, as parameters.
pub(crate) fn physical_fields() -> Vec<Field> {
    fields!(base: 3, tint: 3, specular_light: 3, irradiance: 3, split_sum: 2, coverage: 1)
}

/// Reads [`physical_fields`] from a formula's inputs.
pub(crate) fn take_physical<R: Real>(inputs: &mut Inputs<'_, R>) -> (PixelSurface<R>, PixelLight<R>, R) {
    let (base, tint) = (inputs.vec3(), inputs.vec3());
    let light = PixelLight { specular: inputs.vec3(), irradiance: inputs.vec3(), split_sum: inputs.array() };
    let coverage = inputs.number();
    (PixelSurface { base, tint, roughness: coverage.zero(), reflection_dir: Vec3::zero(coverage) }, light, coverage)
}

/// Colour of a pixel of a physical material, and its specular part
/// ([`specula_core::physical::pixel_color`]).
#[derive(Clone, Copy, Debug)]
pub struct PhysicalColorOfPixel;

formula!(PhysicalColorOfPixel, |_, inputs| physical_color_of_pixel(..physical_fields()) -> (color: 3, specular: 3) {
    let (surface, light, coverage) = take_physical(inputs);
    let [_, specular] = reflected(&surface, &light);
    (physical::pixel_color(&surface, &light, coverage), specular * coverage)
});
