//! Blended surfaces to pictures and back: light, pixel by pixel, sixteen at a time.

use crate::{
    blend::{Frame, FrameGrad, bands},
    lanes::{Lanes, load_some, store_some},
    light::{Lookup, look_up, look_up_vjp},
    prefilter::{Light, LightGrad},
    shade::{LIGHT_PARTS, sum_parts},
};
use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    camera::{Camera, CameraOf},
    pixel::{Pixel, PixelSurface, pixel_color, pixel_color_vjp, pixel_surface, pixel_surface_vjp},
    plan::{Channels, channel},
    scene::{BLOCK, Image},
    vector::{Vec3, vec3},
};

/// Pixels of a part; parts do not depend on the number of threads, so neither does the sum of their gradients.
fn part_len(size: usize) -> usize {
    size.div_ceil(LIGHT_PARTS).next_multiple_of(BLOCK).max(BLOCK)
}

pub(crate) fn shade_pixels(level: Level, surface: &Frame, light: Option<&Light>, camera: &Camera) -> Frame {
    let image = &surface.image;
    let mut values = image.values.clone();
    let part_len = part_len(image.pixel_count());
    bands(&mut values, image.pixel_count(), part_len).into_par_iter().enumerate().for_each(|(part, mut out)| {
        dispatch!(level, simd => {
            let lifted = camera.lift(Lanes::splat(simd, 0.0));
            shade_part(simd, image, light, &lifted, part * part_len, &mut out);
        });
    });
    Frame { image: Image { values, ..*image } }
}

pub(crate) fn shade_pixels_vjp(
    level: Level,
    surface: &Frame,
    light: Option<&Light>,
    camera: &Camera,
    mut grad: FrameGrad,
) -> (FrameGrad, Option<LightGrad>) {
    let image = &surface.image;
    let part_len = part_len(image.pixel_count());
    let texel_count = light.map_or(0, |light| light.texels.len());
    let parts: Vec<_> = bands(&mut grad.image.values, image.pixel_count(), part_len)
        .into_par_iter()
        .enumerate()
        .map(|(part, mut grad)| {
            let mut light_grad = vec![[0.0; 4]; texel_count];
            dispatch!(level, simd => {
                let lifted = camera.lift(Lanes::splat(simd, 0.0));
                part_vjp(simd, image, light, &lifted, part * part_len, &mut grad, &mut light_grad);
            });
            light_grad
        })
        .collect();
    (grad, light.map(|_| LightGrad { texels: sum_parts(&parts) }))
}

/// Sixteen pixels under their light.
struct Lit<S: Simd> {
    pixel: Pixel<Lanes<S>>,
    view_dir: Vec3<Lanes<S>>,
    surface: PixelSurface<Lanes<S>>,
    lookup: Option<Lookup<S>>,
    light: Vec3<Lanes<S>>,
}

impl<S: Simd> Lit<S> {
    /// Up to sixteen pixels from `first` on; none if nothing covers them.
    #[inline(always)]
    fn new(
        simd: S,
        image: &Image<Vec<f32>>,
        light: Option<&Light>,
        camera: &CameraOf<Lanes<S>>,
        first: usize,
        count: usize,
    ) -> Option<Self> {
        let at = |plane: usize| load_some(simd, &image.plane(plane)[first..], count);
        let at3 = |plane: usize| vec3(at(plane), at(plane + 1), at(plane + 2));
        let coverage = -at(image.channels - 1) + 1.0;
        if !coverage.any_positive() {
            return None;
        }
        let pixel = Pixel {
            base: at3(channel::COLOR),
            normal: at3(channel::NORMAL),
            tint: at3(channel::TINT),
            roughness: at(channel::ROUGHNESS),
            coverage,
        };
        let (x, y) = centers(simd, first, image.width);
        let view_dir = camera.view_dir(x, y);
        let surface = pixel_surface(&pixel, view_dir);
        let lookup = light.map(|light| look_up(simd, light, surface.reflection_dir, surface.roughness));
        let light = lookup.as_ref().map_or(Vec3::zero(coverage), Lookup::radiance);
        Some(Self { pixel, view_dir, surface, lookup, light })
    }
}

/// Centres of sixteen pixels in the order of rows.
#[inline(always)]
fn centers<S: Simd>(simd: S, first: usize, width: usize) -> (Lanes<S>, Lanes<S>) {
    let (mut x, mut y) = ([0.0; BLOCK], [0.0; BLOCK]);
    let (mut column, mut row) = (first % width, first / width);
    for lane in 0..BLOCK {
        x[lane] = column as f32 + 0.5;
        y[lane] = row as f32 + 0.5;
        column += 1;
        if column == width {
            (column, row) = (0, row + 1);
        }
    }
    (Lanes::from_array(simd, x), Lanes::from_array(simd, y))
}

#[inline(always)]
fn shade_part<S: Simd>(
    simd: S,
    image: &Image<Vec<f32>>,
    light: Option<&Light>,
    camera: &CameraOf<Lanes<S>>,
    first: usize,
    out: &mut [&mut [f32]],
) {
    let len = out[0].len();
    let has_layers = image.channels > Channels::Layers.count();
    for start in (0..len).step_by(BLOCK) {
        let count = BLOCK.min(len - start);
        let Some(lit) = Lit::new(simd, image, light, camera, first + start, count) else { continue };
        let coverage = lit.pixel.coverage;
        put(pixel_color(&lit.surface, lit.light, coverage), out, channel::COLOR, start, count);
        if has_layers {
            put(lit.light * coverage, out, channel::LIGHT, start, count);
            put(lit.pixel.tint.times(lit.light), out, channel::SPECULAR, start, count);
        }
    }
}

#[inline(always)]
fn put<S: Simd>(v: Vec3<Lanes<S>>, planes: &mut [&mut [f32]], plane: usize, start: usize, count: usize) {
    for (k, lanes) in [v.x, v.y, v.z].into_iter().enumerate() {
        store_some(lanes, &mut planes[plane + k][start..], count);
    }
}

#[inline(always)]
fn part_vjp<S: Simd>(
    simd: S,
    image: &Image<Vec<f32>>,
    light: Option<&Light>,
    camera: &CameraOf<Lanes<S>>,
    first: usize,
    grad: &mut [&mut [f32]],
    light_grad: &mut [[f32; 4]],
) {
    let len = grad[0].len();
    for start in (0..len).step_by(BLOCK) {
        let count = BLOCK.min(len - start);
        let Some(lit) = Lit::new(simd, image, light, camera, first + start, count) else { continue };
        let at = |plane: usize| load_some(simd, &grad[plane][start..], count);
        let at3 = |plane: usize| vec3(at(plane), at(plane + 1), at(plane + 2));
        let (mut grad_surface, grad_light, grad_coverage) =
            pixel_color_vjp(&lit.surface, lit.light, lit.pixel.coverage, at3(channel::COLOR));
        if let (Some(lookup), Some(light)) = (&lit.lookup, light) {
            let (direction, roughness) = look_up_vjp(light, lookup, lit.surface.roughness, grad_light, light_grad);
            grad_surface.reflection_dir = direction;
            grad_surface.roughness = roughness;
        }
        let own = pixel_surface_vjp(&lit.pixel, lit.view_dir, &lit.surface, &grad_surface);
        let normal = at3(channel::NORMAL) + own.normal;
        let tint = at3(channel::TINT) + own.tint;
        let roughness = at(channel::ROUGHNESS) + own.roughness;
        let passed = at(image.channels - 1) - (own.coverage + grad_coverage);
        put(own.base, grad, channel::COLOR, start, count);
        put(normal, grad, channel::NORMAL, start, count);
        put(tint, grad, channel::TINT, start, count);
        store_some(roughness, &mut grad[channel::ROUGHNESS][start..], count);
        store_some(passed, &mut grad[image.channels - 1][start..], count);
    }
}
