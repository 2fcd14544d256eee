//! Training loop and its observer: steps, pauses at given iterations, checkpoints, and the CPU as a
//! fallback for devices that fail.

use super::{
    checkpoint::Checkpoints,
    note::Note,
    run::{self, Run, Start, start_on},
};
use crate::{ExecutorChoice, Scene, SceneError, ShadingModel};
use core::fmt::Display;
use specula_core::expose::Exposure;
use specula_cpu::CpuExecutor;
use specula_train::{exchange::Exchange, pictures::PictureSource, ranks::Traffic, start::Point, trainer::Settings};
use std::time::Instant;

/// Program that runs a training, is notified of its progress and may interrupt it.
pub trait Observer {
    /// Error of the program.
    type Error: From<SceneError> + Display;

    /// Returns whether an executor failed on valid input ([`SceneError::is_device_failure`]).
    fn is_device_failure(error: &Self::Error) -> bool;

    /// Pictures and points to start again after a device fails.
    fn origin(&self) -> (&dyn PictureSource, &[Point]);

    /// Returns whether the training ends before its next step.
    fn is_interrupted(&self) -> bool {
        false
    }

    /// Called before each step.
    ///
    /// # Errors
    ///
    /// Any failure that ends the training.
    fn before_step(&mut self, _training: &mut Training) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Called after each step.
    fn after_step(&mut self, _training: &Training) {}

    /// Called after the steps at which the training pauses.
    ///
    /// # Errors
    ///
    /// Any failure that ends the training; one of the device is followed by the fallback.
    fn pause(&mut self, _training: &mut Training) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Reports an event; by default to the log.
    fn note(&mut self, note: Note<Self::Error>) {
        match note {
            Note::StartsOnGpu { .. } | Note::StartsOnCpu { .. } => tracing::info!("{note}"),
            _ => tracing::warn!("{note}"),
        }
    }
}

/// Training on the selected executor.
#[derive(Debug)]
pub struct Training {
    trainer: Box<dyn Run>,
    /// Selected executor, or the CPU after a device fails.
    choice: ExecutorChoice,
    /// Settings with which the CPU continues after a device fails; none on the CPU.
    fallback: Option<Settings>,
    checkpoints: Option<Checkpoints>,
    shading_model: ShadingModel,
    iterations: u32,
    /// Time of all steps, without pauses and checkpoints.
    seconds: f64,
}

/// Outcome of a run.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Number of steps taken.
    pub iteration: u32,
    /// Time of all steps in seconds, without pauses and checkpoints.
    pub seconds: f64,
    /// Number of gradients that were skipped because they were not finite.
    pub nonfinite: usize,
    /// True if the observer ended the run before its last step.
    pub is_interrupted: bool,
}

impl Training {
    /// Starts a training; the CPU takes over from a device that fails at the start.
    ///
    /// # Errors
    ///
    /// An executor that is missing or rejects the scene; invalid views or points.
    pub fn new<O: Observer>(
        choice: &ExecutorChoice,
        settings: Settings,
        views: &dyn PictureSource,
        start: &Start<'_>,
        observer: &mut O,
    ) -> Result<Self, O::Error> {
        let (shading_model, iterations) = (ShadingModel::of_profile(&settings.profile), settings.iterations);
        let (trainer, is_on_device) = start_on(choice, settings.clone(), views, start, |note| observer.note(note))?;
        let choice = if is_on_device { choice.clone() } else { ExecutorChoice::Cpu };
        let fallback = is_on_device.then_some(settings);
        Ok(Self { trainer, choice, fallback, checkpoints: None, shading_model, iterations, seconds: 0.0 })
    }

    /// Shares the training with other ranks that were started with the same settings: all of them
    /// take the same steps and end together. Device failures have no CPU fallback. `description`
    /// identifies everything else, such as a checksum of the pictures.
    ///
    /// # Errors
    ///
    /// [`SceneError::Ranks`] if a rank is gone or was started with other settings, and failures of
    /// the executor.
    pub fn join(&mut self, exchange: Box<dyn Exchange>, description: &str) -> Result<(), SceneError> {
        self.fallback = None;
        let kind = if self.choice == ExecutorChoice::Cpu { "CPU" } else { "device" };
        self.trainer.join(exchange, &format!("{description} on a {kind}"))
    }

    /// Messages to other ranks so far; `None` on a single rank.
    pub fn traffic(&self) -> Option<Traffic> {
        self.trainer.progress().traffic
    }

    /// Writes checkpoints during the run and at its end. `seconds` is the time of earlier steps.
    #[must_use]
    pub fn with_checkpoints(self, checkpoints: Checkpoints, seconds: f64) -> Self {
        Self { checkpoints: Some(checkpoints), seconds, ..self }
    }

    /// Takes all steps, unless the observer interrupts them. Pauses after the iterations in
    /// `pauses`, except after the last one.
    ///
    /// # Errors
    ///
    /// Failures of the executor, unless the CPU takes over, and those of the observer. A picture
    /// that cannot be decoded, after a checkpoint was written.
    pub fn run<O: Observer>(&mut self, pauses: &[u32], observer: &mut O) -> Result<Outcome, O::Error> {
        loop {
            let (is_at_end, fault) = match self.prepare(observer) {
                Ok(is_at_end) => (is_at_end, None),
                Err(error @ SceneError::Picture(_)) => (true, Some(error)),
                Err(error) => {
                    self.fall_back_to_cpu(error.into(), observer)?;
                    continue;
                }
            };
            let done = if is_at_end { self.save_checkpoint(observer) } else { self.advance(pauses, observer) };
            match (done, fault) {
                (Err(error), _) => self.fall_back_to_cpu(error, observer)?,
                (Ok(()), Some(fault)) => return Err(fault.into()),
                (Ok(()), None) if is_at_end => break,
                (Ok(()), None) => {}
            }
        }
        Ok(Outcome {
            iteration: self.iteration(),
            seconds: self.seconds,
            nonfinite: self.trainer.progress().nonfinite,
            is_interrupted: !self.is_finished(),
        })
    }

    /// Uploads the pictures of the next step; returns true if there is no next step, or any rank is
    /// interrupted.
    fn prepare<O: Observer>(&mut self, observer: &O) -> Result<bool, SceneError> {
        if self.is_finished() {
            return Ok(true);
        }
        let start = Instant::now();
        let is_interrupted = self.trainer.prepare(observer.is_interrupted())?;
        self.seconds += start.elapsed().as_secs_f64();
        Ok(is_interrupted)
    }

    /// Takes a step, and pauses or writes a checkpoint if one is due.
    fn advance<O: Observer>(&mut self, pauses: &[u32], observer: &mut O) -> Result<(), O::Error> {
        observer.before_step(self)?;
        // Ranks agree on their end before the step.
        if observer.is_interrupted() && self.traffic().is_none() {
            return Ok(());
        }
        let start = Instant::now();
        self.trainer.step()?;
        self.seconds += start.elapsed().as_secs_f64();
        observer.after_step(self);
        if pauses.contains(&self.iteration()) && !self.is_finished() {
            observer.pause(self)?;
        }
        // Written after the pause, so that a resumed training has not missed it.
        let is_due = self.checkpoints.as_ref().is_some_and(|checkpoints| checkpoints.is_due(self.iteration()));
        if is_due { self.save_checkpoint(observer) } else { Ok(()) }
    }

    /// Writes a checkpoint, unless there is one of this iteration. The training continues if that
    /// fails, because there may be space for the next one.
    fn save_checkpoint<O: Observer>(&mut self, observer: &mut O) -> Result<(), O::Error> {
        let Some(checkpoints) = &mut self.checkpoints else { return Ok(()) };
        if checkpoints.last() == Some(self.trainer.progress().iteration) {
            return Ok(());
        }
        let written = checkpoints.write(self.trainer.snapshot()?, self.seconds);
        let has_failed = self.trainer.agree(written.is_err())?;
        if let Err(error) = written {
            observer.note(Note::CheckpointFailed { error: SceneError::from(error).into() });
        } else if has_failed {
            checkpoints.forget();
        }
        Ok(())
    }

    /// Continues on the CPU after a device fails, from the last checkpoint or else from the start,
    /// because the device may be in the middle of a step.
    fn fall_back_to_cpu<O: Observer>(&mut self, error: O::Error, observer: &mut O) -> Result<(), O::Error> {
        if !O::is_device_failure(&error) {
            return Err(error);
        }
        let Some(settings) = self.fallback.take() else { return Err(error) };
        let saved = self.checkpoints.as_ref().filter(|checkpoints| checkpoints.last().is_some());
        let checkpoint = saved.and_then(|saved| Some((saved.path(), saved.last()?)));
        observer.note(Note::GpuFailed { error, checkpoint });
        let (views, points) = observer.origin();
        let learned = saved.map(Checkpoints::read).transpose().map_err(SceneError::from)?;
        let start = learned.as_ref().map_or(Start::Points(points), Start::Checkpoint);
        let trainer = run::start(CpuExecutor::new(), settings, views, &start).map_err(SceneError::from)?;
        self.trainer = Box::new(trainer);
        self.choice = ExecutorChoice::Cpu;
        Ok(())
    }

    /// Number of steps taken.
    pub fn iteration(&self) -> u32 {
        self.trainer.progress().iteration
    }

    /// Returns whether all steps are taken.
    pub fn is_finished(&self) -> bool {
        self.iteration() >= self.iterations
    }

    /// Running mean of the PSNR of training pictures, in dB.
    pub fn psnr(&self) -> Option<f64> {
        self.trainer.progress().psnr
    }

    /// Number of Gaussians.
    pub fn gaussian_count(&self) -> usize {
        self.trainer.progress().gaussian_count
    }

    /// Executor of the training.
    pub const fn choice(&self) -> &ExecutorChoice {
        &self.choice
    }

    /// Returns whether the last step has a checkpoint.
    pub fn has_checkpoint(&self) -> bool {
        self.checkpoints.as_ref().is_some_and(|checkpoints| checkpoints.last() == Some(self.iteration()))
    }

    /// Time of all steps, in seconds.
    pub const fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Exposure of each picture, if exposures are learned.
    pub fn exposures(&self) -> Option<&[Exposure<f32>]> {
        self.trainer.progress().exposures
    }

    /// Copies the scene to the host.
    ///
    /// # Errors
    ///
    /// Failures of the executor.
    pub fn scene(&mut self) -> Result<Scene, SceneError> {
        Ok(Scene::of_training(self.trainer.download()?, self.shading_model))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::training::{checkpoint, run::Progress};
    use specula_core::{camera::Camera, state::TrainingState};
    use specula_train::{
        profile::by_name,
        trainer::{HostScene, Trainer},
        view::View,
    };
    use std::path::Path;

    /// Run that fails after three steps.
    struct Failing(Trainer<CpuExecutor>);

    impl Run for Failing {
        fn progress(&self) -> Progress<'_> {
            self.0.progress()
        }
        fn prepare(&mut self, wish: bool) -> Result<bool, SceneError> {
            Run::prepare(&mut self.0, wish)
        }
        fn step(&mut self) -> Result<(), SceneError> {
            if self.0.iteration() == 3 {
                return Err(SceneError::Executor("the device was lost".into()));
            }
            Run::step(&mut self.0)
        }
        fn download(&mut self) -> Result<HostScene, SceneError> {
            Run::download(&mut self.0)
        }
        fn snapshot(&mut self) -> Result<TrainingState<Vec<f32>>, SceneError> {
            Run::snapshot(&mut self.0)
        }
        fn join(&mut self, exchange: Box<dyn Exchange>, description: &str) -> Result<(), SceneError> {
            Run::join(&mut self.0, exchange, description)
        }
        fn agree(&mut self, wish: bool) -> Result<bool, SceneError> {
            Run::agree(&mut self.0, wish)
        }
    }

    const POINTS: [Point; 2] =
        [Point { position: [0.0; 3], color: [0.5; 3] }, Point { position: [0.1; 3], color: [0.5; 3] }];

    fn views() -> Vec<View> {
        let eye = glam::Vec3::new(0.0, -3.0, 0.5);
        let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, 32, 32);
        vec![View { name: "one".into(), camera, rgba: vec![200; 32 * 32 * 4], unclipped: None, normals: None }]
    }

    fn settings() -> Settings {
        let profile = by_name("3dgs", 6).expect("a profile of that name");
        Settings { profile, iterations: 6, seed: 0, background: [1.0; 3], random_points: 0 }
    }

    /// Observer that only gives the pictures and points again.
    struct Reloading(Vec<View>);

    impl Observer for Reloading {
        type Error = SceneError;

        fn is_device_failure(error: &SceneError) -> bool {
            error.is_device_failure()
        }
        fn origin(&self) -> (&dyn PictureSource, &[Point]) {
            (&self.0, &POINTS)
        }
    }

    /// Training that fails after three steps; on a device the CPU takes the rest.
    fn training(is_on_device: bool, folder: &Path, every: u32) -> Training {
        let trainer = Trainer::new(CpuExecutor::new(), settings(), &views(), &POINTS).expect("there is a view");
        let facts = checkpoint::describe(&settings(), String::new(), &views());
        Training {
            trainer: Box::new(Failing(trainer)),
            choice: ExecutorChoice::Gpu(String::new()),
            fallback: is_on_device.then(settings),
            checkpoints: Some(Checkpoints::new(folder, every, facts)),
            shading_model: ShadingModel::of_profile(&settings().profile),
            iterations: 6,
            seconds: 0.0,
        }
    }

    fn run(training: &mut Training) -> Result<HostScene, SceneError> {
        let outcome = training.run(&[], &mut Reloading(views()))?;
        assert_eq!((outcome.iteration, outcome.is_interrupted), (6, false), "all steps are taken");
        training.trainer.download()
    }

    #[test]
    fn the_cpu_continues_where_a_device_failed() {
        let mut whole = Trainer::new(CpuExecutor::new(), settings(), &views(), &POINTS).expect("there is a view");
        for _ in 0..6 {
            whole.step().expect("the processor trains");
        }
        let expected = whole.download().expect("the processor gives back");
        // From the second step, or from the start if there is no checkpoint.
        for every in [2, 0] {
            let folder = tempfile::tempdir().expect("a writable folder");
            let mut fallen_back = training(true, folder.path(), every);
            assert_eq!(
                run(&mut fallen_back).expect("the processor takes over"),
                expected,
                "a checkpoint every {every}"
            );
            assert_eq!(fallen_back.choice(), &ExecutorChoice::Cpu, "what measures follows");
        }
    }

    /// Observer that loses the device at the first pause.
    #[cfg(feature = "gpu")]
    struct Losing {
        fuse: Box<dyn Fn()>,
        views: Vec<View>,
        learned: Option<TrainingState<Vec<f32>>>,
    }

    #[cfg(feature = "gpu")]
    impl Observer for Losing {
        type Error = SceneError;

        fn is_device_failure(error: &SceneError) -> bool {
            error.is_device_failure()
        }
        fn pause(&mut self, training: &mut Training) -> Result<(), SceneError> {
            if self.learned.is_none() {
                self.learned = Some(training.checkpoints.as_ref().expect("there are checkpoints").read()?);
                (self.fuse)();
            }
            Ok(())
        }
        fn origin(&self) -> (&dyn PictureSource, &[Point]) {
            (&self.views, &POINTS)
        }
    }

    #[cfg(feature = "gpu")]
    #[test]
    fn the_cpu_continues_where_a_real_device_was_lost() {
        use specula_gpu::{Gpu, GpuExecutor};
        let gpu = match Gpu::new("") {
            Ok(gpu) => gpu,
            Err(error) => {
                assert!(std::env::var_os("CI").is_none(), "CI needs an adapter: {error}");
                return eprintln!("NOT TESTED, because {error}");
            }
        };
        let fuse = gpu.fuse();
        let folder = tempfile::tempdir().expect("a writable folder");
        let mut training = training(true, folder.path(), 2);
        training.trainer =
            Box::new(Trainer::new(GpuExecutor::new(gpu), settings(), &views(), &POINTS).expect("the device is there"));
        let mut observer = Losing { fuse: Box::new(fuse), views: views(), learned: None };
        let outcome = training.run(&[3], &mut observer);
        assert_eq!(outcome.expect("the processor takes over").iteration, 6, "all steps are taken");

        let learned = observer.learned.expect("the device was there for three steps");
        assert_eq!(learned.iteration, 2, "the last checkpoint before");
        let mut expected =
            Trainer::resume(CpuExecutor::new(), settings(), &views(), &learned).expect("it is the same training");
        while !expected.is_finished() {
            expected.step().expect("the processor trains");
        }
        let expected = expected.download().expect("the processor gives back");
        assert_eq!(training.trainer.download().expect("the processor gives back"), expected);
    }

    #[test]
    fn a_failure_of_the_cpu_ends_the_training() {
        let folder = tempfile::tempdir().expect("a writable folder");
        assert!(run(&mut training(false, folder.path(), 2)).is_err(), "nothing can continue");
        assert_eq!(checkpoint_of(folder.path()), 2, "what was saved stays");
    }

    fn checkpoint_of(folder: &Path) -> u32 {
        specula_io::checkpoint::read(folder).expect("it was written").state.iteration
    }

    #[test]
    fn a_full_disk_does_not_stop_a_training() {
        let folder = tempfile::tempdir().expect("a writable folder");
        let file = folder.path().join("file");
        std::fs::write(&file, "mine").expect("a writable folder");
        let mut training = training(true, &file, 1);
        training.trainer =
            Box::new(Trainer::new(CpuExecutor::new(), settings(), &views(), &POINTS).expect("there is a view"));
        run(&mut training).expect("it continues");
        assert!(!training.has_checkpoint(), "and says that there is no checkpoint");
    }
}
