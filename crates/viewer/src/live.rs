//! Feed between a training and its viewer, polled between steps. Watching changes no bit of the
//! trained model: scenes are copied, and steps are only delayed.

use core::time::Duration;
use serde_json::{Value, json};
use specula_scene::Scene;
use std::{
    sync::{Condvar, Mutex, MutexGuard},
    time::Instant,
};

/// Minimum interval between two published scenes, which bounds the overhead of copies.
const PUBLISH_INTERVAL: Duration = Duration::from_millis(200);
/// Maximum wait of a paused training before it polls again.
const WAIT_MAX: Duration = Duration::from_millis(50);
/// Largest number of samples of a curve.
const SAMPLES_MAX: usize = 1000;
/// Largest number of single steps in one request.
const STEPS_MAX: u32 = 1_000_000;

const NO_POISON: &str = "nothing panics under the lock of the feed";

/// Action that the viewer requests of a training before its next step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Publish the current scene ([`LiveTraining::publish`]).
    Scene,
    /// Wait, since the training is paused ([`LiveTraining::wait`]).
    Wait,
}

/// State that a training and its viewer share.
///
/// Before each step the training polls [`request`](Self::request) until it returns `None`; after
/// each step it calls [`record`](Self::record).
#[derive(Debug)]
pub struct LiveTraining {
    iterations: u32,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug)]
struct State {
    is_finished: bool,
    is_paused: bool,
    /// Value of `is_paused` in the last notice.
    is_noticed_paused: bool,
    /// Remaining single steps of a paused training.
    steps: u32,
    is_scene_requested: bool,
    /// Published scene and its iteration, until the viewer takes it.
    scene: Option<(Scene, u32)>,
    /// Iteration and time of the last publication.
    published: (u32, Instant),
    /// Iteration of the displayed scene.
    shown: u32,
    now: Sample,
    curve: Curve,
}

/// Statistics of a training after a step.
#[derive(Clone, Copy, Debug, Default)]
struct Sample {
    iteration: u32,
    seconds: f64,
    psnr: Option<f64>,
    gaussians: usize,
}

/// Statistics over the iterations, evenly spaced.
#[derive(Debug)]
struct Curve {
    samples: Vec<Sample>,
    /// Iterations between two samples.
    every: u32,
}

impl Curve {
    fn add(&mut self, sample: Sample) {
        if !sample.iteration.is_multiple_of(self.every) {
            return;
        }
        self.samples.push(sample);
        if self.samples.len() > SAMPLES_MAX {
            self.every *= 2;
            let every = self.every;
            self.samples.retain(|sample| sample.iteration.is_multiple_of(every));
        }
    }
}

impl LiveTraining {
    /// Feed of a training of `iterations` steps that starts or resumes after `iteration`.
    pub fn new(iterations: u32, iteration: u32) -> Self {
        let state = State {
            is_finished: false,
            is_paused: false,
            is_noticed_paused: false,
            steps: 0,
            is_scene_requested: false,
            scene: None,
            published: (iteration, Instant::now()),
            shown: iteration,
            now: Sample { iteration, ..Sample::default() },
            curve: Curve { samples: Vec::new(), every: 1 },
        };
        Self { iterations, state: Mutex::new(state), changed: Condvar::new() }
    }

    /// Action before the next step; `None` to take the step. A call that returns `None` consumes a
    /// single step of a paused training.
    pub fn request(&self) -> Option<Request> {
        let mut state = self.lock();
        let (published, time) = state.published;
        if state.is_scene_requested && published != state.now.iteration && time.elapsed() >= PUBLISH_INTERVAL {
            return Some(Request::Scene);
        }
        if !state.is_paused {
            return None;
        }
        if state.steps > 0 {
            state.steps -= 1;
            return None;
        }
        Some(Request::Wait)
    }

    /// Notice for the user if the page has paused or resumed the training since the last call.
    pub fn notice(&self) -> Option<&'static str> {
        let mut state = self.lock();
        if state.is_noticed_paused == state.is_paused {
            return None;
        }
        state.is_noticed_paused = state.is_paused;
        Some(if state.is_paused { "paused from the page; resume it there" } else { "resumed" })
    }

    /// Waits up to 50 ms for a change of requests.
    pub fn wait(&self) {
        drop(self.changed.wait_timeout(self.lock(), WAIT_MAX).expect(NO_POISON));
    }

    /// Publishes the scene after `iteration` steps.
    pub fn publish(&self, scene: Scene, iteration: u32) {
        let mut state = self.lock();
        state.scene = Some((scene, iteration));
        state.published = (iteration, Instant::now());
        state.is_scene_requested = false;
    }

    /// Publishes the result of the training and marks it as finished.
    pub fn finish(&self, scene: Scene, iteration: u32) {
        self.publish(scene, iteration);
        self.change(|state| (state.is_finished, state.is_paused) = (true, false));
    }

    /// Records the statistics after a step: training time in seconds and PSNR in dB.
    pub fn record(&self, iteration: u32, seconds: f64, psnr: Option<f64>, gaussians: usize) {
        let mut state = self.lock();
        state.now = Sample { iteration, seconds, psnr, gaussians };
        let now = state.now;
        state.curve.add(now);
    }

    /// Takes the published scene, if there is a new one, and requests another.
    pub(crate) fn take(&self) -> Option<Scene> {
        let mut state = self.lock();
        state.is_scene_requested = true;
        let (scene, iteration) = state.scene.take()?;
        state.shown = iteration;
        Some(scene)
    }

    /// Iteration of the displayed scene.
    pub(crate) fn iteration_shown(&self) -> u32 {
        self.lock().shown
    }

    /// Pauses the training after its current step.
    pub(crate) fn pause(&self) {
        self.change(|state| (state.is_paused, state.steps) = (true, 0));
    }

    /// Resumes the training.
    pub(crate) fn resume(&self) {
        self.change(|state| (state.is_paused, state.steps) = (false, 0));
    }

    /// Pauses the training after `steps` more steps.
    pub(crate) fn step(&self, steps: u32) {
        self.change(|state| (state.is_paused, state.steps) = (true, steps.min(STEPS_MAX)));
    }

    /// Progress and curves for the page.
    pub(crate) fn report(&self) -> Value {
        let state = self.lock();
        let column = |value: &dyn Fn(&Sample) -> Value| -> Value { state.curve.samples.iter().map(value).collect() };
        json!({
            "iteration": state.now.iteration,
            "iterations": self.iterations,
            "seconds": state.now.seconds,
            "psnr": state.now.psnr,
            "gaussians": state.now.gaussians,
            "finished": state.is_finished,
            "paused": state.is_paused && state.steps == 0,
            "curve": {
                "iteration": column(&|sample| sample.iteration.into()),
                "psnr": column(&|sample| json!(sample.psnr)),
                "gaussians": column(&|sample| sample.gaussians.into()),
            },
        })
    }

    fn change(&self, change: impl FnOnce(&mut State)) {
        change(&mut self.lock());
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect(NO_POISON)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_paused_training_takes_the_requested_steps() {
        let live = LiveTraining::new(10, 0);
        assert_eq!(live.request(), None, "it runs without requests");
        live.pause();
        assert_eq!(live.request(), Some(Request::Wait));
        live.step(2);
        assert_eq!([live.request(), live.request(), live.request()], [None, None, Some(Request::Wait)]);
        live.resume();
        assert_eq!(live.request(), None);
    }

    #[test]
    fn pausing_and_resuming_are_noticed_once() {
        let live = LiveTraining::new(10, 0);
        assert_eq!(live.notice(), None);
        live.pause();
        assert_eq!([live.notice(), live.notice()], [Some("paused from the page; resume it there"), None]);
        live.step(2);
        assert_eq!(live.notice(), None, "single steps are no end of a pause");
        live.resume();
        assert_eq!([live.notice(), live.notice()], [Some("resumed"), None]);
    }

    #[test]
    fn a_scene_is_published_only_if_it_is_new_and_requested() {
        let live = LiveTraining::new(10, 0);
        live.record(1, 0.1, None, 5);
        assert_eq!(live.request(), None, "nobody looks");
        assert!(live.take().is_none(), "there is none yet");
        std::thread::sleep(PUBLISH_INTERVAL);
        assert_eq!(live.request(), Some(Request::Scene));
    }

    #[test]
    fn curves_stay_short_and_reach_from_start_to_end() {
        let mut curve = Curve { samples: Vec::new(), every: 1 };
        for iteration in 1..=30_000 {
            curve.add(Sample { iteration, ..Sample::default() });
        }
        let samples = &curve.samples;
        assert!((SAMPLES_MAX / 3..=SAMPLES_MAX).contains(&samples.len()), "{} samples", samples.len());
        assert!(samples[0].iteration <= curve.every && samples[samples.len() - 1].iteration > 30_000 - curve.every);
    }
}
