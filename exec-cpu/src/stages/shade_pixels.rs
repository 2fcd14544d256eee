//! Blended surfaces to pictures and back: light, pixel by pixel, sixteen at a time.

use crate::{
    context::Context,
    frame::{Frame, FrameGrad, QUADS, Quad, RGB, at, of_tile, tile_len},
    lanes::Lanes,
    stages::{
        illuminate::{DIRECT_LEN, direct_of_quad},
        lookup::{
            LIGHT_PARTS, Lookup, look_up, look_up_irradiance, look_up_vjp, radiance, split_sum, split_sum_vjp,
            sum_parts,
        },
        prefilter::{Light, LightGrad, Texel},
        surface::{BlendedQuad, SurfaceQuad},
        trace::{REFLECTION_LEN, reflection_of_quad},
    },
};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    camera::{Camera, CameraOf},
    light_frame::Turned,
    pixel_light::{LightLookupGrads, LightLookups, PixelRays, PixelShading, ShadedPixel},
    rules::{Channels, RenderRules, channel},
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
    let shading = PixelShading::new(rules, Channels::of_count(channels));
    let mut shaded = context.take::<Quad>(cover.tiles.len() * QUADS * RGB);
    let tiles = surface.blended.par_chunks_mut(tile_len(channels)).zip(shaded.par_chunks_mut(QUADS * RGB));
    let reflections = surface.reflections.as_deref();
    tiles.enumerate().for_each(|(slot, (tile, shaded))| {
        if context.skips() {
            return;
        }
        let direct = surface.direct.as_deref().map(|all| of_tile(all, slot, DIRECT_LEN));
        let reflections = reflections.map(|all| of_tile(all, slot, REFLECTION_LEN));
        let far = light.map(|light| Lighting { light, reflections, direct });
        dispatch!(context.level, simd => {
            let lifted = camera.lift(Lanes::splat(simd, 0.0));
            shade_tile(simd, cover.origin(slot), far, &lifted, &shading, tile, shaded);
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
    /// Rays of a quad.
    #[inline(always)]
    fn rays<S: Simd>(&self, simd: S, quad: usize) -> PixelRays<Lanes<S>> {
        let mut rays = PixelRays { reflection: None, has_second: false, direct: None };
        if let Some(reflections) = self.reflections {
            let reflection = reflection_of_quad(simd, reflections, quad);
            rays.has_second = reflection.tint.sum().any_positive();
            rays.reflection = Some(reflection);
        }
        if let Some(direct) = self.direct {
            rays.direct = Some(direct_of_quad(simd, direct, quad));
        }
        rays
    }
}

/// Lookups of quads, without the inputs of gradients.
struct QuadLight<'a, S: Simd> {
    simd: S,
    light: &'a Light,
}

impl<S: Simd> LightLookups<Lanes<S>> for QuadLight<'_, S> {
    type Lookup = Vec3<Lanes<S>>;

    #[inline(always)]
    fn look_up(&self, direction: Vec3<Lanes<S>>, roughness: Lanes<S>) -> Vec3<Lanes<S>> {
        radiance(self.simd, self.light, direction, roughness)
    }
    #[inline(always)]
    fn look_up_irradiance(&self, normal: Vec3<Lanes<S>>) -> Vec3<Lanes<S>> {
        look_up_irradiance(self.simd, self.light, normal).radiance()
    }
    #[inline(always)]
    fn radiance(&self, lookup: &Vec3<Lanes<S>>) -> Vec3<Lanes<S>> {
        *lookup
    }
    #[inline(always)]
    fn split_sum(&self, n_dot_v: Lanes<S>, roughness: Lanes<S>) -> [Lanes<S>; 2] {
        split_sum(self.simd, n_dot_v, roughness)
    }
}

/// Lookups of quads, and the gradient of the light's texels.
struct QuadLightGrad<'a, S: Simd> {
    simd: S,
    light: &'a Light,
    grad: &'a mut [Texel],
}

impl<S: Simd> LightLookups<Lanes<S>> for QuadLightGrad<'_, S> {
    type Lookup = Lookup<S>;

    #[inline(always)]
    fn look_up(&self, direction: Vec3<Lanes<S>>, roughness: Lanes<S>) -> Lookup<S> {
        look_up(self.simd, self.light, direction, roughness)
    }
    #[inline(always)]
    fn look_up_irradiance(&self, normal: Vec3<Lanes<S>>) -> Lookup<S> {
        look_up_irradiance(self.simd, self.light, normal)
    }
    #[inline(always)]
    fn radiance(&self, lookup: &Lookup<S>) -> Vec3<Lanes<S>> {
        lookup.radiance()
    }
    #[inline(always)]
    fn split_sum(&self, n_dot_v: Lanes<S>, roughness: Lanes<S>) -> [Lanes<S>; 2] {
        split_sum(self.simd, n_dot_v, roughness)
    }
}

impl<S: Simd> LightLookupGrads<Lanes<S>> for QuadLightGrad<'_, S> {
    #[inline(always)]
    fn look_up_vjp(
        &mut self,
        lookup: &Lookup<S>,
        _: Vec3<Lanes<S>>,
        roughness: Lanes<S>,
        grad: Vec3<Lanes<S>>,
    ) -> (Vec3<Lanes<S>>, Lanes<S>) {
        look_up_vjp(self.simd, self.light, lookup, roughness, grad, self.grad)
    }
    #[inline(always)]
    fn look_up_irradiance_vjp(
        &mut self,
        lookup: &Lookup<S>,
        normal: Vec3<Lanes<S>>,
        grad: Vec3<Lanes<S>>,
    ) -> Vec3<Lanes<S>> {
        self.look_up_vjp(lookup, normal, normal.x, grad).0
    }
    #[inline(always)]
    fn split_sum_vjp(&self, n_dot_v: Lanes<S>, roughness: Lanes<S>, grad: [Lanes<S>; 2]) -> [Lanes<S>; 2] {
        split_sum_vjp(self.simd, n_dot_v, roughness, grad)
    }
}

pub(crate) fn shade_pixels_vjp(
    context: &Context,
    surface: &Frame,
    light: Option<&Light>,
    camera: &Camera,
    rules: &RenderRules,
    mut grad: FrameGrad,
) -> (FrameGrad, Option<LightGrad>) {
    let tile_len = tile_len(surface.channels);
    let shading = PixelShading::new(rules, Channels::of_count(surface.channels));
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
            let reflections = surface.reflections.as_deref().map(|all| of_tile(all, slot, REFLECTION_LEN));
            let far = light.map(|light| Lighting { light, reflections, direct: None });
            dispatch!(context.level, simd => {
                let lifted = camera.lift(Lanes::splat(simd, 0.0));
                tile_vjp(simd, origin, surface.tile(slot), far, &lifted, &shading, grad, light_grad);
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
    shading: &PixelShading,
    tile: &mut [Quad],
    shaded: &mut [Quad],
) {
    let Some(lighting) = lighting else {
        // Pixels without light need no directions.
        for quad in 0..QUADS {
            let pixel = shading.unlit(&BlendedQuad::new(simd, &*tile, quad));
            store_pixel(&pixel, shading, quad, tile, shaded);
        }
        return;
    };
    let light = Turned { lookups: QuadLight { simd, light: lighting.light }, frame: camera.light };
    for quad in 0..QUADS {
        let Some(SurfaceQuad { blended, view_dir }) = SurfaceQuad::new(simd, tile, quad, origin, camera) else {
            shaded[quad * RGB..(quad + 1) * RGB].as_flattened_mut().fill(0.0);
            continue;
        };
        let pixel = shading.shaded(&blended, view_dir, &lighting.rays(simd, quad), &light);
        store_pixel(&pixel, shading, quad, tile, shaded);
    }
}

#[inline(always)]
fn store_pixel<S: Simd>(
    pixel: &ShadedPixel<Lanes<S>>,
    shading: &PixelShading,
    quad: usize,
    tile: &mut [Quad],
    shaded: &mut [Quad],
) {
    store(pixel.color, &mut shaded[quad * RGB..(quad + 1) * RGB]);
    if shading.channels == Channels::Layers {
        let channels = shading.channels.count();
        store(pixel.light, &mut tile[at(channels, quad, channel::LIGHT)..]);
        store(pixel.specular, &mut tile[at(channels, quad, channel::SPECULAR)..]);
    }
}

#[inline(always)]
fn store<S: Simd>(v: Vec3<Lanes<S>>, quads: &mut [Quad]) {
    v.x.store(&mut quads[0]);
    v.y.store(&mut quads[1]);
    v.z.store(&mut quads[2]);
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
    shading: &PixelShading,
    grad: &mut [Quad],
    light_grad: &mut [Texel],
) {
    for quad in 0..QUADS {
        let Some(SurfaceQuad { blended, view_dir }) = SurfaceQuad::new(simd, tile, quad, origin, camera) else {
            continue;
        };
        let mut grads = BlendedQuad::new(simd, &mut *grad, quad);
        match lighting {
            Some(lighting) => {
                let lookups = QuadLightGrad { simd, light: lighting.light, grad: light_grad };
                let mut light = Turned { lookups, frame: camera.light };
                let rays = lighting.rays(simd, quad);
                shading.shaded_vjp(&blended, view_dir, Some((&rays, &mut light)), &mut grads);
            }
            None => shading.shaded_vjp(&blended, view_dir, None::<(_, &mut QuadLightGrad<'_, S>)>, &mut grads),
        }
    }
}
