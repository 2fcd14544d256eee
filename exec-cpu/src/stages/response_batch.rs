//! Batches of responses, relative to a tile: a vector holds one number of many splats.

use crate::{
    frame::SIZE,
    lanes::Lanes,
    stages::{
        project::{RESPONSE_LEN, ResponseRecord},
        splat_batch::SPLATS_AT_ONCE,
    },
};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use fearless_simd::Simd;
use specula_core::{order::ResponseDepth, scene::BLOCK};

/// Depths of the largest responses of some splats, relative to a tile.
pub(crate) struct ResponseBatch([[f32; SPLATS_AT_ONCE]; RESPONSE_LEN]);

impl ResponseBatch {
    /// Reads the responses of a list.
    #[inline(always)]
    pub(crate) fn read(all: &[ResponseRecord], origin: [f32; 2], list: &[AtomicU32]) -> Self {
        let mut numbers = [[0.0; SPLATS_AT_ONCE]; RESPONSE_LEN];
        for (k, gaussian) in list.iter().enumerate() {
            let mut record = all[gaussian.load(Relaxed) as usize];
            (record[0], record[1]) = (record[0] - origin[0], record[1] - origin[1]);
            for (numbers, number) in numbers.iter_mut().zip(record) {
                numbers[k] = number;
            }
        }
        Self(numbers)
    }

    /// Depth of a splat's largest response in some pixels.
    #[inline(always)]
    pub(crate) fn depth<S: Simd>(&self, simd: S, k: usize, [x, y]: [Lanes<S>; 2]) -> Lanes<S> {
        let response = of_numbers(self.0.each_ref().map(|numbers| Lanes::splat(simd, numbers[k])));
        response.at([x - response.mean2d[0], y - response.mean2d[1]])
    }

    /// Lower bounds of the depths in all pixels of the tile.
    #[inline(always)]
    pub(crate) fn least<S: Simd>(&self, simd: S) -> [f32; SPLATS_AT_ONCE] {
        let mut least = [0.0; SPLATS_AT_ONCE];
        for first in (0..SPLATS_AT_ONCE).step_by(BLOCK) {
            let response = of_numbers(self.0.each_ref().map(|numbers| Lanes::load(simd, &numbers[first..])));
            let [dx, dy] = response.mean2d.map(|mean| [-mean + 0.5, -mean + (SIZE as f32 - 0.5)]);
            response.least(dx, dy).store(&mut least[first..]);
        }
        least
    }
}

#[inline(always)]
fn of_numbers<S: Simd>([x, y, lx, ly, xx, yx, yy, depth]: [Lanes<S>; RESPONSE_LEN]) -> ResponseDepth<Lanes<S>> {
    ResponseDepth { mean2d: [x, y], slope: [lx, ly], root: [xx, yx, yy], depth }
}
