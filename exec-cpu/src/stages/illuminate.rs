//! Light of lamps on a blended surface; shadow rays of sixteen pixels are traced together.

use crate::{
    context::Context,
    error::CpuError,
    frame::{Frame, PIXEL_X, PIXEL_Y, QUADS, Quad, quad_origin, tile_len},
    lanes::Lanes,
    stages::surface::SurfaceQuad,
};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    camera::{Camera, CameraOf},
    executor::Occluder,
    lamps::{
        self, DirectLight, Lamp, LampOf, LitPixel, Toward, direct_light, disc_axes, lit_pixel, seen_share, shadow_ray,
        shift, spiral_point, toward,
    },
    near_field::{Hit, NearField, T_DONE, T_MISS},
    pixel_light::BlendedPixel,
    real::{AnyLane, Real},
    rules::{Channels, channel},
    scene::BLOCK,
    vector::vec3,
};
use std::sync::Arc;

/// Numbers of a direct light.
pub(crate) const DIRECT_LEN: usize = DirectLight::<f32>::LEN;

/// Lamps and the surfaces that cast their shadows.
#[derive(Clone, Debug)]
pub(crate) struct Lamps {
    lamps: Vec<LampRays>,
    /// Points of an area lamp.
    spiral: Vec<[f32; 4]>,
    occluder: Option<Arc<NearField<Vec<f32>>>>,
    /// Irradiance / π of the occluder's vertices by reflected light; empty for none.
    reflected: Vec<f32>,
}

/// Numbers of a lamp, and its number of rays.
#[derive(Clone, Copy, Debug)]
struct LampRays {
    numbers: [f32; 8],
    rays: usize,
}

impl Lamps {
    /// Lamps with this number of shadow rays to each area lamp.
    ///
    /// # Errors
    ///
    /// [`CpuError::Lamps`] if they have a fault.
    pub(crate) fn new(
        lamps: &[Lamp],
        rays: usize,
        occluder: Option<Occluder<'_, Arc<NearField<Vec<f32>>>>>,
    ) -> Result<Self, CpuError> {
        lamps::check(lamps, rays).map_err(CpuError::Lamps)?;
        let reflected = occluder.as_ref().map_or(&[][..], |occluder| occluder.reflected);
        let occluder = occluder.map(|occluder| occluder.surface.clone());
        let vertex_count = occluder.as_ref().map_or(0, |occluder| occluder.vertex_count);
        lamps::check_reflected(vertex_count, reflected).map_err(CpuError::Lamps)?;
        let rays_of = |lamp: &Lamp| LampRays { numbers: lamp.numbers(), rays: if lamp.is_wide() { rays } else { 1 } };
        Ok(Self {
            lamps: lamps.iter().map(rays_of).collect(),
            spiral: (0..rays).map(|k| spiral_point(k, rays)).collect(),
            occluder,
            reflected: reflected.to_vec(),
        })
    }
}

/// Evaluates the direct light of lamps in the pixels of a frame. A frame without all layers, or of
/// a light without lamps, is returned unchanged.
pub(crate) fn illuminate(context: &Context, mut surface: Frame, lamps: Option<&Lamps>, camera: &Camera) -> Frame {
    let has_layers = Channels::of_count(surface.channels) == Channels::Layers;
    let Some(lamps) = lamps.filter(|_| has_layers) else { return surface };
    let (channels, cover) = (surface.channels, &surface.cover);
    let mut direct = context.take::<Quad>(cover.tiles.len() * QUADS * DIRECT_LEN);
    let tiles = surface.blended.par_chunks(tile_len(channels)).zip(direct.par_chunks_mut(QUADS * DIRECT_LEN));
    tiles.enumerate().for_each(|(slot, (tile, direct))| {
        if context.skips() {
            return;
        }
        dispatch!(context.level, simd => {
            let lifted = camera.lift(Lanes::splat(simd, 0.0));
            illuminate_tile(simd, cover.origin(slot), lamps, &lifted, tile, direct);
        });
    });
    surface.direct = Some(direct);
    surface
}

#[inline(always)]
fn illuminate_tile<S: Simd>(
    simd: S,
    origin: [f32; 2],
    lamps: &Lamps,
    camera: &CameraOf<Lanes<S>>,
    tile: &[Quad],
    direct: &mut [Quad],
) {
    for (quad, out) in direct.chunks_exact_mut(DIRECT_LEN).enumerate() {
        let Some(SurfaceQuad { blended, view_dir }) = SurfaceQuad::new(simd, tile, quad, origin, camera) else {
            out.as_flattened_mut().fill(0.0);
            continue;
        };
        let (pixel, depth) = (blended.pixel(), blended.channel(channel::DEPTH));
        let offset = lamps.occluder.as_ref().map_or(0.0, |occluder| occluder.offset);
        let lit = lit_pixel(camera, &pixel, depth, view_dir, depth.constant(offset));
        let is_covered = depth.zero().less(pixel.coverage) & lit.start.is_finite();
        let [x, y] = quad_origin(quad);
        let place = Place {
            // Pixels, not their centres.
            column: Lanes::from_array(simd, PIXEL_X) + (origin[0] + x as f32 - 0.5),
            row: Lanes::from_array(simd, PIXEL_Y) + (origin[1] + y as f32 - 0.5),
            coverage: pixel.coverage.keep(is_covered),
        };
        let mut sum = DirectLight::none(depth);
        for (index, lamp) in lamps.lamps.iter().enumerate() {
            let seen = toward(&LampOf::from_array(constants(lamp.numbers, depth)), lit.point, lit.facing.normal);
            let share = match &lamps.occluder {
                Some(occluder) => share_of(occluder, &lamps.spiral, index, lamp.rays, &place, &lit, &seen),
                None => depth.constant(1.0),
            };
            sum = sum.and(direct_light(&lit, &seen, share));
        }
        if let Some(occluder) = lamps.occluder.as_deref().filter(|_| !lamps.reflected.is_empty()) {
            sum = sum.and(reflected_light(simd, occluder, &lamps.reflected, &place, &lit));
        }
        out.iter_mut().zip(sum.to_array()).for_each(|(quad, numbers)| numbers.keep(is_covered).store(quad));
    }
}

/// Pixels of a quad.
struct Place<S: Simd> {
    column: Lanes<S>,
    row: Lanes<S>,
    /// Coverage; zero without a surface.
    coverage: Lanes<S>,
}

/// Interreflected light on the pixels of a quad.
#[inline(always)]
fn reflected_light<S: Simd>(
    simd: S,
    occluder: &NearField<Vec<f32>>,
    reflected: &[f32],
    place: &Place<S>,
    lit: &LitPixel<Lanes<S>>,
) -> DirectLight<Lanes<S>> {
    let is_covered = place.coverage.zero().less(place.coverage);
    let nothing = place.coverage.constant(T_DONE);
    let reach = Lanes::select(is_covered, occluder.reach_below(nothing), nothing);
    let hits = occluder.first_hits(lit.start, -lit.facing.normal, reach);
    let (found, triangles) = (hits.distance.to_array(), hits.triangle.to_array());
    let weights = hits.weights.map(Lanes::to_array);
    let mut irradiance = [[0.0; BLOCK]; 3];
    for lane in (0..BLOCK).filter(|lane| found[*lane] < T_MISS) {
        let weights = weights.map(|weights| weights[lane]);
        let hit = Hit { distance: found[lane], triangle: triangles[lane] as usize, weights };
        let found = occluder.between(&hit, reflected).to_array();
        irradiance.iter_mut().zip(found).for_each(|(lanes, x)| lanes[lane] = x);
    }
    let [x, y, z] = irradiance.map(|lanes| Lanes::from_array(simd, lanes));
    DirectLight::reflected(vec3(x, y, z))
}

/// Visible share of a lamp in the pixels of a quad.
#[inline(always)]
fn share_of<S: Simd>(
    occluder: &NearField<Vec<f32>>,
    spiral: &[[f32; 4]],
    index: usize,
    rays: usize,
    place: &Place<S>,
    lit: &LitPixel<Lanes<S>>,
    seen: &Toward<Lanes<S>>,
) -> Lanes<S> {
    let like = place.coverage;
    let (normal, axes) = (lit.facing.normal, disc_axes(seen.direction));
    let shift = shift(place.column, place.row, like.constant(index as f32));
    let (mut all, mut reaching) = (like.zero(), like.zero());
    let is_covered = like.zero().less(like);
    for point in &spiral[..rays] {
        let ray = shadow_ray(normal, seen, axes, &shift, constants(*point, like));
        let weight = ray.weight.keep(is_covered);
        let is_shining = like.zero().less(weight);
        if !is_shining.any() {
            continue;
        }
        let reach = Lanes::select(is_shining, seen.reach, like.constant(T_DONE));
        let are_blocked = occluder.are_blocked(lit.start, ray.direction, reach);
        all = all + weight;
        reaching = reaching + weight.keep(!are_blocked);
    }
    seen_share(all, reaching)
}

/// Direct light of a quad of a tile.
#[inline(always)]
pub(crate) fn direct_of_quad<S: Simd>(simd: S, direct: &[Quad], quad: usize) -> DirectLight<Lanes<S>> {
    DirectLight::from_array(Lanes::load_each(simd, &direct[quad * DIRECT_LEN..]))
}

/// Numbers in every lane.
#[inline(always)]
fn constants<S: Simd, const N: usize>(numbers: [f32; N], like: Lanes<S>) -> [Lanes<S>; N] {
    let mut lanes = [like; N];
    for (lanes, number) in lanes.iter_mut().zip(numbers) {
        *lanes = like.constant(number);
    }
    lanes
}
