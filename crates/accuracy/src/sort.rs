//! Error and run time of orders of splats against an exact sort per pixel.
//!
//! Pipelines sort Gaussians by the depth of their means, once for a picture. Along a pixel's ray a
//! Gaussian has its largest response at another depth, so large overlapping Gaussians are blended
//! in the wrong order in some pixels, and swap as the camera moves. The CPU executor can also sort
//! within a window, or per pixel. Everything else is equal here: projection along rays, no cutoffs,
//! the same colours. Run times are those of whole views within the default cutoffs.

use crate::{
    budget::tile_of,
    error::{Errors, Sums},
    reference::{Exact, Reference},
    setting::Setting,
    subject::Subject,
    trial::{Spread, Trial, measured},
};
use rayon::prelude::*;
use specula_core::{
    camera::Camera,
    cutoffs::{
        BlendOrder::{self, Mean, Pixel, Window},
        Cutoffs,
    },
    double::Double,
    scene::Image,
};
use specula_cpu::CpuError;
use specula_oracle::{Frame, independent::rays::Order};

/// Gaussians times pixels to render for each order, ten or twenty seconds of a core.
const EVALUATIONS: usize = 1_000_000_000;

/// Orders of the CPU executor, that of means first.
const ORDERS: [BlendOrder; 5] = [Mean, Window(8), Window(16), Window(32), Pixel];

/// Error and run time of an order.
#[derive(Clone, Debug)]
pub struct Sorted {
    /// Depth that splats are sorted by.
    pub by: String,
    /// Errors against a sort per pixel.
    pub errors: Errors,
    /// Milliseconds of a view within the default cutoffs; `None` if no executor has the order.
    pub milliseconds: Option<f64>,
}

/// Errors of sort orders.
#[derive(Clone, Debug)]
pub struct Sort {
    /// Number of tiles, one from the middle of each view.
    pub tiles: usize,
    /// Pixels of a tile.
    pub size: [u32; 2],
    /// Largest difference of a colour between the pipeline and the independent renderer, both
    /// sorted by the depth of means: the precision of the comparison.
    pub apart: f64,
    /// Depth of the mean, distance of the mean, then the other orders of the CPU executor.
    pub orders: Vec<Sorted>,
}

/// A tile in every order.
struct Tile {
    /// Picture of the pipeline.
    mean: Frame<Double>,
    /// Pictures of the independent renderer: by depth of the mean, by distance of the mean, per
    /// pixel.
    ordered: [Frame<Double>; 3],
}

impl Sort {
    /// Measures a part of each view; calls `done` for each. Run times are the minimum of `repeats`.
    ///
    /// # Errors
    ///
    /// [`CpuError`] if a view cannot be rendered.
    pub fn new(
        subject: &Subject,
        reference: &Reference,
        repeats: u32,
        done: impl Fn() + Sync,
    ) -> Result<Self, CpuError> {
        let cameras: Vec<Camera> = subject.cameras.iter().map(|view| middle(view, subject)).collect();
        let tile = |camera: &Camera| {
            let orders = [Order::Mean, Order::Distance, Order::Response];
            let ordered = orders.map(|order| reference.frame_in_order(subject, camera, order));
            let tile = Tile { mean: reference.frame(subject, camera), ordered };
            done();
            tile
        };
        let tiles: Vec<Tile> = cameras.par_iter().map(tile).collect();
        let mut trial = Trial::under(subject.clone(), reference)?;

        let mut sums = [Sums::default(), Sums::default()];
        let mut by_order = ORDERS.map(|_| Sums::default());
        let mut apart = 0.0_f64;
        for (Tile { mean, ordered: [same, distance, response] }, camera) in tiles.iter().zip(&cameras) {
            let exact = Exact::of(response, subject.background);
            for (sums, frame) in sums.iter_mut().zip([mean, distance]) {
                sums.add(&narrow(frame), &exact, subject.background);
            }
            for (sums, order) in by_order.iter_mut().zip(ORDERS) {
                let setting = in_order(&Setting::exact(subject), order);
                sums.add(&trial.view(&measured(&setting), camera)?.image, &exact, subject.background);
            }
            apart = apart.max(largest_difference(mean, same, subject.background));
        }
        let [mean, distance] = sums.map(Sums::errors);
        let milliseconds = run_times(&mut trial, subject, repeats)?;
        let by_order = by_order.map(Sums::errors).into_iter().zip(ORDERS).zip(milliseconds);
        let sorted = |((errors, order), milliseconds): ((Errors, BlendOrder), Option<f64>)| Sorted {
            by: name(order),
            errors,
            milliseconds,
        };
        let mut orders: Vec<Sorted> = by_order.map(sorted).collect();
        orders[0].errors = mean;
        orders.insert(1, Sorted { by: "distance of the mean".to_owned(), errors: distance, milliseconds: None });
        let size = cameras.first().map_or([0; 2], |camera| [camera.width, camera.height]);
        Ok(Self { tiles: tiles.len(), size, apart, orders })
    }
}

/// Name of an order in reports.
fn name(order: BlendOrder) -> String {
    match order {
        Mean => "depth of the mean".to_owned(),
        Window(count) => format!("depth along the ray, window of {count}"),
        Pixel => "depth along the ray".to_owned(),
    }
}

fn in_order(setting: &Setting, order: BlendOrder) -> Setting {
    Setting { cutoffs: setting.cutoffs.with_order(order), ..*setting }
}

/// Milliseconds of a view in each order within the default cutoffs: the minimum of some runs, in
/// which the orders take turns; none without views or runs.
fn run_times(trial: &mut Trial<'_>, subject: &Subject, repeats: u32) -> Result<[Option<f64>; ORDERS.len()], CpuError> {
    let default = Setting { cutoffs: Cutoffs::DEFAULT, ..Setting::exact(subject) };
    let mut samples = ORDERS.map(|_| Vec::new());
    for _ in 0..repeats {
        for (samples, order) in samples.iter_mut().zip(ORDERS) {
            let mut total = 0.0;
            for camera in &subject.cameras {
                total += trial.view(&in_order(&default, order), camera)?.milliseconds();
            }
            samples.push(total / subject.cameras.len().max(1) as f64);
        }
    }
    Ok(samples.map(|samples| (!samples.is_empty()).then(|| Spread::of(samples).min)))
}

/// Central crop of a view, within the number of pixels.
fn middle(view: &Camera, subject: &Subject) -> Camera {
    let pixels = EVALUATIONS / (subject.gaussians.count * subject.cameras.len()).max(1);
    let share = (pixels as f64 / f64::from(view.width * view.height)).sqrt().min(1.0);
    let size = [view.width, view.height].map(|whole| ((f64::from(whole) * share) as u32).max(1));
    tile_of(view, [(view.width - size[0]) / 2, (view.height - size[1]) / 2], size)
}

fn narrow(frame: &Frame<Double>) -> Image<Vec<f32>> {
    let Image { width, height, channels, .. } = *frame;
    Image { width, height, channels, values: frame.values.iter().map(|x| x.0 as f32).collect() }
}

/// Largest difference; infinite for NaN.
fn largest_difference(one: &Frame<Double>, other: &Frame<Double>, background: [f32; 3]) -> f64 {
    let colors = |frame| Exact::of(frame, background).colors.values;
    let differences = colors(one).into_iter().zip(colors(other)).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, |most, x| if x.is_nan() { f64::INFINITY } else { x.max(most) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::{prefilter::PrefilterScheme, scene::Layout, shade::ShadingRules};
    use specula_oracle::scenes::{camera, random_cloud};

    /// Precision of core's `f32` constants.
    const SAME: f64 = 1e-6;
    /// Rounding of `f32`, and a pixel with two Gaussians of equal depth up to rounding.
    const EXACT: f64 = 1e-4;

    fn sort(log_scale: f32) -> Sort {
        let mut gaussians = random_cloud(60, Layout::radiance(0), 5);
        for gaussian in 0..gaussians.count {
            let scales = gaussians.get::<3>(gaussian, specula_core::scene::LOG_SCALE);
            gaussians.set(gaussian, specula_core::scene::LOG_SCALE, scales.map(|scale| scale + log_scale));
        }
        let subject = Subject {
            gaussians,
            light: None,
            near_field: None,
            shading: ShadingRules::PAPER,
            scheme: PrefilterScheme::Exact,
            cameras: vec![camera(32, 24), camera(32, 24)],
            background: [0.0; 3],
            order: Mean,
        };
        Sort::new(&subject, &Reference::new(&subject), 1, || {}).expect("the CPU renders")
    }

    #[test]
    fn large_gaussians_are_in_the_wrong_order_and_small_ones_are_not() {
        let [large, small] = [0.5, -4.0].map(sort);
        for sort in [&large, &small] {
            assert_eq!((sort.tiles, sort.size), (2, [32, 24]), "there is time for all of it");
            assert!(sort.apart < SAME, "the same picture twice: {}", sort.apart);
        }
        let rms = |sort: &Sort| sort.orders.iter().map(|sorted| sorted.errors.rms).collect::<Vec<_>>();
        assert!(rms(&large)[..2].iter().all(|rms| *rms > 1e-3), "{large:?}");
        assert!(rms(&small).iter().all(|rms| *rms < 1e-3), "{small:?}");
        let [mean, _, eight, sixteen, thirty_two, pixel] = rms(&large)[..] else { panic!("six orders: {large:?}") };
        assert!(mean > eight && eight > sixteen && sixteen > thirty_two && thirty_two >= pixel, "{large:?}");
        assert!(pixel < EXACT, "the exact order is that of the independent renderer: {pixel:e}");
        let times = large.orders.iter().map(|sorted| sorted.milliseconds.is_some());
        assert!(times.eq([true, false, true, true, true, true]), "orders of executors take time: {large:?}");
    }
}
