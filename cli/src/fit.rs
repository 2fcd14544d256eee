//! Training, watched: progress, what is done at certain steps, an orderly end on Ctrl-C.

use crate::{
    checkpoint::Checkpoints,
    failure::Failure,
    interrupt, machine,
    progress::{self, Work},
    settings::shading_model_of,
};
use specula_core::{executor::Executor, expose::Exposure, state::TrainingState};
use specula_cpu::CpuExecutor;
use specula_report::number::group_digits;
use specula_scene::{ExecutorChoice, Scene, ShadingModel};
use specula_train::{
    start::Point,
    trainer::{HostScene, Settings, Trainer},
    view::View,
};
use specula_viewer::{LiveTraining, Request};
use std::{fmt, sync::Arc, time::Instant};

/// A run on some executor.
pub(crate) trait Run {
    /// Takes one step.
    fn step(&mut self) -> Result<(), Failure>;
    /// Steps taken.
    fn iteration(&self) -> u32;
    /// PSNR of the training pictures, in dB, a running mean.
    fn psnr(&self) -> Option<f64>;
    /// Gradients left out so far because they were not finite.
    fn nonfinite(&self) -> usize;
    /// Gaussians now.
    fn gaussian_count(&self) -> usize;
    /// How each picture was exposed, if that is learned.
    fn exposures(&self) -> Option<&[Exposure<f32>]>;
    /// The scene on the host.
    fn download(&mut self) -> Result<HostScene, Failure>;
    /// Everything that was learned, on the host.
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

/// Where a run starts.
#[derive(Debug)]
pub(crate) enum Start<'a> {
    /// At its beginning, from points.
    Points(&'a [Point]),
    /// From what it had learned when it was put aside.
    Learned(&'a TrainingState<Vec<f32>>),
}

/// Pictures and points of a training, read again.
pub(crate) type Reload<'a> = dyn Fn() -> Result<(Vec<View>, Vec<Point>), Failure> + 'a;

/// What it takes for the processor to go on where a device gave up.
struct Rescue<'a> {
    settings: Settings,
    reload: &'a Reload<'a>,
}

impl fmt::Debug for Rescue<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("Rescue")
    }
}

/// A training, on whatever executor was asked for.
#[derive(Debug)]
pub(crate) struct Training<'a> {
    trainer: Box<dyn Run>,
    /// What trains: what was asked for, or the processor after a device gave up.
    choice: ExecutorChoice,
    /// On a device that may be lost or run out of memory.
    rescue: Option<Rescue<'a>>,
    checkpoints: Option<Checkpoints>,
    shading_model: ShadingModel,
    iterations: u32,
    /// What steps have taken so far, without what was done in between.
    seconds: f64,
    /// Who watches.
    live: Option<Arc<LiveTraining>>,
}

/// How it went.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outcome {
    /// Steps taken.
    pub(crate) iteration: u32,
    /// Seconds that they took, without what was done in between.
    pub(crate) seconds: f64,
    /// Whether the user ended it.
    pub(crate) is_interrupted: bool,
}

impl<'a> Training<'a> {
    /// Makes ready. `reload` is asked for pictures and points where a device gives up.
    pub(crate) fn new(
        choice: &ExecutorChoice,
        settings: Settings,
        views: &[View],
        start: &Start<'_>,
        reload: &'a Reload<'a>,
    ) -> Result<Self, Failure> {
        let (shading_model, iterations) = (shading_model_of(&settings.profile), settings.iterations);
        let (trainer, is_on_device) = machine::train(choice, settings.clone(), views, start)?;
        let choice = if is_on_device { choice.clone() } else { ExecutorChoice::Cpu };
        let rescue = is_on_device.then_some(Rescue { settings, reload });
        Ok(Self { trainer, choice, rescue, checkpoints: None, shading_model, iterations, seconds: 0.0, live: None })
    }

    /// Puts what was learned aside on the way, and at the end; so many seconds have gone by.
    pub(crate) fn with_checkpoints(self, checkpoints: Checkpoints, seconds: f64) -> Self {
        Self { checkpoints: Some(checkpoints), seconds, ..self }
    }

    /// Somebody watches from now on.
    pub(crate) fn watch(&mut self, live: Arc<LiveTraining>) {
        self.live = Some(live);
    }

    /// Takes all steps; `pause` is called after those in `pauses`, and not after the last.
    pub(crate) fn run(
        &mut self,
        what: &str,

        pauses: &[u32],
        mut pause: impl FnMut(&mut Self) -> Result<(), Failure>,
    ) -> Result<Outcome, Failure> {
        let work = progress::work(what, self.iterations.into()).resumed(self.iteration().into(), self.seconds);
        loop {
            let is_at_end = self.is_finished() || interrupt::is_requested();
            let done = if is_at_end { self.put_aside() } else { self.advance(pauses, &work, &mut pause) };
            match done {
                Err(failure) => self.go_on_without_device(failure)?,
                Ok(()) if is_at_end => break,
                Ok(()) => {}
            }
        }
        work.finish();
        self.warn_of_nonfinite();
        let is_interrupted = !self.is_finished();
        Ok(Outcome { iteration: self.iteration(), seconds: self.seconds, is_interrupted })
    }

    /// A step, and what is done after it.
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
        // After the pause: who goes on from here has not missed it.
        let is_due = self.checkpoints.as_ref().is_some_and(|checkpoints| checkpoints.is_due(self.iteration()));
        if is_due { self.put_aside() } else { Ok(()) }
    }

    /// Shows the scene to who watches, if it is asked for, and waits while the training is paused.
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

    /// Writes a checkpoint where there is none of this iteration. A full disk is no reason to stop: there may be room
    /// when the next one comes.
    fn put_aside(&mut self) -> Result<(), Failure> {
        let Some(checkpoints) = &mut self.checkpoints else { return Ok(()) };
        if checkpoints.last() == Some(self.trainer.iteration()) {
            return Ok(());
        }
        match checkpoints.write(self.trainer.snapshot()?, self.seconds) {
            Err(failure @ Failure::File(_)) => {
                tracing::warn!("{failure}; the training goes on without this checkpoint");
                Ok(())
            }
            done => done,
        }
    }

    /// Goes on with the processor, from the last checkpoint or else from the start, where a device gave up: what the
    /// device holds then may be half of a step.
    fn go_on_without_device(&mut self, failure: Failure) -> Result<(), Failure> {
        if !failure.is_of_device() {
            return Err(failure);
        }
        let Some(Rescue { settings, reload }) = self.rescue.take() else { return Err(failure) };
        let saved = self.checkpoints.as_ref().filter(|checkpoints| checkpoints.last().is_some());
        tracing::warn!("{failure}; {}", saved.map_or_else(from_the_start, from_checkpoint));
        let (views, points) = reload()?;
        let learned = saved.map(Checkpoints::read).transpose()?;
        let start = learned.as_ref().map_or(Start::Points(&points), Start::Learned);
        self.trainer = Box::new(machine::begin(CpuExecutor::new(), settings, &views, &start)?);
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

    /// Steps taken.
    pub(crate) fn iteration(&self) -> u32 {
        self.trainer.iteration()
    }

    fn is_finished(&self) -> bool {
        self.iteration() >= self.iterations
    }

    /// What trains now.
    pub(crate) fn choice(&self) -> &ExecutorChoice {
        &self.choice
    }

    /// The checkpoint of the last step that was taken, if it could be written.
    pub(crate) fn is_put_aside(&self) -> bool {
        self.checkpoints.as_ref().is_some_and(|checkpoints| checkpoints.last() == Some(self.iteration()))
    }

    /// Seconds that steps have taken.
    pub(crate) fn seconds(&self) -> f64 {
        self.seconds
    }

    /// How each picture was exposed, if that is learned.
    pub(crate) fn exposures(&self) -> Option<&[Exposure<f32>]> {
        self.trainer.exposures()
    }

    /// The scene as it is now.
    pub(crate) fn scene(&mut self) -> Result<Scene, Failure> {
        Ok(Scene::of_training(self.trainer.download()?, self.shading_model))
    }
}

fn from_checkpoint(checkpoints: &Checkpoints) -> String {
    let (place, last) = (checkpoints.place(), checkpoints.last().unwrap_or_default());
    format!(
        "iteration {last} is in {place:?}, from where the processor goes on; to do that later press Ctrl-C, and start \
         again with --resume --executor cpu"
    )
}

fn from_the_start() -> String {
    "there is no checkpoint yet, so the processor begins again".to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checkpoint;
    use specula_core::camera::Camera;
    use specula_train::profile::by_name;
    use std::path::Path;

    /// A run that gives up after three steps.
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

    /// A training whose run gives up after three steps; on a device it leaves the rest to the processor.
    fn training(is_on_device: bool, folder: &Path, every: u32) -> Training<'static> {
        let trainer = Trainer::new(CpuExecutor::new(), settings(), &views(), &POINTS).expect("there is a view");
        let facts = checkpoint::facts_of(&settings(), String::new(), &views());
        Training {
            trainer: Box::new(Failing(trainer)),
            choice: ExecutorChoice::Gpu(String::new()),
            rescue: is_on_device.then(|| Rescue { settings: settings(), reload: &reload }),
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
    fn the_processor_goes_on_where_a_device_gave_up() {
        let mut whole = Trainer::new(CpuExecutor::new(), settings(), &views(), &POINTS).expect("there is a view");
        for _ in 0..6 {
            whole.step().expect("the processor trains");
        }
        let expected = whole.download().expect("the processor gives back");
        // From the second step, or from the start where there is no checkpoint.
        for every in [2, 0] {
            let folder = tempfile::tempdir().expect("there is room");
            let mut rescued = training(true, folder.path(), every);
            assert_eq!(run(&mut rescued).expect("the processor takes over"), expected, "a checkpoint every {every}");
            assert_eq!(rescued.choice(), &ExecutorChoice::Cpu, "what measures follows");
        }
    }

    #[cfg(feature = "gpu")]
    #[test]
    fn the_processor_goes_on_where_a_real_device_went_away() {
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
        run(&mut training).expect("it goes on");
        assert!(!training.is_put_aside(), "and says that there is no checkpoint");
    }
}
