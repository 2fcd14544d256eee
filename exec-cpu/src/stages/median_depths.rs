//! Median depths of pixels ([`specula_core::blend::is_median`]).

use crate::{
    context::Context,
    frame::{QUAD, QUADS, Quad, SIZE, quad_origin},
    lanes::Lanes,
    stages::{
        bin::Tiles,
        project::{SplatRecord, Splats},
        splat_batch::{BatchedSplat, SPLATS_AT_ONCE, SplatBatch, centers_of},
    },
};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    blend::{PixelState, is_median},
    camera::Camera,
    cutoffs::Cutoffs,
    real::Real,
    scene::BLOCK,
};

/// Median depth of each pixel of a picture, row by row. Splats are in the order of their means.
pub(crate) fn median_depths(
    context: &Context,
    splats: &Splats,
    tiles: &Tiles,
    camera: &Camera,
    cutoffs: &Cutoffs,
) -> Vec<f32> {
    match &splats.in_perspective {
        None => depths_of(context, &splats.records, &splats.records, tiles, camera, cutoffs),
        Some(perspective) => depths_of(context, perspective, &splats.records, tiles, camera, cutoffs),
    }
}

fn depths_of(
    context: &Context,
    splats: &[impl BatchedSplat],
    records: &[SplatRecord],
    tiles: &Tiles,
    camera: &Camera,
    cutoffs: &Cutoffs,
) -> Vec<f32> {
    let (width, height, cover) = (camera.width as usize, camera.height as usize, &tiles.cover);
    let mut medians = context.take::<Quad>(cover.tiles.len() * QUADS);
    medians.par_chunks_mut(QUADS).enumerate().for_each(|(slot, medians)| {
        if context.skips() {
            return;
        }
        let (list, origin) = (tiles.of_covered(slot), cover.origin(slot));
        dispatch!(context.level, simd => median_tile(simd, splats, records, list, origin, cutoffs, medians));
    });
    let mut depths = vec![f32::INFINITY; width * height];
    for (slot, medians) in medians.chunks(QUADS).enumerate() {
        let [column, row] = cover.tile_position(slot);
        for (quad, lane) in (0..QUADS).flat_map(|quad| (0..BLOCK).map(move |lane| (quad, lane))) {
            let [x, y] = quad_origin(quad);
            let (x, y) = (column * SIZE + x + lane % QUAD, row * SIZE + y + lane / QUAD);
            if x < width && y < height {
                depths[y * width + x] = medians[quad][lane];
            }
        }
    }
    depths
}

#[inline(always)]
fn median_tile<S: Simd, T: BatchedSplat>(
    simd: S,
    splats: &[T],
    records: &[SplatRecord],
    list: &[AtomicU32],
    origin: [f32; 2],
    cutoffs: &Cutoffs,
    medians: &mut [Quad],
) {
    medians.as_flattened_mut().fill(f32::INFINITY);
    let (mut batch, mut transmittance) = (T::Batch::EMPTY, [[1.0; BLOCK]; QUADS]);
    for list in list.chunks(SPLATS_AT_ONCE) {
        for (quad, mut splats) in batch.read(simd, splats, origin, list, cutoffs).into_iter().enumerate() {
            let mut in_front = Lanes::load(simd, &transmittance[quad]);
            let mut median = Lanes::load(simd, &medians[quad]);
            let centers = centers_of(simd, quad);
            while splats != 0 {
                let k = splats.trailing_zeros() as usize % SPLATS_AT_ONCE;
                splats &= splats - 1;
                let alpha = cutoffs.alpha(batch.log2_strength(simd, k, centers));
                let state = PixelState { transmittance: in_front, final_transmittance: in_front };
                let behind = cutoffs.step(alpha, state).behind.transmittance;
                let depth = Lanes::splat(simd, records[list[k].load(Relaxed) as usize].depth);
                median = Lanes::select(is_median(in_front, behind), depth, median);
                in_front = behind;
            }
            in_front.store(&mut transmittance[quad]);
            median.store(&mut medians[quad]);
        }
    }
}
