//! What a training and who watches it tell each other, between steps. Whether somebody watches changes no bit of what
//! is trained: scenes are copied, and steps are only taken later.

use core::time::Duration;
use serde_json::{Value, json};
use specula_scene::Scene;
use std::{
    sync::{Condvar, Mutex, MutexGuard},
    time::Instant,
};

/// Between two scenes that are given, so that a training has time for itself.
const PAUSE_MIN: Duration = Duration::from_millis(200);
/// How long a paused training waits before it looks up.
const PATIENCE: Duration = Duration::from_millis(50);
/// Points of a curve, at most.
const POINTS_MAX: usize = 1000;
/// Steps that can be asked for at once.
const STEPS_MAX: u32 = 1_000_000;

const HELD_SHORTLY: &str = "nothing panics while it holds what is shared";

/// What a training is to do before its next step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wish {
    /// Give the scene as it is now.
    Scene,
    /// Wait: the training is paused.
    Patience,
}

/// A training that is watched.
#[derive(Debug)]
pub(crate) struct Live {
    iterations: u32,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug)]
struct State {
    is_finished: bool,
    is_paused: bool,
    /// Whether the pause was told.
    is_told_paused: bool,
    /// Steps to take although it is paused.
    steps: u32,
    is_scene_wanted: bool,
    /// What was given last, until it is taken.
    scene: Option<(Scene, u32)>,
    /// Of the scene that was given last, and when it was.
    given: (u32, Instant),
    /// Of the scene that is shown.
    shown: u32,
    now: Point,
    curve: Curve,
}

/// A moment of a training.
#[derive(Clone, Copy, Debug, Default)]
struct Point {
    iteration: u32,
    seconds: f64,
    psnr: Option<f64>,
    gaussians: usize,
}

/// Points of a training, evenly spread.
#[derive(Debug)]
struct Curve {
    points: Vec<Point>,
    /// Steps between two points.
    every: u32,
}

impl Curve {
    fn add(&mut self, point: Point) {
        if !point.iteration.is_multiple_of(self.every) {
            return;
        }
        self.points.push(point);
        if self.points.len() > POINTS_MAX {
            self.every *= 2;
            let every = self.every;
            self.points.retain(|point| point.iteration.is_multiple_of(every));
        }
    }
}

impl Live {
    /// A training of so many iterations, whose scene is shown as it is at this one.
    pub(crate) fn new(iterations: u32, iteration: u32) -> Self {
        let state = State {
            is_finished: false,
            is_paused: false,
            is_told_paused: false,
            steps: 0,
            is_scene_wanted: false,
            scene: None,
            given: (iteration, Instant::now()),
            shown: iteration,
            now: Point { iteration, ..Point::default() },
            curve: Curve { points: Vec::new(), every: 1 },
        };
        Self { iterations, state: Mutex::new(state), changed: Condvar::new() }
    }

    /// What the training is to do; nothing but its next step where there is no wish.
    pub(crate) fn wish(&self) -> Option<Wish> {
        let mut state = self.lock();
        let (given, when) = state.given;
        if state.is_scene_wanted && given != state.now.iteration && when.elapsed() >= PAUSE_MIN {
            return Some(Wish::Scene);
        }
        if !state.is_paused {
            return None;
        }
        if state.steps > 0 {
            state.steps -= 1;
            return None;
        }
        Some(Wish::Patience)
    }

    /// A sentence where the page has paused the training since the last one, or has it go on.
    pub(crate) fn news(&self) -> Option<&'static str> {
        let mut state = self.lock();
        if state.is_told_paused == state.is_paused {
            return None;
        }
        state.is_told_paused = state.is_paused;
        Some(if state.is_paused { "paused from the page; it goes on from there" } else { "goes on" })
    }

    /// Waits for another wish, for a moment.
    pub(crate) fn wait(&self) {
        drop(self.changed.wait_timeout(self.lock(), PATIENCE).expect(HELD_SHORTLY));
    }

    /// The scene as it is after so many iterations.
    pub(crate) fn give(&self, scene: Scene, iteration: u32) {
        let mut state = self.lock();
        state.scene = Some((scene, iteration));
        state.given = (iteration, Instant::now());
        state.is_scene_wanted = false;
    }

    /// The training has come to its end, with this scene.
    pub(super) fn finish(&self, scene: Scene, iteration: u32) {
        self.give(scene, iteration);
        self.change(|state| (state.is_finished, state.is_paused) = (true, false));
    }

    /// How far the training has come.
    pub(crate) fn note(&self, iteration: u32, seconds: f64, psnr: Option<f64>, gaussians: usize) {
        let mut state = self.lock();
        state.now = Point { iteration, seconds, psnr, gaussians };
        let now = state.now;
        state.curve.add(now);
    }

    /// The latest scene, if it was not taken yet; another one is wanted from now on.
    pub(super) fn take(&self) -> Option<Scene> {
        let mut state = self.lock();
        state.is_scene_wanted = true;
        let (scene, iteration) = state.scene.take()?;
        state.shown = iteration;
        Some(scene)
    }

    /// Of the scene that is shown.
    pub(super) fn iteration_shown(&self) -> u32 {
        self.lock().shown
    }

    /// No step is taken any more.
    pub(super) fn pause(&self) {
        self.change(|state| (state.is_paused, state.steps) = (true, 0));
    }

    /// Steps are taken again.
    pub(super) fn go(&self) {
        self.change(|state| (state.is_paused, state.steps) = (false, 0));
    }

    /// So many steps are taken, and no more.
    pub(super) fn step(&self, steps: u32) {
        self.change(|state| (state.is_paused, state.steps) = (true, steps.min(STEPS_MAX)));
    }

    /// All that there is to say.
    pub(super) fn report(&self) -> Value {
        let state = self.lock();
        let column = |of: &dyn Fn(&Point) -> Value| -> Value { state.curve.points.iter().map(of).collect() };
        json!({
            "iteration": state.now.iteration,
            "iterations": self.iterations,
            "seconds": state.now.seconds,
            "psnr": state.now.psnr,
            "gaussians": state.now.gaussians,
            "finished": state.is_finished,
            "paused": state.is_paused && state.steps == 0,
            "curve": {
                "iteration": column(&|point| point.iteration.into()),
                "psnr": column(&|point| json!(point.psnr)),
                "gaussians": column(&|point| point.gaussians.into()),
            },
        })
    }

    fn change(&self, change: impl FnOnce(&mut State)) {
        change(&mut self.lock());
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect(HELD_SHORTLY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_paused_training_takes_the_steps_that_are_asked_for() {
        let live = Live::new(10, 0);
        assert_eq!(live.wish(), None, "it goes on by itself");
        live.pause();
        assert_eq!(live.wish(), Some(Wish::Patience));
        live.step(2);
        assert_eq!([live.wish(), live.wish(), live.wish()], [None, None, Some(Wish::Patience)]);
        live.go();
        assert_eq!(live.wish(), None);
    }

    #[test]
    fn a_pause_is_told_once_and_so_is_its_end() {
        let live = Live::new(10, 0);
        assert_eq!(live.news(), None);
        live.pause();
        assert_eq!([live.news(), live.news()], [Some("paused from the page; it goes on from there"), None]);
        live.step(2);
        assert_eq!(live.news(), None, "single steps are no end of a pause");
        live.go();
        assert_eq!([live.news(), live.news()], [Some("goes on"), None]);
    }

    #[test]
    fn a_scene_is_given_only_where_there_is_a_new_one_and_somebody_looks() {
        let live = Live::new(10, 0);
        live.note(1, 0.1, None, 5);
        assert_eq!(live.wish(), None, "nobody looks");
        assert!(live.take().is_none(), "there is none yet");
        std::thread::sleep(PAUSE_MIN);
        assert_eq!(live.wish(), Some(Wish::Scene));
    }

    #[test]
    fn curves_stay_short_and_reach_from_start_to_end() {
        let mut curve = Curve { points: Vec::new(), every: 1 };
        for iteration in 1..=30_000 {
            curve.add(Point { iteration, ..Point::default() });
        }
        let points = &curve.points;
        assert!((POINTS_MAX / 3..=POINTS_MAX).contains(&points.len()), "{} points", points.len());
        assert!(points[0].iteration <= curve.every && points[points.len() - 1].iteration > 30_000 - curve.every);
    }
}
