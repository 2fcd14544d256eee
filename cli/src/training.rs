//! Training loop: progress, checkpoints, pauses at given iterations, an orderly end on Ctrl-C, and
//! the CPU as a fallback for devices that fail.

mod run;

use crate::{
    checkpoint::Checkpoints,
    failure::Failure,
    interrupt,
    progress::{self, Work},
    settings::shading_model_of,
};
use run::{Run, start_on};
pub(crate) use run::{Start, check};
use specula_core::expose::Exposure;
use specula_cpu::CpuExecutor;
use specula_report::number::group_digits;
use specula_scene::{ExecutorChoice, Scene, ShadingModel};
use specula_train::{start::Point, trainer::Settings, view::View};
use specula_viewer::{LiveTraining, Request};
use std::{fmt, sync::Arc, time::Instant};

/// Reads the pictures and points of a training again.
pub(crate) type Reload<'a> = dyn Fn() -> Result<(Vec<View>, Vec<Point>), Failure> + 'a;

/// Inputs with which the CPU continues after a device fails.
struct CpuFallback<'a> {
    settings: Settings,
    reload: &'a Reload<'a>,
}

impl fmt::Debug for CpuFallback<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("CpuFallback")
    }
}

/// Training on the selected executor.
#[derive(Debug)]
pub(crate) struct Training<'a> {
    trainer: Box<dyn Run>,
    /// Selected executor, or the CPU after a device fails.
    choice: ExecutorChoice,
    /// Fallback of a training on a device, which may be lost or run out of memory.
    fallback: Option<CpuFallback<'a>>,
    checkpoints: Option<Checkpoints>,
    shading_model: ShadingModel,
    iterations: u32,
    /// Time of all steps, without pauses and checkpoints.
    seconds: f64,
    /// Feed of a viewer.
    live: Option<Arc<LiveTraining>>,
}

/// Outcome of a run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outcome {
    /// Number of steps taken.
    pub(crate) iteration: u32,
    /// Time of all steps in seconds, without pauses and checkpoints.
    pub(crate) seconds: f64,
    /// True if the user ended it.
    pub(crate) is_interrupted: bool,
}

impl<'a> Training<'a> {
    /// Starts a training. `reload` provides pictures and points again if a device fails.
    ///
    /// # Errors
    /// Those of the executor and of the trainer.
    pub(crate) fn new(
        choice: &ExecutorChoice,
        settings: Settings,
        views: &[View],
        start: &Start<'_>,
        reload: &'a Reload<'a>,
    ) -> Result<Self, Failure> {
        let (shading_model, iterations) = (shading_model_of(&settings.profile), settings.iterations);
        let (trainer, is_on_device) = start_on(choice, settings.clone(), views, start)?;
        let choice = if is_on_device { choice.clone() } else { ExecutorChoice::Cpu };
        let fallback = is_on_device.then_some(CpuFallback { settings, reload });
        Ok(Self { trainer, choice, fallback, checkpoints: None, shading_model, iterations, seconds: 0.0, live: None })
    }

    /// Writes checkpoints during the run and at its end. `seconds` is the time of earlier steps.
    pub(crate) fn with_checkpoints(self, checkpoints: Checkpoints, seconds: f64) -> Self {
        Self { checkpoints: Some(checkpoints), seconds, ..self }
    }

    /// Connects the feed of a viewer.
    pub(crate) fn watch(&mut self, live: Arc<LiveTraining>) {
        self.live = Some(live);
    }

    /// Takes all steps. Calls `pause` after the iterations in `pauses`, except after the last one.
    ///
    /// # Errors
    /// Failures of the executor, unless the CPU takes over, and those of `pause`.
    pub(crate) fn run(
        &mut self,
        title: &str,
        pauses: &[u32],
        mut pause: impl FnMut(&mut Self) -> Result<(), Failure>,
    ) -> Result<Outcome, Failure> {
        let work = progress::work(title, self.iterations.into()).resumed(self.iteration().into(), self.seconds);
        loop {
            let is_at_end = self.is_finished() || interrupt::is_requested();
            let done = if is_at_end { self.save_checkpoint() } else { self.advance(pauses, &work, &mut pause) };
            match done {
                Err(failure) => self.fall_back_to_cpu(failure)?,
                Ok(()) if is_at_end => break,
                Ok(()) => {}
            }
        }
        work.finish();
        self.warn_of_nonfinite();
        let is_interrupted = !self.is_finished();
        Ok(Outcome { iteration: self.iteration(), seconds: self.seconds, is_interrupted })
    }

    /// Takes a step, and pauses or writes a checkpoint if one is due.
    fn advance(
        &mut self,
        pauses: &[u32],
        work: &Work,
        pause: &mut impl FnMut(&mut Self) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        self.show()?;
        if interrupt::is_requested() {
            return Ok(());
        }
        let start = Instant::now();
        self.trainer.step()?;
        self.seconds += start.elapsed().as_secs_f64();
        if let Some(live) = &self.live {
            live.record(self.iteration(), self.seconds, self.trainer.psnr(), self.trainer.gaussian_count());
        }
        work.done(self.iteration().into(), || self.message());
        if pauses.contains(&self.iteration()) && !self.is_finished() {
            pause(self)?;
        }
        // Written after the pause, so that a resumed training has not missed it.
        let is_due = self.checkpoints.as_ref().is_some_and(|checkpoints| checkpoints.is_due(self.iteration()));
        if is_due { self.save_checkpoint() } else { Ok(()) }
    }

    /// Serves the requests of a viewer: publishes the scene, or waits while the training is paused.
    fn show(&mut self) -> Result<(), Failure> {
        let Some(live) = self.live.clone() else { return Ok(()) };
        while let Some(request) = live.request() {
            live.notice().into_iter().for_each(|notice| tracing::info!("{notice}"));
            match request {
                Request::Scene => live.publish(self.scene()?, self.iteration()),
                Request::Wait if interrupt::is_requested() => break,
                Request::Wait => live.wait(),
            }
        }
        live.notice().into_iter().for_each(|notice| tracing::info!("{notice}"));
        Ok(())
    }

    /// Writes a checkpoint, unless there is one of this iteration. The training continues if that
    /// fails, since there may be space for the next one.
    fn save_checkpoint(&mut self) -> Result<(), Failure> {
        let Some(checkpoints) = &mut self.checkpoints else { return Ok(()) };
        if checkpoints.last() == Some(self.trainer.iteration()) {
            return Ok(());
        }
        match checkpoints.write(self.trainer.snapshot()?, self.seconds) {
            Err(failure @ Failure::File(_)) => {
                tracing::warn!("{failure}; the training continues without this checkpoint");
                Ok(())
            }
            done => done,
        }
    }

    /// Continues on the CPU after a device fails, from the last checkpoint or else from the start,
    /// since the state on the device may be that of half a step.
    fn fall_back_to_cpu(&mut self, failure: Failure) -> Result<(), Failure> {
        if !failure.is_of_device() {
            return Err(failure);
        }
        let Some(CpuFallback { settings, reload }) = self.fallback.take() else { return Err(failure) };
        let saved = self.checkpoints.as_ref().filter(|checkpoints| checkpoints.last().is_some());
        tracing::warn!("{failure}; {}", saved.map_or_else(from_the_start, from_checkpoint));
        let (views, points) = reload()?;
        let learned = saved.map(Checkpoints::read).transpose()?;
        let start = learned.as_ref().map_or(Start::Points(&points), Start::Checkpoint);
        self.trainer = Box::new(run::start(CpuExecutor::new(), settings, &views, &start)?);
        self.choice = ExecutorChoice::Cpu;
        Ok(())
    }

    fn message(&self) -> String {
        let psnr = self.trainer.psnr().map_or(String::new(), |psnr| format!("PSNR {psnr:.2} dB, "));
        format!("{psnr}{} Gaussians", group_digits(self.trainer.gaussian_count()))
    }

    fn warn_of_nonfinite(&self) {
        let count = self.trainer.nonfinite();
        if count > 0 {
            tracing::warn!("{count} gradients were not finite and were skipped; the result may be worse for it");
        }
    }

    /// Number of steps taken.
    pub(crate) fn iteration(&self) -> u32 {
        self.trainer.iteration()
    }

    fn is_finished(&self) -> bool {
        self.iteration() >= self.iterations
    }

    /// Executor of the training.
    pub(crate) fn choice(&self) -> &ExecutorChoice {
        &self.choice
    }

    /// True if the last step has a checkpoint.
    pub(crate) fn has_checkpoint(&self) -> bool {
        self.checkpoints.as_ref().is_some_and(|checkpoints| checkpoints.last() == Some(self.iteration()))
    }

    /// Time of all steps, in seconds.
    pub(crate) fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Exposure of each picture, if exposures are learned.
    pub(crate) fn exposures(&self) -> Option<&[Exposure<f32>]> {
        self.trainer.exposures()
    }

    /// Copies the scene to the host.
    ///
    /// # Errors
    /// Failures of the executor.
    pub(crate) fn scene(&mut self) -> Result<Scene, Failure> {
        Ok(Scene::of_training(self.trainer.download()?, self.shading_model))
    }
}

fn from_checkpoint(checkpoints: &Checkpoints) -> String {
    let (place, last) = (checkpoints.path(), checkpoints.last().unwrap_or_default());
    format!(
        "the CPU continues from iteration {last} in {place:?}; to do that later press Ctrl-C, and start \
         again with --resume --executor cpu"
    )
}

fn from_the_start() -> String {
    "there is no checkpoint yet, so the CPU begins again".to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checkpoint;
    use specula_core::{camera::Camera, state::TrainingState};
    use specula_train::{
        profile::by_name,
        trainer::{HostScene, Trainer},
    };
    use std::path::Path;

    /// Run that fails after three steps.
    struct Failing(Trainer<CpuExecutor>);

    impl Run for Failing {
        fn step(&mut self) -> Result<(), Failure> {
            if self.0.iteration() == 3 {
                return Err(Failure::Device("the device was lost".to_owned()));
            }
            Run::step(&mut self.0)
        }
        fn iteration(&self) -> u32 {
            self.0.iteration()
        }
        fn psnr(&self) -> Option<f64> {
            self.0.psnr()
        }
        fn nonfinite(&self) -> usize {
            self.0.nonfinite()
        }
        fn gaussian_count(&self) -> usize {
            self.0.gaussians().count
        }
        fn exposures(&self) -> Option<&[Exposure<f32>]> {
            Run::exposures(&self.0)
        }
        fn download(&mut self) -> Result<HostScene, Failure> {
            Run::download(&mut self.0)
        }
        fn snapshot(&mut self) -> Result<TrainingState<Vec<f32>>, Failure> {
            Run::snapshot(&mut self.0)
        }
    }

    const POINTS: [Point; 2] =
        [Point { position: [0.0; 3], color: [0.5; 3] }, Point { position: [0.1; 3], color: [0.5; 3] }];

    fn views() -> Vec<View> {
        let eye = glam::Vec3::new(0.0, -3.0, 0.5);
        let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, 32, 32);
        vec![View { name: "one".into(), camera, rgba: vec![200; 32 * 32 * 4], normals: None }]
    }

    fn settings() -> Settings {
        let profile = by_name("3dgs", 6).expect("a profile of that name");
        Settings { profile, iterations: 6, seed: 0, background: [1.0; 3], random_points: 0 }
    }

    fn reload() -> Result<(Vec<View>, Vec<Point>), Failure> {
        Ok((views(), POINTS.to_vec()))
    }

    /// Training whose run fails after three steps; on a device the CPU takes the rest.
    fn training(is_on_device: bool, folder: &Path, every: u32) -> Training<'static> {
        let trainer = Trainer::new(CpuExecutor::new(), settings(), &views(), &POINTS).expect("there is a view");
        let facts = checkpoint::describe(&settings(), String::new(), &views());
        Training {
            trainer: Box::new(Failing(trainer)),
            choice: ExecutorChoice::Gpu(String::new()),
            fallback: is_on_device.then(|| CpuFallback { settings: settings(), reload: &reload }),
            checkpoints: Some(Checkpoints::new(folder, every, facts)),
            shading_model: shading_model_of(&settings().profile),
            iterations: 6,
            seconds: 0.0,
            live: None,
        }
    }

    fn run(training: &mut Training<'_>) -> Result<HostScene, Failure> {
        let outcome = training.run("training", &[], |_| Ok(()))?;
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
        // From the second step, or from the start where there is no checkpoint.
        for every in [2, 0] {
            let folder = tempfile::tempdir().expect("there is room");
            let mut fallen_back = training(true, folder.path(), every);
            assert_eq!(
                run(&mut fallen_back).expect("the processor takes over"),
                expected,
                "a checkpoint every {every}"
            );
            assert_eq!(fallen_back.choice(), &ExecutorChoice::Cpu, "what measures follows");
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
        let folder = tempfile::tempdir().expect("there is room");
        let mut training = training(true, folder.path(), 2);
        training.trainer =
            Box::new(Trainer::new(GpuExecutor::new(gpu), settings(), &views(), &POINTS).expect("the device is there"));
        let mut learned = None;
        let outcome = training.run("training", &[3], |training| {
            if learned.is_none() {
                learned = Some(training.checkpoints.as_ref().expect("there are checkpoints").read()?);
                fuse();
            }
            Ok(())
        });
        assert_eq!(outcome.expect("the processor takes over").iteration, 6, "all steps are taken");

        let learned = learned.expect("the device was there for three steps");
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
    fn a_failure_of_the_processor_itself_is_one() {
        let folder = tempfile::tempdir().expect("there is room");
        assert!(run(&mut training(false, folder.path(), 2)).is_err(), "nothing can go on");
        assert_eq!(checkpoint_of(folder.path()), 2, "what was saved stays");
    }

    fn checkpoint_of(folder: &Path) -> u32 {
        specula_io::checkpoint::read(folder).expect("it was written").state.iteration
    }

    #[test]
    fn a_full_disk_is_no_reason_to_stop() {
        let folder = tempfile::tempdir().expect("there is room");
        let file = folder.path().join("file");
        std::fs::write(&file, "mine").expect("there is room");
        let mut training = training(true, &file, 1);
        training.trainer =
            Box::new(Trainer::new(CpuExecutor::new(), settings(), &views(), &POINTS).expect("there is a view"));
        run(&mut training).expect("it continues");
        assert!(!training.has_checkpoint(), "and says that there is no checkpoint");
    }
}
