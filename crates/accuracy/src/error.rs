//! Metrics of a picture against the exact one.

use crate::{
    flip::flip,
    reference::Exact,
    setting::Setting,
    subject::Subject,
    trial::{Trial, Work, measured},
};
use specula_core::{
    camera::Camera,
    metrics::{angle_degrees, psnr},
    rules::channel,
    scene::Image,
};
use specula_cpu::CpuError;
use specula_train::evaluate::{mean_ssim, over_background};

/// Coverage below which a pixel has no meaningful normal.
const COVERED: f64 = 0.5;
/// Share of the differences above the percentile.
const LARGEST: f64 = 1e-3;

/// Errors of pictures against exact ones, over all their colours. Numbers that are not finite are
/// counted and excluded from all metrics but [`Errors::is_within`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Largest difference.
    pub max: f64,
    /// Root mean square.
    pub rms: f64,
    /// Largest root mean square of a view.
    pub worst: f64,
    /// Root mean square relative to that of the exact pictures.
    pub relative: f64,
    /// Peak signal-to-noise ratio in dB of colours clamped to \[0, 1\]; infinite for equal
    /// pictures.
    pub psnr: f64,
    /// Mean SSIM of 8-bit pictures.
    pub ssim: f64,
    /// Mean ꟻLIP.
    pub flip: f64,
    /// 99.9th percentile of the differences.
    pub p999: f64,
    /// Mean angle between normals in degrees, over pixels with a coverage of at least one half.
    pub normal_mae: f64,
    /// Count of numbers that are not finite.
    pub nonfinite: usize,
}

impl Errors {
    /// Returns whether the root mean square of every view is within a bound and everything is
    /// finite.
    pub fn is_within(&self, rms: f64) -> bool {
        self.nonfinite == 0 && self.worst <= rms
    }
}

/// Errors of a setting in some views, and the work of its pictures.
///
/// # Errors
///
/// [`CpuError`] if a picture cannot be rendered.
pub fn errors_of(
    trial: &mut Trial<'_>,
    subject: &Subject,
    setting: &Setting,
    views: &[(Camera, Exact)],
) -> Result<(Errors, Work), CpuError> {
    let (mut sums, mut work) = (Sums::default(), Work::default());
    for (camera, exact) in views {
        work = work.and(&trial.view(setting, camera)?.work);
        sums.add(&trial.view(&measured(setting), camera)?.image, exact, subject.background);
    }
    Ok((sums.errors(), work))
}

/// Sums over views.
#[derive(Clone, Debug, Default)]
pub struct Sums {
    differences: Vec<f64>,
    worst: f64,
    squares_shown: f64,
    squares_exact: f64,
    similarities: Vec<[f64; 2]>,
    angles: Vec<f64>,
    nonfinite: usize,
}

impl Sums {
    /// Adds a view: a picture with the channels of training, over a background.
    pub fn add(&mut self, picture: &Image<Vec<f32>>, exact: &Exact, background: [f32; 3]) {
        let shown = over_background(picture, background);
        let before = self.differences.len();
        for (value, exact) in shown.iter().zip(&exact.colors.values) {
            let value = f64::from(*value);
            self.squares_exact += exact * exact;
            if value.is_finite() {
                self.differences.push((value - exact).abs());
                self.squares_shown += (value.clamp(0.0, 1.0) - exact.clamp(0.0, 1.0)).powi(2);
            } else {
                self.nonfinite += 1;
            }
        }
        self.worst = self.worst.max(mean_square(&self.differences[before..]).sqrt());
        let narrow: Vec<f32> = exact.colors.values.iter().map(|x| *x as f32).collect();
        let wide = Image { values: shown.iter().map(|x| f64::from(*x)).collect(), ..exact.colors.clone() };
        let ssim = mean_ssim(picture.width, picture.height, &shown, &narrow);
        self.similarities.push([ssim, flip(&exact.colors, &wide)]);
        for pixel in (0..picture.pixel_count()).filter(|pixel| exact.coverage[*pixel] > COVERED) {
            let normal = [0, 1, 2].map(|k| picture.plane(channel::NORMAL + k)[pixel]);
            let angle = angle_degrees(normal, exact.normals[pixel]);
            if angle.is_finite() { self.angles.push(angle) } else { self.nonfinite += 1 }
        }
    }

    /// Metrics of the sums.
    pub fn errors(mut self) -> Errors {
        let mean = |sum: f64, count: usize| if count == 0 { 0.0 } else { sum / count as f64 };
        let count = self.differences.len();
        let square = mean_square(&self.differences);
        self.differences.sort_by(f64::total_cmp);
        let place = (count as f64 * (1.0 - LARGEST)) as usize;
        let mean_of = |k: usize| mean(self.similarities.iter().map(|pair| pair[k]).sum(), self.similarities.len());
        Errors {
            max: self.differences.last().copied().unwrap_or(0.0),
            rms: square.sqrt(),
            worst: self.worst,
            relative: (square * count as f64 / self.squares_exact.max(f64::MIN_POSITIVE)).sqrt(),
            psnr: psnr(mean(self.squares_shown, count)),
            ssim: mean_of(0),
            flip: mean_of(1),
            p999: self.differences.get(place.min(count.saturating_sub(1))).copied().unwrap_or(0.0),
            normal_mae: mean(self.angles.iter().sum(), self.angles.len()),
            nonfinite: self.nonfinite,
        }
    }
}

/// Mean; zero for no elements.
fn mean_square(differences: &[f64]) -> f64 {
    let sum: f64 = differences.iter().map(|x| x * x).sum();
    sum / differences.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 20;
    /// Rounding of differences of `f32` numbers.
    const ROUNDING: f64 = 1e-6;

    /// A fully covered grey view that faces +z, and its exact picture.
    fn view(value_of: impl Fn(usize) -> f32) -> (Image<Vec<f32>>, Exact) {
        let pixels = SIZE * SIZE;
        let mut values = vec![0.0; 9 * pixels];
        (0..3 * pixels).for_each(|k| values[k] = value_of(k % pixels));
        values[5 * pixels..6 * pixels].fill(1.0);
        let picture = Image { width: SIZE, height: SIZE, channels: 9, values };
        let colors = Image { width: SIZE, height: SIZE, channels: 3, values: vec![0.5; 3 * pixels] };
        (picture, Exact { colors, normals: vec![[0.0, 0.0, 1.0]; pixels], coverage: vec![1.0; pixels] })
    }

    fn errors(value_of: impl Fn(usize) -> f32) -> Errors {
        let (picture, exact) = view(value_of);
        let mut sums = Sums::default();
        sums.add(&picture, &exact, [0.0; 3]);
        sums.errors()
    }

    #[test]
    fn an_exact_picture_has_no_error() {
        let errors = errors(|_| 0.5);
        assert_eq!((errors.max, errors.rms, errors.relative, errors.p999), (0.0, 0.0, 0.0, 0.0));
        assert_eq!((errors.flip, errors.normal_mae, errors.nonfinite), (0.0, 0.0, 0));
        assert!(errors.psnr == f64::INFINITY && (errors.ssim - 1.0).abs() < ROUNDING, "{errors:?}");
        assert!(errors.is_within(0.0), "it is as close as can be");
    }

    #[test]
    fn a_hundredth_everywhere_is_forty_decibels() {
        let errors = errors(|_| 0.51);
        assert!((errors.psnr - 40.0).abs() < 1e-3 && (errors.rms - 0.01).abs() < ROUNDING, "{errors:?}");
        assert!((errors.relative - 0.02).abs() < ROUNDING, "{errors:?}");
        assert!(!errors.is_within(0.0099) && errors.is_within(0.0101), "{errors:?}");
    }

    #[test]
    fn a_single_wrong_pixel_shows_only_in_the_largest_difference() {
        let errors = errors(|pixel| if pixel == 7 { 0.9 } else { 0.5 });
        assert!((errors.max - 0.4).abs() < ROUNDING && errors.rms < 0.03, "{errors:?}");
    }

    #[test]
    fn nonfinite_numbers_are_counted_and_within_no_bound() {
        let errors = errors(|pixel| if pixel == 7 { f32::NAN } else { 0.5 });
        assert!(errors.nonfinite == 3 && errors.rms == 0.0 && !errors.is_within(1.0), "{errors:?}");
    }
}
