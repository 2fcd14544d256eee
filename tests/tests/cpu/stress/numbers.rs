//! Functions of one number at its limits, undefined directions, and the optimiser's step.

use super::assert_at_most;
use specula_core::{
    activation::{sigmoid, softplus},
    color::{srgb_from_linear, srgb_from_linear_vjp},
    executor::{Executor, Renderer},
    loss::{sparse, sparse_vjp},
    normal::facing,
    optimise::{EPSILON, Moment, adam},
    prefilter::{LevelRange, PrefilterScheme},
    scene::{Gaussians, Layout, RadianceActivation},
    sh,
    shade::{view_dir, view_dir_vjp},
    state::AdamMoments,
    vector::vec3,
};
use specula_cpu::CpuExecutor;
use specula_tests::strategies::{random_cloud, random_environment};

/// A thousand steps of 10⁻⁴, each rounded.
const THOUSAND_STEPS: f64 = 1e-3;

#[test]
fn activations_and_sparse_losses_are_finite_at_every_number() {
    for x in [0.0_f32, 1e-30, 88.0, 89.0, 104.0, 1e4, 1e30, f32::MAX] {
        for x in [x, -x] {
            let values = [sigmoid(x), softplus(x), sparse(x), sparse_vjp(x, 1.0)];
            assert!(values.iter().all(|value| value.is_finite()), "{x}: {values:?}");
            assert!((0.0..=1.0).contains(&values[0]) && values[1] >= 0.0 && values[3].abs() <= 1.0, "{x}: {values:?}");
        }
    }
}

#[test]
fn colours_below_zero_are_encoded_with_a_gradient_towards_it() {
    for x in [-1e30_f32, -1.0, -1e-30, 0.0, 1e-30, 1e30, f32::MAX] {
        let (value, grad) = (srgb_from_linear(x), srgb_from_linear_vjp(x, srgb_from_linear(x), 1.0));
        assert!(value.is_finite() && grad.is_finite() && grad >= 0.0, "{x}: {value}, {grad}");
    }
}

#[test]
fn a_gaussian_in_the_eye_is_seen_along_z_and_has_no_gradient() {
    let eye = vec3(0.3_f32, -0.2, 0.7);
    assert_eq!(view_dir(eye, eye), vec3(0.0, 0.0, 1.0));
    assert_eq!(view_dir_vjp(eye, eye, vec3(1.0, 2.0, 3.0)), vec3(0.0, 0.0, 0.0));
    let dark = vec3(-2.0_f32, 0.0, 2e9);
    assert_eq!(sh::radiance_vjp(dark, vec3(1.0, 1.0, 1.0)), vec3(0.0, 1.0, 0.0), "limited colours have none");
}

#[test]
fn a_normal_cancelled_by_a_residual_is_the_axis() {
    let (axis, eye) = (vec3(0.0_f32, 0.6, 0.8), vec3(0.0_f32, 0.0, 1.0));
    let (away, none) = (vec3(-0.0_f32, -0.6, -0.8), vec3(0.0_f32, 0.0, 0.0));
    assert_eq!(facing(axis, eye, [away, none], true).normal, axis);
    let huge = facing(axis, eye, [vec3(3e38_f32, 0.0, 0.0), none], true);
    assert_eq!(huge.normal, vec3(1.0, 6e-9, 8e-9), "what is huge points where the residual does");
    assert!(huge.residual_squared.is_finite());
}

/// One step of the executor for one plane of sixteen Gaussians.
pub(crate) fn stepped(grads: &[f32]) -> (Vec<f32>, usize) {
    let layout = Layout::radiance(0);
    let mut gaussians = random_cloud(16, layout, 1);
    let before = gaussians.values.clone();
    let mut grad = Gaussians { values: vec![0.0; before.len()], ..gaussians.clone() };
    grads.iter().enumerate().for_each(|(gaussian, number)| grad.set(gaussian, 0, [*number]));
    let zeros = vec![0.0; before.len()];
    let mut moments = AdamMoments { mean: zeros.clone(), square: zeros };
    let mut exec = CpuExecutor::new();
    let rates = vec![1e-3; layout.plane_count()];
    exec.optimise(&mut gaussians, &mut moments, grad, &rates, 1).expect("the CPU optimises");
    let numbers = gaussians.values.iter().chain(&moments.mean).chain(&moments.square);
    assert!(numbers.into_iter().all(|x| x.is_finite()), "a number is not finite");
    let moved = gaussians.values.iter().zip(&before).map(|(after, before)| after - before);
    (
        moved.take(grads.len()).collect(),
        exec.report().expect("the CPU counts").expect("the capacity suffices").nonfinite,
    )
}

#[test]
fn a_step_of_adam_is_finite_for_any_gradient_and_counts_those_it_skips() {
    let (moved, left_out) = stepped(&[0.0, 1e-30, 1e-12, 1.0, 1e18, 1e30, -1e30, f32::INFINITY, f32::NAN]);
    println!("steps: {moved:?}");
    assert_eq!(left_out, 4, "±10³⁰, ∞ and NaN");
    assert_eq!(moved[0], 0.0);
    assert!(moved[5..].iter().all(|step| *step == 0.0), "what is left out moves nothing");
    for step in &moved[2..5] {
        assert!(
            (step + 1e-3).abs() < 1e-5,
            "INRIA's ε of {EPSILON} lets a gradient of 10⁻¹² take a whole step: {step}"
        );
    }
}

#[test]
fn a_thousand_small_steps_do_not_stagnate() {
    let mut moment = Moment { value: 1.0_f32, mean: 0.0, square: 0.0 };
    for _ in 0..1000 {
        // Means that have settled, so that each step is the rate.
        moment = adam(Moment { mean: 1.0, square: 1.0, ..moment }, 1.0, 1e-4, 0.0);
    }
    assert_at_most("a thousand steps of 10⁻⁴", (f64::from(moment.value) - 0.9).abs(), THOUSAND_STEPS);
}

#[test]
fn a_light_of_any_finite_numbers_filters_to_finite_ones() {
    let mut exec = CpuExecutor::new();
    for (activation, numbers) in [
        (RadianceActivation::Identity, [65504.0, 1e-8, 1e30, 0.0]),
        (RadianceActivation::Exponential, [88.0, -1e30, 0.0, 11.1]),
    ] {
        let mut light = random_environment(16, activation, 1);
        light.values.iter_mut().enumerate().for_each(|(k, x)| *x = numbers[k % 4]);
        let light = exec.prefilter(&light, PrefilterScheme::Exact, LevelRange::ALL).expect("16 is a power of two");
        assert!(light.texels().iter().flatten().all(|x| x.is_finite()), "{activation:?}");
    }
}
