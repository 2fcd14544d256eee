//! Blended surfaces to pictures and back: light, pixel by pixel, sixteen at a time.

use crate::{
    context::Context,
    frame::{Frame, FrameGrad, QUADS, Quad, RGB, at, tile_len},
    lanes::Lanes,
    stages::{
        illuminate::{direct_of_quad, direct_of_tile},
        lookup::{
            LIGHT_PARTS, Lookup, look_up, look_up_irradiance, look_up_vjp, radiance, split_sum, split_sum_vjp,
            sum_parts,
        },
        prefilter::{Light, LightGrad, Texel},
        surface::{BlendedQuad, SurfaceQuad},
        trace::{LEN, reflection_of_quad},
    },
};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    camera::{Camera, CameraOf},
    lamps::{self, diffuse_albedo},
    near_field::Reflection,
    physical::{self, PixelFacing, PixelLight, pixel_facing, pixel_facing_vjp, reflected},
    rules::{Channels, LightLayer, RenderRules, channel},
    shade::ShadingForm,
    shade_pixels::{PixelSurface, pixel_color, pixel_color_vjp, pixel_surface, pixel_surface_vjp, unlit_pixel_color},
    vector::Vec3,
};

pub(crate) fn shade_pixels(
    context: &Context,
    mut surface: Frame,
    light: Option<&Light>,
    camera: &Camera,
    rules: &RenderRules,
) -> Frame {
    let (channels, cover) = (surface.channels, &surface.cover);
    let mut shaded = context.take::<Quad>(cover.tiles.len() * QUADS * RGB);
    let tiles = surface.blended.par_chunks_mut(tile_len(channels)).zip(shaded.par_chunks_mut(QUADS * RGB));
    let reflections = surface.reflections.as_deref();
    tiles.enumerate().for_each(|(slot, (tile, shaded))| {
        let direct = surface.direct.as_deref().map(|all| direct_of_tile(all, slot));
        let reflections = reflections.map(|all| of_tile(all, slot));
        let far = light.map(|light| Lighting { light, reflections, direct });
        dispatch!(context.level, simd => {
            let lifted = camera.lift(Lanes::splat(simd, 0.0));
            shade_tile(simd, cover.origin(slot), far, &lifted, rules, tile, shaded);
        });
    });
    surface.shaded = Some(shaded);
    surface
}

/// Light of the pixels of a tile.
#[derive(Clone, Copy)]
struct Lighting<'a> {
    light: &'a Light,
    /// Reflections of the tile, where rays were traced.
    reflections: Option<&'a [Quad]>,
    /// Light of lamps on the tile, where there are any.
    direct: Option<&'a [Quad]>,
}

impl Lighting<'_> {
    /// Reflection of a quad; `None` if no ray was traced.
    #[inline(always)]
    fn reflection<S: Simd>(&self, simd: S, quad: usize) -> Option<Reflection<Lanes<S>>> {
        self.reflections.map(|reflections| reflection_of_quad(simd, reflections, quad))
    }
}

/// Whether a ray of the quad hits a surface that reflects far light.
#[inline(always)]
fn has_second_lookup<S: Simd>(reflection: &Reflection<Lanes<S>>) -> bool {
    reflection.tint.sum().any_positive()
}

/// Reflections of a covered tile.
fn of_tile(reflections: &[Quad], slot: usize) -> &[Quad] {
    &reflections[slot * QUADS * LEN..(slot + 1) * QUADS * LEN]
}

pub(crate) fn shade_pixels_vjp(
    context: &Context,
    surface: &Frame,
    light: Option<&Light>,
    camera: &Camera,
    form: ShadingForm,
    mut grad: FrameGrad,
) -> (FrameGrad, Option<LightGrad>) {
    let tile_len = tile_len(surface.channels);
    let count = surface.cover.tiles.len();
    // Parts do not depend on the number of threads, so neither does the sum of their gradients.
    let part_len = count.div_ceil(LIGHT_PARTS).max(1);
    let texel_count = light.map_or(0, |light| light.texels.len());
    let mut texels = context.take::<Texel>(LIGHT_PARTS * texel_count.max(1));
    let parts = grad.values.par_chunks_mut(part_len * tile_len).zip(texels.par_chunks_mut(texel_count.max(1)));
    parts.enumerate().for_each(|(part, (grad, light_grad))| {
        light_grad.fill([0.0; 4]);
        for (slot, grad) in (part * part_len..).zip(grad.chunks_exact_mut(tile_len)) {
            let origin = surface.cover.origin(slot);
            let reflections = surface.reflections.as_deref().map(|all| of_tile(all, slot));
            let far = light.map(|light| Lighting { light, reflections, direct: None });
            dispatch!(context.level, simd => {
                let lifted = camera.lift(Lanes::splat(simd, 0.0));
                tile_vjp(simd, origin, surface.tile(slot), far, &lifted, form, grad, light_grad);
            });
        }
    });
    (grad, light.map(|_| sum_parts(texels, texel_count, count.div_ceil(part_len))))
}

#[inline(always)]
fn shade_tile<S: Simd>(
    simd: S,
    origin: [f32; 2],
    lighting: Option<Lighting<'_>>,
    camera: &CameraOf<Lanes<S>>,
    rules: &RenderRules,
    tile: &mut [Quad],
    shaded: &mut [Quad],
) {
    let channels = tile.len() / QUADS - 1;
    let Some(lighting) = lighting else { return unlit_tile(simd, channels, rules, tile, shaded) };
    for quad in 0..QUADS {
        let out = &mut shaded[quad * RGB..(quad + 1) * RGB];
        let Some(blended) = SurfaceQuad::new(simd, tile, quad, origin, camera) else {
            out.as_flattened_mut().fill(0.0);
            continue;
        };
        let surface = pixel_surface(&blended.pixel, blended.view_dir);
        let coverage = blended.pixel.coverage;
        let none = Vec3::zero(coverage);
        let own = radiance(simd, lighting.light, surface.reflection_dir, surface.roughness);
        let reflection = lighting.reflection(simd, quad);
        let near_light = match &reflection {
            Some(reflection) if has_second_lookup(reflection) => {
                radiance(simd, lighting.light, reflection.direction, reflection.roughness)
            }
            _ => none,
        };
        let light = reflection.as_ref().map_or(own, |reflection| reflection.light(own, near_light));
        let layers = BlendedQuad::new(simd, tile, quad);
        let (color, specular, irradiance) = if rules.shading.form == ShadingForm::Physical {
            let facing = pixel_facing(&blended.pixel, blended.view_dir);
            let light = PixelLight {
                specular: light,
                irradiance: look_up_irradiance(simd, lighting.light, facing.normal).radiance(),
                split_sum: split_sum(simd, facing.n_dot_v, surface.roughness),
            };
            let [_, specular] = reflected(&surface, &light);
            let sky_irradiance = light.irradiance * layers.load(channel::AMBIENT);
            let (color, irradiance) = match lighting.direct {
                Some(direct) => {
                    let direct = direct_of_quad(simd, direct, quad);
                    let metalness = layers.load(channel::METALNESS);
                    let albedo = diffuse_albedo(layers.load3(channel::DIFFUSE), metalness, coverage);
                    let color = lamps::pixel_color(&surface, &light, albedo, &direct, coverage);
                    (color, sky_irradiance + direct.irradiance * coverage)
                }
                None => (physical::pixel_color(&surface, &light, coverage), sky_irradiance),
            };
            (color, specular * coverage, irradiance)
        } else {
            (pixel_color(&surface, light, coverage), blended.pixel.tint.times(light), none)
        };
        store(color, out);
        if channels >= Channels::Layers.count() {
            let shown = match rules.light_layer {
                LightLayer::Reflected => light * coverage,
                LightLayer::Indirect => {
                    reflection.as_ref().map_or(none, |reflection| reflection.indirect(near_light)) * coverage
                }
                LightLayer::Visibility => {
                    Vec3::splat(reflection.as_ref().map_or(coverage, |reflection| reflection.far * coverage))
                }
                LightLayer::Irradiance => irradiance,
            };
            store(shown, &mut tile[at(channels, quad, channel::LIGHT)..]);
            store(specular, &mut tile[at(channels, quad, channel::SPECULAR)..]);
        }
    }
}

/// Shades a tile without light, which needs no directions. Physical materials are black.
#[inline(always)]
fn unlit_tile<S: Simd>(simd: S, channels: usize, rules: &RenderRules, tile: &mut [Quad], shaded: &mut [Quad]) {
    for quad in 0..QUADS {
        let pixel = BlendedQuad::new(simd, tile, quad);
        let (base, coverage) = (pixel.load3(channel::COLOR), -pixel.transmittance() + 1.0);
        let base = if rules.shading.form == ShadingForm::Physical { Vec3::zero(coverage) } else { base };
        store(unlit_pixel_color(base, coverage), &mut shaded[quad * RGB..(quad + 1) * RGB]);
        if channels >= Channels::Layers.count() {
            let none = Vec3::zero(coverage);
            let is_open = rules.light_layer == LightLayer::Visibility;
            store(if is_open { Vec3::splat(coverage) } else { none }, &mut tile[at(channels, quad, channel::LIGHT)..]);
            store(none, &mut tile[at(channels, quad, channel::SPECULAR)..]);
        }
    }
}

#[inline(always)]
fn store<S: Simd>(v: Vec3<Lanes<S>>, quads: &mut [Quad]) {
    v.x.store(&mut quads[0]);
    v.y.store(&mut quads[1]);
    v.z.store(&mut quads[2]);
}

/// Light that a quad reflects as a mirror, with what its gradient needs.
struct Reflected<'a, S: Simd> {
    light: &'a Light,
    own: Lookup<S>,
    /// Surface that the rays hit, if they were traced, and the far light that it reflects.
    reflection: Option<Reflection<Lanes<S>>>,
    near: Option<Lookup<S>>,
}

impl<'a, S: Simd> Reflected<'a, S> {
    #[inline(always)]
    fn new(simd: S, lighting: &Lighting<'a>, quad: usize, surface: &PixelSurface<Lanes<S>>) -> Self {
        let light = lighting.light;
        let reflection = lighting.reflection(simd, quad);
        let near = match &reflection {
            Some(reflection) if has_second_lookup(reflection) => {
                Some(look_up(simd, light, reflection.direction, reflection.roughness))
            }
            _ => None,
        };
        Self { light, own: look_up(simd, light, surface.reflection_dir, surface.roughness), reflection, near }
    }
    #[inline(always)]
    fn light(&self) -> Vec3<Lanes<S>> {
        let own = self.own.radiance();
        match (&self.reflection, &self.near) {
            (Some(reflection), Some(near)) => reflection.light(own, near.radiance()),
            (Some(reflection), None) => reflection.light(own, Vec3::zero(own.x)),
            (None, _) => own,
        }
    }
    /// Gradient with respect to the direction of the reflection and to roughness; adds to the
    /// light's. Hit points are detached; only the light gets a gradient.
    #[inline(always)]
    fn vjp(
        &self,
        simd: S,
        roughness: Lanes<S>,
        grad: Vec3<Lanes<S>>,
        light_grad: &mut [Texel],
    ) -> (Vec3<Lanes<S>>, Lanes<S>) {
        let [grad_own, grad_second] = match &self.reflection {
            Some(reflection) => reflection.light_vjp(grad),
            None => [grad; 2],
        };
        let grad_surface = look_up_vjp(simd, self.light, &self.own, roughness, grad_own, light_grad);
        if let (Some(reflection), Some(second)) = (&self.reflection, &self.near) {
            look_up_vjp(simd, self.light, second, reflection.roughness, grad_second, light_grad);
        }
        grad_surface
    }
}

/// Irradiance of a quad of physical materials, with what its gradient needs.
struct Ambient<'a, S: Simd> {
    light: &'a Light,
    facing: PixelFacing<Lanes<S>>,
    irradiance: Lookup<S>,
}

impl<'a, S: Simd> Ambient<'a, S> {
    #[inline(always)]
    fn new(simd: S, light: &'a Light, facing: PixelFacing<Lanes<S>>) -> Self {
        Self { light, irradiance: look_up_irradiance(simd, light, facing.normal), facing }
    }
    /// Gradient with respect to the facing; adds to that of the surface's roughness, and to the
    /// light's.
    #[inline(always)]
    fn vjp(
        &self,
        simd: S,
        surface: &PixelSurface<Lanes<S>>,
        grad: &PixelLight<Lanes<S>>,
        grad_surface: &mut PixelSurface<Lanes<S>>,
        light_grad: &mut [Texel],
    ) -> PixelFacing<Lanes<S>> {
        let (normal, _) =
            look_up_vjp(simd, self.light, &self.irradiance, surface.roughness, grad.irradiance, light_grad);
        let [n_dot_v, roughness] = split_sum_vjp(simd, self.facing.n_dot_v, surface.roughness, grad.split_sum);
        grad_surface.roughness = grad_surface.roughness + roughness;
        PixelFacing { normal, n_dot_v }
    }
}

/// Converts the gradient of a tile of the picture to that of the blended surface; adds to the
/// light's.
#[inline(always)]
fn tile_vjp<S: Simd>(
    simd: S,
    origin: [f32; 2],
    tile: &[Quad],
    lighting: Option<Lighting<'_>>,
    camera: &CameraOf<Lanes<S>>,
    form: ShadingForm,
    grad: &mut [Quad],
    light_grad: &mut [Texel],
) {
    let channels = Channels::of_count(tile.len() / QUADS - 1);
    for quad in 0..QUADS {
        let Some(SurfaceQuad { pixel, view_dir }) = SurfaceQuad::new(simd, tile, quad, origin, camera) else {
            continue;
        };
        let surface = pixel_surface(&pixel, view_dir);
        let reflected = match &lighting {
            Some(lighting) => Some(Reflected::new(simd, lighting, quad, &surface)),
            None => None,
        };
        let none = Vec3::zero(pixel.coverage);
        let light = match &reflected {
            Some(reflected) => reflected.light(),
            None => none,
        };

        let grad_picture = BlendedQuad::new(simd, grad, quad);
        // Physical materials without light are black, whatever their attributes.
        let is_black = form == ShadingForm::Physical && lighting.is_none();
        let grad_color = if is_black { none } else { grad_picture.load3(channel::COLOR) };
        let ambient = match &lighting {
            Some(lighting) if form == ShadingForm::Physical => {
                Some(Ambient::new(simd, lighting.light, pixel_facing(&pixel, view_dir)))
            }
            _ => None,
        };
        let (mut grad_surface, grad_light, grad_coverage, grad_pixel_light) = match &ambient {
            Some(ambient) => {
                let light = PixelLight {
                    specular: light,
                    irradiance: ambient.irradiance.radiance(),
                    split_sum: split_sum(simd, ambient.facing.n_dot_v, surface.roughness),
                };
                let (surface, light, coverage) =
                    physical::pixel_color_vjp(&surface, &light, pixel.coverage, grad_color);
                (surface, light.specular, coverage, Some(light))
            }
            None => {
                let (surface, light, coverage) = pixel_color_vjp(&surface, light, pixel.coverage, grad_color);
                (surface, light, coverage, None)
            }
        };
        if let Some(reflected) = &reflected {
            (grad_surface.reflection_dir, grad_surface.roughness) =
                reflected.vjp(simd, surface.roughness, grad_light, light_grad);
        }
        let mut grad_facing = none;
        if let (Some(ambient), Some(grad_pixel_light)) = (&ambient, &grad_pixel_light) {
            let facing = ambient.vjp(simd, &surface, grad_pixel_light, &mut grad_surface, light_grad);
            grad_facing = pixel_facing_vjp(&pixel, view_dir, &facing);
        }
        let grad_pixel = pixel_surface_vjp(&pixel, view_dir, &surface, &grad_surface);
        let normal = grad_picture.load3(channel::NORMAL) + grad_pixel.normal + grad_facing;
        let tint = grad_picture.load3(channel::TINT) + grad_pixel.tint;
        let roughness = grad_picture.load(channel::ROUGHNESS) + grad_pixel.roughness;
        let transmittance = grad_picture.transmittance() - (grad_pixel.coverage + grad_coverage);
        store(grad_pixel.base, &mut grad[at(channels.count(), quad, channel::COLOR)..]);
        for (first, vector) in [(channel::NORMAL, normal), (channel::TINT, tint)] {
            if let Some(index) = channels.index_of(first) {
                store(vector, &mut grad[at(channels.count(), quad, index)..]);
            }
        }
        if let Some(index) = channels.index_of(channel::ROUGHNESS) {
            roughness.store(&mut grad[at(channels.count(), quad, index)]);
        }
        transmittance.store(&mut grad[at(channels.count(), quad, channels.count())]);
    }
}
