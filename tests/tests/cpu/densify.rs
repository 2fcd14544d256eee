//! Decisions of densification at their thresholds, as literals: both executors run one formula.

use specula_core::{
    cull::CullReason,
    densify::{Action, DensifyRules, action},
    executor::{Executor, Renderer},
    scene::{BLOCK, Layout, MEAN},
    state::Statistics,
};
use specula_cpu::{CpuExecutor, stages::blend_vjp::SplatGrads};
use specula_tests::{formulas::camera, strategies::random_cloud};

const RULES: DensifyRules = DensifyRules { grad_min: 0.25, split_scale: 0.5, opacity_min: 0.125, scale_max: 2.0 };
const NAN: f32 = f32::NAN;

/// Every threshold from below, exactly and from above; the other measures are far from theirs.
#[test]
fn actions_change_at_their_thresholds() {
    use Action::{Clone, Keep, Prune, Split};
    let (below, above) = (f32::next_down, f32::next_up);
    for (grad, opacity, scale, expected) in [
        (below(0.25), 0.5, 0.25, Keep),
        (0.25, 0.5, 0.25, Clone),
        (above(0.25), 0.5, 0.25, Clone),
        (below(0.25), 0.5, 1.0, Keep),
        (0.25, 0.5, 1.0, Split),
        (above(0.25), 0.5, 1.0, Split),
        (1.0, 0.5, below(0.5), Clone),
        (1.0, 0.5, 0.5, Clone),
        (1.0, 0.5, above(0.5), Split),
        (0.0, 0.5, above(0.5), Keep),
        (0.0, below(0.125), 0.25, Prune),
        (0.0, 0.125, 0.25, Keep),
        (0.0, above(0.125), 0.25, Keep),
        (1.0, below(0.125), 0.25, Prune),
        (1.0, 0.125, 0.25, Clone),
        (1.0, below(0.125), 1.0, Prune),
        (1.0, 0.125, 1.0, Split),
        (0.0, 0.5, below(2.0), Keep),
        (0.0, 0.5, 2.0, Keep),
        (0.0, 0.5, above(2.0), Prune),
        (1.0, 0.5, 2.0, Split),
        (1.0, 0.5, above(2.0), Prune),
        (0.0, below(0.125), above(2.0), Prune),
    ] {
        let actual = action(&RULES, grad, opacity, scale);
        assert_eq!(actual, expected, "gradient {grad}, opacity {opacity}, scale {scale}");
    }
}

#[test]
fn a_measure_that_is_not_a_number_is_decided() {
    for scale in [0.25, 1.0] {
        assert_eq!(action(&RULES, NAN, 0.5, scale), Action::Keep, "a gradient, scale {scale}");
    }
    for grad in [0.0, 1.0, NAN] {
        assert_eq!(action(&RULES, grad, NAN, 0.25), Action::Prune, "an opacity, gradient {grad}");
        assert_eq!(action(&RULES, grad, 0.5, NAN), Action::Prune, "a scale, gradient {grad}");
        assert_eq!(action(&RULES, grad, NAN, NAN), Action::Prune, "both, gradient {grad}");
    }
}

#[test]
fn without_a_largest_scale_none_is_too_large() {
    let rules = DensifyRules { scale_max: f32::INFINITY, ..RULES };
    assert_eq!(action(&rules, 0.0, 0.5, f32::MAX), Action::Keep);
    assert_eq!(action(&rules, 1.0, 0.5, f32::INFINITY), Action::Split);
}

/// Views count for Gaussians beside their pictures as well, not for those behind the camera.
#[test]
fn a_view_counts_the_gaussians_in_front_of_its_camera() {
    const COUNT: usize = 400;
    const COLORS: usize = 3;
    const GRAD_PLANES: usize = 6 + COLORS;
    let mut cloud = random_cloud(COUNT, Layout::radiance(0), 23);
    for index in 0..COUNT {
        let mean = cloud.get::<3>(index, MEAN).map(|x| 5.0 * x);
        cloud.set(index, MEAN, mean);
    }
    let camera = camera(70, 45);
    let mut exec = CpuExecutor::new();
    let splats = exec.project(&cloud, &camera).expect("the CPU projects");
    let grads = SplatGrads::of_values(COLORS, &vec![1.0; COUNT.next_multiple_of(BLOCK) * GRAD_PLANES]);
    let mut statistics = Statistics { grad_sum: vec![0.0; COUNT], view_count: vec![0.0; COUNT] };
    exec.observe(&mut statistics, &splats, &grads, &camera).expect("the CPU observes");
    let mut found = [0; 3];
    for (index, count) in statistics.view_count.iter().enumerate() {
        let reason = CullReason::of(&cloud, index, Some(&camera));
        let (kind, expected) = match reason {
            CullReason::Drawn => (0, 1.0),
            CullReason::Outside => (1, 1.0),
            _ => (2, 0.0),
        };
        assert_eq!(*count, expected, "Gaussian {index}: {reason:?}");
        found[kind] += 1;
    }
    assert!(found.into_iter().all(|count| count > 10), "{found:?} in the picture, beside it and behind the camera");
}
