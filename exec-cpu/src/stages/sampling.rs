//! 3D filters, from the sampling intervals of views.

use crate::{block::BlockPlanes, context::Context, lanes::Lanes, stages::project::BLOCKS_AT_ONCE};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    antialias::{SamplingInterval, sampling_interval},
    attributes::AttributePlanes,
    camera::Camera,
    scene::{BLOCK, Gaussians, MEAN},
};

/// Sets the filters of all Gaussians, if they have one.
pub(crate) fn sampling(context: &Context, gaussians: &mut Gaussians<Vec<f32>>, views: &[Camera]) {
    let Some(plane) = gaussians.layout.filter_plane() else { return };
    let block_len = gaussians.block_len();
    gaussians.values.par_chunks_mut(block_len).with_min_len(BLOCKS_AT_ONCE).for_each(|block| {
        dispatch!(context.level, simd => sample_block(simd, block, plane, views));
    });
}

#[inline(always)]
fn sample_block<S: Simd>(simd: S, block: &mut [f32], plane: usize, views: &[Camera]) {
    let zero = Lanes::splat(simd, 0.0);
    let mean = BlockPlanes { simd, values: block }.vec3(MEAN);
    let least = views
        .iter()
        .fold(SamplingInterval::none(zero), |least, camera| least.min(sampling_interval(mean, &camera.lift(zero))));
    least.filter().store(&mut block[plane * BLOCK..]);
}
