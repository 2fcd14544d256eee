//! Deep, opaque and faint stacks of splats.

use super::{assert_at_most, worst};
use specula_core::{
    blend::{self, MAX_ALPHA, PixelState, Replay},
    cutoffs::Cutoffs,
    double::Double,
    random,
};
use specula_tests::number::Number;

/// Gradients of three layers are sums and quotients of a few numbers, of which 1 − 0.99 has lost
/// two digits.
const GRADIENT: f64 = 1e-4;
/// The transmittance of a stack is a product of thousands of factors, each rounded: √5000 · 6e-8,
/// and twice that.
const STACK: f64 = 1e-5;
/// A haze of a thousand layers, of which each is rounded.
const HAZE: f64 = 1e-4;
/// A blended colour, as a share of itself.
const EMITTER: f64 = 1e-4;

/// Strengths as logarithms to base two.
fn strengths<R: Number>(alphas: &[f64]) -> Vec<R> {
    alphas.iter().map(|alpha| R::of(f64::from((*alpha as f32).log2()))).collect()
}

/// Transmittance behind a stack, and its colour where each layer has one.
fn front_to_back<R: Number>(cutoffs: &Cutoffs, strengths: &[R], colors: &[f64]) -> [f64; 2] {
    let (mut state, mut sum) = (PixelState::open(strengths[0]), R::of(0.0));
    for (strength, color) in strengths.iter().zip(colors) {
        let step = cutoffs.step(cutoffs.alpha(*strength), state);
        sum = sum + step.weight * R::of(*color);
        state = step.behind;
    }
    [state.final_transmittance.value(), sum.value()]
}

/// The gradients of a stack's strengths and colours, of a pixel with a gradient of one.
fn gradients<R: Number>(strengths: &[R], colors: &[f64]) -> Vec<f64> {
    let [_, color] = front_to_back(&Cutoffs::DEFAULT, strengths, colors);
    let mut front = Replay { transmittance: R::of(1.0), remaining: R::of(color) };
    let step = |(strength, color): (&R, &f64)| {
        let step = blend::step_vjp(*strength, front, R::of(*color));
        front = step.behind;
        [step.log_strength.value(), step.weight.value()]
    };
    strengths.iter().zip(colors).flat_map(step).collect()
}

/// Weights and gradients of a stack are numbers.
#[track_caller]
pub(crate) fn assert_front_to_back_is_finite(alphas: &[f64]) {
    let (strengths, colors) = (strengths::<f32>(alphas), vec![0.5; alphas.len()]);
    let [left, color] = front_to_back(&Cutoffs::DEFAULT, &strengths, &colors);
    let gradients = gradients(&strengths, &colors);
    assert!(left >= 0.0 && color <= 0.5 && gradients.iter().all(|x| x.is_finite()), "{left}, {color}, {gradients:?}");
}

#[test]
fn gradients_of_opaque_layers_are_those_of_f64_and_zero_where_alpha_is_clamped() {
    let opaque = [1.0 - 1e-9; 3];
    let off = |seed: u64| {
        let draw = |index: u64| f64::from(random::uniform(seed, 1, index));
        let mut alphas = opaque;
        // The first layer may let some light through.
        alphas[0] = 0.98 + 0.02 * draw(0);
        let colors = [draw(1), draw(2), draw(3)];
        let (own, exact) =
            (gradients(&strengths::<f32>(&alphas), &colors), gradients(&strengths::<Double>(&alphas), &colors));
        assert_eq!([own[2], own[4]], [0.0; 2], "layers as opaque as can be have no gradient");
        worst(own.iter().zip(&exact).map(|(own, exact)| (own - exact).abs()))
    };
    assert_at_most("gradients of three opaque layers", worst((0..500).map(off)), GRADIENT);
}

#[test]
fn the_transmittance_of_a_stack_is_that_of_f64() {
    let off = |seed: u64| {
        let count = 1 + (random::bits(seed, 2, 0) % 5000) as usize;
        // Their joint transmittance is that of a pixel that is not terminated.
        let mean = 8.0 / count as f64;
        let alphas: Vec<f64> =
            (0..count).map(|k| (2.0 * mean * f64::from(random::uniform(seed, 3, k as u64))).min(0.9)).collect();
        let colors = vec![1.0; count];
        let cutoffs = Cutoffs::REFERENCE;
        let [own, _] = front_to_back(&cutoffs, &strengths::<f32>(&alphas), &colors);
        let [exact, _] = front_to_back(&cutoffs, &strengths::<Double>(&alphas), &colors);
        (own / exact - 1.0).abs()
    };
    assert_at_most("transmittance of up to 5000 layers", worst((0..200).map(off)), STACK);
}

#[test]
fn haze_is_omitted_by_the_default_alpha_threshold_and_kept_by_the_reference() {
    const LAYERS: usize = 1000;
    let (haze, colors) = (strengths::<f32>(&[0.0035; LAYERS]), vec![1.0; LAYERS]);
    let exact = 1.0 - (1.0_f64 - 0.0035).powi(LAYERS as i32);
    let [_, kept] = front_to_back(&Cutoffs::REFERENCE, &haze, &colors);
    let [_, lost] = front_to_back(&Cutoffs::DEFAULT, &haze, &colors);
    assert_eq!(lost, 0.0, "INRIA's limit shows nothing of it");
    assert_at_most("haze of 97 %", (kept - exact).abs(), HAZE);
}

#[test]
fn an_emitter_behind_a_wall_is_omitted_by_the_default_transmittance_threshold_and_kept_by_the_reference() {
    let alphas = [1.0 - 0.1_f64.sqrt() * 0.1, 1.0 - 0.1_f64.sqrt() * 0.1, 0.99];
    let colors = [0.0, 0.0, 1e4];
    let through = alphas[..2].iter().map(|alpha| 1.0 - f64::from(*alpha as f32)).product::<f64>();
    let exact = through * f64::from(MAX_ALPHA) * 1e4;
    let [_, kept] = front_to_back(&Cutoffs::REFERENCE, &strengths::<f32>(&alphas), &colors);
    let [_, lost] = front_to_back(&Cutoffs::DEFAULT, &strengths::<f32>(&alphas), &colors);
    println!("of {exact}, the default cutoffs show {lost}");
    assert_eq!(lost, 0.0, "a pixel ends before the splat that brings it below 10⁻⁴");
    assert_at_most("an emitter of 10⁴ behind a wall of 10⁻³", (kept / exact - 1.0).abs(), EMITTER);
}
