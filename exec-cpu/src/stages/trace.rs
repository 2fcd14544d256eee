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
    near_field::{NearField, Reflection, ray_origin},
    real::Real,
    rules::{Channels, channel},
    scene::BLOCK,
    shade_pixels::pixel_surface,
    vector::{Vec3, vec3},
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
        let rays = Rays {
            origin: start.map(Lanes::to_array),
            direction: surface.reflection_dir.map(Lanes::to_array),
            roughness: surface.roughness.to_array(),
            coverage: pixel.coverage.to_array(),
        };
        for lane in 0..BLOCK {
            let numbers = rays.reflection(near_field, lane).to_array();
            out.iter_mut().zip(numbers).for_each(|(quad, number)| quad[lane] = number);
        }
    }
}

/// Reflected rays of a quad.
struct Rays {
    origin: Vec3<[f32; BLOCK]>,
    direction: Vec3<[f32; BLOCK]>,
    roughness: [f32; BLOCK],
    coverage: [f32; BLOCK],
}

impl Rays {
    fn reflection(&self, near_field: &NearField<Vec<f32>>, lane: usize) -> Reflection<f32> {
        let [origin, direction] = [&self.origin, &self.direction].map(|v| vec3(v.x[lane], v.y[lane], v.z[lane]));
        let roughness = self.roughness[lane];
        let hit = if self.coverage[lane] > 0.0 { near_field.first_hit(origin, direction) } else { None };
        match hit {
            Some(hit) => Reflection::of_near(direction, roughness, &near_field.surface(&hit)),
            None => Reflection::of_far(direction, roughness),
        }
    }
}

/// Reflection of a quad of a tile.
#[inline(always)]
pub(crate) fn reflection_of_quad<S: Simd>(simd: S, reflections: &[Quad], quad: usize) -> Reflection<Lanes<S>> {
    let numbers = &reflections[quad * LEN..(quad + 1) * LEN];
    Reflection::from_array(core::array::from_fn(|k| Lanes::load(simd, &numbers[k])))
}
