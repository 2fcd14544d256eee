//! Errors and times of settings on a scene.

use crate::{
    error::Result,
    tradeoff::{
        findings::{Findings, MeasuredSetting},
        progress::StartProgress,
    },
};
use core::sync::atomic::{AtomicU64, Ordering};
use specula_accuracy::{
    error::{Errors, errors_of},
    off_axis::off_axis,
    reference::{Exact, Reference},
    setting::{PARAMETERS, Setting, Tried, is_possible, random_setting, together},
    sort::Sort,
    stability,
    subject::Subject,
    trial::{STAGES, Spread, Times, Trial, Work},
};
use specula_core::{camera::Camera, random};

/// Errors (RMS) for which all parameters are jointly optimised: two per power of ten.
const BOUNDS: [f64; 10] = [1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 2e-2, 3e-2, 1e-1];
/// Number of settings with random parameters.
const RANDOM_SETTINGS: u64 = 16;
/// Seed of the order in which settings are timed.
const SEED: u64 = 0;

/// Extent of a measurement.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Repetitions of each time.
    pub repeats: u32,
    /// Measures invariants in scenes at the limits of valid input.
    pub with_stability: bool,
}

/// Measures a scene.
///
/// # Errors
///
/// Those of the CPU executor.
pub fn measure(scene: &str, subject: &Subject, options: Options, progress: &StartProgress<'_>) -> Result<Findings> {
    let reference = Reference::new(subject);
    let views = view_by_view("in f64", subject, progress, |done| reference.views(subject, done));
    let sort = view_by_view("sorted", subject, progress, |done| Sort::new(subject, &reference, options.repeats, done))?;
    let mut bench = Bench { subject, views, trial: Trial::new(subject), repeats: options.repeats };
    let exact = Setting::exact(subject);
    let (settings, parameters) = one_at_a_time(subject, &exact);
    let mut measured = bench.measure(&settings, &parameters, &*progress("one parameter", bench.steps(&settings)))?;
    let settings = all_together(subject, &exact, &measured);
    let parameters = vec![None; settings.len()];
    measured.extend(bench.measure(&settings, &parameters, &*progress("all parameters", bench.steps(&settings)))?);
    let stability = if options.with_stability {
        let advance = progress("edge cases", stability::row_count() as u64);
        stability::rows(|done| advance(done as u64))?
    } else {
        Vec::new()
    };
    Ok(Findings {
        scene: scene.to_owned(),
        gaussians: subject.gaussians.count,
        views: subject.cameras.len(),
        size: subject.cameras.first().map_or([0; 2], |camera| [camera.width, camera.height]),
        repeats: options.repeats,
        default: Setting::default_for(subject),
        measured,
        sort,
        off_axis: off_axis(),
        lamps: Vec::new(),
        stability,
    })
}

/// Evenly spread selection of `count` cameras, with pictures reduced to `edge` pixels along the
/// longer edge.
pub fn spread_cameras(cameras: &[Camera], count: usize, edge: u32) -> Vec<Camera> {
    let count = count.min(cameras.len());
    let reduced = |camera: Camera| {
        let longest = camera.width.max(camera.height).max(edge);
        let scaled = |pixels: u32| (pixels * edge).div_ceil(longest).max(1);
        camera.resized(scaled(camera.width), scaled(camera.height))
    };
    (0..count).map(|k| reduced(cameras[k * cameras.len() / count])).collect()
}

/// Result of a computation that calls its argument after each view.
fn view_by_view<T>(
    title: &str,
    subject: &Subject,
    progress: &StartProgress<'_>,
    compute: impl FnOnce(&(dyn Fn() + Sync)) -> T,
) -> T {
    let advance = progress(title, subject.cameras.len() as u64);
    let done = AtomicU64::new(0);
    compute(&|| advance(1 + done.fetch_add(1, Ordering::Relaxed)))
}

/// Every value of each parameter, with all others most exact, and the parameter's index; the
/// default setting last.
fn one_at_a_time(subject: &Subject, exact: &Setting) -> (Vec<Setting>, Vec<Option<usize>>) {
    let values = PARAMETERS.iter().enumerate().flat_map(|(index, parameter)| {
        parameter.settings(subject, exact).into_iter().map(move |setting| (setting, Some(index)))
    });
    values.chain([(Setting::default_for(subject), None)]).unzip()
}

/// Settings that vary several parameters: optimised for [`BOUNDS`], and random.
fn all_together(subject: &Subject, exact: &Setting, measured: &[MeasuredSetting]) -> Vec<Setting> {
    let trials_of = |index: usize| {
        let varied = measured.iter().filter(move |measured| measured.parameter == Some(index));
        varied.map(|measured| {
            let [error, cost] = measured.point();
            Tried { setting: measured.setting, error, cost }
        })
    };
    let trials: Vec<_> =
        PARAMETERS.iter().enumerate().map(|(index, parameter)| (*parameter, trials_of(index).collect())).collect();
    let for_bounds = BOUNDS.iter().map(|bound| together(exact, &trials, *bound));
    let at_random = (0..RANDOM_SETTINGS).map(|seed| random_setting(subject, exact, seed));
    let mut settings: Vec<Setting> = Vec::new();
    for setting in for_bounds.chain(at_random).filter(is_possible) {
        let is_known = measured.iter().any(|known| known.setting == setting) || settings.contains(&setting);
        if !is_known {
            settings.push(setting);
        }
    }
    settings
}

/// Scene on which settings are measured.
struct Bench<'a> {
    subject: &'a Subject,
    views: Vec<(Camera, Exact)>,
    trial: Trial<'a>,
    repeats: u32,
}

/// Measurements of a setting so far.
struct Samples {
    errors: Errors,
    work: Work,
    /// Milliseconds of all views, for each repetition.
    times: Vec<Times>,
}

impl Bench<'_> {
    /// Steps of measuring these settings.
    fn steps(&self, settings: &[Setting]) -> u64 {
        settings.len() as u64 * (1 + u64::from(self.repeats))
    }

    /// Measures errors first, which also warms up; then times, each repetition in another order, so
    /// that other load on the machine affects all settings equally.
    fn measure(
        &mut self,
        settings: &[Setting],
        parameters: &[Option<usize>],
        advance: &dyn Fn(u64),
    ) -> Result<Vec<MeasuredSetting>> {
        let mut samples = Vec::new();
        for setting in settings {
            samples.push(self.errors(setting)?);
            advance(samples.len() as u64);
        }
        for repeat in 0..self.repeats {
            let done = (1 + u64::from(repeat)) * settings.len() as u64;
            self.repeat(settings, &mut samples, repeat, &|more| advance(done + more))?;
        }
        let measured = settings.iter().zip(parameters).zip(samples);
        Ok(measured.map(|((setting, parameter), samples)| self.summarize(setting, *parameter, samples)).collect())
    }

    fn errors(&mut self, setting: &Setting) -> Result<Samples> {
        let (errors, work) = errors_of(&mut self.trial, self.subject, setting, &self.views)?;
        Ok(Samples { errors, work, times: Vec::new() })
    }

    fn repeat(
        &mut self,
        settings: &[Setting],
        samples: &mut [Samples],
        repeat: u32,
        advance: &dyn Fn(u64),
    ) -> Result<()> {
        let mut order: Vec<usize> = (0..settings.len()).collect();
        order.sort_by_key(|index| random::bits(SEED, repeat.into(), *index as u64));
        for (done, index) in order.into_iter().enumerate() {
            let mut times = Times::default();
            for (camera, _) in &self.views {
                let view = self.trial.view(&settings[index], camera)?.times;
                times.iter_mut().zip(view).for_each(|(sum, time)| *sum += time);
            }
            samples[index].times.push(times);
            advance(done as u64);
        }
        Ok(())
    }

    fn summarize(&self, setting: &Setting, parameter: Option<usize>, samples: Samples) -> MeasuredSetting {
        let views = self.views.len().max(1) as f64;
        let stage = |stage: usize| Spread::of(samples.times.iter().map(|times| times[stage] / views).collect());
        MeasuredSetting {
            setting: *setting,
            parameter,
            errors: samples.errors,
            times: core::array::from_fn::<_, { STAGES.len() }, _>(stage),
            filter: self.trial.filter_milliseconds(setting),
            work: samples.work,
        }
    }
}
