//! Light added pixel by pixel to a blended surface.

use super::{
    light::{Light, LightGrad, look_up, look_up_vjp},
    picture::{Frame, vector_at},
};
use crate::number::Number;
use specula_core::{
    camera::Camera,
    near_field::{NearField, Reflection, ray_origin},
    rules::{Channels, channel},
    shade_pixels::{Pixel, PixelSurface, pixel_color, pixel_color_vjp, pixel_surface, pixel_surface_vjp},
    vector::Vec3,
};

/// One pixel under its light.
struct Lit<R> {
    pixel: Pixel<R>,
    view_dir: Vec3<R>,
    surface: PixelSurface<R>,
    /// Reflection of the pixel; none without a light.
    reflection: Option<Reflection<R>>,
    light: Vec3<R>,
}

impl<R: Number> Lit<R> {
    fn new(frame: &Frame<R>, index: usize, light: Option<&Light<R>>, camera: &Camera, traces: bool) -> Self {
        let size = frame.pixel_count();
        let pixel = Pixel {
            base: vector_at(frame, channel::COLOR, index),
            normal: vector_at(frame, channel::NORMAL, index),
            tint: vector_at(frame, channel::TINT, index),
            roughness: frame.values[channel::ROUGHNESS * size + index],
            coverage: -frame.values[(frame.channels - 1) * size + index] + 1.0,
        };
        let center = |index: usize| R::of(index as f64 + 0.5);
        let (x, y) = (center(index % frame.width), center(index / frame.width));
        let view_dir = camera.lift(R::of(0.0)).view_dir(x, y);
        let surface = pixel_surface(&pixel, view_dir);
        let reflection = light.map(|light| match light.near_field.as_deref().filter(|_| traces) {
            Some(near_field) => {
                let depth = frame.values[channel::DEPTH * size + index];
                let offset = R::of(f64::from(near_field.offset));
                let origin = ray_origin(&camera.lift(depth), &pixel, depth, view_dir, offset);
                reflected(near_field, origin, &surface)
            }
            None => Reflection::of_far(surface.reflection_dir, surface.roughness),
        });
        let looked_up = light.zip(reflection.as_ref());
        let radiance = looked_up.map_or(Vec3::zero(R::of(0.0)), |(light, reflection)| {
            let own = look_up(light, surface.reflection_dir, surface.roughness);
            reflection.light(own, look_up(light, reflection.direction, reflection.roughness))
        });
        Self { pixel, view_dir, surface, reflection, light: radiance }
    }
}

/// Reflection of a ray from a surface. What it meets is constant.
fn reflected<R: Number>(near_field: &NearField<Vec<f32>>, origin: Vec3<R>, surface: &PixelSurface<R>) -> Reflection<R> {
    let fixed = |x: R| R::of(x.value());
    let (direction, roughness) = (surface.reflection_dir.map(fixed), fixed(surface.roughness));
    match near_field.first_hit(origin.map(fixed), direction) {
        Some(hit) => Reflection::of_near(direction, roughness, &near_field.surface(&hit)),
        None => Reflection::of_far(surface.reflection_dir, surface.roughness),
    }
}

fn store<R: Number>(frame: &mut Frame<R>, plane: usize, index: usize, v: Vec3<R>) {
    let size = frame.pixel_count();
    for (k, number) in v.to_array().into_iter().enumerate() {
        frame.values[(plane + k) * size + index] = number;
    }
}

/// The picture of a blended surface under a light; `traces` says whether reflected rays are traced
/// against its near field.
pub fn shade_pixels<R: Number>(
    surface: &Frame<R>,
    light: Option<&Light<R>>,
    camera: &Camera,
    traces: bool,
) -> Frame<R> {
    let mut picture = surface.clone();
    for index in 0..surface.pixel_count() {
        let lit = Lit::new(surface, index, light, camera, traces);
        store(&mut picture, channel::COLOR, index, pixel_color(&lit.surface, lit.light, lit.pixel.coverage));
        if surface.channels > Channels::Layers.count() {
            store(&mut picture, channel::SPECULAR, index, lit.pixel.tint.times(lit.light));
            store(&mut picture, channel::LIGHT, index, lit.light * lit.pixel.coverage);
        }
    }
    picture
}

/// Gradient of [`shade_pixels`]: that of the picture becomes that of the surface; adds to the
/// light's.
pub fn shade_pixels_vjp<R: Number>(
    surface: &Frame<R>,
    light: Option<&Light<R>>,
    camera: &Camera,
    traces: bool,
    grad: &mut Frame<R>,
    mut light_grad: Option<&mut LightGrad<R>>,
) {
    let size = surface.pixel_count();
    for index in 0..size {
        let lit = Lit::new(surface, index, light, camera, traces);
        let grad_color = vector_at(grad, channel::COLOR, index);
        let (mut grad_surface, grad_light, grad_coverage) =
            pixel_color_vjp(&lit.surface, lit.light, lit.pixel.coverage, grad_color);
        if let (Some(light), Some(reflection), Some(light_grad)) = (light, &lit.reflection, light_grad.as_deref_mut()) {
            let [of_own, of_near] = reflection.light_vjp(grad_light);
            let (direction, roughness) =
                look_up_vjp(light, lit.surface.reflection_dir, lit.surface.roughness, of_own, light_grad);
            grad_surface.reflection_dir = direction;
            grad_surface.roughness = roughness;
            look_up_vjp(light, reflection.direction, reflection.roughness, of_near, light_grad);
        }
        let of_surface = pixel_surface_vjp(&lit.pixel, lit.view_dir, &lit.surface, &grad_surface);
        store(grad, channel::COLOR, index, of_surface.base);
        for (plane, vector) in [(channel::NORMAL, of_surface.normal), (channel::TINT, of_surface.tint)] {
            let sum = vector_at(grad, plane, index) + vector;
            store(grad, plane, index, sum);
        }
        let roughness = &mut grad.values[channel::ROUGHNESS * size + index];
        *roughness = *roughness + of_surface.roughness;
        let transmittance = &mut grad.values[(surface.channels - 1) * size + index];
        *transmittance = *transmittance - of_surface.coverage - grad_coverage;
    }
}
