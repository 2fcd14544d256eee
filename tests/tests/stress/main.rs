//! What must hold where numbers are extreme: the rows of `docs/stability.md`, each with a test or more.
//!
//! Each test prints the worst value that it saw.

mod blending;
mod naive;
mod numbers;
mod scenes;
mod splats;
mod training;

/// Says what came out at worst, and fails above what is allowed or if it is no number.
#[track_caller]
fn assert_at_most(what: &str, worst: f64, allowed: f64) {
    println!("{what}: {worst:.1e} of {allowed:.0e}");
    assert!(worst <= allowed, "{what}: {worst:e}, allowed are {allowed:e}");
}

/// The largest of some numbers; infinite if one is none.
fn worst(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.fold(0.0, |worst, number| if number.is_nan() { f64::INFINITY } else { f64::max(worst, number) })
}

#[test]
#[should_panic(expected = "allowed are")]
fn a_value_that_is_too_large_is_seen() {
    assert_at_most("twice what is allowed", 2.0, 1.0);
}

#[test]
#[should_panic(expected = "allowed are")]
fn a_value_that_is_no_number_is_seen() {
    assert_at_most("no number", worst([0.0, f64::NAN, 1.0].into_iter()), 1e30);
}
