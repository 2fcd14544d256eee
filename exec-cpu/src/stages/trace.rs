//! Reflected rays of a blended surface, traced against the near field of a light.

use crate::{
    context::Context,
    frame::{Frame, QUADS, Quad, tile_len},
    lanes::Lanes,
    stages::{
        prefilter::Light,
        shade_pixels::{BlendedQuad, SurfaceQuad},
    },
};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    camera::{Camera, CameraOf},
    near_field::{
        FINISHED, Hits, NOTHING, NearField, NearSurface, Reflection, VERTEX_LEN, ray_origin, surface_within,
        vertex_surface,
    },
    real::{AnyLane, Real},
    rules::{Channels, channel},
    scene::BLOCK,
    shade_pixels::pixel_surface,
};

/// Numbers of a reflection.
pub(crate) const LEN: usize = Reflection::<f32>::LEN;

/// Traces the pixels of a frame; one without depths stays as it is, as does one under a light
/// without a near field.
pub(crate) fn trace(context: &Context, mut surface: Frame, light: &Light, camera: &Camera) -> Frame {
    let has_depth = Channels::of_count(surface.channels).index_of(channel::DEPTH).is_some();
    let Some(near_field) = light.near_field.as_deref().filter(|_| has_depth) else { return surface };
    let (channels, cover) = (surface.channels, &surface.cover);
    let mut reflections = context.take::<Quad>(cover.tiles.len() * QUADS * LEN);
    let tiles = surface.blended.par_chunks(tile_len(channels)).zip(reflections.par_chunks_mut(QUADS * LEN));
    tiles.enumerate().for_each(|(slot, (tile, reflections))| {
        dispatch!(context.level, simd => {
            let lifted = camera.lift(Lanes::splat(simd, 0.0));
            trace_tile(simd, cover.origin(slot), near_field, &lifted, tile, reflections);
        });
    });
    surface.reflections = Some(reflections);
    surface
}

#[inline(always)]
fn trace_tile<S: Simd>(
    simd: S,
    origin: [f32; 2],
    near_field: &NearField<Vec<f32>>,
    camera: &CameraOf<Lanes<S>>,
    tile: &[Quad],
    reflections: &mut [Quad],
) {
    for (quad, out) in reflections.chunks_exact_mut(LEN).enumerate() {
        let Some(SurfaceQuad { pixel, view_dir }) = SurfaceQuad::new(simd, tile, quad, origin, camera) else {
            out.as_flattened_mut().fill(0.0);
            continue;
        };
        let surface = pixel_surface(&pixel, view_dir);
        let depth = BlendedQuad::new(simd, tile, quad).load(channel::DEPTH);
        let start = ray_origin(camera, &pixel, depth, view_dir, depth.constant(near_field.offset));
        let (direction, roughness) = (surface.reflection_dir, surface.roughness);
        let is_covered = depth.zero().less(pixel.coverage);
        let reach = Lanes::select(is_covered, depth.constant(NOTHING), depth.constant(FINISHED));
        let hits = near_field.first_hits(start, direction, reach);
        let far = Reflection::of_far(direction, roughness);
        let is_near = hits.is_hit();
        let reflection = if is_near.any() {
            let near = Reflection::of_near(direction, roughness, &surfaces(simd, near_field, &hits));
            near.or(&far, is_near)
        } else {
            far
        };
        out.iter_mut().zip(reflection.to_array()).for_each(|(quad, numbers)| numbers.store(quad));
    }
}

/// Surfaces that rays meet; any where they meet nothing.
#[inline(always)]
fn surfaces<S: Simd>(simd: S, near_field: &NearField<Vec<f32>>, hits: &Hits<Lanes<S>>) -> NearSurface<Lanes<S>> {
    let corners = hits.triangle.to_array().map(|triangle| near_field.corners(triangle as usize));
    let all = near_field.vertices();
    let vertices = [0, 1, 2].map(|k| {
        let vertices: [&[f32; VERTEX_LEN]; BLOCK] = core::array::from_fn(|lane| &all[corners[lane][k]]);
        let number = |index: usize| Lanes::from_array(simd, core::array::from_fn(|lane| vertices[lane][index]));
        vertex_surface(core::array::from_fn(number))
    });
    surface_within(&vertices, hits.weights)
}

/// Reflection of a quad of a tile.
#[inline(always)]
pub(crate) fn reflection_of_quad<S: Simd>(simd: S, reflections: &[Quad], quad: usize) -> Reflection<Lanes<S>> {
    let numbers = &reflections[quad * LEN..(quad + 1) * LEN];
    Reflection::from_array(core::array::from_fn(|k| Lanes::load(simd, &numbers[k])))
}
