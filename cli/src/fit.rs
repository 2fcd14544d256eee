//! Training, watched: progress, what is done at certain steps, an orderly end on Ctrl-C.

use crate::{
    convention::Reading,
    failure::Failure,
    interrupt,
    machine::{self, ExecutorChoice},
    progress::{Talk, Work},
    scene::Scene,
    settings::reading_of,
};
use specula_core::executor::Executor;
use specula_cpu::CpuExecutor;
use specula_train::{
    start::Point,
    trainer::{HostScene, Settings, Snapshot, Trainer},
    view::View,
};
use std::{fmt, time::Instant};

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
    /// The scene on the host.
    fn download(&mut self) -> Result<HostScene, Failure>;
    /// Everything that was learned, on the host.
    fn snapshot(&mut self) -> Result<Snapshot, Failure>;
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
    fn download(&mut self) -> Result<HostScene, Failure> {
        self.download().map_err(Failure::from)
    }
    fn snapshot(&mut self) -> Result<Snapshot, Failure> {
        self.snapshot().map_err(Failure::from)
    }
}

/// What it takes for the processor to go on where a device gave up.
#[derive(Debug)]
pub(crate) struct Rescue {
    settings: Settings,
    views: Vec<View>,
    last: Snapshot,
}

impl Rescue {
    /// How many steps are lost at most.
    const EVERY: u32 = 500;

    /// Of a run that begins.
    pub(crate) fn new(run: &mut dyn Run, settings: Settings, views: &[View]) -> Result<Self, Failure> {
        Ok(Self { settings, views: views.to_vec(), last: run.snapshot()? })
    }

    /// Notes what a run has learned, now and then.
    fn note(&mut self, run: &mut dyn Run) -> Result<(), Failure> {
        if run.iteration().is_multiple_of(Self::EVERY) {
            self.last = run.snapshot()?;
        }
        Ok(())
    }

    /// The run, on the processor.
    fn go_on(self) -> Result<Box<dyn Run>, Failure> {
        Ok(Box::new(Trainer::resume(CpuExecutor::new(), self.settings, &self.views, self.last)?))
    }
}

/// A training, on whatever executor was asked for.
#[derive(Debug)]
pub(crate) struct Training {
    trainer: Box<dyn Run>,
    /// On a device that may be lost or run out of memory.
    rescue: Option<Rescue>,
    reading: Reading,
    iterations: u32,
    /// What steps have taken so far, without what was done in between.
    seconds: f64,
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

impl Training {
    /// Makes ready.
    pub(crate) fn new(
        choice: &ExecutorChoice,
        settings: Settings,
        views: &[View],
        points: &[Point],
        talk: Talk,
    ) -> Result<Self, Failure> {
        let (reading, iterations) = (reading_of(&settings.profile), settings.iterations);
        let (trainer, rescue) = machine::train(choice, settings, views, points, talk)?;
        Ok(Self { trainer, rescue, reading, iterations, seconds: 0.0 })
    }

    /// Takes all steps; `pause` is called after those in `pauses`, and not after the last.
    pub(crate) fn run(
        &mut self,
        what: &str,
        talk: Talk,
        pauses: &[u32],
        mut pause: impl FnMut(&mut Self, &Work) -> Result<(), Failure>,
    ) -> Result<Outcome, Failure> {
        let work = talk.work(what, self.iterations.into());
        while !self.is_finished() && !interrupt::is_requested() {
            let start = Instant::now();
            self.step(&work)?;
            self.seconds += start.elapsed().as_secs_f64();
            work.done(self.iteration().into(), || self.message());
            if pauses.contains(&self.iteration()) && !self.is_finished() {
                pause(self, &work)?;
            }
        }
        work.finish();
        self.warn_of_nonfinite(talk);
        let is_interrupted = !self.is_finished();
        Ok(Outcome { iteration: self.iteration(), seconds: self.seconds, is_interrupted })
    }

    /// One step, or what happens instead.
    fn step(&mut self, work: &Work) -> Result<(), Failure> {
        let done = self.trainer.step().and_then(|()| match &mut self.rescue {
            Some(rescue) => rescue.note(self.trainer.as_mut()),
            None => Ok(()),
        });
        let Err(failure) = done else { return Ok(()) };
        let Some(rescue) = self.rescue.take() else { return Err(failure) };
        work.note(&format!("{failure}; the processor goes on from iteration {}", rescue.last.iteration()));
        self.trainer = rescue.go_on()?;
        Ok(())
    }

    fn message(&self) -> String {
        let psnr = self.trainer.psnr().map_or(String::new(), |psnr| format!("PSNR {psnr:.2} dB, "));
        format!("{psnr}{} Gaussians", thousands(self.trainer.gaussian_count()))
    }

    fn warn_of_nonfinite(&self, talk: Talk) {
        let count = self.trainer.nonfinite();
        if count > 0 {
            talk.note(&format!("{count} gradients were not finite and were left out; the result may be worse for it"));
        }
    }

    /// Steps taken.
    pub(crate) fn iteration(&self) -> u32 {
        self.trainer.iteration()
    }

    fn is_finished(&self) -> bool {
        self.iteration() >= self.iterations
    }

    /// Seconds that steps have taken.
    pub(crate) fn seconds(&self) -> f64 {
        self.seconds
    }

    /// The scene as it is now.
    pub(crate) fn scene(&mut self) -> Result<Scene, Failure> {
        Ok(Scene::of_training(self.trainer.download()?, self.reading))
    }
}

/// A number in groups of three digits.
pub(crate) fn thousands(number: usize) -> String {
    let digits = number.to_string();
    let mut grouped = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            grouped.push(' ');
        }
        grouped.push(digit);
    }
    grouped
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::camera::Camera;
    use specula_train::profile::by_name;

    /// A run that gives up after three steps.
    struct Failing(Trainer<CpuExecutor>);

    impl Run for Failing {
        fn step(&mut self) -> Result<(), Failure> {
            if self.0.iteration() == 3 {
                return Err(Failure::Input("the device was lost".to_owned()));
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
        fn download(&mut self) -> Result<HostScene, Failure> {
            Run::download(&mut self.0)
        }
        fn snapshot(&mut self) -> Result<Snapshot, Failure> {
            Run::snapshot(&mut self.0)
        }
    }

    fn training(is_rescued: bool) -> Training {
        let eye = glam::Vec3::new(0.0, -3.0, 0.5);
        let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, 32, 32);
        let views = [View { name: "one".into(), camera, rgba: vec![200; 32 * 32 * 4], normals: None }];
        let points = [Point { position: [0.0; 3], color: [0.5; 3] }, Point { position: [0.1; 3], color: [0.5; 3] }];
        let profile = by_name("3dgs", 6).expect("a profile of that name");
        let settings = Settings { profile, iterations: 6, seed: 0, background: [1.0; 3], random_points: 0 };
        let trainer = Trainer::new(CpuExecutor::new(), settings.clone(), &views, &points).expect("there is a view");
        let mut run = Failing(trainer);
        let reading = reading_of(&settings.profile);
        let rescue = is_rescued.then(|| Rescue::new(&mut run, settings, &views).expect("the processor gives back"));
        Training { trainer: Box::new(run), rescue, reading, iterations: 6, seconds: 0.0 }
    }

    #[test]
    fn the_processor_goes_on_where_a_device_gave_up() {
        let quiet = Talk { quiet: true };
        let mut rescued = training(true);
        let outcome = rescued.run("training", quiet, &[], |_, _| Ok(())).expect("the processor takes over");
        assert_eq!((outcome.iteration, outcome.is_interrupted), (6, false), "all steps are taken");
        let lost = training(false).run("training", quiet, &[], |_, _| Ok(()));
        assert!(lost.is_err(), "a failure of the processor itself is one");
    }

    #[test]
    fn digits_are_grouped_from_the_right() {
        assert_eq!([0, 999, 1000, 1_234_567].map(thousands), ["0", "999", "1 000", "1 234 567"]);
    }
}
