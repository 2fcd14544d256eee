//! Deferred shading of a pixel.

use crate::{
    codegen::formula::{call, formula},
    stages::camera::{camera_fields, take_camera},
};
use specula_core::{
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
