//! Comparisons, and how close is close.

use specula_core::metrics;

/// Smoothness of normals that bend by 1e-3: second differences of smoother ones are a few thousand
/// units in the last place, and pictures differ by some of these.
pub const LEAST_SMOOTHNESS: f64 = 1e-6;
/// Derivatives by dual numbers and by hand are the same arithmetic in another order.
pub const SAME_DERIVATIVE: f64 = 1e-10;
/// A few roundings of `f64`.
pub const ROUNDING_F64: f64 = 1e-12;
/// A few roundings of `f32`.
pub const ROUNDING_F32: f64 = 1e-6;
/// Closeness of pictures in `f32` and `f64`, in dB: rounding of a few hundred operations, 1e-5, is
/// 100 dB; a single pixel on the other side of the cut at 1/255 brings a small picture down to 85
/// dB.
pub const SAME_FRAME: f64 = 80.0;
/// The same of pictures whose rays hit triangles: a pixel whose ray hits the other of two brings a
/// small picture down to 80 dB.
pub const NEAR_TRIANGLES: f64 = 75.0;
/// Gradients of a small picture in `f32`, by attribute, relative to the largest: a pixel on the
/// other side of the cut at 1/255 makes a few in ten thousand.
pub const SAME_GRADIENT: f64 = 5e-4;
/// The same of physical materials. The split-sum table is linear between its entries: pixels within
/// rounding of one may take the slope on its other side.
pub const SAME_PHYSICAL_GRADIENT: f64 = 1e-3;
/// Positions on the screen: a few roundings of projection.
pub const SAME_SPLAT: f64 = 1e-5;

/// Checks that two numbers differ by no more than `tolerance`.
#[track_caller]
pub fn assert_close(actual: f64, expected: f64, tolerance: f64) {
    let difference = (actual - expected).abs();
    assert!(difference <= tolerance, "{actual} is {difference:e} from {expected}, allowed are {tolerance:e}");
}

/// The largest difference of two lists, as a share of the largest number expected; infinite for
/// NaN.
#[track_caller]
pub fn relative_difference(actual: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(actual.len(), expected.len(), "lists of different lengths cannot be close");
    let scale = expected.iter().fold(f64::MIN_POSITIVE, |largest, x| largest.max(x.abs()));
    actual.iter().zip(expected).map(|(a, e)| (a - e).abs() / scale).fold(0.0, nan_wins)
}

/// The larger of the two; infinite if one is not a number, which `f64::max` would ignore.
fn nan_wins(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::INFINITY } else { a.max(b) }
}

/// Checks that the lists agree up to `tolerance` times the largest number expected.
#[track_caller]
pub fn assert_all_close(actual: &[f64], expected: &[f64], tolerance: f64) {
    let difference = relative_difference(actual, expected);
    assert!(
        difference <= tolerance,
        "{difference:e} apart, allowed are {tolerance:e}:\n  actual   {actual:?}\n  expected {expected:?}"
    );
}

/// Peak signal-to-noise ratio of two pictures in [0, 1], in dB; values outside are limited first,
/// as a screen does.
#[track_caller]
pub fn psnr(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len(), "pictures of different sizes have no distance");
    let squared = |(x, y): (&f64, &f64)| (x.clamp(0.0, 1.0) - y.clamp(0.0, 1.0)).powi(2);
    metrics::psnr(a.iter().zip(b).map(squared).sum::<f64>() / a.len() as f64)
}

/// Closeness in dB of pictures of so many pixels in `f32` and `f64`, plane by plane: two pixels
/// with a splat on the other side of the cut at 1/255, 80 dB for 3000 pixels. Rounding of a few
/// hundred operations, 1e-5, is 100 dB.
pub fn same_planes(pixels: usize) -> f64 {
    10.0 * (pixels as f64 * 255.0 * 255.0 / 2.0).log10()
}

/// Closeness of the least close planes of two pictures, in dB: the PSNR of each plane, in units of
/// one or of its largest expected number, whichever is larger. NaN if a number is.
#[track_caller]
pub fn closeness(actual: &[f64], expected: &[f64], pixels: usize) -> f64 {
    assert_eq!(actual.len(), expected.len(), "pictures of different sizes have no distance");
    let planes = actual.chunks(pixels.max(1)).zip(expected.chunks(pixels.max(1)));
    let of_plane = |(actual, expected): (&[f64], &[f64])| {
        let scale = expected.iter().fold(1.0, |scale, x| f64::max(scale, x.abs()));
        let squared = |(a, e): (&f64, &f64)| ((a - e) / scale).powi(2);
        metrics::psnr(actual.iter().zip(expected).map(squared).sum::<f64>() / actual.len() as f64)
    };
    planes.map(of_plane).fold(f64::INFINITY, |least, own| if own.is_nan() || own < least { own } else { least })
}

/// Checks that all numbers are finite.
///
/// # Errors
///
/// The first that is not.
pub fn assert_finite(numbers: &[f64]) -> Result<(), String> {
    match numbers.iter().position(|x| !x.is_finite()) {
        Some(index) => Err(format!("number {index} is {}", numbers[index])),
        None => Ok(()),
    }
}

/// Checks that the pictures are at least this close, in dB.
#[track_caller]
pub fn assert_psnr(actual: &[f64], expected: &[f64], at_least: f64) {
    let psnr = psnr(actual, expected);
    assert!(psnr >= at_least, "{psnr:.2} dB, needed are {at_least:.2}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[should_panic(expected = "allowed are")]
    fn assert_close_fails_for_numbers_apart() {
        assert_close(1.0 + 2e-12, 1.0, ROUNDING_F64);
    }

    #[test]
    #[should_panic(expected = "allowed are")]
    fn assert_close_fails_for_nan() {
        assert_close(f64::NAN, 1.0, 1e9);
    }

    #[test]
    #[should_panic(expected = "apart")]
    fn assert_all_close_fails_for_one_number_of_many() {
        assert_all_close(&[1.0, 2.0, 3.1], &[1.0, 2.0, 3.0], 0.01);
    }

    #[test]
    #[should_panic(expected = "apart")]
    fn assert_all_close_fails_for_nan_anywhere() {
        assert_all_close(&[f64::NAN, 2.0], &[1.0, 2.0], 0.01);
    }

    #[test]
    #[should_panic(expected = "lengths")]
    fn assert_all_close_fails_for_a_missing_number() {
        assert_all_close(&[1.0], &[1.0, 2.0], 0.01);
    }

    #[test]
    #[should_panic(expected = "dB")]
    fn assert_psnr_fails_for_a_wrong_picture() {
        assert_psnr(&[0.5, 0.6], &[0.5, 0.5], 30.0);
    }

    #[test]
    #[should_panic(expected = "dB")]
    fn assert_psnr_fails_for_nan() {
        assert_psnr(&[0.5, f64::NAN], &[0.5, 0.5], 30.0);
    }

    #[test]
    fn closeness_is_that_of_the_worst_plane() {
        let expected = [0.5, 0.5, 10.0, 5.0];
        assert_close(closeness(&[0.51, 0.51, 10.0, 5.0], &expected, 2), 40.0, 1e-9);
        assert_close(closeness(&[0.5, 0.5, 10.1, 5.1], &expected, 2), 40.0, 1e-9);
        assert!(closeness(&expected, &expected, 2) > 1000.0, "the same pictures are the same");
        assert!(closeness(&[0.5, 0.5, f64::NAN, 5.0], &expected, 2).is_nan(), "NaN anywhere is seen");
    }

    #[test]
    fn a_hundredth_everywhere_is_forty_decibels() {
        assert_close(psnr(&[0.51; 7], &[0.5; 7]), 40.0, 1e-9);
    }
}
