//! Error of one sort per picture against a sort per pixel.
//!
//! Pipelines sort Gaussians by the depth of their means, once for a picture. Along a pixel's ray a
//! Gaussian lies where its response is largest, which may be elsewhere, so that large overlapping
//! Gaussians are blended in the wrong order in some pixels, and swap as the camera moves. All else
//! is equal here: projection along rays in `f64`, no cutoffs, the same colours.

use crate::{
    budget::tile_of,
    error::{Errors, Sums},
    reference::{Exact, Reference},
    subject::Subject,
};
use rayon::prelude::*;
use specula_core::{camera::Camera, double::Double, scene::Image};
use specula_oracle::{Frame, independent::rays::Order};

/// Gaussians times pixels to render for each order, ten or twenty seconds of a core.
const EVALUATIONS: usize = 1_000_000_000;

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
    /// Errors against a sort per pixel.
    pub orders: [(&'static str, Errors); 2],
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
    /// Measures a part of each view; `done` is called for each.
    pub fn new(subject: &Subject, reference: &Reference, done: impl Fn() + Sync) -> Self {
        let cameras: Vec<Camera> = subject.cameras.iter().map(|view| middle(view, subject)).collect();
        let tile = |camera: &Camera| {
            let orders = [Order::Mean, Order::Distance, Order::Response];
            let ordered = orders.map(|order| reference.frame_in_order(subject, camera, order));
            let tile = Tile { mean: reference.frame(subject, camera), ordered };
            done();
            tile
        };
        let tiles: Vec<Tile> = cameras.par_iter().map(tile).collect();

        let mut sums = [Sums::default(), Sums::default()];
        let mut apart = 0.0_f64;
        for Tile { mean, ordered: [same, distance, response] } in &tiles {
            let exact = Exact::of(response, subject.background);
            for (sums, frame) in sums.iter_mut().zip([mean, distance]) {
                sums.add(&narrow(frame), &exact, subject.background);
            }
            apart = apart.max(largest_difference(mean, same, subject.background));
        }
        let [mean, distance] = sums.map(Sums::errors);
        Self {
            tiles: tiles.len(),
            size: cameras.first().map_or([0; 2], |camera| [camera.width, camera.height]),
            apart,
            orders: [("depth of the mean", mean), ("distance of the mean", distance)],
        }
    }
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

    fn sort(log_scale: f32) -> Sort {
        let mut gaussians = random_cloud(60, Layout::radiance(0), 5);
        for gaussian in 0..gaussians.count {
            let scales = gaussians.get::<3>(gaussian, specula_core::scene::LOG_SCALE);
            gaussians.set(gaussian, specula_core::scene::LOG_SCALE, scales.map(|scale| scale + log_scale));
        }
        let subject = Subject {
            gaussians,
            light: None,
            shading: ShadingRules::PAPER,
            scheme: PrefilterScheme::Exact,
            cameras: vec![camera(32, 24), camera(32, 24)],
            background: [0.0; 3],
        };
        Sort::new(&subject, &Reference::new(&subject), || {})
    }

    #[test]
    fn large_gaussians_are_in_the_wrong_order_and_small_ones_are_not() {
        let [large, small] = [0.5, -4.0].map(sort);
        for sort in [&large, &small] {
            assert_eq!((sort.tiles, sort.size), (2, [32, 24]), "there is time for all of it");
            assert!(sort.apart < SAME, "the same picture twice: {}", sort.apart);
        }
        let rms = |sort: &Sort| sort.orders.map(|(_, errors)| errors.rms);
        assert!(rms(&large).iter().all(|rms| *rms > 1e-3), "{large:?}");
        assert!(rms(&small).iter().all(|rms| *rms < 1e-3), "{small:?}");
    }
}
