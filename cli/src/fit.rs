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
use specula_train::{
    start::Point,
    trainer::{HostScene, Settings, Trainer},
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
}

/// A training, on whatever executor was asked for.
#[derive(Debug)]
pub(crate) struct Training {
    trainer: Box<dyn Run>,
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
        let trainer = machine::train(choice, settings, views, points, talk)?;
        Ok(Self { trainer, reading, iterations, seconds: 0.0 })
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
            self.trainer.step()?;
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

    #[test]
    fn digits_are_grouped_from_the_right() {
        assert_eq!([0, 999, 1000, 1_234_567].map(thousands), ["0", "999", "1 000", "1 234 567"]);
    }
}
