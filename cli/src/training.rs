//! Observer of a training: progress on stderr, the page that shows it, an orderly end on Ctrl-C,
//! and notes that name the program's options.

use crate::{
    failure::Failure,
    interrupt,
    progress::{self, Work},
    ranks::Ranks,
    time_left::Plan,
};
use core::fmt;
use specula_core::camera::Camera;
use specula_scene::{
    number::group_digits,
    training::{Note, Observer, Outcome, Training},
};
use specula_train::{pictures::PictureSource, profile::Profile, start::Point, trainer::Settings};
use specula_viewer::{LiveTraining, Request};
use std::sync::Arc;

/// Action at a pause.
type Pause<'a> = dyn FnMut(&mut Training) -> Result<(), Failure> + 'a;

/// Program that runs a training.
pub(crate) struct Session<'a> {
    pictures: &'a dyn PictureSource,
    points: &'a [Point],
    /// Mean number of pixels of a picture, and number of pictures.
    pixels: usize,
    views: usize,
    /// Prefix of the notes of one of several ranks.
    prefix: String,
    pause: Option<Box<Pause<'a>>>,
    /// Feed of a viewer.
    live: Option<Arc<LiveTraining>>,
    /// Progress of the run.
    work: Option<Work>,
    expectation: Option<Expectation>,
    /// Number of steps until the session ends, if it ends before the training.
    steps_left: Option<u32>,
}

impl fmt::Debug for Session<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("Session")
    }
}

impl<'a> Session<'a> {
    /// Session without pauses, for a training that starts from these pictures and points.
    pub(crate) fn new(pictures: &'a dyn PictureSource, points: &'a [Point]) -> Self {
        Self {
            pictures,
            points,
            pixels: 0,
            views: 0,
            prefix: String::new(),
            pause: None,
            live: None,
            work: None,
            expectation: None,
            steps_left: None,
        }
    }

    /// Ends the training after some steps.
    pub(crate) fn ending_after(self, steps: u32) -> Self {
        Self { steps_left: Some(steps), ..self }
    }

    /// Estimates the time of steps from the sizes of these cameras' pictures.
    pub(crate) fn showing<'c>(self, cameras: impl ExactSizeIterator<Item = &'c Camera>) -> Self {
        let count = cameras.len().max(1);
        let pixels = cameras.map(|camera| camera.width as usize * camera.height as usize).sum::<usize>() / count;
        Self { pixels, views: count, ..self }
    }

    /// Session of one of several ranks.
    pub(crate) fn of(self, ranks: &Ranks<'_>) -> Self {
        Self { prefix: ranks.prefix(), ..self }
    }

    /// Calls `pause` when the training pauses, and connects the feed of a viewer.
    pub(crate) fn with(
        self,
        pause: impl FnMut(&mut Training) -> Result<(), Failure> + 'a,
        live: Option<Arc<LiveTraining>>,
    ) -> Self {
        Self { pause: Some(Box::new(pause)), live, ..self }
    }

    /// Takes all steps of a training.
    ///
    /// # Errors
    /// Those of [`Training::run`].
    pub(crate) fn run(
        mut self,
        training: &mut Training,
        title: &str,
        Settings { profile, iterations, .. }: &Settings,
        pauses: &[u32],
    ) -> Result<Outcome, Failure> {
        let work = progress::work(title, (*iterations).into());
        let sizes = [self.pixels, self.views];
        let expectation =
            Expectation::new(training.gaussian_count(), training.iteration(), profile, *iterations, sizes);
        let expectation = expectation.pausing(pauses);
        self.work = Some(work.resumed(training.iteration().into(), training.seconds(), expectation.plan(0)));
        self.expectation = Some(expectation);
        let outcome = training.run(pauses, &mut self)?;
        self.work.into_iter().for_each(Work::finish);
        let count = outcome.nonfinite;
        if count > 0 {
            tracing::warn!("{count} gradients were not finite and were skipped; the result may be worse");
        }
        Ok(outcome)
    }
}

/// Expected costs of the steps of a training, whose number of Gaussians changes.
pub(crate) struct Expectation {
    profile: Profile,
    iterations: u32,
    pixels: usize,
    /// Number of Gaussians at the start, and the share of their growth before it.
    start: (usize, f64),
    /// Steps that take longer: those that rebuild the scene's surface, or follow a pause.
    slow: Vec<u64>,
    /// Number of Gaussians now.
    count: usize,
    /// Step after which every picture has been decoded.
    warm_up: u64,
}

impl Expectation {
    /// Expectation of a training that has `count` Gaussians after `iteration`, with pictures of so
    /// many pixels, and so many views.
    pub(crate) fn new(
        count: usize,
        iteration: u32,
        profile: &Profile,
        iterations: u32,
        [pixels, views]: [usize; 2],
    ) -> Self {
        let has_new_surface =
            |step: &u32| profile.near_field.is_some_and(|schedule| schedule.is_due(*step, iterations));
        Self {
            profile: profile.clone(),
            iterations,
            pixels,
            start: (count, profile.share_of_growth(iteration, iterations)),
            slow: (1..=iterations).filter(has_new_surface).map(u64::from).collect(),
            count,
            warm_up: u64::from(iteration) + views as u64,
        }
    }

    /// Cost of all steps and surfaces, in the unit of [`Profile::step_cost`].
    pub(crate) fn cost(&self) -> f64 {
        let Plan { costs, pauses, pause_cost, .. } = self.plan(0);
        costs.last().copied().unwrap_or_default() + pauses.len() as f64 * pause_cost
    }

    /// Cost of the steps after `from` up to `to`.
    pub(crate) fn cost_of(&self, from: u32, to: u32) -> f64 {
        let costs = self.plan(0).costs;
        costs[to as usize] - costs[from as usize]
    }

    /// The same with pauses after some steps.
    fn pausing(mut self, pauses: &[u32]) -> Self {
        let pauses = pauses.iter().map(|step| u64::from(step + 1)).filter(|step| *step <= u64::from(self.iterations));
        self.slow.extend(pauses);
        self.slow.sort_unstable();
        self.slow.dedup();
        self
    }

    /// Plan of the steps after `iteration`: the number of Gaussians keeps growing at its rate so
    /// far, at first at the usual one.
    fn plan(&self, iteration: u32) -> Plan {
        /// Growth of a typical scene, relative to its start, and the weight of this prior as a
        /// share of growth.
        const USUAL: f64 = 1.7;
        const WEIGHT: f64 = 0.3;
        /// About the time that a surface takes, in the unit of [`Profile::step_cost`].
        const SURFACE: f64 = 7e6;
        let (first, share_before) = (self.start.0.max(1) as f64, self.start.1);
        let share = |step| (self.profile.share_of_growth(step, self.iterations) - share_before).max(0.0);
        let so_far = self.count as f64 / first - 1.0;
        let growth = (USUAL * WEIGHT + so_far) / (WEIGHT + share(iteration));
        let now = 1.0 + growth * share(iteration);
        let costs = (0..=self.iterations).scan(0.0, |sum, step| {
            if step > 0 {
                let count = self.count as f64 * ((1.0 + growth * share(step)) / now.max(0.1)).max(0.0);
                *sum += self.profile.step_cost(step, self.iterations, self.pixels, count);
            }
            Some(*sum)
        });
        Plan { costs: costs.collect(), pauses: self.slow.clone(), pause_cost: SURFACE, warm_up: self.warm_up }
    }
}

impl Observer for Session<'_> {
    type Error = Failure;

    fn is_device_failure(failure: &Failure) -> bool {
        failure.is_of_device()
    }

    fn origin(&self) -> (&dyn PictureSource, &[Point]) {
        (self.pictures, self.points)
    }

    fn is_interrupted(&self) -> bool {
        self.steps_left == Some(0) || interrupt::is_requested()
    }

    /// Serves the requests of a viewer: publishes the scene, or waits while the training is paused.
    fn before_step(&mut self, training: &mut Training) -> Result<(), Failure> {
        let Some(live) = &self.live else { return Ok(()) };
        while let Some(request) = live.request() {
            live.notice().into_iter().for_each(|notice| tracing::info!("{notice}"));
            match request {
                Request::Scene => live.publish(training.scene()?, training.iteration()),
                Request::Wait if interrupt::is_requested() => break,
                Request::Wait => live.wait(),
            }
        }
        live.notice().into_iter().for_each(|notice| tracing::info!("{notice}"));
        Ok(())
    }

    fn after_step(&mut self, training: &Training) {
        self.steps_left = self.steps_left.map(|steps| steps - 1);
        let (iteration, psnr, count) = (training.iteration(), training.psnr(), training.gaussian_count());
        if let Some(live) = &self.live {
            live.record(iteration, training.seconds(), psnr, count);
        }
        let message = || {
            let psnr = psnr.map_or(String::new(), |psnr| format!("{psnr:.2} dB on training pictures, "));
            format!("{psnr}{} Gaussians", group_digits(count))
        };
        let Some(work) = &self.work else { return };
        work.done(iteration.into(), message);
        if let Some(expectation) = &mut self.expectation
            && expectation.count != count
        {
            expectation.count = count;
            work.replan(expectation.plan(iteration));
        }
    }

    fn pause(&mut self, training: &mut Training) -> Result<(), Failure> {
        self.pause.as_mut().map_or(Ok(()), |pause| pause(training))
    }

    fn note(&mut self, note: Note<Failure>) {
        match note {
            Note::StartsOnGpu { is_software: true, place: None, .. } => {
                tracing::info!("{note}; --executor cpu is faster");
            }
            Note::StartsOnGpu { place: Some(_), .. } => {
                tracing::info!(target: progress::RANKS_TARGET, "{}{note}", self.prefix);
            }
            Note::StartsOnGpu { .. } | Note::StartsOnCpu { .. } => tracing::info!("{note}"),
            Note::GpuFailed { checkpoint: Some(_), .. } => {
                tracing::warn!(
                    "{note}; to continue on the CPU, press Ctrl-C and run again with --resume --executor cpu"
                );
            }
            _ => tracing::warn!("{note}"),
        }
    }
}
