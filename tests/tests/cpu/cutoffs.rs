//! Cutoffs and their cost: the viewer against the executor, and against the plain pipeline.

use specula_core::{
    blend,
    camera::Camera,
    cutoffs::{Cutoffs, ProjectionModel},
    double::Double,
    dual::Dual,
    executor::Renderer,
    pipeline::render,
    prefilter::{LevelRange, PrefilterScheme},
    rules::{Channels, RenderRules},
    scene::{Environment, Gaussians, LOG_SCALE, Layout, OPACITY, RadianceActivation},
    shade::ShadingRules,
};
use specula_cpu::{CpuError, CpuExecutor, CpuViewer, frame::Frame, stages::prefilter::Light};
use specula_tests::{
    compare::{assert_psnr, psnr},
    formulas::camera,
    number::Number,
    plain::{self, lift_environment, lift_gaussians},
    strategies::{random_cloud, random_environment},
};

/// `f32` on lanes against `f64`: rounding of a few hundred operations, 1e-5, is 100 dB; a single
/// pixel on the other side of a cut at 1/255 brings a small picture down to 85 dB.
const SAME_FRAME: f64 = 80.0;
const RESOLUTION: usize = 16;
/// Tolerance of `f32` against `f64` where no cutoff is visible, relative to one or to the number.
const SAME_NUMBER: f64 = 1e-5;

fn cloud() -> Gaussians<Vec<f32>> {
    random_cloud(300, Layout::shaded(Some(1)), 3)
}

fn light() -> Environment<Vec<f32>> {
    random_environment(RESOLUTION, RadianceActivation::Identity, 4)
}

fn view() -> Camera {
    camera(50, 37)
}

fn rules() -> RenderRules {
    RenderRules::full(ShadingRules::DEFERRED, PrefilterScheme::Exact, Channels::Training)
}

fn picture<E>(exec: &mut E, cloud: &Gaussians<Vec<f32>>) -> Vec<f32>
where
    E: Renderer<Array = Vec<f32>, Light = Light, Frame = Frame, Error = CpuError>,
{
    let light = exec.prefilter(&light(), PrefilterScheme::Exact, LevelRange::ALL).expect("the resolution is allowed");
    let frame = render(exec, cloud, Some(&light), &view(), &rules()).expect("the CPU renders");
    let mut values = vec![0.0; (frame.channel_count() + 1) * frame.size()[0] * frame.size()[1]];
    exec.read_frame(&frame, &mut values).expect("the frame has that size");
    values
}

fn exact(cloud: &Gaussians<Vec<f32>>, cutoffs: &Cutoffs) -> Vec<f64> {
    let light = plain::prefilter(&lift_environment::<Double>(&light()), &plain::Operator::new(RESOLUTION));
    let frame = plain::render_within(&lift_gaussians(cloud), Some(&light), &view(), &rules(), cutoffs);
    frame.values.iter().map(|x| x.0).collect()
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}

#[test]
fn within_the_default_cutoffs_a_viewer_shows_what_the_executor_shows() {
    let default =
        Cutoffs::DEFAULT.with_alpha_min(1.0 / 255.0).with_transmittance_min(1e-4).with_reach_max(f32::INFINITY);
    assert_eq!(default, Cutoffs::DEFAULT);
    let [executor, viewer] =
        [picture(&mut CpuExecutor::new(), &cloud()), picture(&mut CpuViewer::with_cutoffs(default), &cloud())];
    assert!(executor.iter().zip(&viewer).all(|(a, b)| a.to_bits() == b.to_bits()), "a bit differs");
}

#[test]
fn within_any_cutoffs_a_viewer_shows_what_the_plain_pipeline_shows() {
    let tight = Cutoffs::DEFAULT.with_alpha_min(1.0 / 4096.0).with_transmittance_min(1e-7);
    let loose = Cutoffs::DEFAULT.with_alpha_min(1.0 / 20.0).with_transmittance_min(0.03);
    let [tangent, ray, within] = [ProjectionModel::Tangent, ProjectionModel::Ray, ProjectionModel::Within(0.02)]
        .map(|projection| Cutoffs::DEFAULT.with_projection(projection));
    for cutoffs in [Cutoffs::REFERENCE, tight, loose, tangent, ray, within] {
        let own = wide(&picture(&mut CpuViewer::with_cutoffs(cutoffs), &cloud()));
        assert_psnr(&own, &exact(&cloud(), &cutoffs), SAME_FRAME);
    }
    let default = wide(&picture(&mut CpuViewer::with_cutoffs(Cutoffs::DEFAULT), &cloud()));
    let apart = psnr(&default, &exact(&cloud(), &loose));
    assert!(apart < SAME_FRAME, "other cutoffs make another picture, so the comparison can fail: {apart} dB");
}

/// The largest difference, as a share of one or of the exact number.
fn largest_difference(own: &[f64], exact: &[f64]) -> f64 {
    assert_eq!(own.len(), exact.len(), "lists of different lengths cannot be close");
    let difference = |(own, exact): (&f64, &f64)| (own - exact).abs() / exact.abs().max(1.0);
    own.iter().zip(exact).map(difference).fold(0.0, |a, b| if b.is_nan() { f64::INFINITY } else { a.max(b) })
}

#[test]
fn the_largest_difference_is_seen_wherever_it_is() {
    assert_eq!(largest_difference(&[1.0, 2.0, 100.0], &[1.0, 2.5, 100.0]), 0.2);
    assert_eq!(largest_difference(&[1.0, f64::NAN, 3.0], &[1.0, 2.0, 3.0]), f64::INFINITY);
}

#[test]
fn ordinary_pictures_in_f32_are_those_in_f64() {
    for projection in [ProjectionModel::Affine, ProjectionModel::Tangent, ProjectionModel::Ray] {
        let cutoffs = Cutoffs::REFERENCE.with_projection(projection);
        for seed in 1..4 {
            let cloud = random_cloud(300, Layout::shaded(Some(3)), seed);
            let difference = largest_difference(
                &wide(&picture(&mut CpuViewer::with_cutoffs(cutoffs), &cloud)),
                &exact(&cloud, &cutoffs),
            );
            println!("{projection:?}, seed {seed}: {difference:.1e}");
            assert!(difference < SAME_NUMBER, "{projection:?}, seed {seed}: {difference:e}");
        }
    }
}

#[test]
fn earlier_cutoffs_have_larger_errors() {
    let exact = exact(&cloud(), &Cutoffs::REFERENCE);
    let psnr_of = |cutoffs: Cutoffs| psnr(&wide(&picture(&mut CpuViewer::with_cutoffs(cutoffs), &cloud())), &exact);
    let falls = |cutoffs: [Cutoffs; 3]| {
        let measured = cutoffs.map(psnr_of);
        assert!(measured[0] > measured[1] && measured[1] > measured[2], "{measured:?}");
    };
    falls([1e-4, 1.0 / 255.0, 1.0 / 30.0].map(|least| Cutoffs::REFERENCE.with_alpha_min(least)));
    falls([1e-5, 1e-2, 0.1].map(|least| Cutoffs::REFERENCE.with_transmittance_min(least)));
    falls([4.0, 2.5, 1.5].map(|sigmas| Cutoffs::REFERENCE.with_reach_max(sigmas)));
}

#[test]
fn fainter_splats_than_the_least_alpha_are_not_drawn() {
    let mut cloud = cloud();
    (0..cloud.count).for_each(|gaussian| cloud.set(gaussian, OPACITY, [-4.0]));
    let covers = |least: f32| {
        let values = picture(&mut CpuViewer::with_cutoffs(Cutoffs::REFERENCE.with_alpha_min(least)), &cloud);
        let pixels = (view().width * view().height) as usize;
        values[values.len() - pixels..].iter().any(|passed| *passed < 1.0)
    };
    // An opacity of σ(−4) is 1/55.6.
    assert!(covers(1.0 / 56.0) && !covers(1.0 / 55.0));
}

#[test]
fn the_default_formulas_are_those_within_the_default_cutoffs() {
    let state = blend::PixelState::open(1.0_f32);
    for log2_strength in [-9.0_f32, -7.9944, -7.9943, -3.0, -0.01, 0.0] {
        let [one, other] = [blend::alpha(log2_strength), Cutoffs::DEFAULT.alpha(log2_strength)];
        assert_eq!(one.to_bits(), other.to_bits());
        assert_eq!(blend::passes_alpha_test(log2_strength), Cutoffs::DEFAULT.passes_alpha_test(log2_strength));
        let [one, other] = [blend::step(one, state), Cutoffs::DEFAULT.step(other, state)];
        assert_eq!(one.weight.to_bits(), other.weight.to_bits());
    }
}

#[test]
fn thresholds_of_zero_become_the_least_threshold() {
    let nothing = Cutoffs::DEFAULT.with_alpha_min(0.0).with_transmittance_min(0.0);
    assert_eq!((nothing.alpha_min(), nothing.transmittance_min()), (1e-12, 1e-12));
    assert!(
        (nothing.passes_alpha_test(-39.863_12_f32)) && !nothing.passes_alpha_test(-39.864_f32),
        "2^-39.8631 is 1e-12"
    );
}

/// Relative difference of a slope and of finite differences with a step of [`STEP`], of formulas
/// without a jump: the third derivative.
const SMOOTH_SLOPE: f64 = 1e-3;
/// Step of finite differences, in units of log scales.
const STEP: f64 = 2e-3;

/// Mean square of a plain picture whose Gaussians have grown by `growth`, in log scales.
fn mean_square<R: Number>(cloud: &Gaussians<Vec<f32>>, growth: R, cutoffs: &Cutoffs) -> R {
    let mut grown = lift_gaussians::<R>(cloud);
    for gaussian in 0..grown.count {
        for plane in LOG_SCALE..LOG_SCALE + 3 {
            let index = grown.index_of(gaussian, plane);
            grown.values[index] = grown.values[index] + growth;
        }
    }
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    let values = plain::render_within(&grown, None, &view(), &rules, cutoffs).values;
    let count = values.len() as f64;
    values.into_iter().fold(R::of(0.0), |sum, x| sum + x * x * R::of(1.0 / count))
}

#[test]
fn finite_differences_see_the_edge_of_the_cut_and_gradients_do_not() {
    let cloud = random_cloud(300, Layout::radiance(0), 5);
    let uncut = Cutoffs::DEFAULT.with_alpha_min(0.0).with_transmittance_min(0.0);
    let difference = |cutoffs: &Cutoffs| {
        let Dual { slope, .. } = mean_square(&cloud, Dual::variable(0.0), cutoffs);
        let [before, after] = [-STEP, STEP].map(|growth| mean_square(&cloud, Double(growth), cutoffs).0);
        let measured = (after - before) / (2.0 * STEP);
        println!("slope {slope}, finite differences {measured}: {:.1e} apart", (measured - slope).abs() / slope.abs());
        (measured - slope).abs() / slope.abs()
    };
    assert!(difference(&uncut) < SMOOTH_SLOPE, "the gradient is that of the formulas");
    assert!(difference(&Cutoffs::DEFAULT) > 5.0 * SMOOTH_SLOPE, "pixels that a growing splat reaches jump by 1/255");
}
