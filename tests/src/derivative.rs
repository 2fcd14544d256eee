//! Exact gradients by dual numbers, to check every `_vjp`.

use crate::{compare::assert_all_close, number::Number};
use specula_core::{double::Double, dual::Dual, random};

/// Gradient of `cotangent · f(inputs)`: one pass with dual numbers for each input.
#[track_caller]
pub fn pull_back(f: impl Fn(&[Dual]) -> Vec<Dual>, inputs: &[f64], cotangent: &[f64]) -> Vec<f64> {
    let along = |index: usize| {
        let mut numbers: Vec<Dual> = inputs.iter().map(|&x| Dual::of(x)).collect();
        numbers[index] = Dual::variable(inputs[index]);
        let outputs = f(&numbers);
        assert_eq!(outputs.len(), cotangent.len(), "one cotangent for each output");
        outputs.iter().zip(cotangent).map(|(output, c)| output.slope * c).sum()
    };
    (0..inputs.len()).map(along).collect()
}

/// Gradient of a function of several numbers.
#[track_caller]
pub fn gradient(f: impl Fn(&[Dual]) -> Dual, inputs: &[f64]) -> Vec<f64> {
    pull_back(|x| vec![f(x)], inputs, &[1.0])
}

/// Checks a hand-written pull-back against dual numbers, for random cotangents.
///
/// `f` maps inputs to outputs; `vjp` maps inputs and a gradient of the outputs to a gradient of the
/// inputs. The largest difference may be `tolerance` times the largest component.
#[track_caller]
pub fn assert_vjp(
    inputs: &[f64],
    f: impl Fn(&[Dual]) -> Vec<Dual>,
    vjp: impl Fn(&[Double], &[Double]) -> Vec<Double>,
    tolerance: f64,
) {
    const COTANGENTS: u64 = 3;
    let numbers: Vec<Dual> = inputs.iter().map(|&x| Dual::of(x)).collect();
    let output_count = f(&numbers).len();
    for draw in 0..COTANGENTS {
        let cotangent = random_cotangent(output_count, draw);
        let expected = pull_back(&f, inputs, &cotangent);
        let actual = vjp(&doubles(inputs), &doubles(&cotangent));
        assert_all_close(&actual.into_iter().map(Double::value).collect::<Vec<_>>(), &expected, tolerance);
    }
}

fn doubles(values: &[f64]) -> Vec<Double> {
    values.iter().map(|&x| Double(x)).collect()
}

/// Numbers from −1 to 1, the same for every call.
pub fn random_cotangent(count: usize, stream: u64) -> Vec<f64> {
    (0..count as u64).map(|index| 2.0 * f64::from(random::uniform(7, stream, index)) - 1.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::{SAME_DERIVATIVE, assert_close};
    use specula_core::real::Real;

    fn product(x: &[Dual]) -> Vec<Dual> {
        vec![x[0] * x[1], x[0].sqrt()]
    }

    #[test]
    fn gradient_of_a_product_is_the_other_factor() {
        let gradient = gradient(|x| x[0] * x[1] * x[1], &[2.0, 3.0]);
        assert_close(gradient[0], 9.0, 0.0);
        assert_close(gradient[1], 12.0, 0.0);
    }

    #[test]
    fn a_right_vjp_passes() {
        let vjp = |x: &[Double], g: &[Double]| vec![x[1] * g[0] + g[1] * 0.5 / x[0].sqrt(), x[0] * g[0]];
        assert_vjp(&[2.0, 3.0], product, vjp, SAME_DERIVATIVE);
    }

    #[test]
    #[should_panic(expected = "apart")]
    fn a_vjp_with_a_wrong_sign_fails() {
        let vjp = |x: &[Double], g: &[Double]| vec![x[1] * g[0] - g[1] * 0.5 / x[0].sqrt(), x[0] * g[0]];
        assert_vjp(&[2.0, 3.0], product, vjp, SAME_DERIVATIVE);
    }

    #[test]
    #[should_panic(expected = "apart")]
    fn a_vjp_off_by_a_millionth_fails() {
        let vjp = |x: &[Double], g: &[Double]| vec![x[1] * g[0] + g[1] * 0.500_000_5 / x[0].sqrt(), x[0] * g[0]];
        assert_vjp(&[2.0, 3.0], product, vjp, SAME_DERIVATIVE);
    }
}
