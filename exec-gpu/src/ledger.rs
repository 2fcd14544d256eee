//! What the device notes of a step while nobody waits for it, read in one go at its end.
//!
//! How many splats the tiles of a picture hold is known only once they are projected, and a step of training does not
//! wait for that: it takes the memory that former steps needed, and a quarter more. The device notes what is needed.
//! Where that is more than there is, tiles stay empty, and kernels that would change the scene leave it as it is.

use crate::{
    device::{Gpu, GpuError},
    memory::{Array, Pool},
};
use std::sync::Arc;

/// Numbers of the ledger, in the order of `ledger.wgsl`.
const LEN: usize = 8;

/// What is needed to sort the splats of a picture into tiles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Room {
    /// Pairs of a tile and a splat.
    pub(crate) pairs: usize,
    /// Bits that tell depths apart, and from what is not drawn.
    pub(crate) depth_bits: u32,
}

/// The ledger on the device.
#[derive(Clone, Debug)]
pub(crate) struct Ledger {
    array: Arc<Array>,
}

/// What was found in it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Entries {
    /// Key of the nearest depth.
    nearest: u32,
    /// Key of the furthest; nothing is drawn if it is nearer.
    furthest: u32,
    pairs: u32,
    /// Whether the pairs are more than a word counts.
    is_too_much: bool,
    /// Whether there was too little room.
    pub(crate) is_short: bool,
    /// Gradients that were not finite.
    pub(crate) left_out: usize,
}

impl Ledger {
    /// How its first numbers begin with every picture.
    pub(crate) const OF_A_PICTURE: [u32; 5] = [u32::MAX, 0, 0, 0, 0];
    /// Where the others begin, which a report sets to zero, in bytes.
    pub(crate) const OF_A_STEP: u64 = 4 * Self::OF_A_PICTURE.len() as u64;

    /// An empty one.
    pub(crate) fn new(gpu: &Gpu, pool: &Pool) -> Self {
        Self { array: Arc::new(pool.take(gpu, "a ledger", LEN).expect("some numbers fit")) }
    }

    /// What kernels bind as `ledger`.
    pub(crate) fn array(&self) -> &Array {
        &self.array
    }
}

impl Entries {
    /// From the numbers of the ledger.
    pub(crate) fn new(numbers: &[u32]) -> Self {
        let [nearest, furthest, pairs, is_too_much, _, is_short, left_out, _] =
            numbers.try_into().expect("all are there");
        let (is_too_much, is_short, left_out) = (is_too_much != 0, is_short != 0, left_out as usize);
        Self { nearest, furthest, pairs, is_too_much, is_short, left_out }
    }

    /// What the picture needed.
    pub(crate) fn room(&self, gpu: &Gpu) -> Result<Room, GpuError> {
        if self.is_too_much {
            return Err(GpuError::TooLarge {
                what: "splats of tiles",
                bytes: 4 << u32::BITS,
                limit: gpu.binding_max(),
            });
        }
        // One key more, for what is not drawn.
        let keys = self.furthest.saturating_sub(self.nearest) + 1;
        Ok(Room { pairs: self.pairs as usize, depth_bits: u32::BITS - keys.leading_zeros() })
    }
}

impl Room {
    /// Room for pictures that need somewhat more than the last, or what those before needed, which is forgotten bit by
    /// bit.
    pub(crate) fn after(self, before: Option<Self>, gpu: &Gpu) -> Self {
        let most = (gpu.binding_max() / 4) as usize;
        let before = before.unwrap_or_default();
        let ample = self.pairs.saturating_add(self.pairs / 4).min(most);
        Self {
            pairs: ample.max(before.pairs - before.pairs / 256).max(self.pairs),
            depth_bits: self.depth_bits.max(before.depth_bits),
        }
    }
}
