//! Light added pixel by pixel to a blended surface.

use super::{
    illuminate::illuminate,
    light::{Light, LightGrad},
    picture::Frame,
    split_sum::{split_sum, split_sum_vjp},
};
use crate::number::Number;
use core::borrow::{Borrow, BorrowMut};
use specula_core::{
    camera::Camera,
    light_frame::Turned,
    light_view::{LightLookup, LightView, TexelMap},
    near_field::{Reflection, ray_origin},
    pixel_light::{BlendedGrads, BlendedPixel, LightLookupGrads, LightLookups, PixelRays, PixelShading},
    rules::{Channels, RenderRules, channel},
    shade::ShadingForm,
    shade_pixels::pixel_surface,
    vector::Vec3,
};

/// Pixel of a frame, or of its gradient.
struct FramePixel<F> {
    frame: F,
    index: usize,
}

impl<R: Number, F: Borrow<Frame<R>>> BlendedPixel<R> for FramePixel<F> {
    fn channel(&self, channel: usize) -> R {
        let frame = self.frame.borrow();
        if channel < frame.channels - 1 { frame.values[channel * frame.pixel_count() + self.index] } else { R::of(0.0) }
    }
    fn transmittance(&self) -> R {
        let frame = self.frame.borrow();
        frame.values[(frame.channels - 1) * frame.pixel_count() + self.index]
    }
}

impl<R: Number, F: BorrowMut<Frame<R>>> BlendedGrads<R> for FramePixel<F> {
    fn set(&mut self, channel: usize, grad: R) {
        let frame = self.frame.borrow_mut();
        let size = frame.pixel_count();
        if channel < frame.channels - 1 {
            frame.values[channel * size + self.index] = grad;
        }
    }
    fn set_transmittance(&mut self, grad: R) {
        let frame = self.frame.borrow_mut();
        let plane = (frame.channels - 1) * frame.pixel_count();
        frame.values[plane + self.index] = grad;
    }
}

/// Traces the reflected ray of a pixel that is seen along −`view_dir`, and rays to the lamps.
fn traced<R: Number>(
    blended: &FramePixel<&Frame<R>>,
    view_dir: Vec3<R>,
    light: &Light<R>,
    camera: &Camera,
    rules: &RenderRules,
) -> PixelRays<R> {
    let (pixel, depth) = (blended.pixel(), blended.channel(channel::DEPTH));
    let reflection = light.near_field.as_deref().filter(|_| rules.traces_near).map(|near_field| {
        let surface = pixel_surface(&pixel, view_dir);
        let offset = R::of(f64::from(near_field.offset));
        let origin = ray_origin(&camera.lift(depth), &pixel, depth, view_dir, offset);
        // The hit point is detached.
        let fixed = |x: R| R::of(x.value());
        let (direction, roughness) = (surface.reflection_dir.map(fixed), fixed(surface.roughness));
        match near_field.first_hit(origin.map(fixed), direction) {
            Some(hit) => Reflection::of_near(direction, roughness, &near_field.surface(&hit)),
            None => Reflection::of_far(surface.reflection_dir, surface.roughness),
        }
    });
    let is_physical = rules.shading.form == ShadingForm::Physical;
    let direct = light.lamps.as_deref().filter(|_| rules.illuminates && is_physical).map(|lamps| {
        let width = blended.frame.width;
        let place = [blended.index % width, blended.index / width];
        illuminate(lamps, &camera.lift(depth), &pixel, depth, view_dir, place)
    });
    PixelRays { reflection, has_second: true, direct }
}

/// Lookups of a light. `G` is where the gradient of its texels is added.
struct Lookups<'a, R, G> {
    light: LightView<'a, R>,
    grad: G,
}

impl<R: Number, G> LightLookups<R> for Lookups<'_, R, G> {
    type Lookup = LightLookup<R, TexelMap>;

    fn look_up(&self, direction: Vec3<R>, roughness: R) -> Self::Lookup {
        self.light.look_up(direction, roughness)
    }
    fn look_up_irradiance(&self, normal: Vec3<R>) -> Self::Lookup {
        self.light.look_up_irradiance(normal)
    }
    fn radiance(&self, lookup: &Self::Lookup) -> Vec3<R> {
        lookup.radiance()
    }
    fn split_sum(&self, n_dot_v: R, roughness: R) -> [R; 2] {
        split_sum(n_dot_v, roughness)
    }
}

impl<R: Number> LightLookupGrads<R> for Lookups<'_, R, &mut LightGrad<R>> {
    fn look_up_vjp(&mut self, lookup: &Self::Lookup, _: Vec3<R>, roughness: R, grad: Vec3<R>) -> (Vec3<R>, R) {
        self.light.look_up_vjp(lookup, roughness, grad, &mut self.grad.texels)
    }
    fn look_up_irradiance_vjp(&mut self, lookup: &Self::Lookup, normal: Vec3<R>, grad: Vec3<R>) -> Vec3<R> {
        self.look_up_vjp(lookup, normal, normal.x, grad).0
    }
    fn split_sum_vjp(&self, n_dot_v: R, roughness: R, grad: [R; 2]) -> [R; 2] {
        split_sum_vjp(n_dot_v, roughness, grad)
    }
}

/// Lookups in the frame of a picture's light.
fn turned<'a, R: Number, G>(camera: &Camera, light: &'a Light<R>, grad: G) -> Turned<R, Lookups<'a, R, G>> {
    Turned { lookups: Lookups { light: light.view(), grad }, frame: camera.lift(R::of(0.0)).light }
}

/// Direction from a pixel to the eye.
fn view_dir<R: Number>(camera: &Camera, width: usize, index: usize) -> Vec3<R> {
    let center = |index: usize| R::of(index as f64 + 0.5);
    camera.lift(R::of(0.0)).view_dir(center(index % width), center(index / width))
}

/// The picture of a blended surface under a light, by the form and the tracing of the rules.
pub fn shade_pixels<R: Number>(
    surface: &Frame<R>,
    light: Option<&Light<R>>,
    camera: &Camera,
    rules: &RenderRules,
) -> Frame<R> {
    let mut picture = surface.clone();
    let shading = PixelShading::new(rules, Channels::of_count(surface.channels - 1));
    for index in 0..surface.pixel_count() {
        let blended = FramePixel { frame: surface, index };
        let shaded = match light {
            Some(light) => {
                let view_dir = view_dir(camera, surface.width, index);
                let rays = traced(&blended, view_dir, light, camera, rules);
                shading.shaded(&blended, view_dir, &rays, &turned(camera, light, ()))
            }
            None => shading.unlit(&blended),
        };
        let mut out = FramePixel { frame: &mut picture, index };
        out.set3(channel::COLOR, shaded.color);
        out.set3(channel::SPECULAR, shaded.specular);
        out.set3(channel::LIGHT, shaded.light);
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
    let shading = PixelShading::new(rules, Channels::of_count(surface.channels - 1));
    for index in 0..surface.pixel_count() {
        let blended = FramePixel { frame: surface, index };
        let view_dir = view_dir(camera, surface.width, index);
        let mut lights = light
            .zip(light_grad.as_deref_mut())
            .map(|(light, grad)| (traced(&blended, view_dir, light, camera, rules), turned(camera, light, grad)));
        let mut grads = FramePixel { frame: &mut *grad, index };
        shading.shaded_vjp(&blended, view_dir, lights.as_mut().map(|(rays, light)| (&*rays, light)), &mut grads);
    }
}
