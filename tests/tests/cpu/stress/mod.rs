//! Guarantees for extreme numbers: the rows of `docs/lab/stability.md`, each with a test or more.
//!
//! Each test prints the worst value that it saw.

mod blending;
mod naive;
mod numbers;
mod scenes;
mod splats;
mod training;

/// Prints the worst value, and fails if it exceeds the allowed one or is NaN.
#[track_caller]
fn assert_at_most(what: &str, worst: f64, allowed: f64) {
    println!("{what}: {worst:.1e} of {allowed:.0e}");
    assert!(worst <= allowed, "{what}: {worst:e}, allowed are {allowed:e}");
}

/// Largest of some numbers; infinite if one is NaN.
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

/// Sources of the tests that `docs/lab/stability.md` names.
const SOURCES: [&str; 15] = [
    include_str!("blending.rs"),
    include_str!("naive.rs"),
    include_str!("numbers.rs"),
    include_str!("scenes.rs"),
    include_str!("splats.rs"),
    include_str!("training.rs"),
    include_str!("../antialias.rs"),
    include_str!("../executor.rs"),
    include_str!("../../../../crates/conformance/src/executor.rs"),
    include_str!("../../../../crates/conformance/src/renderer.rs"),
    include_str!("../../gpu/stages.rs"),
    include_str!("../../gpu/stress.rs"),
    include_str!("../../gpu/train.rs"),
    include_str!("../invariants.rs"),
    include_str!("../order.rs"),
];

#[test]
fn every_row_of_the_table_is_there_and_names_tests_that_exist() {
    let table = include_str!("../../../../docs/lab/stability.md");
    let rows: Vec<&str> =
        table.lines().filter(|line| line.starts_with("| ") && line.matches('|').count() == 6).collect();
    for number in 1..=31 {
        let start = format!("| {number} |");
        let row = rows.iter().find(|row| row.starts_with(&start)).expect("a row of each number");
        let mut named = row.split('`').skip(1).step_by(2).filter(|name| name.len() > 30).peekable();
        assert!(named.peek().is_some() || row.contains("not offered"), "row {number} has no test");
        for name in named {
            let declared = ["(", "<"].map(|next| format!("fn {name}{next}"));
            let is_in = |source: &&str| declared.iter().any(|declared| source.contains(declared));
            assert!(SOURCES.iter().any(is_in), "row {number}: there is no test {name}");
        }
    }
}
