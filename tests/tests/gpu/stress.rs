//! The GPU executor against the CPU executor at the limits of valid input.

use specula_core::{
    executor::{Executor, Renderer},
    scene::Gaussians,
    shade::ShadingRules,
};
use specula_cpu::CpuExecutor;
use specula_gpu::{GpuError, GpuExecutor};
use specula_tests::{
    device::executor,
    stress::{Case, every_case, results::Results, too_many_splats},
};

/// By how much numbers are moved to see what their rounding does: 16 units in the last place, more
/// than a formula of some dozen operations loses.
const NUDGE: f32 = 1e-6;
/// Number of nudges: a decision that depends on rounding is the same every time once in 65 536.
const NUDGES: u64 = 16;
/// Further allowance of some hundred roundings of the result itself.
const ROUNDINGS: f64 = 2e-5;
/// Largest share of a picture, or of a gradient, that may depend on rounding: pixels where a splat
/// ends, numbers that are sums of what cancels, a loss of normals.
const LOOSE_MAX: f64 = 0.05;

/// Allowed distance of the executors.
#[derive(Clone, Copy)]
struct Allowance {
    /// Multiple of the distance that nudges move a result.
    as_far: f64,
    /// Smaller numbers may become zero.
    negligible: f64,
}

impl Allowance {
    /// Devices may flush numbers that are not normal to zero.
    const SOFTWARE: Self = Self { as_far: 4.0, negligible: 1e-37 };
    /// Hardware flushes products of small numbers as well, and its 2^x may be off by 3 + 2 |x|
    /// units in the last place, which add up over 100 000 layers.
    const HARDWARE: Self = Self { as_far: 8.0, negligible: 1e-19 };
}

/// Largest distance of nudged cases from each number.
fn reach<'a>(expected: &[f64], nudged: impl Iterator<Item = &'a Vec<f64>>) -> Vec<f64> {
    nudged.fold(vec![0.0; expected.len()], |reach, numbers| {
        let further = |k: usize| f64::max(reach[k], (numbers[k] - expected[k]).abs());
        (0..expected.len()).map(further).collect()
    })
}

/// The number that is furthest off, and its difference as a multiple of the allowed one: a multiple
/// of its change by rounding, and some roundings of its own. Infinite for numbers that are not
/// finite.
fn excess(actual: &[f64], expected: &[f64], reach: &[f64], allowance: Allowance) -> (usize, f64) {
    assert_eq!(actual.len(), expected.len(), "lists of different lengths cannot be close");
    let of = |k: usize| {
        let allowed = allowance.as_far * reach[k] + ROUNDINGS * expected[k].abs() + allowance.negligible;
        let excess = (actual[k] - expected[k]).abs() / allowed;
        if excess.is_nan() { f64::INFINITY } else { excess }
    };
    (0..actual.len()).map(|k| (k, of(k))).fold((0, 0.0), |most, own| if own.1 > most.1 { own } else { most })
}

/// The share of the numbers that nudges move by more than a hundredth of themselves, which are not
/// compared.
fn share_loose(expected: &[f64], reach: &[f64]) -> f64 {
    let loose = expected.iter().zip(reach).filter(|(x, reach)| **reach > 0.01 * x.abs()).count();
    loose as f64 / expected.len().max(1) as f64
}

#[test]
fn the_comparison_can_fail() {
    let expected = [1.0, 2.0, 0.0];
    let reach = reach(&expected, [vec![1.0, 2.1, 0.0], vec![1.0, 1.9, 0.0]].iter());
    let on_software = |actual: [f64; 3]| excess(&actual, &expected, &reach, Allowance::SOFTWARE);
    let on_hardware = |actual: [f64; 3]| excess(&actual, &expected, &reach, Allowance::HARDWARE).1;
    assert!(on_software(expected).1 == 0.0, "the same numbers are the same");
    assert!(on_software([1.0, 2.3, 0.0]).1 < 1.0, "what nudges move far may be apart");
    assert_eq!(on_software([1.0001, 2.0, 0.0]).0, 0, "a wrong number is found");
    for wrong in
        [[1.0001, 2.0, 0.0], [1.0, 2.5, 0.0], [1.0, 2.0, 1e-30], [1.0, f64::NAN, 0.0], [1.0, 2.0, f64::INFINITY]]
    {
        assert!(on_software(wrong).1 > 1.0, "{wrong:?} is wrong");
    }
    let [lost, found] = [1e-20, 1e-18].map(|x| on_hardware([1.0, 2.0, x]));
    assert!(lost < 1.0 && found > 1.0, "hardware may lose only small numbers: {lost} and {found}");
    let [near, far] = [2.7, 2.9].map(|x| on_hardware([1.0, x, 0.0]));
    assert!(near < 1.0 && far > 1.0, "hardware may be twice as far off and no more: {near} and {far}");
}

/// Description of the first fault in the GPU executor's results.
fn faults(gpu: &mut GpuExecutor, cpu: &mut CpuExecutor, case: &Case, shading: ShadingRules) -> Vec<String> {
    let (ours, theirs) = (Results::new(gpu, case, shading), Results::new(cpu, case, shading));
    let nudged: Vec<Results> = (0..NUDGES).map(|seed| Results::new(cpu, &case.nudged(NUDGE, seed), shading)).collect();
    let lists: [(&str, fn(&Results) -> &Vec<f64>); 3] =
        [("picture", |r| &r.picture), ("gradient", |r| &r.gradient), ("losses", |r| &r.losses)];
    let allowance = if gpu.gpu().is_software() { Allowance::SOFTWARE } else { Allowance::HARDWARE };
    let what = format!("{} ({:?})", case.name, shading.form);
    let mut faults = Vec::new();
    for (list, of) in lists {
        let (actual, expected) = (of(&ours), of(&theirs));
        let reach = reach(expected, nudged.iter().map(of));
        let (k, excess) = excess(actual, expected, &reach, allowance);
        let loose = share_loose(expected, &reach);
        println!("{what}: {list} {excess:.2} of what is allowed, {loose:.4} loose");
        if loose > LOOSE_MAX && !case.is_on_edge {
            faults.push(format!("{what}: {loose} of the {list} hang on rounding"));
        }
        if excess > 1.0 {
            let list_fault = format!("number {k} of the {list} is {} and not {}", actual[k], expected[k]);
            faults.push(format!("{what}: {list_fault}, {excess:.1} times as far off as allowed"));
        }
    }
    if (ours.nonfinite, theirs.nonfinite) != (0, 0) {
        let counts = format!("{} and {} gradients are not finite", ours.nonfinite, theirs.nonfinite);
        faults.push(format!("{what}: {counts}"));
    }
    faults
}

#[test]
fn both_executors_render_and_train_alike_at_every_edge() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    let mut found = Vec::new();
    for case in every_case() {
        for shading in case.shadings() {
            found.extend(faults(&mut gpu, &mut cpu, &case, *shading));
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn more_splats_in_tiles_than_a_word_counts_are_refused() {
    let (cloud, camera) = too_many_splats();
    let Some(mut gpu) = executor() else { return };
    let Gaussians { count, layout, values } = cloud;
    let cloud = Gaussians { count, layout, values: gpu.upload(&values).expect("numbers fit") };
    let splats = gpu.project(&cloud, &camera).expect("the device projects");
    let refused = gpu.bin(&splats, &camera).expect_err("there are 2³² and more");
    assert!(matches!(refused, GpuError::TooLarge { what: "splats of tiles", .. }), "{refused:?}");
    gpu.set_pair_capacity(1000);
    gpu.bin_for_step(&splats, &camera).expect("it is found out later");
    assert!(matches!(gpu.report(), Err(GpuError::TooLarge { .. })), "no step is taken again for ever");
}
