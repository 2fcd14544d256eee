//! Surfaces of another renderer in front of splats ([`specula_core::occlusion`]).

use crate::{
    frame::{QUAD, QUADS, Quad, SIZE, quad_origin},
    stages::project::SplatRecord,
};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use specula_core::{occlusion::is_hidden, scene::BLOCK};

/// Depths of the surfaces of a picture, and of its splats.
#[derive(Clone, Copy)]
pub(crate) struct Surfaces<'a> {
    /// One depth for each pixel, row by row.
    pub(crate) depths: &'a [f32],
    /// Width and height of the picture.
    pub(crate) size: [usize; 2],
    pub(crate) records: &'a [SplatRecord],
}

impl Surfaces<'_> {
    /// Depths in a tile, quad by quad; infinite outside of the picture.
    pub(crate) fn of_tile(&self, [column, row]: [usize; 2]) -> [Quad; QUADS] {
        let [width, height] = self.size;
        core::array::from_fn(|quad| {
            let [x, y] = quad_origin(quad);
            core::array::from_fn(|lane| {
                let (x, y) = (column * SIZE + x + lane % QUAD, row * SIZE + y + lane / QUAD);
                if x < width && y < height { self.depths[y * width + x] } else { f32::INFINITY }
            })
        })
    }

    /// Number of splats in front of the surface of each pixel of a tile, whose list is sorted by
    /// depth.
    pub(crate) fn visible_in_tile(&self, tile: [usize; 2], list: &[AtomicU32]) -> [[u32; BLOCK]; QUADS] {
        let depth = |gaussian: &AtomicU32| self.records[gaussian.load(Relaxed) as usize].depth;
        self.of_tile(tile).map(|quad| {
            quad.map(|surface| list.partition_point(|gaussian| !is_hidden(depth(gaussian), surface)) as u32)
        })
    }
}

/// Splats of a batch of a quad, from the next one on, up to the first that a surface hides from
/// another pixel. Ends the pixels from which a surface hides the next one. `visible` are the
/// visible splats of each pixel, and `first` is the place of the batch in the list.
#[inline(always)]
pub(crate) fn visible_part(visible: &[u32; BLOCK], first: usize, splats: u64, transmittance: &mut Quad) -> u64 {
    let next = first as u32 + splats.trailing_zeros();
    let mut end = u32::MAX;
    for (visible, transmittance) in visible.iter().zip(transmittance) {
        if *visible <= next {
            *transmittance = 0.0;
        } else {
            end = end.min(*visible);
        }
    }
    match 1_u64.checked_shl(end - first as u32) {
        Some(bit) => splats & (bit - 1),
        None => splats,
    }
}
