//! Number of iterations that fit into a time (`--minutes`).

use crate::{
    failure::Failure,
    progress,
    training::{Expectation, Session},
};
use specula_core::camera::Camera;
use specula_scene::{
    ExecutorChoice,
    number::group_digits,
    training::{Start, Training},
};
use specula_train::{pictures::PictureSource, profile::Profile, start::Point, trainer::Settings};

/// Steps that are timed, after at most so many in which pictures are decoded.
const TIMED: u32 = 60;
const WARM_UP_MAX: usize = 100;
/// Least number of iterations.
const LEAST: u32 = 300;

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
    // A training that is thrown away; the next one says where it runs.
    let session = |steps: u32| Session::new(pictures, points).ending_after(steps);
    let start = Start::Points(points);
    let training = progress::silently(|| Training::new(choice, settings, pictures, &start, &mut session(0)));
    let mut training = training?;
    let count = training.gaussian_count();
    let warm = training.run(&[], &mut session(warm_up))?.seconds;
    let all = training.run(&[], &mut session(TIMED))?.seconds;
    let expected = |profile: &Profile, iterations: u32| Expectation::new(count, 0, profile, iterations, sizes);
    let steps = expected(&profile, most).cost_of(warm_up, training.iteration());
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
    let unit = if minutes == 1.0 { "minute" } else { "minutes" };
    if low == least && !fits(least)? {
        tracing::warn!("{iterations} iterations, the fewest of --minutes, take longer than {minutes} {unit} here");
    } else {
        let number = group_digits(iterations as usize);
        let about = if low == most { "fewer than" } else { "about" };
        tracing::info!("{number} iterations, which take {about} {minutes} {unit} here");
    }
    Ok(iterations)
}

/// Rounded down to hundreds, or to tens below a thousand.
fn rounded(iterations: u32) -> u32 {
    let unit = if iterations < 1000 { 10 } else { 100 };
    iterations - iterations % unit
}
