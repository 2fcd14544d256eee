//! A scene under different settings: pictures, stage times, operation counts.

use crate::{reference::Reference, setting::Setting, subject::Subject};
use core::cell::OnceCell;
use specula_core::{
    camera::Camera,
    cutoffs::BlendOrder,
    executor::Renderer,
    pack::Storage,
    pipeline::{Stage, StageObserver, render_observed},
    plan::{Needs, Plan},
    prefilter::{LevelRange, Levels, PrefilterScheme},
    rules::{Channels, RenderRules},
    scene::{Gaussians, Image},
};
use specula_cpu::{CpuError, CpuViewer, stages::prefilter::Light};
use std::{borrow::Cow, time::Instant};

/// Timed stages, and their total.
pub const STAGES: [&str; 6] = ["project", "shade", "bin", "blend", "shade_pixels", "picture"];

/// Milliseconds of each of [`STAGES`].
pub type Times = [f64; STAGES.len()];

/// Operation counts of a picture, equal on every machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Splats in tiles.
    pub intersections: usize,
    /// Pixels of the 4 × 4 quads in which a splat is visible, summed over all splats.
    pub pairs: usize,
    /// Approximate number of pairs with perspective within the splat.
    pub pairs_in_perspective: usize,
    /// Gaussians with a perspective footprint.
    pub perspectives: usize,
    /// Operations of sorting splats in pixels; zero in the order of means.
    pub sorting: usize,
    /// Texels of light read.
    pub texel_reads: usize,
    /// Weights of the light's prefilter, which runs once for all pictures.
    pub weights: usize,
    /// Numbers read of Gaussians.
    pub numbers: usize,
    /// Channels that a splat blends into a pixel.
    pub channels: usize,
    /// Bytes of stored Gaussians and filtered light.
    pub bytes: usize,
}

impl Work {
    /// Cost of a picture in operations: 29 per pair and two per blended channel, plus sorting per
    /// intersection, plus reads of numbers and texels; perspective costs a division and some
    /// products per pair, and a sum over the pairs of five axes per Gaussian. Sorting in pixels is
    /// counted separately. The prefilter is not included.
    pub fn cost(&self) -> f64 {
        const PAIR: f64 = 29.0;
        const PAIR_IN_PERSPECTIVE: f64 = 12.0;
        const PERSPECTIVE: f64 = 200.0;
        const INTERSECTION: f64 = 60.0;
        const NUMBER: f64 = 4.0;
        const TEXEL: f64 = 16.0;
        let pair = PAIR + 2.0 * self.channels as f64;
        pair * self.pairs as f64
            + PAIR_IN_PERSPECTIVE * self.pairs_in_perspective as f64
            + PERSPECTIVE * self.perspectives as f64
            + self.sorting as f64
            + INTERSECTION * self.intersections as f64
            + NUMBER * self.numbers as f64
            + TEXEL * self.texel_reads as f64
    }

    /// Adds the work of another view; storage and prefilter count once.
    #[must_use]
    pub fn and(self, other: &Self) -> Self {
        Self {
            intersections: self.intersections + other.intersections,
            pairs: self.pairs + other.pairs,
            pairs_in_perspective: self.pairs_in_perspective + other.pairs_in_perspective,
            perspectives: self.perspectives + other.perspectives,
            sorting: self.sorting + other.sorting,
            texel_reads: self.texel_reads + other.texel_reads,
            numbers: self.numbers + other.numbers,
            ..*other
        }
    }
}

/// A filtered light, with the time of its prefilter.
#[derive(Debug)]
struct Filtered {
    of: (PrefilterScheme, usize, LevelRange, Storage),
    light: Light,
    /// True if it has all levels with the weights of exact pictures and so serves every range of
    /// levels.
    is_of_reference: bool,
    milliseconds: f64,
}

/// A subject prepared for any setting.
#[derive(Debug)]
pub struct Trial<'a> {
    subject: Cow<'a, Subject>,
    exec: CpuViewer,
    /// Gaussians in each number format, with their required stages.
    stored: Stored,
    lights: Vec<Filtered>,
}

/// A picture under a setting, with its times and counts.
#[derive(Clone, Debug)]
pub struct Taken {
    /// Requested channels, then transmittance.
    pub image: Image<Vec<f32>>,
    /// Time of each stage.
    pub times: Times,
    /// Operation counts.
    pub work: Work,
}

impl Taken {
    /// Total time in milliseconds.
    pub fn milliseconds(&self) -> f64 {
        self.times[STAGES.len() - 1]
    }
}

impl<'a> Trial<'a> {
    /// Prepares a subject whose light is filtered under each setting.
    pub fn new(subject: &'a Subject) -> Self {
        Self::of(Cow::Borrowed(subject))
    }

    fn of(subject: Cow<'a, Subject>) -> Self {
        Self { subject, exec: CpuViewer::default(), stored: Default::default(), lights: Vec::new() }
    }
}

impl Trial<'static> {
    /// Prepares a subject with the light of its exact pictures, for settings with the full light in
    /// `f32`: errors of cutoffs, projection and rounding remain.
    ///
    /// # Errors
    ///
    /// [`CpuError`] if the light cannot be filtered.
    pub fn under(subject: Subject, reference: &Reference) -> Result<Self, CpuError> {
        let mut trial = Self::of(Cow::Owned(subject));
        let setting = Setting::exact(&trial.subject);
        if let Some((levels, light)) = reference.filtered().zip(trial.subject.light_at(setting.light)) {
            let start = Instant::now();
            let light = trial.exec.prefilter(&light, setting.scheme, LevelRange::ALL)?;
            let mut light = trial.surrounded(light)?;
            for (level, texels) in levels.enumerate() {
                light.set_level(level, texels);
            }
            let of = (setting.scheme, setting.light, LevelRange::ALL, setting.storage);
            trial.lights.push(Filtered { of, light, is_of_reference: true, milliseconds: milliseconds(start) });
        }
        Ok(trial)
    }
}

impl Trial<'_> {
    /// Renders a view under a setting. The light is filtered on first use.
    ///
    /// # Errors
    ///
    /// [`CpuError`] if the view cannot be rendered.
    pub fn view(&mut self, setting: &Setting, camera: &Camera) -> Result<Taken, CpuError> {
        let rules = self.rules(setting);
        let light = self.filtered(setting, &rules)?;
        let (gaussians, _) = stored(&self.stored, &self.subject, setting.storage);
        self.exec.set_cutoffs(setting.cutoffs);
        let light = light.map(|index| &self.lights[index].light);
        let is_lit = light.is_some() && rules.is_lit;
        let is_deferred = rules.is_deferred(gaussians.layout);
        let start = Instant::now();
        let mut watch = Stopwatch::new([is_lit && !is_deferred, is_lit]);
        let frame = render_observed(&mut self.exec, gaussians, light, camera, &rules, &mut watch)?;
        watch.times[STAGES.len() - 1] = milliseconds(start);
        let (times, mut work) = (watch.times, watch.work);
        work.sorting = work.pairs * operations_of(setting.cutoffs.order());
        work.weights = light.map_or(0, Light::weight_count);
        work.numbers = gaussians.count * rules.numbers_read(gaussians.layout);
        work.channels = rules.blended(gaussians.layout).count();
        work.bytes = bytes(gaussians, light, setting.storage);
        let (width, height) = (camera.width as usize, camera.height as usize);
        let channels = work.channels + 1;
        let mut image = Image { width, height, channels, values: vec![0.0; channels * width * height] };
        self.exec.read_frame(&frame, &mut image.values)?;
        Ok(Taken { image, times, work })
    }

    /// Milliseconds of the light's prefilter under a setting; zero if it was not used.
    pub fn filter_milliseconds(&self, setting: &Setting) -> f64 {
        let of = self.light_of(setting, &self.rules(setting));
        self.lights.iter().find(|filtered| filtered.of == of).map_or(0.0, |filtered| filtered.milliseconds)
    }

    /// Rendering rules of a setting after planning.
    fn rules(&self, setting: &Setting) -> RenderRules {
        let (gaussians, needs) = stored(&self.stored, &self.subject, setting.storage);
        let levels = (setting.light > 0).then(|| Levels::new(setting.scheme, setting.light));
        Plan::new(gaussians.layout, needs, levels.as_ref(), &setting.rules(&self.subject)).rules
    }

    fn light_of(&self, setting: &Setting, rules: &RenderRules) -> (PrefilterScheme, usize, LevelRange, Storage) {
        (setting.scheme, setting.light, rules.levels, setting.storage)
    }

    /// Light around the near field of the subject, if there is one.
    fn surrounded(&mut self, light: Light) -> Result<Light, CpuError> {
        let Some(near_field) = self.subject.near_field.as_deref() else { return Ok(light) };
        let near_field = self.exec.upload_near_field(&near_field.with_values(near_field.values.as_slice()))?;
        self.exec.surround(light, &near_field)
    }

    /// Index of a setting's filtered light.
    fn filtered(&mut self, setting: &Setting, rules: &RenderRules) -> Result<Option<usize>, CpuError> {
        let of = self.light_of(setting, rules);
        let serves = |filtered: &Filtered| {
            let (scheme, resolution, _, storage) = of;
            filtered.of == of
                || filtered.is_of_reference && filtered.of == (scheme, resolution, LevelRange::ALL, storage)
        };
        if let Some(index) = self.lights.iter().position(serves) {
            return Ok(Some(index));
        }
        if setting.light == 0 || !rules.is_lit {
            return Ok(None);
        }
        let Some(light) = self.subject.light_at(setting.light) else { return Ok(None) };
        let start = Instant::now();
        let light = self.exec.prefilter(&light, setting.scheme, rules.levels)?;
        let mut light = self.surrounded(light)?;
        let milliseconds = milliseconds(start);
        light.round(setting.storage);
        self.lights.push(Filtered { of, light, is_of_reference: false, milliseconds });
        Ok(Some(self.lights.len() - 1))
    }
}

/// Operations of sorting a splat of a pixel, proportional to run times: a view of a trained scene
/// (45 887 Gaussians, 200 × 200 pixels) takes 47 ms in the order of means, 113, 110 and 125 ms in
/// windows of 8, 16 and 32, and 175 ms in the exact order; a pair of the first takes 49 operations.
const fn operations_of(order: BlendOrder) -> usize {
    const IN_WINDOW: usize = 64;
    const IN_PIXEL: usize = 134;
    match order {
        BlendOrder::Mean | BlendOrder::Window(0 | 1) => 0,
        BlendOrder::Window(count) => IN_WINDOW + count as usize / 2,
        BlendOrder::Pixel => IN_PIXEL,
    }
}

/// Gaussians in each number format, rounded on first use.
type Stored = [OnceCell<(Gaussians<Vec<f32>>, Needs)>; 2];

/// Gaussians of a subject in a number format, with their required stages.
fn stored<'a>(stored: &'a Stored, subject: &Subject, storage: Storage) -> &'a (Gaussians<Vec<f32>>, Needs) {
    stored[usize::from(storage == Storage::F16)].get_or_init(|| {
        let mut gaussians = subject.gaussians.clone();
        storage.round(&mut gaussians);
        let needs = Needs::of(&gaussians).under(subject.light.as_ref());
        (gaussians, needs)
    })
}

fn bytes(gaussians: &Gaussians<Vec<f32>>, light: Option<&Light>, storage: Storage) -> usize {
    let texel = match storage {
        Storage::F32 => size_of::<[f32; 4]>(),
        Storage::F16 => size_of::<[f32; 2]>(),
    };
    let light_bytes = light.map_or(0, |light| light.texel_count() * texel);
    size_of::<u32>() * storage.words(gaussians.layout) * gaussians.count + light_bytes
}

fn milliseconds(start: Instant) -> f64 {
    1e3 * start.elapsed().as_secs_f64()
}

/// Texels of a lookup: four of two levels.
const TEXELS_OF_LOOKUP: usize = 8;

/// Observer of a picture's stages: times and operation counts.
struct Stopwatch {
    /// Start of the current stage.
    start: Instant,
    times: Times,
    work: Work,
    /// Light lookups per Gaussian, and per pixel.
    looks_light_up: [bool; 2],
}

impl Stopwatch {
    fn new(looks_light_up: [bool; 2]) -> Self {
        Self { start: Instant::now(), times: Times::default(), work: Work::default(), looks_light_up }
    }
}

impl StageObserver<CpuViewer> for Stopwatch {
    fn on_stage(&mut self, stage: Stage<'_, CpuViewer>) {
        let index = match stage {
            Stage::Project(_) => 0,
            Stage::Shade(_) => 1,
            Stage::Bin(_) => 2,
            Stage::Blend(..) => 3,
            Stage::Trace(_) | Stage::Illuminate(_) | Stage::ShadePixels(_) => 4,
        };
        self.times[index] += milliseconds(self.start);
        let [by_gaussian, by_pixel] = self.looks_light_up;
        match stage {
            Stage::Project(splats) => {
                let records = splats.records();
                self.work.perspectives += if splats.are_affine() { 0 } else { records.len() };
                if by_gaussian {
                    let drawn = records.iter().filter(|record| record.reach > 0.0).count();
                    self.work.texel_reads += TEXELS_OF_LOOKUP * drawn;
                }
            }
            Stage::Shade(_) | Stage::Trace(_) | Stage::Illuminate(_) => {}
            Stage::Bin(tiles) => self.work.intersections += tiles.intersection_count(),
            Stage::Blend(splats, frame) => {
                let pairs = frame.seen_pairs();
                self.work.pairs += pairs;
                self.work.pairs_in_perspective += (splats.share_in_perspective() * pairs as f64) as usize;
            }
            Stage::ShadePixels(frame) => {
                if by_pixel {
                    self.work.texel_reads += TEXELS_OF_LOOKUP * frame.covered_pixels();
                }
            }
        }
        self.start = Instant::now();
    }
}

/// Minimum, median and interquartile range.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    /// Minimum, the statistic least affected by other processes.
    pub min: f64,
    /// Median.
    pub median: f64,
    /// Interquartile range.
    pub iqr: f64,
}

impl Spread {
    /// Statistics of some numbers; zero for none.
    pub fn of(mut numbers: Vec<f64>) -> Self {
        numbers.sort_by(f64::total_cmp);
        let Some(last) = numbers.len().checked_sub(1) else { return Self::default() };
        let at = |share: f64| numbers[(share * last as f64).round() as usize];
        Self { min: numbers[0], median: at(0.5), iqr: at(0.75) - at(0.25) }
    }
}

/// Setting with all channels for metrics, including normals.
pub fn measured(setting: &Setting) -> Setting {
    let channels = match setting.channels {
        Channels::Color => Channels::Training,
        channels => channels,
    };
    Setting { channels, ..*setting }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_is_of_sorted_numbers() {
        assert_eq!(Spread::of(vec![5.0, 1.0, 4.0, 2.0, 3.0]), Spread { min: 1.0, median: 3.0, iqr: 2.0 });
        assert_eq!(Spread::of(Vec::new()), Spread::default());
    }
}
