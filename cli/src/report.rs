//! `specula report`: error against run time, one knob at a time and all together.

mod page;
mod plot;
mod records;
mod table;

use crate::{
    args::{Demo, Report},
    demo,
    failure::Failure,
    look::Tour,
    output,
    progress::{self, Work as Progress},
    scene::{self, background_of, into_subject},
};
use core::sync::atomic::{AtomicU64, Ordering};
use specula_accuracy::{
    error::{Errors, errors_of},
    off_axis::{OffAxis, off_axis},
    reference::{Exact, Reference},
    setting::{KNOBS, Setting, Tried, is_possible, random_setting, together},
    sort::Sort,
    stability,
    subject::Subject,
    trial::{STAGES, Spread, Times, Trial, Work},
};
use specula_core::{camera::Camera, random};
use std::path::{Path, PathBuf};

/// Errors for which every knob is turned at once: two for each power of ten.
const BOUNDS: [f64; 10] = [1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 2e-2, 3e-2, 1e-1];
/// Settings with every knob turned at random.
const RANDOM: u64 = 16;
/// Seed of the order in which settings are timed.
const SEED: u64 = 0;

/// A setting, and everything that was measured of it.
#[derive(Clone, Debug)]
struct Measured {
    setting: Setting,
    /// The knob that it turns, all others at their most exact; none where more than one is turned.
    knob: Option<usize>,
    errors: Errors,
    /// Milliseconds a picture, of each of [`STAGES`].
    times: [Spread; STAGES.len()],
    /// Milliseconds that filtering its light took, once.
    filter: f64,
    work: Work,
}

impl Measured {
    /// Error and time by which settings are held against one another.
    fn point(&self) -> [f64; 2] {
        let error = if self.errors.nonfinite == 0 { self.errors.rms } else { f64::INFINITY };
        [error, self.times[STAGES.len() - 1].min]
    }
}

/// Everything that the report says.
#[derive(Debug)]
struct Findings {
    scene: String,
    gaussians: usize,
    views: usize,
    size: [u32; 2],
    repeats: u32,
    usual: Setting,
    measured: Vec<Measured>,
    sort: Sort,
    off_axis: Vec<OffAxis>,
    stability: Vec<stability::Row>,
}

/// Measures, and writes everything.
pub(crate) fn run(args: &Report) -> Result<(), Failure> {
    output::make_folder(&args.output)?;
    let model = match &args.model {
        Some(model) => model.clone(),
        None => demo_model(&args.output)?,
    };
    let subject = subject(&model, args)?;
    let findings = Findings::new(&model, &subject, args)?;
    records::write(&args.output.join("report.jsonl"), &findings)?;
    page::write(&args.output.join("index.html"), &findings)?;
    output::say(&table::markdown(&findings))?;
    output::say(&format!("\nPage: {}", args.output.join("index.html").display()))
}

/// The demo's scene: where the demo left it, or else trained now.
fn demo_model(folder: &Path) -> Result<PathBuf, Failure> {
    let left = Path::new(crate::args::demo::FOLDER).join("specula");
    if left.join("specula.json").is_file() {
        return Ok(left);
    }
    tracing::info!("training the demo's scene first, which takes half a minute");
    demo::train_shaded(&Demo { output: folder.join("demo"), iterations: crate::args::demo::ITERATIONS })
}

fn subject(model: &Path, args: &Report) -> Result<Subject, Failure> {
    let opened = scene::open(model, None)?;
    let cameras = spread_out(Tour::of_scene(&opened)?, args.views as usize, args.size);
    let background = background_of(&opened, None).0;
    let subject = into_subject(opened.scene, cameras, background);
    if !subject.has_reference() {
        return Err(Failure::Input(format!(
            "there are no exact pictures of {model:?}, because the authors' shading is what their code does; report on a \
             model of profile specula, paper or 3dgs, or name one with the --profile of its training"
        )));
    }
    Ok(subject)
}

/// So many of the cameras, evenly spread over them, with pictures of that size at most.
fn spread_out(cameras: Vec<Camera>, count: usize, size: u32) -> Vec<Camera> {
    let count = count.min(cameras.len());
    let chosen = (0..count).map(|k| cameras[k * cameras.len() / count]);
    let shrunk = |camera: Camera| {
        let largest = camera.width.max(camera.height).max(size);
        let scaled = |pixels: u32| (pixels * size).div_ceil(largest).max(1);
        camera.resized(scaled(camera.width), scaled(camera.height))
    };
    chosen.map(shrunk).collect()
}

impl Findings {
    fn new(model: &Path, subject: &Subject, args: &Report) -> Result<Self, Failure> {
        let reference = Reference::new(subject);
        let views = view_by_view("in f64", subject, |done| reference.views(subject, done));
        let sort = view_by_view("sorted", subject, |done| Sort::new(subject, &reference, done));
        let mut bench = Bench { subject, views, trial: Trial::new(subject), repeats: args.repeats };
        let exact = Setting::exact(subject);
        let (settings, knobs) = one_at_a_time(subject, &exact);
        let mut measured = bench.measure(&settings, &knobs, "knob by knob")?;
        let all = all_at_once(subject, &exact, &measured);
        let none = vec![None; all.len()];
        measured.extend(bench.measure(&all, &none, "all knobs")?);
        let stability = if args.no_stability { Vec::new() } else { stable()? };
        let size = subject.cameras.first().map_or([0; 2], |camera| [camera.width, camera.height]);
        Ok(Self {
            scene: model.display().to_string(),
            gaussians: subject.gaussians.count,
            views: subject.cameras.len(),
            size,
            repeats: args.repeats,
            usual: Setting::usual(subject),
            measured,
            sort,
            off_axis: off_axis(),
            stability,
        })
    }
}

/// What is worked out for each view, which calls what it is given when one is done.
fn view_by_view<T>(what: &str, subject: &Subject, run: impl FnOnce(&(dyn Fn() + Sync)) -> T) -> T {
    let work = progress::work(what, subject.cameras.len() as u64);
    let done = AtomicU64::new(0);
    let all = run(&|| work.done(1 + done.fetch_add(1, Ordering::Relaxed), String::new));
    work.finish();
    all
}

/// Every value of each knob, all others at their most exact, and which knob it is; the usual setting last.
fn one_at_a_time(subject: &Subject, exact: &Setting) -> (Vec<Setting>, Vec<Option<usize>>) {
    let turned = |(index, knob): (usize, &specula_accuracy::setting::Knob)| {
        knob.turned(subject, exact).into_iter().map(move |setting| (setting, Some(index)))
    };
    let usual = (Setting::usual(subject), None);
    KNOBS.iter().enumerate().flat_map(turned).chain([usual]).unzip()
}

/// Settings that turn several knobs: for some errors, and at random.
fn all_at_once(subject: &Subject, exact: &Setting, measured: &[Measured]) -> Vec<Setting> {
    let of_knob = |index: usize| {
        let own = measured.iter().filter(move |own| own.knob == Some(index));
        own.map(|own| Tried { setting: own.setting, error: own.point()[0], cost: own.point()[1] }).collect()
    };
    let of_knobs: Vec<_> = KNOBS.iter().enumerate().map(|(index, knob)| (*knob, of_knob(index))).collect();
    let for_bounds = BOUNDS.iter().map(|bound| together(exact, &of_knobs, *bound));
    let at_random = (0..RANDOM).map(|seed| random_setting(subject, exact, seed));
    let mut settings: Vec<Setting> = Vec::new();
    for setting in for_bounds.chain(at_random).filter(is_possible) {
        let is_known = measured.iter().any(|own| own.setting == setting) || settings.contains(&setting);
        if !is_known {
            settings.push(setting);
        }
    }
    settings
}

/// What settings are measured on.
struct Bench<'a> {
    subject: &'a Subject,
    views: Vec<(Camera, Exact)>,
    trial: Trial<'a>,
    repeats: u32,
}

/// What is known of a setting while it is measured.
struct Samples {
    errors: Errors,
    work: Work,
    /// For each repetition the milliseconds of all views.
    times: Vec<Times>,
}

impl Bench<'_> {
    /// Errors first, which also warms up; then times, each repetition in another order, so that what else the machine
    /// does falls on all alike.
    fn measure(&mut self, settings: &[Setting], knobs: &[Option<usize>], what: &str) -> Result<Vec<Measured>, Failure> {
        let progress = progress::work(what, settings.len() as u64 * (1 + u64::from(self.repeats)));
        let mut samples = Vec::new();
        for setting in settings {
            samples.push(self.first(setting)?);
            progress.done(samples.len() as u64, String::new);
        }
        for repeat in 0..self.repeats {
            self.repeat(settings, &mut samples, repeat, &progress)?;
        }
        progress.finish();
        let measured = settings.iter().zip(knobs).zip(samples);
        Ok(measured.map(|((setting, knob), samples)| self.summed_up(setting, *knob, samples)).collect())
    }

    fn first(&mut self, setting: &Setting) -> Result<Samples, Failure> {
        let (errors, work) = errors_of(&mut self.trial, self.subject, setting, &self.views)?;
        Ok(Samples { errors, work, times: Vec::new() })
    }

    fn repeat(
        &mut self,
        settings: &[Setting],
        samples: &mut [Samples],
        repeat: u32,
        progress: &Progress,
    ) -> Result<(), Failure> {
        let mut order: Vec<usize> = (0..settings.len()).collect();
        order.sort_by_key(|index| random::bits(SEED, repeat.into(), *index as u64));
        for (done, index) in order.into_iter().enumerate() {
            let mut times = Times::default();
            for (camera, _) in &self.views {
                let own = self.trial.view(&settings[index], camera)?.times;
                times.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
            }
            samples[index].times.push(times);
            progress.done((1 + u64::from(repeat)) * settings.len() as u64 + done as u64, String::new);
        }
        Ok(())
    }

    fn summed_up(&self, setting: &Setting, knob: Option<usize>, samples: Samples) -> Measured {
        let views = self.views.len().max(1) as f64;
        let of_stage = |stage: usize| Spread::of(samples.times.iter().map(|times| times[stage] / views).collect());
        Measured {
            setting: *setting,
            knob,
            errors: samples.errors,
            times: core::array::from_fn(of_stage),
            filter: self.trial.filter_milliseconds(setting),
            work: samples.work,
        }
    }
}

fn stable() -> Result<Vec<stability::Row>, Failure> {
    let work = progress::work("edges", stability::row_count() as u64);
    let rows = stability::rows(|done| work.done(done as u64, String::new))?;
    work.finish();
    Ok(rows)
}
