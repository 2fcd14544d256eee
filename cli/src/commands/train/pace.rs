//! Number of iterations that fit into a time (`--minutes`).

use crate::{failure::Failure, training::Expectation};
use core::fmt;
use specula_core::camera::Camera;
use specula_scene::{
    ExecutorChoice,
    number::group_digits,
    training::{Note, Observer, Start, Training},
};
use specula_train::{pictures::PictureSource, profile::Profile, start::Point, trainer::Settings};

/// Steps that are timed, after at most so many in which pictures are decoded.
const TIMED: u32 = 60;
const WARM_UP_MAX: usize = 100;
/// Least number of iterations.
const LEAST: u32 = 300;

/// Training that is thrown away after some steps.
struct Probe<'a> {
    pictures: &'a dyn PictureSource,
    points: &'a [Point],
    steps: u32,
    taken: u32,
}

impl fmt::Debug for Probe<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("Probe")
    }
}

impl Observer for Probe<'_> {
    type Error = Failure;

    fn is_device_failure(failure: &Failure) -> bool {
        failure.is_of_device()
    }

    fn origin(&self) -> (&dyn PictureSource, &[Point]) {
        (self.pictures, self.points)
    }

    fn is_interrupted(&self) -> bool {
        self.taken >= self.steps
    }

    fn after_step(&mut self, _: &Training) {
        self.taken += 1;
    }

    /// The training itself says where it runs.
    fn note(&mut self, _: Note<Failure>) {}
}

/// Number of iterations, at most those of `settings`, that take about `minutes`. `profile_at` is
/// the profile for another number.
///
/// # Errors
/// Those of the steps that are timed, and of `profile_at`.
pub(super) fn iterations_within(
    minutes: f64,
    settings: Settings,
    choice: &ExecutorChoice,
    pictures: &dyn PictureSource,
    points: &[Point],
    cameras: &[Camera],
    profile_at: impl Fn(u32) -> Result<Profile, Failure>,
) -> Result<u32, Failure> {
    let pixels = cameras.iter().map(|camera| camera.width as usize * camera.height as usize).sum::<usize>();
    let sizes = [pixels / cameras.len().max(1), cameras.len()];
    let (profile, most) = (settings.profile.clone(), settings.iterations);
    let warm_up = cameras.len().min(WARM_UP_MAX) as u32;
    let mut probe = Probe { pictures, points, steps: warm_up, taken: 0 };
    let mut training = Training::new(choice, settings, pictures, &Start::Points(points), &mut probe)?;
    let count = training.gaussian_count();
    let warm = training.run(&[], &mut probe)?.seconds;
    probe.steps += TIMED;
    let all = training.run(&[], &mut probe)?.seconds;
    let expected = |profile: &Profile, iterations: u32| Expectation::new(count, 0, profile, iterations, sizes);
    let steps = expected(&profile, most).cost_of(warm_up, probe.taken);
    let (seconds_per_cost, left) = ((all - warm) / steps.max(1.0), 60.0 * minutes - all);
    let fits = |iterations: u32| -> Result<bool, Failure> {
        Ok(seconds_per_cost * expected(&profile_at(iterations)?, iterations).cost() <= left)
    };
    let least = LEAST.min(most);
    let (mut low, mut high) = (least, most + 1);
    while high - low > 1 {
        let middle = low.midpoint(high);
        if fits(middle)? { low = middle } else { high = middle }
    }
    let iterations = if low == most { low } else { rounded(low).max(least) };
    if low == least && !fits(least)? {
        tracing::warn!("{iterations} iterations, the fewest of --minutes, take longer than {minutes} minutes here");
    } else {
        let number = group_digits(iterations as usize);
        let about = if low == most { "fewer than" } else { "about" };
        tracing::info!("{number} iterations, which take {about} {minutes} minutes here");
    }
    Ok(iterations)
}

/// Rounded down to hundreds, or to tens below a thousand.
fn rounded(iterations: u32) -> u32 {
    let unit = if iterations < 1000 { 10 } else { 100 };
    iterations - iterations % unit
}
