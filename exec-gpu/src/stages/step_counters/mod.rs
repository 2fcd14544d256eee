//! Counters that kernels update during a training step, read back once at its end.
//!
//! The number of tile-splat pairs of an image is known only after projection, and a training step
//! does not wait for it: it allocates the need of previous steps plus a quarter. Kernels count
//! their need. If it exceeds the capacity, tiles stay empty, and kernels that update the scene
//! leave it unchanged.

use crate::{
    codegen::source::Source,
    device::{context::Context, error::GpuError, gpu::Gpu, memory::Array},
};

/// Number of counters, in the order of `step_counters.wgsl`.
const LEN: usize = 8;
/// Initial values of the first counters, which every image resets.
const IMAGE_START: [u32; 5] = [u32::MAX, 0, 0, 0, 0];

/// Capacity for sorting the splats of an image into tiles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Capacity {
    /// Pairs of a tile and a splat.
    pub(crate) pairs: usize,
    /// Bits of a depth key, including that of Gaussians that are not drawn.
    pub(crate) depth_bits: u32,
}

/// Counters on the device.
#[derive(Debug)]
pub(crate) struct StepCounters {
    array: Array,
}

/// Values of the counters.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StepCounts {
    /// Smallest depth key.
    nearest: u32,
    /// Largest depth key; smaller than `nearest` if nothing is drawn.
    furthest: u32,
    pairs: u32,
    /// Whether the number of pairs exceeds 32 bits.
    overflows: bool,
    /// Whether the capacity was exceeded.
    pub(crate) exceeds_capacity: bool,
    /// Gradients that were not finite.
    pub(crate) nonfinite: usize,
}

impl StepCounters {
    /// Counters with arbitrary values.
    pub(crate) fn new(context: &Context) -> Self {
        Self { array: context.allocate("step counters", LEN).expect("some numbers fit") }
    }

    /// Array that kernels bind as `counters`.
    pub(crate) fn array(&self) -> &Array {
        &self.array
    }

    /// Records the reset of the counters of an image.
    ///
    /// # Errors
    ///
    /// See [`Context::write`].
    pub(crate) fn reset_image(&self, context: &mut Context) -> Result<(), GpuError> {
        context.write(&self.array, &IMAGE_START)
    }

    /// Records the reset of the counters of a step.
    pub(crate) fn reset_step(&self, context: &mut Context) {
        context.clear(&self.array, IMAGE_START.len());
    }

    /// Reads the counters. Blocks until the device is done.
    ///
    /// # Errors
    ///
    /// See [`Context::download`].
    pub(crate) fn read(&self, context: &mut Context) -> Result<StepCounts, GpuError> {
        let mut numbers = [0; LEN];
        context.download(&self.array, 0, &mut numbers)?;
        Ok(StepCounts::new(&numbers))
    }
}

impl StepCounts {
    /// Values from the numbers of the array.
    pub(crate) fn new(numbers: &[u32]) -> Self {
        let [nearest, furthest, pairs, overflows, _, exceeds_capacity, nonfinite, _] =
            numbers.try_into().expect("all are there");
        Self {
            nearest,
            furthest,
            pairs,
            overflows: overflows != 0,
            exceeds_capacity: exceeds_capacity != 0,
            nonfinite: nonfinite as usize,
        }
    }

    /// Capacity that the image needs.
    ///
    /// # Errors
    ///
    /// [`GpuError::TooLarge`] if the number of pairs exceeds 32 bits.
    pub(crate) fn required(&self, gpu: &Gpu) -> Result<Capacity, GpuError> {
        if self.overflows {
            return Err(GpuError::TooLarge {
                what: "splats of tiles",
                bytes: 4 << u32::BITS,
                limit: gpu.binding_max(),
            });
        }
        // One additional key, for Gaussians that are not drawn.
        let keys = self.furthest.saturating_sub(self.nearest) + 1;
        Ok(Capacity { pairs: self.pairs as usize, depth_bits: u32::BITS - keys.leading_zeros() })
    }
}

impl Capacity {
    /// Capacity of the next step: the need of this one plus a quarter, or the previous capacity,
    /// which decays slowly.
    pub(crate) fn grown(self, former: Option<Self>, gpu: &Gpu) -> Self {
        let most = (gpu.binding_max() / 4) as usize;
        let former = former.unwrap_or_default();
        let ample = self.pairs.saturating_add(self.pairs / 4).min(most);
        Self {
            pairs: ample.max(former.pairs - former.pairs / 256).max(self.pairs),
            depth_bits: self.depth_bits.max(former.depth_bits),
        }
    }
}

/// Appends the indices of the counters.
pub(crate) fn step_counters(source: Source) -> Source {
    source.with(include_str!("step_counters.wgsl"))
}
