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
    fn a_hundredth_everywhere_is_forty_decibels() {
        assert_close(psnr(&[0.51; 7], &[0.5; 7]), 40.0, 1e-9);
    }
}
