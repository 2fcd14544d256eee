//! The cheapest setting for an error: chosen by whole views, tried on others, and with every
//! picture verified in [`crate::verify`].
//!
//! Let P be a picture under a setting, T the exact one in `f64`, and X the most exact one that
//! `f32` has: nothing cut off, along rays, under the light of T. Roots of mean squares over a
//! picture obey the triangle inequality,
//!
//! ```text
//! |P − T| ≤ |P − X| + |X − T|
//! ```
//!
//! The first is measured in every pixel of a view, on the tiles of that very picture: a sample of
//! pixels would say nothing of what a cut leaves out elsewhere, and a part that is rendered by
//! itself has other tiles, where splats are cut elsewhere. The second is rounding alone, which is
//! measured in `f64` in a window of each view and counts `ROUNDING_MARGIN` times. So a picture is
//! within an error E of T where |P − X| is at most E less that margin.
//!
//! Each knob is turned alone, all others at their most exact; then all at once, each to its
//! cheapest value whose own error is within a bound. The bound begins with the whole error, because
//! errors of different knobs seldom add up, and falls until the setting holds in each view that it
//! was chosen by. Then it is tried on the other views; where it fails, the worst of these joins
//! those that it is chosen by, and the search goes on. What is cheap is told by counts of the work,
//! so that the choice is the same on every machine and in every run.

use crate::{
    reference::Reference,
    setting::{KNOBS, Knob, Setting, Tried, together},
    subject::Subject,
    trial::{Trial, Work},
};
use rayon::prelude::*;
use specula_core::{bin::TILE_SIZE, camera::Camera, scene::Image};
use specula_cpu::CpuError;
use specula_train::evaluate::over_background;

/// A bound is this share of the one before.
const TIGHTER: f64 = 0.7;
/// So many bounds are tried.
const BOUNDS: usize = 16;
/// A setting is chosen for this share of what is allowed, so that views that nobody looked at are
/// seldom beyond it.
const CHOSEN_FOR: f64 = 0.8;
/// Views that are looked at, at most; all of them together have about so many pixels.
const VIEWS: usize = 16;
const PIXELS: usize = 16_000_000;
/// A setting is chosen by one of so many of these at first.
const CHOSEN_BY: usize = 4;
/// Values of a knob come from the most exact to the coarsest: after so many in a row that are
/// beyond the error, those that follow are not tried.
const MISSES: usize = 2;
/// Pixels along an edge of a tile, and of the window in which rounding is measured.
const TILE: usize = TILE_SIZE as usize;
const WINDOW: usize = 2 * TILE;
/// Rounding of a picture is at most so many times that of the worst window. A picture's is a mean
/// over all its windows, of which those were measured where most is cut off, and so most splats
/// meet.
const ROUNDING_MARGIN: f64 = 2.0;
/// Knobs that do not change what a picture costs here, once its light is filtered, or not its colours.
const LEFT_ALONE: [&str; 4] = ["storage", "prefilter", "light", "channels"];

/// What was chosen, and by what right.
#[derive(Clone, Copy, Debug)]
pub struct Certificate {
    /// The setting.
    pub setting: Setting,
    /// The error that was asked for, of each picture: root of the mean square of sRGB colours in
    /// [0, 1].
    pub asked: f64,
    /// Distance of the most exact pictures of `f32` from those of `f64`, at most.
    pub rounding: f64,
    /// On the views that it was chosen by.
    pub chosen_by: Bounds,
    /// On views that it was not chosen by.
    pub tried_on: Bounds,
    /// Work of all these views: under the setting, under the usual and under the most exact one.
    pub work: [Work; 3],
}

impl Certificate {
    /// Distance of a picture from the most exact one of `f32` that is allowed, so that it is within what was
    /// asked for of that of `f64`.
    pub fn allowed(&self) -> f64 {
        self.asked - self.rounding
    }
}

/// Distances of pictures of some views from exact ones at most, roots of mean squares; zero where
/// there are no views.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bounds {
    /// Number of views.
    pub views: usize,
    /// Of all of them together.
    pub rms: f64,
    /// Of the worst.
    pub worst: f64,
}

impl Bounds {
    /// Views that are so far from those of `f32`, with what rounding adds.
    fn of(apart: &[f64], rounding: f64) -> Self {
        let views = apart.len();
        if views == 0 {
            return Self::default();
        }
        let square = apart.iter().map(|x| x * x).sum::<f64>() / views as f64;
        Self { views, rms: square.sqrt() + rounding, worst: largest(apart) + rounding }
    }
}

/// Why there is no setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refusal {
    /// Even the most exact setting may be this far off; infinite where pictures hold numbers that
    /// are not finite.
    TooClose(f64),
    /// The processor could not render.
    Failed,
}

impl From<CpuError> for Refusal {
    fn from(_: CpuError) -> Self {
        Self::Failed
    }
}

/// Part of a view: what is around a pixel, at the same scale.
pub(crate) fn tile_of(camera: &Camera, [x, y]: [u32; 2], size: [u32; 2]) -> Camera {
    let principal_px = [camera.principal_px[0] - x as f32, camera.principal_px[1] - y as f32];
    Camera { principal_px, width: size[0], height: size[1], ..*camera }
}

/// Views that are evenly spread over those of a subject: fewer where they are large, but two at
/// least to have one that a setting is not chosen by.
fn spread(cameras: &[Camera]) -> Vec<Camera> {
    let largest = cameras.iter().map(|camera| camera.width as usize * camera.height as usize).max().unwrap_or(1);
    let count = (PIXELS / largest.max(1)).clamp(2, VIEWS).min(cameras.len());
    (0..count).map(|k| cameras[k * cameras.len() / count]).collect()
}

/// Distance of the colours of two pictures of a view over a background: root of the mean
/// square. Infinite where a number is not finite in either.
pub(crate) fn apart(own: &Image<Vec<f32>>, exact: &[f32], background: [f32; 3]) -> f64 {
    root_mean_square(over_background(own, background).iter().zip(exact).map(|(a, b)| f64::from(*a) - f64::from(*b)))
}

/// Infinite where a number is not finite.
pub(crate) fn root_mean_square(differences: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = differences.len().max(1) as f64;
    let mean = differences.map(|x| x * x).sum::<f64>() / count;
    if mean.is_finite() { mean.sqrt() } else { f64::INFINITY }
}

fn largest(numbers: &[f64]) -> f64 {
    numbers.iter().copied().fold(0.0, f64::max)
}

/// The cheapest setting with which pictures of the subject's views are within `error` of exact
/// ones.
///
/// # Errors
///
/// If rounding alone may be as large, or the processor cannot render.
pub fn cheapest_within(subject: &Subject, reference: &Reference, error: f64) -> Result<Certificate, Refusal> {
    let mut trial = Trial::under(subject.clone(), reference)?;
    let exact = Setting::exact(subject);
    let views = spread(&subject.cameras)
        .into_iter()
        .map(|camera| Looked::new(&mut trial, subject, &exact, camera))
        .collect::<Result<Vec<_>, _>>()?;
    let of_views: Vec<f64> = views.par_iter().map(|view| view.rounding(subject, reference)).collect();
    let rounding = ROUNDING_MARGIN * largest(&of_views);
    if rounding >= error {
        return Err(Refusal::TooClose(rounding));
    }
    Search::new(subject, trial, exact, views, error - rounding).run(error, rounding)
}

/// A view, and its most exact picture.
#[derive(Debug)]
struct Looked {
    camera: Camera,
    /// Colours over the background, three planes.
    exact: Vec<f32>,
    /// First pixel of the window in which the usual setting is most wrong.
    window: [u32; 2],
    /// Of the usual picture, and of this one.
    work: [Work; 2],
}

impl Looked {
    fn new(trial: &mut Trial<'_>, subject: &Subject, exact: &Setting, camera: Camera) -> Result<Self, CpuError> {
        let own = trial.view(exact, &camera)?;
        let usual = trial.view(&Setting::usual(subject), &camera)?;
        let colors = |image: &Image<Vec<f32>>| over_background(image, subject.background);
        let exact = colors(&own.image);
        let window = window(&colors(&usual.image), &exact, [camera.width as usize, camera.height as usize]);
        Ok(Self { camera, exact, window, work: [usual.work, own.work] })
    }

    /// Distance of this picture from that of `f64`, in its window.
    fn rounding(&self, subject: &Subject, reference: &Reference) -> f64 {
        let size = [self.camera.width, self.camera.height].map(|size| size.min(WINDOW as u32));
        let truth = reference.view(subject, &tile_of(&self.camera, self.window, size)).colors;
        let plane = self.camera.width as usize * self.camera.height as usize;
        let first = self.window[1] as usize * self.camera.width as usize + self.window[0] as usize;
        let index = |k: usize| {
            let (channel, row, column) = (k / truth.pixel_count(), k / truth.width % truth.height, k % truth.width);
            channel * plane + first + row * self.camera.width as usize + column
        };
        root_mean_square((0..truth.values.len()).map(|k| f64::from(self.exact[index(k)]) - truth.values[k]))
    }
}

/// The first pixel of the window in which two pictures differ most, of those that begin where tiles
/// do.
fn window(one: &[f32], other: &[f32], [width, height]: [usize; 2]) -> [u32; 2] {
    let tiles = [width.div_ceil(TILE), height.div_ceil(TILE)];
    let mut sums = vec![0.0_f64; tiles[0] * tiles[1]];
    for (k, (a, b)) in one.iter().zip(other).enumerate() {
        let (row, column) = (k / width % height, k % width);
        let square = f64::from(a - b).powi(2);
        sums[row / TILE * tiles[0] + column / TILE] += if square.is_finite() { square } else { 0.0 };
    }
    let sum = |x: usize, y: usize| -> f64 {
        let rows = y..(y + 2).min(tiles[1]);
        rows.flat_map(|row| (x..(x + 2).min(tiles[0])).map(move |column| (row, column)))
            .map(|(row, column)| sums[row * tiles[0] + column])
            .sum()
    };
    let places = (0..tiles[0] * tiles[1]).map(|k| [k % tiles[0], k / tiles[0]]);
    let most = places.max_by(|a, b| sum(a[0], a[1]).total_cmp(&sum(b[0], b[1]))).unwrap_or([0; 2]);
    let within = |place: usize, size: usize| (place * TILE).min(size.saturating_sub(WINDOW)) as u32;
    [within(most[0], width), within(most[1], height)]
}

struct Search<'a> {
    subject: &'a Subject,
    trial: Trial<'static>,
    exact: Setting,
    /// Distance of pictures from the most exact ones that is allowed.
    allowed: f64,
    views: Vec<Looked>,
    /// The views that the setting is chosen by.
    chosen_by: Vec<usize>,
    of_knobs: Vec<(Knob, Vec<Tried>)>,
}

impl<'a> Search<'a> {
    fn new(subject: &'a Subject, trial: Trial<'static>, exact: Setting, views: Vec<Looked>, allowed: f64) -> Self {
        let knobs = KNOBS.into_iter().filter(|knob| !LEFT_ALONE.contains(&knob.name));
        let untried = |setting| Tried { setting, error: 0.0, cost: 0.0 };
        let of_knobs =
            knobs.map(|knob| (knob, knob.turned(subject, &exact).into_iter().map(untried).collect())).collect();
        Self { subject, trial, exact, allowed, views, chosen_by: Vec::new(), of_knobs }
    }

    fn run(mut self, asked: f64, rounding: f64) -> Result<Certificate, Refusal> {
        for view in (0..self.views.len()).step_by(CHOSEN_BY) {
            self.learn(view)?;
        }
        let setting = self.choose()?;
        let (mut chosen_by, mut tried_on, mut work) = (Vec::new(), Vec::new(), [Work::default(); 3]);
        for view in 0..self.views.len() {
            let (apart, own) = self.measure(&setting, view)?;
            if self.chosen_by.contains(&view) {
                chosen_by.push(apart);
            } else {
                tried_on.push(apart);
            }
            let [usual, exact] = self.views[view].work;
            work = [work[0].and(&own), work[1].and(&usual), work[2].and(&exact)];
        }
        let [chosen_by, tried_on] = [chosen_by, tried_on].map(|apart| Bounds::of(&apart, rounding));
        Ok(Certificate { setting, asked, rounding, chosen_by, tried_on, work })
    }

    /// Turns each knob in a view, which from now on is one of those that the setting is chosen by.
    fn learn(&mut self, view: usize) -> Result<(), Refusal> {
        let mut of_knobs = core::mem::take(&mut self.of_knobs);
        for (_, tried) in &mut of_knobs {
            let mut misses = 0;
            for own in tried {
                if misses < MISSES && own.error <= self.allowed {
                    let (apart, work) = self.measure(&own.setting, view)?;
                    own.error = own.error.max(apart);
                    own.cost += work.cost();
                } else {
                    own.error = f64::INFINITY;
                }
                misses = if own.error <= self.allowed { 0 } else { misses + 1 };
            }
        }
        self.of_knobs = of_knobs;
        self.chosen_by.push(view);
        Ok(())
    }

    /// The cheapest setting that holds in all views.
    fn choose(&mut self) -> Result<Setting, Refusal> {
        let mut bound = CHOSEN_FOR * self.allowed;
        for _ in 0..BOUNDS {
            while let setting = together(&self.exact, &self.of_knobs, bound)
                && self.worst(&setting, true)?.1 <= CHOSEN_FOR * self.allowed
            {
                match self.worst(&setting, false)? {
                    (Some(view), apart) if apart > CHOSEN_FOR * self.allowed => self.learn(view)?,
                    _ => return Ok(setting),
                }
            }
            bound *= TIGHTER;
        }
        Ok(self.exact)
    }

    /// The view in which a setting is most wrong, and how wrong, of those that it is chosen by or
    /// of the others.
    fn worst(&mut self, setting: &Setting, chosen_by: bool) -> Result<(Option<usize>, f64), Refusal> {
        let mut worst = (None, 0.0);
        for view in (0..self.views.len()).filter(|view| self.chosen_by.contains(view) == chosen_by).collect::<Vec<_>>()
        {
            let (apart, _) = self.measure(setting, view)?;
            if worst.0.is_none() || apart > worst.1 {
                worst = (Some(view), apart);
            }
        }
        Ok(worst)
    }

    /// Distance of a setting's picture from the most exact one of a view, and its work.
    fn measure(&mut self, setting: &Setting, view: usize) -> Result<(f64, Work), Refusal> {
        let Looked { camera, exact, work: [_, work], .. } = &self.views[view];
        if *setting == self.exact {
            return Ok((0.0, *work));
        }
        let own = self.trial.view(setting, camera)?;
        Ok((apart(&own.image, exact, self.subject.background), own.work))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::errors_of;
    use glam::Vec3;
    use specula_core::{
        prefilter::PrefilterScheme,
        scene::{Layout, RadianceActivation},
        shade::ShadingRules,
    };
    use specula_oracle::scenes::{random_cloud, random_environment};

    /// The seed that has a light, whose weights take a while.
    const LIT: u64 = 1;
    /// Views of a subject.
    const SEEN: u32 = 8;
    /// Width and height of views in pixels: windows are a part of the large.
    const LARGE: u32 = 128;
    const SMALL: u32 = 48;
    /// Tolerance of pictures that are equal in `f64` but for principal points, which are `f32`.
    const SAME: f64 = 1e-6;

    /// A view from a place of a circle.
    fn orbit(place: f32, size: u32) -> Camera {
        let (sin, cos) = (place * core::f32::consts::TAU / SEEN as f32).sin_cos();
        Camera::look_at(Vec3::new(3.6 * sin, 3.6 * cos, 1.5), Vec3::ZERO, Vec3::Z, 0.7, size, size)
    }

    fn subject(seed: u64, size: u32) -> Subject {
        Subject {
            gaussians: random_cloud(200, Layout::shaded(Some(1)), seed),
            light: (seed == LIT).then(|| random_environment(16, RadianceActivation::Identity, seed)),
            shading: ShadingRules::DEFERRED,
            scheme: PrefilterScheme::Exact,
            cameras: (0..SEEN).map(|k| orbit(k as f32, size)).collect(),
            background: [1.0; 3],
        }
    }

    fn cheapest(subject: &Subject, error: f64) -> Result<Certificate, Refusal> {
        cheapest_within(subject, &Reference::new(subject), error)
    }

    #[test]
    fn a_certificate_holds_on_whole_views_that_it_has_not_seen() {
        for (seed, error) in [(1, 0.03), (2, 0.01), (3, 0.002)] {
            let subject = subject(seed, LARGE);
            let reference = Reference::new(&subject);
            let certificate = cheapest_within(&subject, &reference, error).expect("it can be met");
            assert!(certificate.chosen_by.worst.max(certificate.tried_on.worst) <= error, "{certificate:?}");
            let views = [0.5, 3.3, 6.7].map(|place| {
                let other = orbit(place, LARGE);
                (other, reference.view(&subject, &other))
            });
            let mut trial = Trial::under(subject.clone(), &reference).expect("the light is filtered");
            let (errors, _) = errors_of(&mut trial, &subject, &certificate.setting, &views).expect("it renders");
            assert!(errors.is_within(error), "{error} was asked for, and {errors:?} measured");
        }
    }

    #[test]
    fn under_the_light_of_exact_pictures_nothing_but_rounding_is_left() {
        let subject = subject(LIT, SMALL);
        let reference = Reference::new(&subject);
        let views = [(subject.cameras[0], reference.view(&subject, &subject.cameras[0]))];
        let exact = Setting::exact(&subject);
        let error = |mut trial: Trial<'_>| errors_of(&mut trial, &subject, &exact, &views).expect("it renders").0.rms;
        let own = error(Trial::under(subject.clone(), &reference).expect("the light is filtered"));
        let executors = error(Trial::new(&subject));
        assert!(
            own < 1e-5 && executors > 10.0 * own,
            "{own:e}, and {executors:e} under the light as executors filter it"
        );
    }

    #[test]
    fn a_scene_of_nothing_is_exact() {
        let nothing = Subject { gaussians: random_cloud(0, Layout::shaded(Some(1)), 0), ..subject(LIT, SMALL) };
        let certificate = cheapest(&nothing, 1e-6).expect("there is nothing to get wrong");
        assert_eq!(certificate.tried_on.worst, 0.0, "{certificate:?}");
    }

    #[test]
    fn what_is_allowed_more_error_costs_no_more() {
        let subject = subject(4, SMALL);
        let cost = |error: f64| cheapest(&subject, error).expect("it can be met").work[0].cost();
        let costs = [0.001, 0.01, 0.1].map(cost);
        assert!(costs[0] >= costs[1] && costs[1] >= costs[2], "{costs:?}");
        assert!(costs[2] < 0.9 * costs[0], "something is saved: {costs:?}");
    }

    #[test]
    fn what_cannot_be_met_is_refused_with_what_can() {
        let subject = subject(5, SMALL);
        let Err(Refusal::TooClose(least)) = cheapest(&subject, 1e-12) else { panic!("f32 has no 12 digits") };
        assert!(least > 1e-12 && least < 1e-4, "{least}");
        assert!(cheapest(&subject, 1.01 * least).is_ok(), "a little more can be kept");
    }

    #[test]
    fn views_are_chosen_by_or_tried_on_and_never_both() {
        let cameras = subject(7, SMALL).cameras;
        for count in [1, 2, 5, 8] {
            let subject = Subject { cameras: cameras[..count].to_vec(), ..subject(7, SMALL) };
            let certificate = cheapest(&subject, 0.01).expect("it can be met");
            assert_eq!(certificate.chosen_by.views + certificate.tried_on.views, count);
            assert!(count == 1 || certificate.tried_on.views > 0, "{certificate:?}");
        }
    }

    #[test]
    fn a_window_is_where_pictures_differ_most_and_within_them() {
        let [width, height] = [100, 70];
        for [x, y] in [[5, 3], [99, 69], [40, 20]] {
            let mut other = vec![0.0; 3 * width * height];
            other[width * height + y * width + x] = 1.0;
            let [left, top] = window(&vec![0.0; other.len()], &other, [width, height]).map(|first| first as usize);
            assert!((left..left + WINDOW).contains(&x) && (top..top + WINDOW).contains(&y), "{left}, {top}");
            assert!(left + WINDOW <= width && top + WINDOW <= height, "{left}, {top}");
        }
        assert_eq!(window(&[0.0; 30], &[1.0; 30], [5, 2]), [0, 0], "a view that is smaller than a window");
    }

    #[test]
    fn a_tile_is_a_part_of_its_view() {
        let subject = subject(6, SMALL);
        let whole = subject.cameras[0];
        let reference = Reference::new(&subject);
        let [tile, whole] =
            [tile_of(&whole, [9, 5], [16, 12]), whole].map(|camera| reference.view(&subject, &camera).colors);
        for k in 0..tile.values.len() {
            let (channel, row, column) = (k / tile.pixel_count(), k / 16 % 12, k % 16);
            let of_whole = whole.values[channel * whole.pixel_count() + (row + 5) * whole.width + column + 9];
            assert!((tile.values[k] - of_whole).abs() < SAME, "{} and {of_whole}", tile.values[k]);
        }
    }
}
