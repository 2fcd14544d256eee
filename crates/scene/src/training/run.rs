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

/// State of a training, as its program reports it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Progress<'a> {
    /// Number of steps taken.
    pub(super) iteration: u32,
    /// Running mean of the PSNR of training pictures, in dB.
    pub(super) psnr: Option<f64>,
    /// Number of gradients skipped so far because they were not finite.
    pub(super) nonfinite: usize,
    /// Number of Gaussians.
    pub(super) gaussian_count: usize,
    /// Exposure of each picture, if exposures are learned.
    pub(super) exposures: Option<&'a [Exposure<f32>]>,
    /// Messages to other ranks so far; `None` for a training on one rank.
    pub(super) traffic: Option<Traffic>,
}

/// Training on some executor. All methods but `progress` are those of [`Trainer`].
pub(super) trait Run {
    fn progress(&self) -> Progress<'_>;
    fn prepare(&mut self, wish: bool) -> Result<bool, SceneError>;
    fn step(&mut self) -> Result<(), SceneError>;
    fn download(&mut self) -> Result<HostScene, SceneError>;
    fn snapshot(&mut self) -> Result<TrainingState<Vec<f32>>, SceneError>;
    fn join(&mut self, exchange: Box<dyn Exchange>, description: &str) -> Result<(), SceneError>;
    fn agree(&mut self, wish: bool) -> Result<bool, SceneError>;
}

impl fmt::Debug for dyn Run {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "Run({})", self.progress().iteration)
    }
}

impl<E> Run for Trainer<E>
where
    E: Executor,
    E::Error: Into<SceneError> + core::error::Error,
{
    fn progress(&self) -> Progress<'_> {
        Progress {
            iteration: self.iteration(),
            psnr: self.psnr(),
            nonfinite: self.nonfinite(),
            gaussian_count: self.gaussians().count,
            exposures: self.exposures().map(|exposures| exposures.maps.as_slice()),
            traffic: self.traffic(),
        }
    }
    fn prepare(&mut self, wish: bool) -> Result<bool, SceneError> {
        Ok(self.prepare(wish)?)
    }
    fn step(&mut self) -> Result<(), SceneError> {
        self.step()?;
        Ok(())
    }
    fn download(&mut self) -> Result<HostScene, SceneError> {
        Ok(self.download()?)
    }
    fn snapshot(&mut self) -> Result<TrainingState<Vec<f32>>, SceneError> {
        Ok(self.snapshot()?)
    }
    fn join(&mut self, exchange: Box<dyn Exchange>, description: &str) -> Result<(), SceneError> {
        Ok(self.join(exchange, description)?)
    }
    fn agree(&mut self, wish: bool) -> Result<bool, SceneError> {
        Ok(self.agree(wish)?)
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
