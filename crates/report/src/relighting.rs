//! Relit views against ground truth.
//!
//! Light and reflectance are known only up to a factor per colour channel, so PSNR is measured by
//! several protocols: as rendered, after the factors of linear red, green and blue that fit the
//! ground truth of all views best, and after separate factors for each view. A fourth protocol
//! scales the albedo before rendering ([`specula_scene::Scene::scale_albedo`]) and measures as
//! rendered.

use crate::error::{Error, Result};
use core::{fmt, slice};
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

/// Coverage below which a colour cannot be distinguished from its background.
const COVERAGE_MIN: f32 = 1e-3;
/// Logarithm of the largest factor of the search; minus that of the smallest.
const LOG_FACTOR_MAX: f32 = 3.0;
/// Steps of the search; each keeps 0.618 of the range.
const SEARCH_STEPS: usize = 24;
/// Stride in pixels of the search.
const PIXEL_STRIDE: usize = 5;

/// Ground-truth pictures of some of the views.
#[derive(Debug)]
pub struct GroundTruth {
    pictures: Vec<Option<Pixels>>,
}

impl GroundTruth {
    /// Reads the pictures named `<view>.png` and resizes them to their views.
    ///
    /// # Errors
    ///
    /// A picture that cannot be read, or a folder without a picture of any view.
    pub fn read(folder: &Path, cameras: &[NamedCamera]) -> Result<Self> {
        let read = |(name, camera): &NamedCamera| -> Result<Option<Pixels>> {
            let path = folder.join(format!("{name}.png"));
            let picture = path.is_file().then(|| Pixels::read(&path)).transpose()?;
            Ok(picture.map(|picture| match [picture.width, picture.height] == [camera.width, camera.height] {
                true => picture,
                false => picture.resized(camera.width, camera.height),
            }))
        };
        let pictures: Vec<Option<Pixels>> = cameras.iter().map(read).collect::<Result<_>>()?;
        if pictures.iter().all(Option::is_none) {
            let first = cameras.first().map_or("", |(name, _)| name);
            return Err(Error::Input(format!(
                "no picture in {folder:?} has the name of a view; expected are names such as {first}.png"
            )));
        }
        Ok(Self { pictures })
    }

    /// Whether a view has a picture.
    pub fn has(&self, index: usize) -> bool {
        self.pictures.get(index).is_some_and(Option::is_some)
    }

    /// Rendered view paired with its picture; `None` if the view has no picture.
    pub fn pair(&self, index: usize, image: &Image<Vec<f32>>) -> Option<RelitView> {
        self.pictures.get(index)?.as_ref().map(|truth| RelitView::new(image, truth))
    }
}

/// Rendered view and its ground truth.
#[derive(Debug)]
pub struct RelitView {
    /// Linear colours, not premultiplied, three planes.
    linear: Vec<f32>,
    alpha: Vec<f32>,
    /// Straight sRGB and alpha, pixel by pixel.
    truth: Vec<u8>,
}

impl RelitView {
    fn new(image: &Image<Vec<f32>>, truth: &Pixels) -> Self {
        let alpha = alpha(image);
        let straight = |(color, alpha): (&f32, &f32)| {
            if *alpha > COVERAGE_MIN { linear_from_srgb((color / alpha).max(0.0)) } else { 0.0 }
        };
        let linear = (0..3).flat_map(|c| image.plane(c).iter().zip(&alpha).map(straight).collect::<Vec<_>>()).collect();
        Self { linear, alpha, truth: truth.rgba.clone() }
    }

    /// Channel of a pixel over a background: rendered with a factor, and true.
    fn colors(&self, channel: usize, pixel: usize, factor: f32, background: f32) -> [f32; 2] {
        let alpha = self.alpha[pixel];
        let rendered = srgb_from_linear(self.linear[channel * self.alpha.len() + pixel] * factor) * alpha;
        let true_alpha = f32::from(self.truth[4 * pixel + 3]) / 255.0;
        let truth = f32::from(self.truth[4 * pixel + channel]) / 255.0 * true_alpha;
        [rendered + (1.0 - alpha) * background, truth + (1.0 - true_alpha) * background]
    }

    fn psnr(&self, factors: [f32; 3], background: [f32; 3]) -> f64 {
        let values = 0..3 * self.alpha.len();
        let (rendered, truth): (Vec<f32>, Vec<f32>) = values
            .map(|index| {
                let (channel, pixel) = (index / self.alpha.len(), index % self.alpha.len());
                let [rendered, truth] = self.colors(channel, pixel, factors[channel], background[channel]);
                (rendered, truth)
            })
            .unzip();
        psnr(mean_squared_error(&rendered, &truth))
    }
}

/// Mean PSNR in dB of views over a background, as rendered.
pub fn mean_psnr(views: &[RelitView], background: [f32; 3]) -> f64 {
    mean_scaled_psnr(views, background, |_| [1.0; 3])
}

/// Mean PSNR in dB of views over a background, each after its factors.
fn mean_scaled_psnr(views: &[RelitView], background: [f32; 3], factors: impl Fn(&RelitView) -> [f32; 3]) -> f64 {
    let psnrs = views.iter().map(|view| view.psnr(factors(view), background));
    psnrs.sum::<f64>() / views.len().max(1) as f64
}

/// Agreement of relit views with ground truth.
#[derive(Clone, Copy, Debug)]
pub struct RelightingQuality {
    /// Mean PSNR in dB, as rendered.
    pub psnr: f64,
    /// Mean PSNR in dB, after scaling.
    pub psnr_scaled: f64,
    /// Factors of linear red, green and blue, the same for all views.
    pub scale: [f32; 3],
    /// Mean PSNR in dB, after scaling each view by separate factors.
    pub psnr_view_scaled: f64,
}

impl fmt::Display for RelightingQuality {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { psnr, psnr_scaled, scale: [r, g, b], psnr_view_scaled } = self;
        write!(
            out,
            "PSNR {psnr:.2} dB; {psnr_scaled:.2} dB after scaling red, green, blue by {r:.3}, {g:.3}, {b:.3}; \
             {psnr_view_scaled:.2} dB after scaling each view"
        )
    }
}

impl RelightingQuality {
    /// Measures views over a background, as rendered, with the best factors, and with those of each
    /// view.
    pub fn of(views: &[RelitView], background: [f32; 3]) -> Self {
        let scale = best_factors(views, background);
        Self {
            psnr: mean_psnr(views, background),
            psnr_scaled: mean_scaled_psnr(views, background, |_| scale),
            scale,
            psnr_view_scaled: mean_scaled_psnr(views, background, |view| {
                best_factors(slice::from_ref(view), background)
            }),
        }
    }

    /// JSON object, with the number of views.
    pub fn to_json(&self, views: usize) -> Value {
        let Self { psnr, psnr_scaled, scale, psnr_view_scaled } = self;
        json!({
            "PSNR": psnr,
            "PSNR_scaled": psnr_scaled,
            "PSNR_view_scaled": psnr_view_scaled,
            "scale": scale,
            "views": views,
        })
    }
}

/// Factors of linear red, green and blue with the least squared error.
fn best_factors(views: &[RelitView], background: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|channel| best_factor(views, channel, background[channel]))
}

/// Factor with the least squared error, by golden-section search over its logarithm.
fn best_factor(views: &[RelitView], channel: usize, background: f32) -> f32 {
    const GOLDEN: f32 = 0.618_034;
    let error = |logarithm: f32| squared_error(views, channel, logarithm.exp(), background);
    let (mut low, mut high) = (-LOG_FACTOR_MAX, LOG_FACTOR_MAX);
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

fn squared_error(views: &[RelitView], channel: usize, factor: f32, background: f32) -> f64 {
    let error_of_view = |view: &RelitView| {
        let pixels = (0..view.alpha.len()).step_by(PIXEL_STRIDE);
        let difference = |pixel: usize| {
            let [rendered, truth] = view.colors(channel, pixel, factor, background);
            f64::from(rendered.clamp(0.0, 1.0) - truth)
        };
        pixels.map(|pixel| difference(pixel).powi(2)).sum::<f64>()
    };
    views.iter().map(error_of_view).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// View whose ground truth is `factor` times as bright.
    fn view(factor: f32) -> RelitView {
        let linear: Vec<f32> = (0..300).map(|k| 0.001 * k as f32).collect();
        let byte = |x: f32| (srgb_from_linear(x) * 255.0 + 0.5) as u8;
        let pixel = |k: usize| {
            let [r, g, b] = [0, 1, 2].map(|channel| byte(linear[100 * channel + k] * factor));
            [r, g, b, 255]
        };
        RelitView { truth: (0..100).flat_map(pixel).collect(), alpha: vec![1.0; 100], linear }
    }

    #[test]
    fn a_factor_between_rendering_and_truth_is_found() {
        let measured = RelightingQuality::of(&[view(1.7)], [1.0; 3]);
        assert!(measured.scale.iter().all(|scale| (scale - 1.7).abs() < 0.02), "{:?}", measured.scale);
        assert!(measured.psnr_scaled > 50.0 && measured.psnr < 30.0, "{measured:?}");
        assert!((measured.psnr_view_scaled - measured.psnr_scaled).abs() < 1e-9, "one view has the factors of all");
    }

    #[test]
    fn factors_of_each_view_forgive_what_those_of_all_views_do_not() {
        let measured = RelightingQuality::of(&[view(0.5), view(2.0)], [1.0; 3]);
        assert!(measured.psnr_scaled < 30.0 && measured.psnr_view_scaled > 50.0, "{measured:?}");
    }
}
