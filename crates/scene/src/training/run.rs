//! Training on an executor that is selected at run time.

use super::note::Note;
use crate::{Device, ExecutorChoice, SceneError};
use core::fmt;
use specula_core::{executor::Executor, expose::Exposure, state::TrainingState};
use specula_cpu::CpuExecutor;
use specula_train::{
    exchange::Exchange,
    pictures::PictureSource,
    ranks::Traffic,
    start::Point,
    trainer::{HostScene, Settings, TrainError, Trainer},
};

/// Training on some executor.
pub(super) trait Run {
    /// Uploads the pictures of the next step; returns true if any rank requested a stop.
    fn prepare(&mut self, wish: bool) -> Result<bool, SceneError>;
    /// Takes one step.
    fn step(&mut self) -> Result<(), SceneError>;
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
    fn download(&mut self) -> Result<HostScene, SceneError>;
    /// Shares the training with other ranks.
    fn join(&mut self, exchange: Box<dyn Exchange>, description: &str) -> Result<(), SceneError>;
    /// Returns true if any rank requested a stop.
    fn agree(&mut self, wish: bool) -> Result<bool, SceneError>;
    /// Messages to other ranks so far; `None` on a single rank.
    fn traffic(&self) -> Option<Traffic>;
    /// Copies the whole state of the training to the host.
    fn snapshot(&mut self) -> Result<TrainingState<Vec<f32>>, SceneError>;
}

impl fmt::Debug for dyn Run {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "Run({})", self.iteration())
    }
}

impl<E> Run for Trainer<E>
where
    E: Executor,
    E::Error: Into<SceneError> + core::error::Error,
{
    fn prepare(&mut self, wish: bool) -> Result<bool, SceneError> {
        self.prepare(wish).map_err(SceneError::from)
    }
    fn step(&mut self) -> Result<(), SceneError> {
        self.step().map(drop).map_err(SceneError::from)
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
    fn download(&mut self) -> Result<HostScene, SceneError> {
        self.download().map_err(SceneError::from)
    }
    fn join(&mut self, exchange: Box<dyn Exchange>, description: &str) -> Result<(), SceneError> {
        self.join(exchange, description).map_err(SceneError::from)
    }
    fn agree(&mut self, wish: bool) -> Result<bool, SceneError> {
        self.agree(wish).map_err(SceneError::from)
    }
    fn traffic(&self) -> Option<Traffic> {
        self.traffic()
    }
    fn snapshot(&mut self) -> Result<TrainingState<Vec<f32>>, SceneError> {
        self.snapshot().map_err(SceneError::from)
    }
}

/// Initial state of a training.
#[derive(Debug)]
pub enum Start<'a> {
    /// Points.
    Points(&'a [Point]),
    /// State of a checkpoint.
    Checkpoint(&'a TrainingState<Vec<f32>>),
}

/// Starts a training on the selected executor; returns true if that is a device, which may fail. If
/// a device fails at the start, the training runs on the CPU. `note` receives each event.
///
/// # Errors
///
/// Those of [`ExecutorChoice::open`] and of [`Trainer::new`].
pub(super) fn start_on<E: From<SceneError>>(
    choice: &ExecutorChoice,
    settings: Settings,
    views: &dyn PictureSource,
    from: &Start<'_>,
    mut note: impl FnMut(Note<E>),
) -> Result<(Box<dyn Run>, bool), E> {
    match choice.open()? {
        Device::Cpu => {}
        #[cfg(feature = "gpu")]
        Device::Gpu(gpu, place) => {
            let (name, is_software) = (gpu.info().name.clone(), gpu.is_software());
            let place = place.map(|place| (place.number + 1, place.count));
            note(Note::StartsOnGpu { name, is_software, place });
            match start(specula_gpu::GpuExecutor::new(*gpu), settings.clone(), views, from).map_err(SceneError::from) {
                Ok(trainer) => return Ok((Box::new(trainer), true)),
                Err(error) if error.is_device_failure() => note(Note::GpuRefused { error: error.into() }),
                Err(error) => return Err(error.into()),
            }
        }
    }
    note(Note::StartsOnCpu { threads: rayon::current_num_threads() });
    let trainer = start(CpuExecutor::new(), settings, views, from).map_err(SceneError::from)?;
    Ok((Box::new(trainer), false))
}

/// Starts or resumes a training on an executor.
pub(super) fn start<E: Executor>(
    exec: E,
    settings: Settings,
    views: &dyn PictureSource,
    from: &Start<'_>,
) -> Result<Trainer<E>, TrainError<E::Error>> {
    match from {
        Start::Points(points) => Trainer::new(exec, settings, views, points),
        Start::Checkpoint(state) => Trainer::resume(exec, settings, views, state),
    }
}
