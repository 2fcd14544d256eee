//! Light added pixel by pixel to a blended surface.

use super::{
    illuminate::illuminate,
    light::{Light, LightGrad, look_up, look_up_vjp},
    picture::{Frame, vector_at},
    split_sum::{split_sum, split_sum_vjp},
};
use crate::number::Number;
use specula_core::{
    camera::Camera,
    lamps::{self, DirectLight, diffuse_albedo},
    near_field::{NearField, Reflection, ray_origin},
    physical::{self, PixelFacing, PixelLight, pixel_facing, pixel_facing_vjp},
    rules::{Channels, LightLayer, RenderRules, channel},
    shade::ShadingForm,
    shade_pixels::{Pixel, PixelSurface, pixel_color, pixel_color_vjp, pixel_surface, pixel_surface_vjp},
    vector::Vec3,
};

/// One pixel under its light.
struct Lit<R> {
    pixel: Pixel<R>,
    view_dir: Vec3<R>,
    surface: PixelSurface<R>,
    /// Reflection of the pixel; `None` without a light.
    reflection: Option<Reflection<R>>,
    light: Vec3<R>,
    /// Part of the light that other surfaces reflect.
    indirect: Vec3<R>,
    /// Orientation of a physical material, and all light that reaches it; `None` without a light.
    physical: Option<(PixelFacing<R>, PixelLight<R>)>,
    /// Diffuse albedo and light of lamps, if there are any.
    direct: Option<(Vec3<R>, DirectLight<R>)>,
    is_physical: bool,
}

impl<R: Number> Lit<R> {
    fn new(frame: &Frame<R>, index: usize, light: Option<&Light<R>>, camera: &Camera, rules: &RenderRules) -> Self {
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
        let reflection = light.map(|light| match light.near_field.as_deref().filter(|_| rules.traces_near) {
            Some(near_field) => {
                let depth = frame.values[channel::DEPTH * size + index];
                let offset = R::of(f64::from(near_field.offset));
                let origin = ray_origin(&camera.lift(depth), &pixel, depth, view_dir, offset);
                reflected(near_field, origin, &surface)
            }
            None => Reflection::of_far(surface.reflection_dir, surface.roughness),
        });
        let looked_up = light.zip(reflection.as_ref());
        let [radiance, indirect] = looked_up.map_or([Vec3::zero(R::of(0.0)); 2], |(light, reflection)| {
            let own = look_up(light, surface.reflection_dir, surface.roughness);
            let near_light = look_up(light, reflection.direction, reflection.roughness);
            [reflection.light(own, near_light), reflection.indirect(near_light)]
        });
        let is_physical = rules.shading.form == ShadingForm::Physical;
        let physical = light.filter(|_| is_physical).map(|light| {
            let facing = pixel_facing(&pixel, view_dir);
            let irradiance = look_up(light, facing.normal, R::of(1.0));
            let split_sum = split_sum(facing.n_dot_v, surface.roughness);
            (facing, PixelLight { specular: radiance, irradiance, split_sum })
        });
        let lamps = light.and_then(|light| light.lamps.as_deref()).filter(|_| rules.illuminates && is_physical);
        let direct = lamps.map(|lamps| {
            let depth = frame.values[channel::DEPTH * size + index];
            let metalness = frame.values[channel::METALNESS * size + index];
            let albedo = diffuse_albedo(vector_at(frame, channel::DIFFUSE, index), metalness, pixel.coverage);
            let place = [index % frame.width, index / frame.width];
            (albedo, illuminate(lamps, &camera.lift(depth), &pixel, depth, view_dir, place))
        });
        Self { pixel, view_dir, surface, reflection, light: radiance, indirect, physical, direct, is_physical }
    }

    /// Colour and its specular part, premultiplied; a physical material without light is black.
    fn colors(&self) -> [Vec3<R>; 2] {
        let coverage = self.pixel.coverage;
        match &self.physical {
            Some((_, light)) => {
                let [_, specular] = physical::reflected(&self.surface, light);
                let color = match &self.direct {
                    Some((albedo, direct)) => lamps::pixel_color(&self.surface, light, *albedo, direct, coverage),
                    None => physical::pixel_color(&self.surface, light, coverage),
                };
                [color, specular * coverage]
            }
            None if self.is_physical => [Vec3::zero(coverage); 2],
            None => [pixel_color(&self.surface, self.light, coverage), self.pixel.tint.times(self.light)],
        }
    }

    /// The layer of light, premultiplied; `ambient` is the blended mean of the ambient transfer.
    fn light_layer(&self, layer: LightLayer, ambient: R) -> Vec3<R> {
        let coverage = self.pixel.coverage;
        let none = Vec3::zero(coverage);
        match layer {
            LightLayer::Reflected => self.light * coverage,
            LightLayer::Indirect => self.indirect * coverage,
            LightLayer::Visibility => {
                let far = self.reflection.as_ref().map_or(R::of(1.0), |reflection| reflection.far);
                Vec3::splat(far * coverage)
            }
            LightLayer::Irradiance => {
                let sky_irradiance = self.physical.as_ref().map_or(none, |(_, light)| light.irradiance * ambient);
                let lamp_irradiance = self.direct.as_ref().map_or(none, |(_, direct)| direct.irradiance * coverage);
                sky_irradiance + lamp_irradiance
            }
        }
    }

    /// Gradient of the colour: of the surface, of the light along the reflection, of the coverage,
    /// and of all light that reaches a physical material.
    fn colors_vjp(&self, grad: Vec3<R>) -> (PixelSurface<R>, Vec3<R>, R, Option<PixelLight<R>>) {
        let coverage = self.pixel.coverage;
        let none = Vec3::zero(coverage);
        match &self.physical {
            Some((_, light)) => {
                let (surface, light, coverage) = physical::pixel_color_vjp(&self.surface, light, coverage, grad);
                (surface, light.specular, coverage, Some(light))
            }
            None => {
                let grad = if self.is_physical { none } else { grad };
                let (surface, light, coverage) = pixel_color_vjp(&self.surface, self.light, coverage, grad);
                (surface, light, coverage, None)
            }
        }
    }
}

/// Reflection of a ray from a surface. The hit point is detached.
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

/// The picture of a blended surface under a light, by the form and the tracing of the rules.
pub fn shade_pixels<R: Number>(
    surface: &Frame<R>,
    light: Option<&Light<R>>,
    camera: &Camera,
    rules: &RenderRules,
) -> Frame<R> {
    let mut picture = surface.clone();
    for index in 0..surface.pixel_count() {
        let lit = Lit::new(surface, index, light, camera, rules);
        let [color, specular] = lit.colors();
        store(&mut picture, channel::COLOR, index, color);
        if surface.channels > Channels::Layers.count() {
            store(&mut picture, channel::SPECULAR, index, specular);
            let ambient = surface.values[channel::AMBIENT * surface.pixel_count() + index];
            store(&mut picture, channel::LIGHT, index, lit.light_layer(rules.light_layer, ambient));
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
    rules: &RenderRules,
    grad: &mut Frame<R>,
    mut light_grad: Option<&mut LightGrad<R>>,
) {
    let size = surface.pixel_count();
    for index in 0..size {
        let lit = Lit::new(surface, index, light, camera, rules);
        let (mut grad_surface, grad_light, grad_coverage, grad_physical) =
            lit.colors_vjp(vector_at(grad, channel::COLOR, index));
        let mut grad_facing = Vec3::zero(R::of(0.0));
        if let (Some(light), Some(reflection), Some(light_grad)) = (light, &lit.reflection, light_grad.as_deref_mut()) {
            let [grad_own, grad_near] = reflection.light_vjp(grad_light);
            let (direction, roughness) =
                look_up_vjp(light, lit.surface.reflection_dir, lit.surface.roughness, grad_own, light_grad);
            grad_surface.reflection_dir = direction;
            grad_surface.roughness = roughness;
            look_up_vjp(light, reflection.direction, reflection.roughness, grad_near, light_grad);
            if let (Some((facing, _)), Some(grad_physical)) = (&lit.physical, grad_physical) {
                let (normal, _) = look_up_vjp(light, facing.normal, R::of(1.0), grad_physical.irradiance, light_grad);
                let [n_dot_v, grad_roughness] =
                    split_sum_vjp(facing.n_dot_v, lit.surface.roughness, grad_physical.split_sum);
                grad_surface.roughness = grad_surface.roughness + grad_roughness;
                grad_facing = pixel_facing_vjp(&lit.pixel, lit.view_dir, &PixelFacing { normal, n_dot_v });
            }
        }
        let grad_pixel = pixel_surface_vjp(&lit.pixel, lit.view_dir, &lit.surface, &grad_surface);
        store(grad, channel::COLOR, index, grad_pixel.base);
        for (plane, vector) in [(channel::NORMAL, grad_pixel.normal + grad_facing), (channel::TINT, grad_pixel.tint)] {
            let sum = vector_at(grad, plane, index) + vector;
            store(grad, plane, index, sum);
        }
        let roughness = &mut grad.values[channel::ROUGHNESS * size + index];
        *roughness = *roughness + grad_pixel.roughness;
        let transmittance = &mut grad.values[(surface.channels - 1) * size + index];
        *transmittance = *transmittance - grad_pixel.coverage - grad_coverage;
    }
}
