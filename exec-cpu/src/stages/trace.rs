//! Reflected rays of a blended surface, traced against the near field of a light.

use crate::{
    context::Context,
    frame::{Frame, QUADS, Quad, tile_len},
    lanes::Lanes,
    stages::surface::SurfaceQuad,
};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    camera::{Camera, CameraOf},
    near_field::{
        Hits, NearField, NearSurface, Reflection, T_DONE, T_MISS, VERTEX_LEN, is_traced, ray_origin, surface_within,
        vertex_surface,
    },
    pixel_light::BlendedPixel,
    real::{AnyLane, Real},
    rules::{Channels, channel},
    scene::BLOCK,
    shade_pixels::pixel_surface,
};

/// Numbers of a reflection.
pub(crate) const REFLECTION_LEN: usize = Reflection::<f32>::LEN;

/// Traces the reflected rays of a frame's pixels. A frame without depths, or of a light without a
/// near field, is returned unchanged.
pub(crate) fn trace(
    context: &Context,
    mut surface: Frame,
    near_field: Option<&NearField<Vec<f32>>>,
    camera: &Camera,
) -> Frame {
    let has_depth = Channels::of_count(surface.channels).contain(channel::DEPTH);
    let Some(near_field) = near_field.filter(|_| has_depth) else { return surface };
    let (channels, cover) = (surface.channels, &surface.cover);
    let mut reflections = context.take::<Quad>(cover.tiles.len() * QUADS * REFLECTION_LEN);
    let tiles = surface.blended.par_chunks(tile_len(channels)).zip(reflections.par_chunks_mut(QUADS * REFLECTION_LEN));
    tiles.enumerate().for_each(|(slot, (tile, reflections))| {
        if context.skips() {
            return;
        }
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
    for (quad, out) in reflections.chunks_exact_mut(REFLECTION_LEN).enumerate() {
        let Some(SurfaceQuad { blended, view_dir }) = SurfaceQuad::new(simd, tile, quad, origin, camera) else {
            out.as_flattened_mut().fill(0.0);
            continue;
        };
        let (pixel, depth) = (blended.pixel(), blended.channel(channel::DEPTH));
        let surface = pixel_surface(&pixel, view_dir);
        let start = ray_origin(camera, &pixel, depth, view_dir, depth.constant(near_field.offset));
        let (direction, roughness) = (surface.reflection_dir, surface.roughness);
        let reach = Lanes::select(is_traced(pixel.coverage, roughness), depth.constant(T_MISS), depth.constant(T_DONE));
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

/// Surfaces hit by rays; arbitrary for rays without a hit.
#[inline(always)]
fn surfaces<S: Simd>(simd: S, near_field: &NearField<Vec<f32>>, hits: &Hits<Lanes<S>>) -> NearSurface<Lanes<S>> {
    let (triangles, all) = (hits.triangle.to_array(), near_field.vertices());
    let mut numbers = [[[0.0; BLOCK]; VERTEX_LEN]; 3];
    for lane in 0..BLOCK {
        let corners = near_field.corners(triangles[lane] as usize);
        for (numbers, corner) in numbers.iter_mut().zip(corners) {
            for (number, value) in numbers.iter_mut().zip(&all[corner]) {
                number[lane] = *value;
            }
        }
    }
    let [a, b, c] = &numbers;
    let [a, b, c] = [Lanes::load_each(simd, a), Lanes::load_each(simd, b), Lanes::load_each(simd, c)];
    surface_within(&[vertex_surface(a), vertex_surface(b), vertex_surface(c)], hits.weights)
}

/// Reflection of a quad of a tile.
#[inline(always)]
pub(crate) fn reflection_of_quad<S: Simd>(simd: S, reflections: &[Quad], quad: usize) -> Reflection<Lanes<S>> {
    Reflection::from_array(Lanes::load_each(simd, &reflections[quad * REFLECTION_LEN..]))
}
