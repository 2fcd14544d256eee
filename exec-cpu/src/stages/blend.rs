//! Tiles to a picture and back, a quad of four by four pixels at a time: most splats are small and
//! round.
//!
//! A tile has sixteen quads, and a quad has one pixel for each lane. For 64 splats at a time, one
//! bit for each splat marks that it may overlap the quad, computed for sixteen splats in a vector;
//! the quad then stays in registers while its splats are composited.

use crate::{
    context::Context,
    frame::{Frame, QUADS, Quad, tile_len},
    lanes::Lanes,
    parts::{Pieces, each_part},
    stages::{
        bin::Tiles,
        blend_in_order::{Ordered, blend_in_order},
        occlusion::{Surfaces, visible_part},
        project::{ResponseRecord, Splats},
        shade::Colors,
        splat_batch::{BatchedSplat, SPLATS_AT_ONCE, SplatBatch, centers_of},
    },
};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use fearless_simd::{Simd, dispatch, prelude::*, u32x16};
use specula_core::{
    blend::{Composite, PixelState},
    camera::Camera,
    cutoffs::Cutoffs,
    real::Real,
    rules::Channels,
    scene::BLOCK,
};

/// Maximum number of channels of a splat.
pub(crate) const CHANNELS_MAX: usize = Channels::Layers.count();

/// Calls a function that is generic over the number of channels.
macro_rules! with_channels {
    ($count:expr, $function:ident($($argument:expr),*)) => {
        match $count {
            3 => $function::<3>($($argument),*),
            8 => $function::<8>($($argument),*),
            10 => $function::<10>($($argument),*),
            12 => $function::<12>($($argument),*),
            _ => $function::<CHANNELS_MAX>($($argument),*),
        }
    };
}

pub(crate) fn blend_all(
    context: &Context,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    camera: &Camera,
    occlusion: Option<&[f32]>,
    cutoffs: &Cutoffs,
) -> Frame {
    let responses = splats.responses.as_deref();
    let size = [camera.width as usize, camera.height as usize];
    let surfaces = occlusion.map(|depths| Surfaces { depths, size, records: &splats.records });
    let surfaces = surfaces.as_ref();
    match &splats.in_perspective {
        None => {
            let records = &splats.records;
            with_channels!(
                colors.channels,
                blend_channels(context, records, responses, colors, tiles, size, surfaces, cutoffs)
            )
        }
        Some(splats) => {
            with_channels!(
                colors.channels,
                blend_channels(context, splats, responses, colors, tiles, size, surfaces, cutoffs)
            )
        }
    }
}

fn blend_channels<const C: usize>(
    context: &Context,
    splats: &[impl BatchedSplat],
    responses: Option<&[ResponseRecord]>,
    colors: &Colors,
    tiles: &Tiles,
    [width, height]: [usize; 2],
    surfaces: Option<&Surfaces<'_>>,
    cutoffs: &Cutoffs,
) -> Frame {
    let cover = tiles.cover.clone();
    let count = cover.tiles.len();
    let mut blended = context.take::<Quad>(count * tile_len(C));
    let mut seen = context.take::<u16>(tiles.intersection_count());
    let (pixels_of, splats_of) = (|slot: usize| slot * tile_len(C), |slot: usize| tiles.start_of_covered(slot));
    let parts = (Pieces::new(&mut blended, &pixels_of), Pieces::new(&mut seen, &splats_of));
    each_part(count, parts, &|slot, (pixels, seen): (Pieces<'_, Quad>, Pieces<'_, u16>)| {
        if context.skips() {
            return;
        }
        let list = tiles.of_covered(slot);
        let (origin, pixels, seen) = (cover.origin(slot), pixels.only(), seen.only());
        let tile = cover.tile_position(slot);
        match responses {
            None => {
                let visible = surfaces.map(|surfaces| surfaces.visible_in_tile(tile, list));
                let visible = visible.as_ref();
                dispatch!(context.level, simd => {
                    blend_tile::<_, C, _>(simd, splats, &colors.values, list, origin, visible, cutoffs, pixels, seen);
                });
            }
            Some(responses) => {
                let surfaces = surfaces.map(|surfaces| surfaces.of_tile(tile));
                let (colors, channels) = (&colors.values, C);
                let ordered = Ordered { splats, responses, colors, channels, list, origin, surfaces, cutoffs };
                blend_in_order(context.level, &ordered, pixels, seen);
            }
        }
    });
    Frame {
        width,
        height,
        channels: C,
        cover,
        blended,
        reflections: None,
        direct: None,
        shaded: None,
        exposed: None,
        seen,
    }
}

#[inline(always)]
fn blend_tile<S: Simd, const C: usize, T: BatchedSplat>(
    simd: S,
    splats: &[T],
    colors: &[f32],
    list: &[AtomicU32],
    origin: [f32; 2],
    visible: Option<&[[u32; BLOCK]; QUADS]>,
    cutoffs: &Cutoffs,
    pixels: &mut [Quad],
    seen: &mut [u16],
) {
    let (channels, last) = pixels.split_at_mut(QUADS * C);
    channels.as_flattened_mut().fill(0.0);
    last.as_flattened_mut().fill(1.0);
    let (channels, last) = (channels.as_chunks_mut::<C>().0, &mut last[..QUADS]);
    let mut transmittance = [[1.0; BLOCK]; QUADS];
    let (mut batch, mut near) = (T::Batch::EMPTY, [[0.0; C]; SPLATS_AT_ONCE]);
    let batches = list.chunks(SPLATS_AT_ONCE).zip(seen.chunks_mut(SPLATS_AT_ONCE)).enumerate();
    for (index, (list, seen)) in batches {
        if transmittance.iter().all(|quad| cutoffs.is_active(Lanes::load(simd, quad)).bits() == 0) {
            seen.fill(0);
            continue;
        }
        read_colors(&mut near, colors, list);
        let mut seen_by_quad = [0; QUADS];
        for (quad, mut splats) in batch.read(simd, splats, origin, list, cutoffs).into_iter().enumerate() {
            while splats != 0 {
                let part = match visible {
                    None => splats,
                    Some(visible) => {
                        visible_part(&visible[quad], index * SPLATS_AT_ONCE, splats, &mut transmittance[quad])
                    }
                };
                splats &= !part;
                let state = [&mut transmittance[quad], &mut last[quad]];
                seen_by_quad[quad] |= blend_quad(simd, &batch, &near, quad, part, cutoffs, &mut channels[quad], state);
            }
        }
        transpose_back(simd, &seen_by_quad, seen);
    }
}

/// Blends splats into a quad, one after the other; returns a bit for each that is visible in an
/// active pixel. The quad stays in registers.
#[inline(always)]
fn blend_quad<S: Simd, const C: usize>(
    simd: S,
    batch: &impl SplatBatch,
    colors: &[[f32; C]; SPLATS_AT_ONCE],
    quad: usize,
    mut splats: u64,
    cutoffs: &Cutoffs,
    channels: &mut [Quad; C],
    [transmittance, last]: [&mut Quad; 2],
) -> u64 {
    let front = Lanes::load(simd, transmittance);
    let mut alive = cutoffs.is_active(front);
    if alive.bits() == 0 {
        return 0;
    }
    // Pixels that have ended get zero: an unused product would become denormal, and slow.
    let mut state = PixelState { transmittance: front.keep(alive), final_transmittance: Lanes::load(simd, last) };
    let mut sums = [front; C];
    for c in 0..C {
        sums[c] = Lanes::load(simd, &channels[c]);
    }
    let centers = centers_of(simd, quad);
    let mut seen = 0;
    while splats != 0 {
        let k = splats.trailing_zeros() as usize % SPLATS_AT_ONCE;
        splats &= splats - 1;
        let strength = batch.log2_strength(simd, k, centers);
        let Composite { weight, behind } = cutoffs.step(cutoffs.alpha(strength), state);
        // Branchless, because a branch would be hard to predict.
        seen |= u64::from((alive & cutoffs.passes_alpha_test(strength)).bits() != 0) << k;
        alive = cutoffs.is_active(behind.transmittance);
        state = behind;
        for c in 0..C {
            sums[c] = weight.mul_add(Lanes::splat(simd, colors[k][c]), sums[c]);
        }
    }
    state.transmittance.store(transmittance);
    state.final_transmittance.store(last);
    for c in 0..C {
        sums[c].store(&mut channels[c]);
    }
    seen
}

/// For each splat a bit for each quad, from a bit for each splat of each quad.
#[inline(always)]
fn transpose_back<S: Simd>(simd: S, splats: &[u64; QUADS], quads: &mut [u16]) {
    let zero = u32x16::splat(simd, 0);
    for (half, quads) in quads.chunks_mut(HALF_BITS).enumerate() {
        let splats = splats.map(|splats| (splats >> (half * HALF_BITS)) as u32);
        let splats = u32x16::from_slice(simd, &splats);
        for (k, quads) in quads.iter_mut().enumerate() {
            *quads = (splats & u32x16::splat(simd, 1 << k)).simd_gt(zero).to_bitmask() as u16;
        }
    }
}

pub(crate) use with_channels;

/// Bits of a lane.
const HALF_BITS: usize = 32;

#[inline(always)]
pub(crate) fn read_colors<const C: usize>(near: &mut [[f32; C]], colors: &[f32], list: &[AtomicU32]) {
    for (gaussian, color) in list.iter().zip(near) {
        let gaussian = gaussian.load(Relaxed) as usize;
        color.copy_from_slice(&colors[gaussian * C..(gaussian + 1) * C]);
    }
}
