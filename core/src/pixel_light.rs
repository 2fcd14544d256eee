//! Light of a pixel: which terms a blended surface reflects, and the gradients of all of them.
//!
//! The composition of the stage `shade_pixels` and of its gradient, over any memory. An executor
//! implements small traits: [`BlendedPixel`] reads the channels of a pixel, or of several side by
//! side, [`BlendedGrads`] takes their gradients, and [`LightLookups`] with [`LightLookupGrads`]
//! looks up the light that reaches them. A pixel takes, in this order,
//!
//! ```text
//! own light     along the reflected direction, at the roughness          every lit pixel
//! second light  of the surface that the reflected ray hits               traced pixels
//! irradiance    along the normal, and the split sum at n·v               physical materials
//! direct light  of lamps                                                 physical materials
//! ```
//!
//! and the gradients of the lookups follow in the same order. [`PixelShading::shaded`] gives the
//! colour of a pixel under a light, [`PixelShading::unlit`] without one, and
//! [`PixelShading::shaded_vjp`] the gradient of both.

use crate::{
    lamps::{self, DirectLight, diffuse_albedo},
    near_field::Reflection,
    physical::{self, PixelFacing, PixelLight, pixel_facing, pixel_facing_vjp, reflected},
    real::Real,
    rules::{Channels, LightLayer, RenderRules, channel},
    shade::ShadingForm,
    shade_pixels::{
        Pixel, PixelSurface, pixel_color, pixel_color_vjp, pixel_surface, pixel_surface_vjp, unlit_pixel_color,
    },
    vector::{Vec3, vec3},
};

/// Blended channels of a pixel, by the numbers of [`mod@channel`], or their gradients.
pub trait BlendedPixel<R: Real> {
    /// Number of a channel; zero for one that is not blended, because nothing reads it.
    fn channel(&self, channel: usize) -> R;
    /// Transmittance, behind all channels.
    fn transmittance(&self) -> R;

    /// Numbers of three neighbouring channels.
    #[inline(always)]
    fn vec3(&self, first: usize) -> Vec3<R> {
        vec3(self.channel(first), self.channel(first + 1), self.channel(first + 2))
    }
    /// Coverage, 1 − transmittance.
    #[inline(always)]
    fn coverage(&self) -> R {
        -self.transmittance() + 1.0
    }
    /// Surface attributes.
    #[inline(always)]
    fn pixel(&self) -> Pixel<R> {
        Pixel {
            base: self.vec3(channel::COLOR),
            normal: self.vec3(channel::NORMAL),
            tint: self.vec3(channel::TINT),
            roughness: self.channel(channel::ROUGHNESS),
            coverage: self.coverage(),
        }
    }
}

/// Gradients of a pixel's blended channels, which are read and replaced.
pub trait BlendedGrads<R: Real>: BlendedPixel<R> {
    /// Replaces the gradient of a channel; ignores one that is not blended.
    fn set(&mut self, channel: usize, grad: R);
    /// Replaces the gradient of the transmittance.
    fn set_transmittance(&mut self, grad: R);

    /// Replaces the gradients of three neighbouring channels.
    #[inline(always)]
    fn set3(&mut self, first: usize, grad: Vec3<R>) {
        self.set(first, grad.x);
        self.set(first + 1, grad.y);
        self.set(first + 2, grad.z);
    }
}

/// Light that reaches a pixel.
pub trait LightLookups<R: Real> {
    /// Light from a direction, with what its gradient needs.
    type Lookup;

    /// Looks up prefiltered radiance along a unit direction, at a perceptual roughness.
    fn look_up(&self, direction: Vec3<R>, roughness: R) -> Self::Lookup;
    /// Looks up irradiance / π along a unit normal.
    fn look_up_irradiance(&self, normal: Vec3<R>) -> Self::Lookup;
    /// Light of a lookup.
    fn radiance(&self, lookup: &Self::Lookup) -> Vec3<R>;
    /// (F_x, F_y) of the split-sum table.
    fn split_sum(&self, n_dot_v: R, roughness: R) -> [R; 2];
}

/// Gradients of [`LightLookups`]. Those of light add to the gradient of its texels.
pub trait LightLookupGrads<R: Real>: LightLookups<R> {
    /// Gradient of a lookup along a direction with respect to direction and roughness.
    fn look_up_vjp(&mut self, lookup: &Self::Lookup, direction: Vec3<R>, roughness: R, grad: Vec3<R>) -> (Vec3<R>, R);
    /// Gradient of a lookup of irradiance with respect to the normal.
    fn look_up_irradiance_vjp(&mut self, lookup: &Self::Lookup, normal: Vec3<R>, grad: Vec3<R>) -> Vec3<R>;
    /// Gradient of the split-sum table with respect to n·v and roughness.
    fn split_sum_vjp(&self, n_dot_v: R, roughness: R, grad: [R; 2]) -> [R; 2];
}

/// Results of the rays of a pixel.
#[derive(Clone, Copy, Debug)]
pub struct PixelRays<R> {
    /// Reflection of the ray that was traced, if one was.
    pub reflection: Option<Reflection<R>>,
    /// Whether its second light is looked up; false only where the share of that light is zero.
    pub has_second: bool,
    /// Light of lamps on a physical material, if there are any.
    pub direct: Option<DirectLight<R>>,
}

/// A pixel of a picture, premultiplied.
#[derive(Clone, Copy, Debug)]
pub struct ShadedPixel<R> {
    /// Colour, sRGB-encoded.
    pub color: Vec3<R>,
    /// Specular part of the colour, linear, without that of lamps ([`channel::SPECULAR`]). Zero
    /// unless all layers were requested.
    pub specular: Vec3<R>,
    /// Light that the rules choose ([`channel::LIGHT`]). Zero unless all layers were requested.
    pub light: Vec3<R>,
}

/// Shading of pixels: what is rendered, and what was blended for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PixelShading {
    /// Whether materials are physical; every other form is that of deferred shading.
    pub form: ShadingForm,
    /// Light in the layer of light.
    pub light_layer: LightLayer,
    /// Channels that were blended.
    pub channels: Channels,
}

/// Surface under the light that it reflects.
struct LitSurface<R: Real, L> {
    surface: PixelSurface<R>,
    own: L,
    /// Light of the surface that the reflected ray hits.
    second: Option<L>,
    /// Light along the reflected direction.
    radiance: Vec3<R>,
    /// The part of it that other surfaces reflect.
    indirect: Vec3<R>,
    /// Orientation of a physical material, its irradiance, and all of its light.
    physical: Option<(PixelFacing<R>, L, PixelLight<R>)>,
}

impl PixelShading {
    /// Shading by the rules, over blended channels.
    #[inline(always)]
    pub const fn new(rules: &RenderRules, channels: Channels) -> Self {
        Self { form: rules.shading.form, light_layer: rules.light_layer, channels }
    }
    #[inline(always)]
    fn is_physical(&self) -> bool {
        self.form == ShadingForm::Physical
    }
    #[inline(always)]
    fn has_layers(&self) -> bool {
        self.channels == Channels::Layers
    }

    /// A pixel without light: its own colour; physical materials are black.
    #[inline(always)]
    pub fn unlit<R: Real>(&self, blended: &impl BlendedPixel<R>) -> ShadedPixel<R> {
        let coverage = blended.coverage();
        let none = Vec3::zero(coverage);
        let base = if self.is_physical() { none } else { blended.vec3(channel::COLOR) };
        let shows_coverage = self.has_layers() && self.light_layer == LightLayer::Visibility;
        let light = if shows_coverage { Vec3::splat(coverage) } else { none };
        ShadedPixel { color: unlit_pixel_color(base, coverage), specular: none, light }
    }

    /// A pixel that is seen along −`view_dir`, under its light.
    #[inline(always)]
    pub fn shaded<R: Real>(
        &self,
        blended: &impl BlendedPixel<R>,
        view_dir: Vec3<R>,
        rays: &PixelRays<R>,
        light: &impl LightLookups<R>,
    ) -> ShadedPixel<R> {
        let pixel = blended.pixel();
        let coverage = pixel.coverage;
        let lit = self.lit(&pixel, view_dir, rays, light);
        let color = match (&lit.physical, &rays.direct) {
            (None, _) => pixel_color(&lit.surface, lit.radiance, coverage),
            (Some((.., light)), None) => physical::pixel_color(&lit.surface, light, coverage),
            (Some((.., light)), Some(direct)) => {
                let metalness = blended.channel(channel::METALNESS);
                let albedo = diffuse_albedo(blended.vec3(channel::DIFFUSE), metalness, coverage);
                lamps::pixel_color(&lit.surface, light, albedo, direct, coverage)
            }
        };
        let [specular, light] =
            if self.has_layers() { self.layers(blended, &pixel, rays, &lit) } else { [Vec3::zero(coverage); 2] };
        ShadedPixel { color, specular, light }
    }

    /// Specular colour and light of a pixel.
    #[inline(always)]
    fn layers<R: Real, L>(
        &self,
        blended: &impl BlendedPixel<R>,
        pixel: &Pixel<R>,
        rays: &PixelRays<R>,
        lit: &LitSurface<R, L>,
    ) -> [Vec3<R>; 2] {
        let coverage = pixel.coverage;
        let (specular, irradiance) = match &lit.physical {
            Some((.., light)) => {
                let [_, specular] = reflected(&lit.surface, light);
                let sky_irradiance = light.irradiance * blended.channel(channel::AMBIENT);
                let irradiance = match &rays.direct {
                    Some(direct) => sky_irradiance + direct.irradiance * coverage,
                    None => sky_irradiance,
                };
                (specular * coverage, irradiance)
            }
            None => (pixel.tint.times(lit.radiance), Vec3::zero(coverage)),
        };
        let light = match (self.light_layer, &rays.reflection) {
            (LightLayer::Reflected, _) => lit.radiance * coverage,
            (LightLayer::Indirect, _) => lit.indirect * coverage,
            (LightLayer::Visibility, Some(reflection)) => Vec3::splat(reflection.far * coverage),
            (LightLayer::Visibility, None) => Vec3::splat(coverage),
            (LightLayer::Irradiance, _) => irradiance,
        };
        [specular, light]
    }

    /// Surface of a pixel, and all light that it looks up.
    #[inline(always)]
    fn lit<R: Real, L: LightLookups<R>>(
        &self,
        pixel: &Pixel<R>,
        view_dir: Vec3<R>,
        rays: &PixelRays<R>,
        light: &L,
    ) -> LitSurface<R, L::Lookup> {
        let surface = pixel_surface(pixel, view_dir);
        let own = light.look_up(surface.reflection_dir, surface.roughness);
        let second = match &rays.reflection {
            Some(reflection) if rays.has_second => Some(light.look_up(reflection.direction, reflection.roughness)),
            _ => None,
        };
        let none = Vec3::zero(pixel.coverage);
        let second_radiance = match &second {
            Some(second) => light.radiance(second),
            None => none,
        };
        let (radiance, indirect) = match &rays.reflection {
            Some(reflection) => {
                (reflection.light(light.radiance(&own), second_radiance), reflection.indirect(second_radiance))
            }
            None => (light.radiance(&own), none),
        };
        let physical = if self.is_physical() {
            let facing = pixel_facing(pixel, view_dir);
            let found = light.look_up_irradiance(facing.normal);
            let split_sum = light.split_sum(facing.n_dot_v, surface.roughness);
            let light = PixelLight { specular: radiance, irradiance: light.radiance(&found), split_sum };
            Some((facing, found, light))
        } else {
            None
        };
        LitSurface { surface, own, second, radiance, indirect, physical }
    }

    /// Gradient of [`PixelShading::shaded`], or of [`PixelShading::unlit`] without a light, through
    /// the colour. `grads` holds the gradient of the colour, which that of the base replaces, and
    /// those of the other channels, which this one adds to. Lamps have no gradient. Hit points are
    /// detached: only the light gets a gradient from the second lookup.
    #[inline(always)]
    pub fn shaded_vjp<R: Real>(
        &self,
        blended: &impl BlendedPixel<R>,
        view_dir: Vec3<R>,
        light: Option<(&PixelRays<R>, &mut impl LightLookupGrads<R>)>,
        grads: &mut impl BlendedGrads<R>,
    ) {
        let pixel = blended.pixel();
        let none = Vec3::zero(pixel.coverage);
        let color = grads.vec3(channel::COLOR);
        let (surface, grad_surface, grad_facing, grad_coverage) = match light {
            Some((rays, light)) => {
                let lit = self.lit(&pixel, view_dir, rays, light);
                let (grad_surface, grad_facing, grad_coverage) = lit.vjp(&pixel, view_dir, rays, light, color);
                (lit.surface, grad_surface, grad_facing, grad_coverage)
            }
            None => {
                let surface = pixel_surface(&pixel, view_dir);
                let color = if self.is_physical() { none } else { color };
                let (grad_surface, _, grad_coverage) = pixel_color_vjp(&surface, none, pixel.coverage, color);
                (surface, grad_surface, none, grad_coverage)
            }
        };
        let grad = pixel_surface_vjp(&pixel, view_dir, &surface, &grad_surface);
        grads.set3(channel::COLOR, grad.base);
        grads.set3(channel::NORMAL, grads.vec3(channel::NORMAL) + grad.normal + grad_facing);
        grads.set3(channel::TINT, grads.vec3(channel::TINT) + grad.tint);
        grads.set(channel::ROUGHNESS, grads.channel(channel::ROUGHNESS) + grad.roughness);
        grads.set_transmittance(grads.transmittance() - (grad.coverage + grad_coverage));
    }
}

impl<R: Real, K> LitSurface<R, K> {
    /// Gradient of the colour with respect to the surface, to the blended normal past the reflected
    /// direction, and to the coverage; adds to that of the light.
    #[inline(always)]
    fn vjp(
        &self,
        pixel: &Pixel<R>,
        view_dir: Vec3<R>,
        rays: &PixelRays<R>,
        light: &mut impl LightLookupGrads<R, Lookup = K>,
        grad: Vec3<R>,
    ) -> (PixelSurface<R>, Vec3<R>, R) {
        let (surface, coverage) = (&self.surface, pixel.coverage);
        let (mut grad_surface, grad_light, grad_coverage) = match &self.physical {
            Some((.., light)) => physical::pixel_color_vjp(surface, light, coverage, grad),
            None => {
                let (grad_surface, specular, grad_coverage) = pixel_color_vjp(surface, self.radiance, coverage, grad);
                let (irradiance, split_sum) = (Vec3::zero(coverage), [coverage.zero(); 2]);
                (grad_surface, PixelLight { specular, irradiance, split_sum }, grad_coverage)
            }
        };
        let [grad_own, grad_second] = match &rays.reflection {
            Some(reflection) => reflection.light_vjp(grad_light.specular),
            None => [grad_light.specular; 2],
        };
        (grad_surface.reflection_dir, grad_surface.roughness) =
            light.look_up_vjp(&self.own, surface.reflection_dir, surface.roughness, grad_own);
        if let (Some(reflection), Some(second)) = (&rays.reflection, &self.second) {
            light.look_up_vjp(second, reflection.direction, reflection.roughness, grad_second);
        }
        let mut grad_normal = Vec3::zero(coverage);
        if let Some((facing, found, _)) = &self.physical {
            let normal = light.look_up_irradiance_vjp(found, facing.normal, grad_light.irradiance);
            let [n_dot_v, roughness] = light.split_sum_vjp(facing.n_dot_v, surface.roughness, grad_light.split_sum);
            grad_surface.roughness = grad_surface.roughness + roughness;
            grad_normal = pixel_facing_vjp(pixel, view_dir, &PixelFacing { normal, n_dot_v });
        }
        (grad_surface, grad_normal, grad_coverage)
    }
}
