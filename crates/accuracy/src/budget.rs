//! Search for the cheapest setting within an error: chosen on whole views, validated on others, and
//! verified picture by picture in [`crate::verify`].
//!
//! Let P be a picture under a setting, T the exact one in `f64`, and X the most exact one in `f32`:
//! without cutoffs, projected along rays, under the light of T. Root mean squares over a picture
//! obey the triangle inequality,
//!
//! ```text
//! |P − T| ≤ |P − X| + |X − T|
//! ```
//!
//! The first term is measured in every pixel of a view, on the tiles of that picture: a sample of
//! pixels would miss cutoffs elsewhere, and a crop has other tiles with other cutoffs. The second
//! term is only rounding; it is measured in `f64` in a window of each view and multiplied by
//! `ROUNDING_MARGIN`. A picture is within an error E of T if |P − X| is at most E minus that
//! margin.
//!
//! Each parameter is first varied with all others at their most exact value. Then all are combined,
//! each at the cheapest value with an error within a bound. The bound starts at the whole error,
//! since errors of parameters seldom add up, and decreases until the setting holds in each
//! selection view. The setting is then validated on the other views; if it fails, the worst of
//! these becomes a selection view, and the search continues. Costs are operation counts, so the
//! choice is the same on every machine and in every run.

use crate::{
    reference::Reference,
    setting::{PARAMETERS, Parameter, Setting, Tried, together},
    subject::Subject,
    trial::{Trial, Work},
};
use rayon::prelude::*;
use specula_core::{bin::TILE_SIZE, camera::Camera, scene::Image};
use specula_cpu::CpuError;
use specula_train::evaluate::over_background;

/// Ratio of successive bounds.
const BOUND_RATIO: f64 = 0.7;
/// Number of bounds.
const BOUND_COUNT: usize = 16;
/// Share of the allowed error that a setting may use, so that unseen views seldom exceed it.
const ERROR_SHARE: f64 = 0.8;
/// Largest number of views, and of their pixels in total.
const VIEWS_MAX: usize = 16;
const PIXELS_MAX: usize = 16_000_000;
/// Every Nth view is used to choose a setting at first.
const CHOICE_STRIDE: usize = 4;
/// Number of consecutive values beyond the error after which the coarser values of a parameter are
/// skipped.
const MISSES_MAX: usize = 2;
/// Edge of a tile, and of the window in which rounding is measured, in pixels.
const TILE: usize = TILE_SIZE as usize;
const WINDOW: usize = 2 * TILE;
/// Upper bound of the ratio between the rounding of a picture and of its worst window. A picture's
/// rounding is a mean over all windows; the measured ones are those with the largest cuts, and so
/// with the most splats.
const ROUNDING_MARGIN: f64 = 2.0;
/// Parameters without effect on the colours or on the cost of a picture with filtered light.
const FREE_PARAMETERS: [&str; 4] = ["storage", "prefilter", "light", "channels"];

/// Chosen setting with its measurements.
#[derive(Clone, Copy, Debug)]
pub struct Certificate {
    /// The setting.
    pub setting: Setting,
    /// Requested error of each picture: root mean square of sRGB colours in \[0, 1\].
    pub asked: f64,
    /// Upper bound of the distance between the most exact pictures in `f32` and those in `f64`.
    pub rounding: f64,
    /// Bounds on the selection views.
    pub chosen_by: Bounds,
    /// Bounds on the other views.
    pub tried_on: Bounds,
    /// Work of all views under the chosen, the default and the most exact setting.
    pub work: [Work; 3],
}

impl Certificate {
    /// Allowed distance from the most exact picture in `f32` for a picture within the requested
    /// error of the one in `f64`.
    pub fn allowed(&self) -> f64 {
        self.asked - self.rounding
    }
}

/// Upper bounds of distances to exact pictures, as root mean squares; zero without views.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bounds {
    /// Number of views.
    pub views: usize,
    /// Root mean square over all views.
    pub rms: f64,
    /// Largest root mean square of a view.
    pub worst: f64,
}

impl Bounds {
    /// Bounds for distances from the pictures in `f32`, with the rounding added.
    fn of(apart: &[f64], rounding: f64) -> Self {
        let views = apart.len();
        if views == 0 {
            return Self::default();
        }
        let square = apart.iter().map(|x| x * x).sum::<f64>() / views as f64;
        Self { views, rms: square.sqrt() + rounding, worst: largest(apart) + rounding }
    }
}

/// Error of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refusal {
    /// Even the most exact setting may have this error; infinite for pictures with numbers that are
    /// not finite.
    TooClose(f64),
    /// The CPU executor failed.
    Failed,
}

impl From<CpuError> for Refusal {
    fn from(_: CpuError) -> Self {
        Self::Failed
    }
}

/// Camera of a crop at the same scale.
pub(crate) fn tile_of(camera: &Camera, [x, y]: [u32; 2], size: [u32; 2]) -> Camera {
    let principal_px = [camera.principal_px[0] - x as f32, camera.principal_px[1] - y as f32];
    Camera { principal_px, width: size[0], height: size[1], ..*camera }
}

/// Evenly spread views of a subject: fewer if they are large, but at least two, so that one remains
/// for validation.
fn spread(cameras: &[Camera]) -> Vec<Camera> {
    let largest = cameras.iter().map(|camera| camera.width as usize * camera.height as usize).max().unwrap_or(1);
    let count = (PIXELS_MAX / largest.max(1)).clamp(2, VIEWS_MAX).min(cameras.len());
    (0..count).map(|k| cameras[k * cameras.len() / count]).collect()
}

/// Root mean square distance of two pictures of a view over a background; infinite if a number is
/// not finite.
pub(crate) fn apart(rendered: &Image<Vec<f32>>, exact: &[f32], background: [f32; 3]) -> f64 {
    root_mean_square(
        over_background(rendered, background).iter().zip(exact).map(|(a, b)| f64::from(*a) - f64::from(*b)),
    )
}

/// Root mean square; infinite if a number is not finite.
pub(crate) fn root_mean_square(differences: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = differences.len().max(1) as f64;
    let mean = differences.map(|x| x * x).sum::<f64>() / count;
    if mean.is_finite() { mean.sqrt() } else { f64::INFINITY }
}

fn largest(numbers: &[f64]) -> f64 {
    numbers.iter().copied().fold(0.0, f64::max)
}

/// Searches the cheapest setting with which pictures of the subject's views are within `error` of
/// exact ones.
///
/// # Errors
///
/// [`Refusal::TooClose`] if the rounding may already be as large, [`Refusal::Failed`] if the CPU
/// executor fails.
pub fn cheapest_within(subject: &Subject, reference: &Reference, error: f64) -> Result<Certificate, Refusal> {
    let mut trial = Trial::under(subject.clone(), reference)?;
    let exact = Setting::exact(subject);
    let views = spread(&subject.cameras)
        .into_iter()
        .map(|camera| MeasuredView::new(&mut trial, subject, &exact, camera))
        .collect::<Result<Vec<_>, _>>()?;
    let view_rounding: Vec<f64> = views.par_iter().map(|view| view.rounding(subject, reference)).collect();
    let rounding = ROUNDING_MARGIN * largest(&view_rounding);
    if rounding >= error {
        return Err(Refusal::TooClose(rounding));
    }
    Search::new(subject, trial, exact, views, error - rounding).run(error, rounding)
}

/// A view with its most exact picture.
#[derive(Debug)]
struct MeasuredView {
    camera: Camera,
    /// Colours over the background, three planes.
    exact: Vec<f32>,
    /// Upper left pixel of the window with the largest error of the default setting.
    window: [u32; 2],
    /// Work of the default and of the most exact picture.
    work: [Work; 2],
}

impl MeasuredView {
    fn new(trial: &mut Trial<'_>, subject: &Subject, exact: &Setting, camera: Camera) -> Result<Self, CpuError> {
        let view = trial.view(exact, &camera)?;
        let default = trial.view(&Setting::default_for(subject), &camera)?;
        let colors = |image: &Image<Vec<f32>>| over_background(image, subject.background);
        let exact = colors(&view.image);
        let window = window(&colors(&default.image), &exact, [camera.width as usize, camera.height as usize]);
        Ok(Self { camera, exact, window, work: [default.work, view.work] })
    }

    /// Distance of this picture from the one in `f64`, in the window.
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

/// Upper left pixel of the window, aligned to tiles, in which two pictures differ most.
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
    /// Allowed distance from the most exact pictures.
    allowed: f64,
    views: Vec<MeasuredView>,
    /// Selection views.
    chosen_by: Vec<usize>,
    trials: Vec<(Parameter, Vec<Tried>)>,
}

impl<'a> Search<'a> {
    fn new(
        subject: &'a Subject,
        trial: Trial<'static>,
        exact: Setting,
        views: Vec<MeasuredView>,
        allowed: f64,
    ) -> Self {
        let parameters = PARAMETERS.into_iter().filter(|parameter| !FREE_PARAMETERS.contains(&parameter.name));
        let untried = |setting| Tried { setting, error: 0.0, cost: 0.0 };
        let trials = parameters
            .map(|parameter| (parameter, parameter.settings(subject, &exact).into_iter().map(untried).collect()))
            .collect();
        Self { subject, trial, exact, allowed, views, chosen_by: Vec::new(), trials }
    }

    fn run(mut self, asked: f64, rounding: f64) -> Result<Certificate, Refusal> {
        for view in (0..self.views.len()).step_by(CHOICE_STRIDE) {
            self.learn(view)?;
        }
        let setting = self.choose()?;
        let (mut chosen_by, mut tried_on, mut work) = (Vec::new(), Vec::new(), [Work::default(); 3]);
        for view in 0..self.views.len() {
            let (apart, chosen) = self.measure(&setting, view)?;
            if self.chosen_by.contains(&view) {
                chosen_by.push(apart);
            } else {
                tried_on.push(apart);
            }
            let [default, exact] = self.views[view].work;
            work = [work[0].and(&chosen), work[1].and(&default), work[2].and(&exact)];
        }
        let [chosen_by, tried_on] = [chosen_by, tried_on].map(|apart| Bounds::of(&apart, rounding));
        Ok(Certificate { setting, asked, rounding, chosen_by, tried_on, work })
    }

    /// Varies each parameter in a view, which becomes a selection view.
    fn learn(&mut self, view: usize) -> Result<(), Refusal> {
        let mut trials = core::mem::take(&mut self.trials);
        for (_, tried) in &mut trials {
            let mut misses = 0;
            for trial in tried {
                if misses < MISSES_MAX && trial.error <= self.allowed {
                    let (apart, work) = self.measure(&trial.setting, view)?;
                    trial.error = trial.error.max(apart);
                    trial.cost += work.cost();
                } else {
                    trial.error = f64::INFINITY;
                }
                misses = if trial.error <= self.allowed { 0 } else { misses + 1 };
            }
        }
        self.trials = trials;
        self.chosen_by.push(view);
        Ok(())
    }

    /// Chooses the cheapest setting that holds in all views.
    fn choose(&mut self) -> Result<Setting, Refusal> {
        let mut bound = ERROR_SHARE * self.allowed;
        for _ in 0..BOUND_COUNT {
            while let setting = together(&self.exact, &self.trials, bound)
                && self.worst(&setting, true)?.1 <= ERROR_SHARE * self.allowed
            {
                match self.worst(&setting, false)? {
                    (Some(view), apart) if apart > ERROR_SHARE * self.allowed => self.learn(view)?,
                    _ => return Ok(setting),
                }
            }
            bound *= BOUND_RATIO;
        }
        Ok(self.exact)
    }

    /// View with the largest error of a setting, and that error, among the selection views or among
    /// the others.
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
        let MeasuredView { camera, exact, work: [_, work], .. } = &self.views[view];
        if *setting == self.exact {
            return Ok((0.0, *work));
        }
        let rendered = self.trial.view(setting, camera)?;
        Ok((apart(&rendered.image, exact, self.subject.background), rendered.work))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::errors_of;
    use glam::Vec3;
    use specula_core::{
        cutoffs::BlendOrder,
        prefilter::PrefilterScheme,
        scene::{Layout, RadianceActivation},
        shade::ShadingRules,
    };
    use specula_oracle::scenes::{random_cloud, random_environment};

    /// Seed of a scene with a light, whose weights take a while.
    const LIT: u64 = 1;
    /// Views of a subject.
    const SEEN: u32 = 8;
    /// Width and height of views in pixels, larger than windows.
    const LARGE: u32 = 128;
    const SMALL: u32 = 48;
    /// Tolerance of pictures that are equal in `f64` up to principal points in `f32`.
    const SAME: f64 = 1e-6;

    /// A view from a point of a circle.
    fn orbit(place: f32, size: u32) -> Camera {
        let (sin, cos) = (place * core::f32::consts::TAU / SEEN as f32).sin_cos();
        Camera::look_at(Vec3::new(3.6 * sin, 3.6 * cos, 1.5), Vec3::ZERO, Vec3::Z, 0.7, size, size)
    }

    fn subject(seed: u64, size: u32) -> Subject {
        Subject {
            gaussians: random_cloud(200, Layout::shaded(Some(1)), seed),
            light: (seed == LIT).then(|| random_environment(16, RadianceActivation::Identity, seed)),
            near_field: None,
            shading: ShadingRules::DEFERRED,
            scheme: PrefilterScheme::Exact,
            cameras: (0..SEEN).map(|k| orbit(k as f32, size)).collect(),
            background: [1.0; 3],
            order: BlendOrder::Mean,
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
    fn under_the_light_of_exact_pictures_only_rounding_remains() {
        let subject = subject(LIT, SMALL);
        let reference = Reference::new(&subject);
        let views = [(subject.cameras[0], reference.view(&subject, &subject.cameras[0]))];
        let exact = Setting::exact(&subject);
        let error = |mut trial: Trial<'_>| errors_of(&mut trial, &subject, &exact, &views).expect("it renders").0.rms;
        let largest = error(Trial::under(subject.clone(), &reference).expect("the light is filtered"));
        let executors = error(Trial::new(&subject));
        assert!(
            largest < 1e-5 && executors > 10.0 * largest,
            "{largest:e}, and {executors:e} under the light as executors filter it"
        );
    }

    #[test]
    fn an_empty_scene_is_exact() {
        let nothing = Subject { gaussians: random_cloud(0, Layout::shaded(Some(1)), 0), ..subject(LIT, SMALL) };
        let certificate = cheapest(&nothing, 1e-6).expect("an empty picture has no error");
        assert_eq!(certificate.tried_on.worst, 0.0, "{certificate:?}");
    }

    #[test]
    fn a_larger_error_costs_no_more() {
        let subject = subject(4, SMALL);
        let cost = |error: f64| cheapest(&subject, error).expect("it can be met").work[0].cost();
        let costs = [0.001, 0.01, 0.1].map(cost);
        assert!(costs[0] >= costs[1] && costs[1] >= costs[2], "{costs:?}");
        assert!(costs[2] < 0.9 * costs[0], "a larger error saves work: {costs:?}");
    }

    #[test]
    fn an_order_is_as_coarse_as_the_error_allows() {
        let subject = Subject { order: BlendOrder::Pixel, ..subject(8, SMALL) };
        let order = |error: f64| cheapest(&subject, error).expect("it can be met").setting.cutoffs.order();
        assert_ne!(order(1e-4), BlendOrder::Mean, "large splats cross");
        assert_eq!(order(0.5), BlendOrder::Mean, "nothing is 0.5 off");
    }

    #[test]
    fn a_certificate_holds_in_the_order_of_exact_pictures() {
        for order in [BlendOrder::Pixel, BlendOrder::Window(16)] {
            let subject = Subject { order, ..subject(9, SMALL) };
            let reference = Reference::new(&subject);
            let certificate = cheapest_within(&subject, &reference, 0.02).expect("it can be met");
            let views = [0.5, 3.3].map(|place| (orbit(place, SMALL), reference.view(&subject, &orbit(place, SMALL))));
            let mut trial = Trial::under(subject.clone(), &reference).expect("the light is filtered");
            let (errors, _) = errors_of(&mut trial, &subject, &certificate.setting, &views).expect("it renders");
            assert!(errors.is_within(0.02), "{order:?}: {errors:?}");
            let by_means = Subject { order: BlendOrder::Mean, ..subject };
            let other = Reference::new(&by_means);
            let views = [0.5, 3.3].map(|place| (orbit(place, SMALL), other.view(&by_means, &orbit(place, SMALL))));
            let (errors, _) = errors_of(&mut trial, &by_means, &certificate.setting, &views).expect("it renders");
            assert!(!errors.is_within(0.02), "pictures of another order are not those: {order:?}, {errors:?}");
        }
    }

    #[test]
    fn unreachable_errors_are_rejected_with_the_smallest_reachable_one() {
        let subject = subject(5, SMALL);
        let Err(Refusal::TooClose(least)) = cheapest(&subject, 1e-12) else { panic!("f32 has no 12 digits") };
        assert!(least > 1e-12 && least < 1e-4, "{least}");
        assert!(cheapest(&subject, 1.01 * least).is_ok(), "a slightly larger error is possible");
    }

    #[test]
    fn views_serve_selection_or_validation_but_not_both() {
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
            let whole_value = whole.values[channel * whole.pixel_count() + (row + 5) * whole.width + column + 9];
            assert!((tile.values[k] - whole_value).abs() < SAME, "{} and {whole_value}", tile.values[k]);
        }
    }
}
