//! Morton order of Gaussians.

use rayon::prelude::*;
use specula_core::{
    morton::Bounds,
    scene::{BLOCK, Gaussians, MEAN},
};

/// The Z-order code of each Gaussian's mean.
pub(crate) fn codes(gaussians: &Gaussians<Vec<f32>>) -> Vec<u32> {
    let mean = |index: usize| gaussians.get::<3>(index, MEAN);
    let bounds = (0..gaussians.count).fold(Bounds::NOTHING, |bounds, index| bounds.with(mean(index)));
    (0..gaussians.count).into_par_iter().map(|index| bounds.code(mean(index))).collect()
}

/// Sorts Gaussians so that neighbours in space are neighbours in memory, which speeds up every
/// stage. A picture changes only where two splats have equal depth.
pub fn sort_in_space(gaussians: &mut Gaussians<Vec<f32>>) {
    let codes = codes(gaussians);
    let mut order: Vec<u32> = (0..gaussians.count as u32).collect();
    order.sort_by_key(|index| codes[*index as usize]);
    gaussians.values = gather(gaussians, &gaussians.values, order.len(), |index| Some(order[index] as usize));
}

/// `count` Gaussians, each a copy of the one that `source` returns, or zero for none.
pub(crate) fn gather(
    like: &Gaussians<Vec<f32>>,
    old: &[f32],
    count: usize,
    source: impl Fn(usize) -> Option<usize> + Sync,
) -> Vec<f32> {
    let block_len = like.block_len();
    let mut new = vec![0.0; count.div_ceil(BLOCK) * block_len];
    new.par_chunks_mut(block_len).enumerate().for_each(|(block, new)| {
        for lane in 0..BLOCK.min(count - block * BLOCK) {
            if let Some(from) = source(block * BLOCK + lane) {
                let start = like.index_of(from, 0);
                for plane in 0..like.layout.plane_count() {
                    new[plane * BLOCK + lane] = old[start + plane * BLOCK];
                }
            }
        }
    });
    new
}
