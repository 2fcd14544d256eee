//! Learned light against the true one of a data set.
//!
//! Both lights are compared by the logarithm of their radiance, with a floor relative to each
//! light's mean, weighted by the solid angle w of each direction:
//!
//! ```text
//! correlation  Σ w (x − x̄)(y − ȳ) / √(Σ w (x − x̄)² Σ w (y − ȳ)²)
//! scale        exp(Σ w ln(learned / true) / Σ w)
//! ```
//!
//! with x and y the logarithms of the means of red, green and blue of both lights. Each channel has
//! a scale; that of the light is their geometric mean.

use crate::error::Result;
use serde_json::{Map, Value, json};
use specula_core::{cubemap, scene::Environment};
use specula_io::{
    Input,
    latlong::{self, LatLong, MapOrientation},
    picture::{self, Panel, RgbImage},
};
use specula_scene::{environment::radiance, light_file};
use std::path::{Path, PathBuf};

/// Width and height of the maps that both lights are averaged to.
pub const COMMON_SIZE: [usize; 2] = [32, 16];
/// Floor of radiance as a share of the mean: ten stops.
const FLOOR: f64 = 1.0 / 1024.0;
/// Width and height of each map in a picture.
const PICTURE_SIZE: [usize; 2] = [512, 256];
/// Linear radiance at which the mean of the true light is shown.
const MEAN_SHOWN: f64 = 0.25;
/// Key of the correlation in `results.json`.
pub(crate) const CORRELATION: &str = "light_correlation";
/// Key of the scale in `results.json`.
pub(crate) const SCALE: &str = "light_scale";
/// Names of the true light in the folder of a data set.
const FILES: [&str; 2] = ["env.hdr", "env.exr"];

/// Agreement of a learned light with the true one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightQuality {
    /// Correlation of log radiance in maps of [`COMMON_SIZE`]; `None` if one of the lights is
    /// constant.
    pub correlation: Option<f64>,
    /// Correlation in the texels of the learned light.
    pub correlation_texels: Option<f64>,
    /// Radiance of the learned light relative to the true one, in the texels of the former.
    pub scale: f64,
    /// Scale of red, green and blue.
    pub scale_rgb: [f64; 3],
}

/// True light of a data set, `env.hdr` or `env.exr` in its folder; none without one.
pub fn true_light(dataset: &Path) -> Option<PathBuf> {
    FILES.iter().map(|name| dataset.join(name)).find(|path| path.is_file())
}

/// Learned light and the true one, at the resolution of the former.
#[derive(Debug)]
pub struct LightPair {
    resolution: usize,
    orientation: MapOrientation,
    /// Six faces of linear radiance each: learned, true.
    cubes: [Vec<f32>; 2],
}

impl LightPair {
    /// Pairs a learned light with a map of this orientation.
    pub fn new(learned: &Environment<Vec<f32>>, truth: &LatLong, orientation: MapOrientation) -> Self {
        let resolution = learned.resolution;
        let cubes = [radiance(learned), latlong::to_cube(truth, resolution, orientation)];
        Self { resolution, orientation, cubes }
    }

    /// Compares the lights; `None` if one of them is black or not finite.
    pub fn quality(&self) -> Option<LightQuality> {
        let weights: Vec<f64> = cubemap::solid_angles(self.resolution).collect();
        let [learned, truth] = self.cubes.each_ref().map(|cube| Logs::new(cube, &weights));
        let (learned, truth) = (learned?, truth?);

        let [width, height] = COMMON_SIZE;
        let rows = (0..height).map(|row| row_solid_angle(row, height));
        let weights_of_maps: Vec<f64> = rows.flat_map(|angle| core::iter::repeat_n(angle, width)).collect();
        let [learned_map, true_map] =
            [0, 1].map(|which| Logs::new(&self.map(which, COMMON_SIZE).rgb, &weights_of_maps));

        let total: f64 = weights.iter().sum();
        let mean_difference = |k: usize| {
            let differences =
                learned.channels.iter().zip(&truth.channels).map(|(learned, truth)| learned[k] - truth[k]);
            differences.zip(&weights).map(|(difference, weight)| weight * difference).sum::<f64>() / total
        };
        let differences = [0, 1, 2].map(mean_difference);
        Some(LightQuality {
            correlation: correlation(&learned_map?.grey, &true_map?.grey, &weights_of_maps),
            correlation_texels: correlation(&learned.grey, &truth.grey, &weights),
            scale: (differences.iter().sum::<f64>() / 3.0).exp(),
            scale_rgb: differences.map(f64::exp),
        })
    }

    /// One of the lights as a lat-long map.
    fn map(&self, which: usize, [width, height]: [usize; 2]) -> LatLong {
        latlong::from_cube(&self.cubes[which], self.resolution, width, height, self.orientation)
    }

    /// Picture of the true light, of the learned one below it, and of the latter divided by the
    /// scale of each channel, all at an exposure that shows the mean of the true light as a quarter
    /// of white.
    pub fn picture(&self, quality: &LightQuality) -> RgbImage {
        let mean = self.cubes[1].iter().map(|value| f64::from(*value)).sum::<f64>() / self.cubes[1].len() as f64;
        let exposure = MEAN_SHOWN / mean;
        let panel = |which: usize, scale: [f64; 3], caption: &str| {
            let mut map = self.map(which, PICTURE_SIZE);
            for pixel in map.rgb.as_chunks_mut::<3>().0 {
                pixel.iter_mut().zip(scale).for_each(|(value, scale)| *value *= (exposure / scale) as f32);
            }
            vec![Panel::new(picture::tone_map_latlong(&map), caption)]
        };
        picture::montage(&[
            panel(1, [1.0; 3], "true light"),
            panel(0, [1.0; 3], "learned light"),
            panel(0, quality.scale_rgb, "learned, divided by scale"),
        ])
    }
}

impl LightQuality {
    /// One line of text.
    pub fn summary(&self) -> String {
        let [width, height] = COMMON_SIZE;
        let [r, g, b] = self.scale_rgb;
        format!(
            "light: correlation {} at {width} × {height}, {} texel by texel; scale {:.3}, of red, green, blue {r:.3}, \
             {g:.3}, {b:.3}",
            number(self.correlation),
            number(self.correlation_texels),
            self.scale,
        )
    }

    /// Cells of a table: both correlations, the scale, and that of each channel.
    pub(crate) fn cells(&self) -> [String; 4] {
        let channels = self.scale_rgb.map(|scale| format!("{scale:.3}")).join(", ");
        [number(self.correlation), number(self.correlation_texels), format!("{:.3}", self.scale), channels]
    }

    /// JSON object.
    pub(crate) fn to_json(self) -> Value {
        let Self { correlation, correlation_texels, scale, scale_rgb } = self;
        json!({
            "correlation": correlation,
            "correlation_texels": correlation_texels,
            "scale": scale,
            "scale_rgb": scale_rgb,
        })
    }

    /// Entries of `results.json`.
    pub fn facts(&self) -> Map<String, Value> {
        let correlation = self.correlation.map(|correlation| (CORRELATION.to_owned(), correlation.into()));
        correlation.into_iter().chain([(SCALE.to_owned(), self.scale.into())]).collect()
    }
}

/// Number of a correlation as text.
fn number(correlation: Option<f64>) -> String {
    correlation.map_or_else(|| "–".to_owned(), |correlation| format!("{correlation:.3}"))
}

/// Logarithms of the radiance of a light, direction by direction.
struct Logs {
    /// Logarithms of red, green and blue.
    channels: Vec<[f64; 3]>,
    /// Logarithms of their mean.
    grey: Vec<f64>,
}

impl Logs {
    /// Logarithms of radiance from directions with these weights; none if the mean is not
    /// positive and finite.
    fn new(rgb: &[f32], weights: &[f64]) -> Option<Self> {
        let colors = || rgb.as_chunks::<3>().0.iter().map(|color| color.map(f64::from));
        let grey = |color: [f64; 3]| color.iter().sum::<f64>() / 3.0;
        let sum: f64 = colors().zip(weights).map(|(color, weight)| weight * grey(color)).sum();
        let mean = sum / weights.iter().sum::<f64>();
        let log = |value: f64| value.max(FLOOR * mean).ln();
        (mean > 0.0 && mean.is_finite()).then(|| Self {
            channels: colors().map(|color| color.map(log)).collect(),
            grey: colors().map(|color| log(grey(color))).collect(),
        })
    }
}

/// Solid angle of a pixel in a row of a lat-long map, up to a factor: the difference of cosines.
fn row_solid_angle(row: usize, height: usize) -> f64 {
    let cosine = |edge: usize| (core::f64::consts::PI * edge as f64 / height as f64).cos();
    cosine(row) - cosine(row + 1)
}

/// Weighted correlation of two lists of numbers; none if one of them is constant.
fn correlation(x: &[f64], y: &[f64], weights: &[f64]) -> Option<f64> {
    /// Variance of numbers that differ only by rounding.
    const CONSTANT: f64 = 1e-10;
    let total: f64 = weights.iter().sum();
    let mean = |of: &dyn Fn(usize) -> f64| {
        weights.iter().enumerate().map(|(index, weight)| weight * of(index)).sum::<f64>() / total
    };
    let [mean_x, mean_y] = [mean(&|index| x[index]), mean(&|index| y[index])];
    let product =
        |a: &[f64], mean_a: f64, b: &[f64], mean_b: f64| mean(&|index| (a[index] - mean_a) * (b[index] - mean_b));
    let [xx, yy] = [product(x, mean_x, x, mean_x), product(y, mean_y, y, mean_y)];
    (xx > CONSTANT && yy > CONSTANT).then(|| product(x, mean_x, y, mean_y) / (xx * yy).sqrt())
}

/// Compares the light of a scene with the true one of a data set in this orientation; `None` if
/// either has no light, or one is black. Returns the lights for a picture, and a warning for each
/// unusual property of the file.
///
/// # Errors
///
/// Those of [`light_file::read`].
pub fn compare_with_truth(
    learned: Option<&Environment<Vec<f32>>>,
    dataset: &Path,
    orientation: MapOrientation,
) -> Result<(Option<(LightPair, LightQuality)>, Vec<String>)> {
    let (Some(learned), Some(path)) = (learned, true_light(dataset)) else { return Ok((None, Vec::new())) };
    let (truth, warnings) = light_file::read(Input::file(&path))?;
    let pair = LightPair::new(learned, &truth, orientation);
    let quality = pair.quality();
    Ok((quality.map(|quality| (pair, quality)), warnings))
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::scene::RadianceActivation;
    use specula_io::latlong::UpAxis;

    /// Texels along an edge of a face.
    const RESOLUTION: usize = 32;
    /// Error of numbers in `f32`.
    const ROUNDING: f64 = 1e-5;

    /// Light with a bright side and a coloured floor.
    fn map() -> LatLong {
        let (width, height) = (128, 64);
        let pixel = |index: usize| {
            let (column, row) = (index % width, index / width);
            let sun = if (20..40).contains(&column) && (10..30).contains(&row) { 8.0 } else { 0.0 };
            let wave = 0.5 + 0.4 * (column as f32 * 0.15).sin();
            [wave + sun, 0.8 * wave + sun, if row < 32 { wave } else { 0.2 * wave } + sun]
        };
        LatLong { width, height, rgb: (0..width * height).flat_map(pixel).collect() }
    }

    fn learned(map: &LatLong, factors: [f32; 3]) -> Environment<Vec<f32>> {
        let mut values = latlong::to_cube(map, RESOLUTION, UpAxis::Z);
        values.iter_mut().enumerate().for_each(|(index, value)| *value *= factors[index % 3]);
        Environment { resolution: RESOLUTION, activation: RadianceActivation::Identity, values }
    }

    fn quality(learned: &Environment<Vec<f32>>, truth: &LatLong) -> LightQuality {
        LightPair::new(learned, truth, UpAxis::Z.into()).quality().unwrap()
    }

    #[test]
    fn twice_the_light_has_the_scale_two_and_is_correlated_fully() {
        let measured = quality(&learned(&map(), [2.0; 3]), &map());
        assert!((measured.scale - 2.0).abs() < ROUNDING, "{measured:?}");
        assert!(measured.scale_rgb.iter().all(|scale| (scale - 2.0).abs() < ROUNDING), "{measured:?}");
        for correlation in [measured.correlation, measured.correlation_texels] {
            assert!((correlation.unwrap() - 1.0).abs() < ROUNDING, "{measured:?}");
        }
    }

    #[test]
    fn the_scale_is_the_geometric_mean_of_the_channels() {
        // Channels above the floor.
        let measured = quality(&learned(&map(), [1.0, 2.0, 4.0]), &map());
        for (found, factor) in measured.scale_rgb.iter().zip([1.0, 2.0, 4.0]) {
            assert!((found - factor).abs() < ROUNDING, "{measured:?}");
        }
        assert!((measured.scale - 2.0).abs() < ROUNDING, "{measured:?}");
    }

    #[test]
    fn a_turned_light_is_correlated_less_and_a_negative_one_negatively() {
        let light = learned(&map(), [1.0; 3]);
        let turned = |degrees: f64| {
            let values = latlong::rotated(&light.values, RESOLUTION, [0.0, 0.0, 1.0], degrees.to_radians());
            quality(&Environment { values, ..light.clone() }, &map())
        };
        let correlations = [0.0, 20.0, 90.0].map(|degrees| turned(degrees).correlation.unwrap());
        assert!(correlations[0] > 0.999 && correlations[1] < 0.9 && correlations[2] < 0.5, "{correlations:?}");
        assert!(correlations.windows(2).all(|pair| pair[0] > pair[1]), "{correlations:?}");
        assert!((turned(90.0).scale - 1.0).abs() < 0.02, "a turn does not change the brightness");

        let inverse = Environment { values: light.values.iter().map(|value| value.recip()).collect(), ..light.clone() };
        assert!(quality(&inverse, &map()).correlation_texels.unwrap() < -0.9);
    }

    #[test]
    fn lights_are_compared_in_the_orientation_of_their_files() {
        let light = learned(&map(), [1.0; 3]);
        let other = LightPair::new(&light, &map(), UpAxis::Y.into()).quality().unwrap();
        assert!(other.correlation.unwrap() < 0.9, "another axis is another light: {other:?}");
    }

    #[test]
    fn a_constant_light_has_a_scale_and_no_correlation_and_a_black_one_has_neither() {
        let flat = LatLong { width: 2, height: 1, rgb: vec![0.5; 6] };
        let measured = quality(&learned(&flat, [1.0; 3]), &map());
        assert_eq!((measured.correlation, measured.correlation_texels), (None, None));
        assert!(measured.scale > 0.0);
        assert!(!measured.facts().contains_key(CORRELATION));
        let black = learned(&flat, [0.0; 3]);
        assert!(LightPair::new(&black, &map(), UpAxis::Z.into()).quality().is_none());
    }

    #[test]
    fn a_picture_shows_three_maps_and_the_last_is_as_bright_as_the_truth() {
        let pair = LightPair::new(&learned(&map(), [0.1, 0.2, 0.4]), &map(), UpAxis::Z.into());
        let pair_picture = pair.picture(&pair.quality().unwrap());
        assert!(pair_picture.height() > 3 * PICTURE_SIZE[1] as u32 && pair_picture.width() as usize >= PICTURE_SIZE[0]);
        let row = |y: u32| (0..PICTURE_SIZE[0] as u32).map(|x| pair_picture.get_pixel(x, y).0).collect::<Vec<_>>();
        let panel = Panel::new(RgbImage::new(PICTURE_SIZE[0] as u32, PICTURE_SIZE[1] as u32), "one map");
        let panel_height = picture::montage(&[vec![panel]]).height();
        // From the top of a map to that of the next.
        let step = (pair_picture.height() - panel_height) / 2;
        let middles = [0, 1, 2].map(|k| row(k * step + step / 2));
        let apart = |one: &[[u8; 3]], other: &[[u8; 3]]| {
            one.iter().flatten().zip(other.iter().flatten()).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
        };
        assert!(apart(&middles[0], &middles[2]) <= 4, "divided by its scale it is the true light");
        assert!(apart(&middles[0], &middles[1]) > 40, "it was darker");
    }
}
