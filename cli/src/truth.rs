//! Renderings under a new light against true ones. Light and reflectance are known only up to a factor for each
//! colour, so a scene is measured as it is, and with the best such factors.

use crate::{background::Background, failure::Failure};
use core::fmt;
use serde_json::{Value, json};
use specula_core::{
    color::{linear_from_srgb, srgb_from_linear},
    metrics::psnr,
    scene::Image,
};
use specula_io::{cameras::NamedCamera, pixels::Pixels};
use specula_scene::layer::alpha;
use specula_train::evaluate::mean_squared_error;
use std::path::Path;

/// Below this coverage a colour cannot be told from its background.
const COVERED: f32 = 1e-3;
/// Factors are sought between e to the power of minus this and e to the power of this.
const REACH: f32 = 3.0;
/// Steps of the search; each leaves 0.618 of the range.
const SEARCH_STEPS: usize = 24;
/// Every so manieth pixel takes part in the search.
const STRIDE: usize = 5;

/// True pictures, for some of the views.
#[derive(Debug)]
pub(crate) struct Truths {
    pictures: Vec<Option<Pixels>>,
}

impl Truths {
    /// Reads the pictures that are named as the views, at the views' size.
    pub(crate) fn read(folder: &Path, cameras: &[NamedCamera]) -> Result<Self, Failure> {
        let pictures: Result<Vec<_>, Failure> = cameras
            .iter()
            .map(|(name, camera)| {
                let path = folder.join(format!("{name}.png"));
                let picture = path.is_file().then(|| Pixels::read(&path)).transpose()?;
                Ok(picture.map(|picture| match [picture.width, picture.height] == [camera.width, camera.height] {
                    true => picture,
                    false => picture.resized(camera.width, camera.height),
                }))
            })
            .collect();
        let pictures = pictures?;
        if pictures.iter().all(Option::is_none) {
            let first = cameras.first().map_or("", |(name, _)| name);
            return Err(Failure::Input(format!(
                "no picture in {folder:?} is named as a view; expected are names such as {first}.png"
            )));
        }
        Ok(Self { pictures })
    }

    /// Whether the truth of a view is known.
    pub(crate) fn has(&self, index: usize) -> bool {
        self.pictures.get(index).is_some_and(Option::is_some)
    }

    /// A rendered view beside its truth, if that is known.
    pub(crate) fn pair(&self, index: usize, image: &Image<Vec<f32>>) -> Option<Pair> {
        self.pictures.get(index)?.as_ref().map(|truth| Pair::new(image, truth))
    }
}

/// A rendered view and its truth.
#[derive(Debug)]
pub(crate) struct Pair {
    /// Linear colours without their coverage, three planes.
    linear: Vec<f32>,
    alpha: Vec<f32>,
    /// Straight sRGB and alpha, pixel by pixel.
    truth: Vec<u8>,
}

impl Pair {
    fn new(image: &Image<Vec<f32>>, truth: &Pixels) -> Self {
        let alpha = alpha(image);
        let straight = |(color, alpha): (&f32, &f32)| {
            if *alpha > COVERED { linear_from_srgb((color / alpha).max(0.0)) } else { 0.0 }
        };
        let linear = (0..3).flat_map(|c| image.plane(c).iter().zip(&alpha).map(straight).collect::<Vec<_>>()).collect();
        Self { linear, alpha, truth: truth.rgba.clone() }
    }

    /// One channel of a pixel over a background: ours with a factor, and the truth.
    fn both(&self, channel: usize, pixel: usize, factor: f32, background: f32) -> [f32; 2] {
        let alpha = self.alpha[pixel];
        let ours = srgb_from_linear(self.linear[channel * self.alpha.len() + pixel] * factor) * alpha;
        let true_alpha = f32::from(self.truth[4 * pixel + 3]) / 255.0;
        let truth = f32::from(self.truth[4 * pixel + channel]) / 255.0 * true_alpha;
        [ours + (1.0 - alpha) * background, truth + (1.0 - true_alpha) * background]
    }

    fn psnr(&self, factors: [f32; 3], background: Background) -> f64 {
        let pixels = 0..3 * self.alpha.len();
        let (ours, truth): (Vec<f32>, Vec<f32>) = pixels
            .map(|index| {
                let (channel, pixel) = (index / self.alpha.len(), index % self.alpha.len());
                let [ours, truth] = self.both(channel, pixel, factors[channel], background.0[channel]);
                (ours, truth)
            })
            .unzip();
        psnr(mean_squared_error(&ours, &truth))
    }
}

/// How close relightings come to the truth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Relighting {
    /// Mean PSNR in dB, as they are.
    pub(crate) psnr: f64,
    /// Mean PSNR in dB, with the best factors.
    pub(crate) psnr_scaled: f64,
    /// The factors of linear red, green and blue, the same for all views.
    pub(crate) scale: [f32; 3],
}

impl fmt::Display for Relighting {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { psnr, psnr_scaled, scale: [r, g, b] } = self;
        write!(out, "PSNR {psnr:.2} dB; {psnr_scaled:.2} dB after scaling red, green, blue by {r:.3}, {g:.3}, {b:.3}")
    }
}

impl Relighting {
    /// The same for other programs, as a mean over so many views.
    pub(crate) fn for_programs(&self, views: usize) -> Value {
        let Self { psnr, psnr_scaled, scale } = self;
        json!({"PSNR": psnr, "PSNR_scaled": psnr_scaled, "scale": scale, "views": views})
    }
}

/// Measures pairs as they are and with the best factors.
pub(crate) fn fit_and_measure(pairs: &[Pair], background: Background) -> Relighting {
    let scale = [0, 1, 2].map(|channel| best_factor(pairs, channel, background));
    let mean = |factors: [f32; 3]| {
        pairs.iter().map(|pair| pair.psnr(factors, background)).sum::<f64>() / pairs.len().max(1) as f64
    };
    Relighting { psnr: mean([1.0; 3]), psnr_scaled: mean(scale), scale }
}

/// The factor with the least squared error, by golden-section search over its logarithm.
fn best_factor(pairs: &[Pair], channel: usize, background: Background) -> f32 {
    const GOLDEN: f32 = 0.618_034;
    let error = |logarithm: f32| squared_error(pairs, channel, logarithm.exp(), background.0[channel]);
    let (mut low, mut high) = (-REACH, REACH);
    let (mut left, mut right) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
    let (mut error_left, mut error_right) = (error(left), error(right));
    for _ in 0..SEARCH_STEPS {
        if error_left < error_right {
            (high, right, error_right) = (right, left, error_left);
            left = high - GOLDEN * (high - low);
            error_left = error(left);
        } else {
            (low, left, error_left) = (left, right, error_right);
            right = low + GOLDEN * (high - low);
            error_right = error(right);
        }
    }
    (0.5 * (low + high)).exp()
}

fn squared_error(pairs: &[Pair], channel: usize, factor: f32, background: f32) -> f64 {
    let of_pair = |pair: &Pair| {
        let pixels = (0..pair.alpha.len()).step_by(STRIDE);
        let difference = |pixel: usize| {
            let [ours, truth] = pair.both(channel, pixel, factor, background);
            f64::from(ours.clamp(0.0, 1.0) - truth)
        };
        pixels.map(|pixel| difference(pixel).powi(2)).sum::<f64>()
    };
    pairs.iter().map(of_pair).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A view whose truth is `factor` times as bright.
    fn pair(factor: f32) -> Pair {
        let linear: Vec<f32> = (0..300).map(|k| 0.001 * k as f32).collect();
        let byte = |x: f32| (srgb_from_linear(x) * 255.0 + 0.5) as u8;
        let pixel = |k: usize| {
            let [r, g, b] = [0, 1, 2].map(|channel| byte(linear[100 * channel + k] * factor));
            [r, g, b, 255]
        };
        Pair { truth: (0..100).flat_map(pixel).collect(), alpha: vec![1.0; 100], linear }
    }

    #[test]
    fn a_factor_between_rendering_and_truth_is_found() {
        let measured = fit_and_measure(&[pair(1.7)], Background::WHITE);
        assert!(measured.scale.iter().all(|scale| (scale - 1.7).abs() < 0.02), "{:?}", measured.scale);
        assert!(measured.psnr_scaled > 50.0 && measured.psnr < 30.0, "{measured:?}");
    }
}
