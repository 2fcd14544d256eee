//! What every stage needs: the device, its memory, its kernels.

use crate::{
    blend_vjp::ReplayParts,
    device::{Gpu, GpuError},
    expose::sum_of_tiles,
    kernel::{Bound, Groups, Kernels},
    ledger::{Entries, Ledger, Room},
    loss::Losses,
    memory::{Array, Pool, read, staged, write},
};
use bytemuck::Pod;
use core::{mem, ops::Range};
use specula_core::{executor::StepReport, loss::LossReport};

/// A device with memory and kernels.
#[derive(Debug)]
pub(crate) struct Machine {
    pub(crate) gpu: Gpu,
    pub(crate) replay_parts: ReplayParts,
    pool: Pool,
    pub(crate) kernels: Kernels,
    pub(crate) ledger: Ledger,
    /// What a step of training is given room for, once it is known what they need.
    pub(crate) room: Option<Room>,
    /// The losses of the last picture.
    pub(crate) losses: Option<Losses>,
    /// What the tiles of the last photograph came to, for its exposure.
    pub(crate) exposure_sums: Option<Array>,
}

impl Machine {
    pub(crate) fn new(gpu: Gpu) -> Self {
        let pool = Pool::default();
        Self {
            replay_parts: ReplayParts::new(&gpu),
            ledger: Ledger::new(&gpu, &pool),
            pool,
            gpu,
            kernels: Kernels::default(),
            room: None,
            losses: None,
            exposure_sums: None,
        }
    }

    /// An array of so many numbers, whatever they are.
    pub(crate) fn take(&self, what: &'static str, len: usize) -> Result<Array, GpuError> {
        self.pool.take(&self.gpu, what, len)
    }

    /// An array of so many zeros.
    pub(crate) fn zeros(&mut self, what: &'static str, len: usize) -> Result<Array, GpuError> {
        let array = self.take(what, len)?;
        self.kernels.encoder(&self.gpu).clear_buffer(array.buffer(), 0, None);
        Ok(array)
    }

    /// An array of these numbers.
    pub(crate) fn upload<T: Pod>(&mut self, what: &'static str, values: &[T]) -> Result<Array, GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let array = self.take(what, bytes.len().div_ceil(4))?;
        write(&self.gpu, self.kernels.encoder(&self.gpu), &array, bytes)?;
        Ok(array)
    }

    /// Writes numbers to the start of an array.
    pub(crate) fn write<T: Pod>(&mut self, array: &Array, values: &[T]) -> Result<(), GpuError> {
        write(&self.gpu, self.kernels.encoder(&self.gpu), array, bytemuck::cast_slice(values))
    }

    /// Some numbers of an array, from `first` on, or whole ones. Waits for the device.
    pub(crate) fn download<T: Pod>(&mut self, array: &Array, first: usize, values: &mut [T]) -> Result<(), GpuError> {
        const { assert!(size_of::<T>() == 4, "arrays are of 32 bits each") };
        let part = first..first + values.len();
        let own: &mut [u8] = bytemuck::cast_slice_mut(values);
        self.read(&[(array, part)], |bytes| own.copy_from_slice(bytes))
    }

    /// Waits until everything that was asked of the device is done.
    pub(crate) fn finish(&mut self) -> Result<(), GpuError> {
        self.kernels.submit(&self.gpu)?;
        self.gpu.wait()
    }

    /// Gives back memory that no array uses.
    pub(crate) fn forget_memory(&mut self) {
        self.pool.forget();
    }

    /// Bytes of all arrays, and of those that are kept to be used again.
    pub(crate) fn memory(&self) -> u64 {
        self.pool.bytes()
    }

    /// What the ledger says now. Waits for the device.
    pub(crate) fn entries(&mut self) -> Result<Entries, GpuError> {
        let ledger = self.ledger.clone();
        let mut numbers = vec![0; ledger.array().len()];
        self.download(ledger.array(), 0, &mut numbers)?;
        Ok(Entries::new(&numbers))
    }

    /// What was noted since the last report, in one go. Waits for the device.
    pub(crate) fn report(&mut self) -> Result<Option<StepReport>, GpuError> {
        let (ledger, losses) = (self.ledger.clone(), mem::take(&mut self.losses));
        let exposure_sums = mem::take(&mut self.exposure_sums);
        let arrays = [Some(ledger.array()), losses.as_ref().map(Losses::sums), exposure_sums.as_ref()];
        let parts: Vec<(&Array, Range<usize>)> =
            arrays.into_iter().flatten().map(|array| (array, 0..array.len())).collect();
        let (mut entries, mut loss, mut exposure) = (Entries::default(), LossReport::default(), None);
        self.read(&parts, |bytes| {
            let (own, sums) = bytes.split_at(4 * ledger.array().len());
            let (of_loss, of_exposure) = sums.split_at(losses.as_ref().map_or(0, |losses| 4 * losses.sums().len()));
            let numbers = bytemuck::pod_collect_to_vec::<u8, f32>;
            entries = Entries::new(&bytemuck::pod_collect_to_vec::<u8, u32>(own));
            loss = losses.as_ref().map_or(loss, |losses| losses.report(&numbers(of_loss)));
            exposure = exposure_sums.as_ref().map(|_| sum_of_tiles(&numbers(of_exposure)));
        })?;
        self.kernels.encoder(&self.gpu).clear_buffer(ledger.array().buffer(), Ledger::OF_A_STEP, None);
        self.room = Some(entries.room(&self.gpu)?.after(self.room, &self.gpu));
        Ok((!entries.is_short).then_some(StepReport { loss, nonfinite: entries.left_out, exposure }))
    }

    fn read(&mut self, parts: &[(&Array, Range<usize>)], take: impl FnOnce(&[u8])) -> Result<(), GpuError> {
        if parts.iter().all(|(_, part)| part.is_empty()) {
            return Ok(());
        }
        let staging = staged(&self.gpu, self.kernels.encoder(&self.gpu), parts);
        self.kernels.submit(&self.gpu)?;
        read(&self.gpu, &staging, take)
    }

    /// Records a kernel; see [`Kernels::run`].
    pub(crate) fn run(
        &mut self,
        key: &str,
        entry: &'static str,
        source: &dyn Fn() -> String,
        bound: &[Bound<'_>],
        groups: Groups,
    ) -> Result<(), GpuError> {
        self.kernels.run(&self.gpu, key, entry, source, bound, groups)
    }
}

#[cfg(test)]
impl Machine {
    /// A machine on the first adapter. Without any a test cannot run: in CI that is a failure, elsewhere it is said.
    pub(crate) fn for_tests() -> Option<Self> {
        match Gpu::new("") {
            Ok(gpu) => Some(Self::new(gpu)),
            Err(error) if std::env::var_os("CI").is_some() => panic!("CI needs an adapter: {error}"),
            Err(error) => {
                eprintln!("NOT TESTED, because {error}");
                None
            }
        }
    }
}
