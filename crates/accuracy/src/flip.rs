//! ꟻLIP: the perceived difference of two alternating pictures (Andersson et al. 2020, "FLIP: A
//! Difference Evaluator for Alternating Images"; the form for pictures in \[0, 1\]).
//!
//! Colours are compared at the resolution of the eye: opponent channels are filtered by its
//! contrast sensitivity, then compared in a perceptually uniform colour space. Edges and points
//! that only one picture has amplify the difference.

use core::f64::consts::PI;
use specula_core::scene::Image;

/// Pixels per degree of visual angle: a screen of 0.7 m and 3840 pixels at a distance of 0.7 m, as
/// in the paper.
const PIXELS_PER_DEGREE: f64 = 67.020_643;
/// Weights and widths of the Gaussians of the contrast sensitivity: achromatic, red–green,
/// blue–yellow (Table 1).
const SENSITIVITY: [[[f64; 2]; 2]; 3] =
    [[[1.0, 0.0047], [0.0, 1e-5]], [[1.0, 0.0053], [0.0, 1e-5]], [[34.1, 0.04], [13.5, 0.025]]];
/// Radius of the filters in standard deviations of the widest Gaussian.
const WIDEST: f64 = 0.04;
const REACH: f64 = 3.0;
/// Width of edge and point filters in degrees.
const FEATURE_WIDTH: f64 = 0.082;
/// Exponents of the colour and feature differences.
const COLOR_EXPONENT: f64 = 0.7;
const FEATURE_EXPONENT: f64 = 0.5;
/// Range compression: differences up to the first share of the largest possible one map to the
/// second share of the result.
const KNEE: [f64; 2] = [0.4, 0.95];

/// Linear RGB of sRGB's primaries to XYZ; (1, 1, 1) is the white point.
const XYZ: [[f64; 3]; 3] = [
    [0.412_390_799_265_959_5, 0.357_584_339_383_878, 0.180_480_788_401_834_3],
    [0.212_639_005_871_510_4, 0.715_168_678_767_756, 0.072_192_315_360_733_7],
    [0.019_330_818_715_591_8, 0.119_194_779_794_626, 0.950_532_152_249_660_6],
];

/// Mean ꟻLIP of two pictures of three sRGB planes, clamped to \[0, 1\]: 0 for equal pictures, at
/// most 1. Pixels that are NaN count as 1.
pub fn flip(reference: &Image<Vec<f64>>, test: &Image<Vec<f64>>) -> f64 {
    let map = flip_map(reference, test);
    map.iter().sum::<f64>() / map.len().max(1) as f64
}

/// ꟻLIP of every pixel.
pub fn flip_map(reference: &Image<Vec<f64>>, test: &Image<Vec<f64>>) -> Vec<f64> {
    let [a, b] = [reference, test].map(PerceptualImage::new);
    let largest = largest_difference();
    let pixel_error = |pixel: usize| {
        let color = stretched(hyab(a.color(pixel), b.color(pixel)).powf(COLOR_EXPONENT), largest);
        let feature = f64::max((a.edges[pixel] - b.edges[pixel]).abs(), (a.points[pixel] - b.points[pixel]).abs());
        let feature = (feature * core::f64::consts::FRAC_1_SQRT_2).powf(FEATURE_EXPONENT);
        let difference = color.powf(1.0 - feature);
        if difference.is_nan() { 1.0 } else { difference.clamp(0.0, 1.0) }
    };
    (0..reference.pixel_count()).map(pixel_error).collect()
}

/// Picture in perceptual terms.
struct PerceptualImage {
    /// Three planes of a uniform colour space, filtered by the contrast sensitivity.
    lab: Vec<[f64; 3]>,
    /// Magnitudes of edges and of points.
    edges: Vec<f64>,
    points: Vec<f64>,
}

impl PerceptualImage {
    fn new(picture: &Image<Vec<f64>>) -> Self {
        let size = picture.pixel_count();
        let limited = |x: f64| if x.is_nan() { x } else { x.clamp(0.0, 1.0) };
        let rgb = |pixel: usize| [0, 1, 2].map(|c| linear(limited(picture.values[c * size + pixel])));
        let opponent: Vec<[f64; 3]> = (0..size).map(|pixel| opponent_of(xyz_of(rgb(pixel)))).collect();
        let plane = |c: usize| opponent.iter().map(|color| color[c]).collect::<Vec<f64>>();
        let blurred = [0, 1, 2].map(|c| blur(picture.width, &plane(c), &SENSITIVITY[c]));
        let color = |pixel: usize| {
            let opponent = [0, 1, 2].map(|c| blurred[c][pixel]);
            let shown = rgb_of(xyz_of_opponent(opponent)).map(limited);
            hunt(lab_of(xyz_of(shown)))
        };
        let light: Vec<f64> = plane(0).iter().map(|y| (y + 16.0) / 116.0).collect();
        let [edges, points] = [Window::slope(), Window::bend()].map(|window| window.strength(picture.width, &light));
        Self { lab: (0..size).map(color).collect(), edges, points }
    }

    fn color(&self, pixel: usize) -> [f64; 3] {
        self.lab[pixel]
    }
}

/// Linear value of an sRGB value in \[0, 1\] (IEC 61966-2-1).
fn linear(x: f64) -> f64 {
    if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

fn xyz_of(rgb: [f64; 3]) -> [f64; 3] {
    XYZ.map(|row| row[0] * rgb[0] + row[1] * rgb[1] + row[2] * rgb[2])
}

/// Inverse of [`xyz_of`] by Cramer's rule.
fn rgb_of(xyz: [f64; 3]) -> [f64; 3] {
    let [a, b, c] = [0, 1, 2].map(|k| [XYZ[0][k], XYZ[1][k], XYZ[2][k]]);
    let determinant = dot(a, cross(b, c));
    [dot(xyz, cross(b, c)), dot(a, cross(xyz, c)), dot(a, cross(b, xyz))].map(|d| d / determinant)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// XYZ relative to the white point.
fn per_white(xyz: [f64; 3]) -> [f64; 3] {
    let white = xyz_of([1.0; 3]);
    [0, 1, 2].map(|k| xyz[k] / white[k])
}

/// YCxCz: the axes of CIELAB without its cube root.
fn opponent_of(xyz: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = per_white(xyz);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn xyz_of_opponent([light, red, blue]: [f64; 3]) -> [f64; 3] {
    let white = xyz_of([1.0; 3]);
    let y = (light + 16.0) / 116.0;
    [(y + red / 500.0) * white[0], y * white[1], (y - blue / 200.0) * white[2]]
}

/// CIELAB.
fn lab_of(xyz: [f64; 3]) -> [f64; 3] {
    const DELTA: f64 = 6.0 / 29.0;
    let root = |t: f64| if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 };
    let [x, y, z] = per_white(xyz).map(root);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Hunt adjustment: colours appear less saturated in the dark (Hunt 1952).
fn hunt([light, red, blue]: [f64; 3]) -> [f64; 3] {
    [light, 0.01 * light * red, 0.01 * light * blue]
}

/// HyAB distance |ΔL| + |(Δa, Δb)| (Abasi et al. 2020).
fn hyab(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// Distance of green and blue, the largest in the gamut.
fn largest_difference() -> f64 {
    let [green, blue] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|rgb| hunt(lab_of(xyz_of(rgb))));
    hyab(green, blue).powf(COLOR_EXPONENT)
}

fn stretched(difference: f64, largest: f64) -> f64 {
    let [knee, height] = [KNEE[0] * largest, KNEE[1]];
    if difference < knee {
        difference * height / knee
    } else {
        height + (difference - knee) / (largest - knee) * (1.0 - height)
    }
}

/// Filters a plane by a sum of Gaussians, normalised together.
fn blur(width: usize, plane: &[f64], gaussians: &[[f64; 2]; 2]) -> Vec<f64> {
    let reach = (REACH * (WIDEST / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as usize;
    let mut sum = vec![0.0; plane.len()];
    let mut whole = 0.0;
    for [weight, spread] in gaussians.iter().filter(|[weight, _]| *weight > 0.0) {
        let factor = weight * (PI / spread).sqrt();
        let window = taps(reach, |x| (-PI * PI * (x / PIXELS_PER_DEGREE).powi(2) / spread).exp());
        whole += factor * window.iter().sum::<f64>().powi(2);
        let blurred = filtered(width, plane, &window, &window);
        sum.iter_mut().zip(blurred).for_each(|(sum, x)| *sum += factor * x);
    }
    sum.iter_mut().for_each(|x| *x /= whole);
    sum
}

fn taps(reach: usize, of: impl Fn(f64) -> f64) -> Vec<f64> {
    (0..=2 * reach).map(|k| of(k as f64 - reach as f64)).collect()
}

/// Filters a plane along rows, then columns, with clamped borders.
fn filtered(width: usize, plane: &[f64], along: &[f64], down: &[f64]) -> Vec<f64> {
    let height = plane.len() / width.max(1);
    let reach = along.len() / 2;
    let at = |index: usize, tap: usize, count: usize| (index + tap).saturating_sub(reach).min(count - 1);
    let mut across = vec![0.0; plane.len()];
    for (row, out) in plane.chunks(width).zip(across.chunks_mut(width)) {
        for (column, out) in out.iter_mut().enumerate() {
            *out = along.iter().enumerate().map(|(tap, weight)| weight * row[at(column, tap, width)]).sum();
        }
    }
    let mut result = vec![0.0; plane.len()];
    for (row, out) in result.chunks_mut(width).enumerate() {
        for (tap, weight) in down.iter().enumerate() {
            let source = &across[at(row, tap, height) * width..];
            out.iter_mut().zip(source).for_each(|(sum, x)| *sum += weight * x);
        }
    }
    result
}

/// Separable filter for features along an axis.
struct Window {
    along: Vec<f64>,
    across: Vec<f64>,
}

impl Window {
    /// First derivative of a Gaussian, for edges.
    fn slope() -> Self {
        Self::new(|x, variance| -x * (-0.5 * x * x / variance).exp())
    }
    /// Second derivative of a Gaussian, for points.
    fn bend() -> Self {
        Self::new(|x, variance| (x * x / variance - 1.0) * (-0.5 * x * x / variance).exp())
    }

    /// Normalises positive weights to a sum of one and negative ones to minus one.
    fn new(of: impl Fn(f64, f64) -> f64) -> Self {
        let deviation = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
        let variance = deviation * deviation;
        let reach = (REACH * deviation).ceil() as usize;
        let across = taps(reach, |x| (-0.5 * x * x / variance).exp());
        let sum: f64 = across.iter().sum();
        let along = taps(reach, |x| of(x, variance));
        let [positive, negative] = [1.0, -1.0].map(|sign| along.iter().map(|x| (sign * x).max(0.0)).sum::<f64>());
        let along = along.iter().map(|x| x / if *x > 0.0 { positive } else { negative }).collect();
        Self { along, across: across.iter().map(|x| x / sum).collect() }
    }

    /// Magnitude of the features along both axes.
    fn strength(&self, width: usize, plane: &[f64]) -> Vec<f64> {
        let right = filtered(width, plane, &self.along, &self.across);
        let down = filtered(width, plane, &self.across, &self.along);
        right.iter().zip(down).map(|(x, y)| x.hypot(y)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Precision of the published values: three digits.
    const THREE_DIGITS: f64 = 5e-4;
    /// Rounding of some hundred operations of `f64`, and powers of them.
    const ROUNDING: f64 = 1e-6;

    fn picture(of: impl Fn(usize, usize, usize) -> f64) -> Image<Vec<f64>> {
        let (width, height) = (40, 30);
        let values = (0..3 * width * height).map(|k| of(k / (width * height), k % width, k / width % height)).collect();
        Image { width, height, channels: 3, values }
    }

    #[test]
    fn equal_pictures_do_not_flip() {
        let some = picture(|c, x, y| (c * 7 + x * 3 + y * 5) as f64 % 11.0 / 11.0);
        assert!(flip(&some, &some) == 0.0);
    }

    #[test]
    fn black_and_white_differ_as_published() {
        let [black, white] = [0.0, 1.0].map(|value| picture(|_, _, _| value));
        let difference = flip(&black, &white);
        assert!((difference - 0.967).abs() < THREE_DIGITS, "{difference}");
    }

    #[test]
    fn green_and_blue_differ_most() {
        let [green, blue] = [1, 2].map(|channel| picture(|c, _, _| f64::from(u8::from(c == channel))));
        assert!((flip(&green, &blue) - 1.0).abs() < ROUNDING);
    }

    #[test]
    fn order_does_not_matter_and_results_grow_with_the_difference() {
        let grey = picture(|_, _, _| 0.5);
        let mut last = 0.0;
        for step in [0.01, 0.03, 0.1, 0.3] {
            let other = picture(|c, x, y| 0.5 + step * f64::from(u8::from((x + y + c) % 8 < 4)));
            let difference = flip(&grey, &other);
            assert!(difference > last && difference < 1.0, "{difference} after {last}");
            assert!((difference - flip(&other, &grey)).abs() < ROUNDING);
            last = difference;
        }
    }

    #[test]
    fn a_difference_at_an_edge_counts_more() {
        let edge = picture(|_, x, _| if x < 20 { 0.3 } else { 0.7 });
        let moved = picture(|_, x, _| if x < 21 { 0.3 } else { 0.7 });
        let map = flip_map(&edge, &moved);
        assert!(map[15 * 40 + 20] > map[15 * 40 + 2] + 0.1, "{} beside {}", map[15 * 40 + 20], map[15 * 40 + 2]);
    }

    #[test]
    fn nan_pixels_differ_fully() {
        let grey = picture(|_, _, _| 0.5);
        let mut wrong = grey.clone();
        wrong.values[0] = f64::NAN;
        assert!(flip_map(&grey, &wrong)[0] == 1.0);
    }
}
