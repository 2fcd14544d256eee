//! Training on an executor that is selected at run time.

use crate::failure::Failure;
use core::fmt;
use specula_core::{executor::Executor, expose::Exposure, state::TrainingState};
use specula_cpu::CpuExecutor;
use specula_scene::ExecutorChoice;
use specula_train::{
    start::Point,
    trainer::{HostScene, Settings, TrainError, Trainer},
    view::View,
};

/// Training on some executor.
pub(crate) trait Run {
    /// Takes one step.
    fn step(&mut self) -> Result<(), Failure>;
    /// Number of steps taken.
    fn iteration(&self) -> u32;
    /// Running mean of the PSNR of training pictures, in dB.
    fn psnr(&self) -> Option<f64>;
    /// Number of gradients skipped so far because they were not finite.
    fn nonfinite(&self) -> usize;
    /// Number of Gaussians.
    fn gaussian_count(&self) -> usize;
    /// Exposure of each picture, if exposures are learned.
    fn exposures(&self) -> Option<&[Exposure<f32>]>;
    /// Copies the scene to the host.
    fn download(&mut self) -> Result<HostScene, Failure>;
    /// Copies the whole state of the training to the host.
    fn snapshot(&mut self) -> Result<TrainingState<Vec<f32>>, Failure>;
}

impl fmt::Debug for dyn Run {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "Run({})", self.iteration())
    }
}

impl<E> Run for Trainer<E>
where
    E: Executor,
    E::Error: Into<Failure> + core::error::Error,
{
    fn step(&mut self) -> Result<(), Failure> {
        self.step().map(drop).map_err(Failure::from)
    }
    fn iteration(&self) -> u32 {
        self.iteration()
    }
    fn psnr(&self) -> Option<f64> {
        self.psnr()
    }
    fn nonfinite(&self) -> usize {
        self.nonfinite()
    }
    fn gaussian_count(&self) -> usize {
        self.gaussians().count
    }
    fn exposures(&self) -> Option<&[Exposure<f32>]> {
        self.exposures().map(|exposures| exposures.maps.as_slice())
    }
    fn download(&mut self) -> Result<HostScene, Failure> {
        self.download().map_err(Failure::from)
    }
    fn snapshot(&mut self) -> Result<TrainingState<Vec<f32>>, Failure> {
        self.snapshot().map_err(Failure::from)
    }
}

/// Initial state of a training.
#[derive(Debug)]
pub(crate) enum Start<'a> {
    /// Points.
    Points(&'a [Point]),
    /// State of a checkpoint.
    Checkpoint(&'a TrainingState<Vec<f32>>),
}

/// Starts a training on the selected executor; true if that is a device, which may fail. If a
/// device fails at the start, the training runs on the CPU.
///
/// # Errors
/// Those of [`ExecutorChoice::open`] and of [`Trainer::new`].
pub(super) fn start_on(
    choice: &ExecutorChoice,
    settings: Settings,
    views: &[View],
    from: &Start<'_>,
) -> Result<(Box<dyn Run>, bool), Failure> {
    match choice.open()? {
        #[cfg(feature = "gpu")]
        specula_scene::Device::Gpu(gpu) => {
            tracing::info!("training on {}", description(&gpu));
            match start(specula_gpu::GpuExecutor::new(*gpu), settings.clone(), views, from).map_err(Failure::from) {
                Ok(trainer) => return Ok((Box::new(trainer), true)),
                Err(failure) if failure.is_of_device() => tracing::warn!("{failure}; the CPU takes over"),
                Err(failure) => return Err(failure),
            }
        }
        _ => {}
    }
    tracing::info!("training on the CPU, {} threads", rayon::current_num_threads());
    Ok((Box::new(start(CpuExecutor::new(), settings, views, from)?), false))
}

/// Adapter of a device, for a note.
#[cfg(feature = "gpu")]
fn description(gpu: &specula_gpu::Gpu) -> String {
    let name = &gpu.info().name;
    match gpu.is_software() {
        true => format!("{name}, a driver that computes on the CPU; --executor cpu is faster"),
        false => format!("the GPU {name}"),
    }
}

/// Opens a GPU that is asked for by name, so that its absence is an error before anything is
/// loaded.
pub(crate) fn check(choice: &ExecutorChoice) -> Result<(), Failure> {
    match choice {
        ExecutorChoice::Gpu(_) => Ok(choice.open().map(drop)?),
        ExecutorChoice::Auto | ExecutorChoice::Cpu => Ok(()),
    }
}

/// Starts or resumes a training on an executor.
pub(super) fn start<E: Executor>(
    exec: E,
    settings: Settings,
    views: &[View],
    from: &Start<'_>,
) -> Result<Trainer<E>, TrainError<E::Error>> {
    match from {
        Start::Points(points) => Trainer::new(exec, settings, views, points),
        Start::Checkpoint(state) => Trainer::resume(exec, settings, views, state),
    }
}
