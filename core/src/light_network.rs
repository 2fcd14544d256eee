//! Light as a network over directions: the directional encoding of Ref-NeRF (Verbin et al. 2022)
//! and three dense layers, instead of a cube map and its prefilter.
//!
//! The radiance of a direction at a roughness is the exponential of the network's output for the
//! *integrated directional encoding*: real harmonics of the degrees 1, 2, 4 and 8, each attenuated
//! as by the mean over a lobe of the roughness. The 34 numbers are those of Ref-NeRF, without the
//! imaginary parts of order zero, which are zero.
//!
//! Weights are stored layer by layer: a row of outputs for each input, then the row of biases.
//! Executors evaluate the network in each texel of the roughness levels of a cube map; the gradient
//! of the levels is propagated to the weights.

use crate::{math, prefilter::PrefilterScheme, random, real::Real, vector::Vec3};

/// Degrees of the harmonics.
pub const DEGREES: [usize; 4] = [1, 2, 4, 8];
/// Numbers of an encoded direction: 2 l + 1 harmonics of each degree l.
pub const ENCODING: usize = 34;
/// Neurons of a hidden layer.
pub const WIDTH: usize = 64;
/// Outputs: red, green and blue.
pub const CHANNELS: usize = 3;

/// First weight of each layer, and the number of all weights.
pub const LAYER_STARTS: [usize; 4] = {
    let first = (ENCODING + 1) * WIDTH;
    let second = first + (WIDTH + 1) * WIDTH;
    [0, first, second, second + (WIDTH + 1) * CHANNELS]
};
/// Number of all weights.
pub const WEIGHT_COUNT: usize = LAYER_STARTS[3];
/// Finest cube map for evaluating a network: it exceeds the detail of the harmonics, so finer ones
/// would only need more memory.
pub const NETWORK_RESOLUTION_MAX: usize = 128;

/// Largest magnitude of a weight; larger ones are clamped and have no gradient.
pub const WEIGHT_MAX: f32 = 1e6;
/// Largest output of a hidden neuron, with no gradient beyond.
pub const HIDDEN_MAX: f32 = 1e6;
/// Bound of the numbers of radiance, e⁴² = 1.7e18, with no gradient beyond.
pub const NUMBER_MAX: f32 = 42.0;

/// Concentration κ of the von Mises-Fisher lobe that approximates the GGX lobe of a roughness ρ >
/// 0: 1 / ρ³ + 5/4 ρ².
///
/// Fitted to the attenuation of the four degrees by the GGX lobe ([`crate::ggx`]), within 0.08 for
/// ρ from 0.07 to 1. Ref-NeRF learns 1 / κ as its roughness; the spherical Gaussian with the
/// curvature of the lobe's peak, 1 / (2 ρ⁴) (Wang et al. 2009), omits the tail, and at ρ = 1 most
/// of the light.
pub fn concentration(roughness: f64) -> f64 {
    1.0 / (roughness * roughness * roughness) + 1.25 * roughness * roughness
}

/// Attenuation by a von Mises-Fisher lobe of harmonics of a degree l: exp(−l (l + 1) / (2 κ))
/// (Ref-NeRF, eq. 8).
pub fn attenuation(degree: usize, concentration: f64) -> f64 {
    let bands = (degree * (degree + 1)) as f64;
    math::exp64(-bands / (2.0 * concentration))
}

/// Attenuation of each of [`DEGREES`] at a roughness; none at roughness 0.
pub fn attenuations(roughness: f32) -> [f64; DEGREES.len()] {
    if roughness > 0.0 {
        DEGREES.map(|degree| attenuation(degree, concentration(f64::from(roughness))))
    } else {
        [1.0; DEGREES.len()]
    }
}

/// Integrated directional encoding of a unit direction (Ref-NeRF, eq. 7): degree by degree, order
/// zero first, then cosine and sine of each further order. The mean square of each harmonic over
/// the sphere is one.
#[inline(always)]
pub fn encode<R: Real>(direction: Vec3<R>, attenuations: &[R; DEGREES.len()]) -> [R; ENCODING] {
    const LAST: usize = DEGREES[DEGREES.len() - 1];
    let Vec3 { x, y, z } = direction;
    let [zero, one] = [0.0, 1.0].map(|value| x.constant(value));
    let root = |above: usize, below: usize| (x.constant(above as f32) / x.constant(below as f32)).sqrt();
    let mut out = [zero; ENCODING];
    // sin^m θ cos mφ and sin^m θ sin mφ are the parts of (x + iy)^m; the other factor is a
    // polynomial of z.
    let (mut cosine, mut sine) = (one, zero);
    let mut sectoral = one;
    for order in 0..=LAST {
        if order > 0 {
            (cosine, sine) = (cosine * x - sine * y, sine * x + cosine * y);
            let doubled = if order == 1 { 2 } else { 1 };
            sectoral = sectoral * root(doubled * (2 * order + 1), 2 * order);
        }
        let (mut below, mut polynomial) = (zero, sectoral);
        for degree in order..=LAST {
            if degree > order {
                let pairs = (degree - order) * (degree + order);
                let rise = root((2 * degree - 1) * (2 * degree + 1), pairs);
                let fall = if degree - order > 1 {
                    root((2 * degree + 1) * (degree + order - 1) * (degree - order - 1), (2 * degree - 3) * pairs)
                } else {
                    zero
                };
                (below, polynomial) = (polynomial, rise * z * polynomial - fall * below);
            }
            let mut first = 0;
            for (encoded_degree, attenuation) in DEGREES.iter().zip(attenuations) {
                if *encoded_degree == degree {
                    let harmonic = polynomial * *attenuation;
                    if order == 0 {
                        out[first] = harmonic;
                    } else {
                        out[first + 2 * order - 1] = harmonic * cosine;
                        out[first + 2 * order] = harmonic * sine;
                    }
                }
                first += 2 * encoded_degree + 1;
            }
        }
    }
    out
}

/// `number` clamped to ±`bound`.
#[inline(always)]
pub fn bounded<R: Real>(number: R, bound: f32) -> R {
    number.clamp(-bound, bound)
}

/// Gradient of [`bounded`]; zero at the bounds and beyond.
#[inline(always)]
pub fn bounded_vjp<R: Real>(number: R, bound: f32, grad: R) -> R {
    grad.keep(number.abs().less(number.constant(bound)))
}

/// Output of a hidden neuron: its sum, at least zero and at most [`HIDDEN_MAX`].
#[inline(always)]
pub fn rectify<R: Real>(sum: R) -> R {
    sum.clamp(0.0, HIDDEN_MAX)
}

/// Gradient of [`rectify`] with respect to the sum, from the output.
#[inline(always)]
pub fn rectify_vjp<R: Real>(answer: R, grad: R) -> R {
    grad.keep(answer.zero().less(answer) & answer.less(answer.constant(HIDDEN_MAX)))
}

/// Sums of a dense layer: biases, then each input times its row of weights, in order.
#[inline(always)]
pub fn dense<R: Real, const OUT: usize>(weights: &[R], inputs: &[R]) -> [R; OUT] {
    let rows = weights.as_chunks::<OUT>().0;
    let mut sums = rows[inputs.len()];
    for (input, row) in inputs.iter().zip(rows) {
        for (sum, weight) in sums.iter_mut().zip(row) {
            *sum = *sum + *input * *weight;
        }
    }
    sums
}

/// Gradient of [`dense`] with respect to the inputs.
#[inline(always)]
pub fn dense_vjp<R: Real, const IN: usize, const OUT: usize>(weights: &[R], grads: &[R; OUT]) -> [R; IN] {
    let rows = weights.as_chunks::<OUT>().0;
    core::array::from_fn(|input| product(&rows[input], grads))
}

/// Gradient of [`dense`] with respect to the weights, which is added to `out`.
#[inline(always)]
pub fn dense_weights_vjp<R: Real, const OUT: usize>(inputs: &[R], grads: &[R; OUT], out: &mut [R]) {
    let rows = out.as_chunks_mut::<OUT>().0;
    for (input, row) in inputs.iter().zip(rows.iter_mut()) {
        for (sum, grad) in row.iter_mut().zip(grads) {
            *sum = *sum + *input * *grad;
        }
    }
    for (sum, grad) in rows[inputs.len()].iter_mut().zip(grads) {
        *sum = *sum + *grad;
    }
}

/// Sum of products, eight sums side by side.
#[inline(always)]
fn product<R: Real>(a: &[R], b: &[R]) -> R {
    let mut sums = [a[0].zero(); 8];
    let (a_eights, a_rest) = a.as_chunks::<8>();
    let (b_eights, b_rest) = b.as_chunks::<8>();
    for (a, b) in a_eights.iter().zip(b_eights) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum = *sum + *a * *b;
        }
    }
    for ((sum, a), b) in sums.iter_mut().zip(a_rest).zip(b_rest) {
        *sum = *sum + *a * *b;
    }
    let [a, b, c, d, e, f, g, h] = sums;
    ((a + b) + (c + d)) + ((e + f) + (g + h))
}

/// Outputs of all layers of the network for one encoded direction.
#[derive(Clone, Copy, Debug)]
pub struct Answers<R> {
    /// Outputs of the hidden layers.
    pub hidden: [[R; WIDTH]; 2],
    /// Numbers of red, green and blue before clamping.
    pub sums: [R; CHANNELS],
}

impl<R: Real> Answers<R> {
    /// Numbers of radiance, which [`crate::environment::radiance`] activates.
    #[inline(always)]
    pub fn numbers(&self) -> [R; CHANNELS] {
        self.sums.map(|sum| bounded(sum, NUMBER_MAX))
    }
}

/// Evaluates the network with weights within ±[`WEIGHT_MAX`].
#[inline(always)]
pub fn evaluate<R: Real>(weights: &[R], encoding: &[R; ENCODING]) -> Answers<R> {
    let [first, second, third, _] = LAYER_STARTS;
    let near: [R; WIDTH] = dense(&weights[first..second], encoding).map(rectify);
    let far: [R; WIDTH] = dense(&weights[second..third], &near).map(rectify);
    Answers { hidden: [near, far], sums: dense(&weights[third..], &far) }
}

/// Gradient of [`evaluate`] with respect to the weights from that of the numbers of radiance,
/// added to `out`.
#[inline(always)]
pub fn evaluate_vjp<R: Real>(
    weights: &[R],
    encoding: &[R; ENCODING],
    answers: &Answers<R>,
    grads: [R; CHANNELS],
    out: &mut [R],
) {
    let [first, second, third, _] = LAYER_STARTS;
    let [near, far] = &answers.hidden;
    let grad_sums: [R; CHANNELS] =
        core::array::from_fn(|channel| bounded_vjp(answers.sums[channel], NUMBER_MAX, grads[channel]));
    dense_weights_vjp(far, &grad_sums, &mut out[third..]);
    let grad_far: [R; WIDTH] = dense_vjp(&weights[third..], &grad_sums);
    let grad_far: [R; WIDTH] = core::array::from_fn(|k| rectify_vjp(far[k], grad_far[k]));
    dense_weights_vjp(near, &grad_far, &mut out[second..third]);
    let grad_near: [R; WIDTH] = dense_vjp(&weights[second..third], &grad_far);
    let grad_near: [R; WIDTH] = core::array::from_fn(|k| rectify_vjp(near[k], grad_near[k]));
    dense_weights_vjp(encoding, &grad_near, &mut out[first..second]);
}

/// Stream of the random numbers of initial weights.
const WEIGHT_STREAM: u64 = 0x6e65_7477;

/// Initial weight of a network with constant light: hidden layers are uniform with the variance of
/// He et al. 2015, 2 / inputs; biases are zero, and so are the weights of the outputs, whose bias
/// is the number of the radiance.
pub fn initial_weight(index: usize, number: f32, seed: u64) -> f32 {
    let [_, second, third, _] = LAYER_STARTS;
    let inputs = if index < second { ENCODING } else { WIDTH };
    let (start, width) = if index < second { (0, WIDTH) } else { (second, WIDTH) };
    if index >= third {
        return if index >= third + WIDTH * CHANNELS { number } else { 0.0 };
    }
    if index - start >= inputs * width {
        return 0.0;
    }
    let bound = math::sqrt(6.0 / inputs as f32);
    (2.0 * random::uniform(seed, WEIGHT_STREAM, index as u64) - 1.0) * bound
}

/// Fault of a light's network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum LightNetworkError {
    /// The scheme is a cube map's.
    Scheme,
    /// The levels are too fine.
    Resolution {
        /// Texels along an edge of a face.
        resolution: usize,
    },
    /// The number of weights is wrong.
    Count {
        /// Number of weights.
        found: usize,
    },
    /// Weights are NaN or infinite.
    Nonfinite {
        /// Number of such weights.
        count: usize,
    },
}

impl LightNetworkError {
    /// Checks the resolution of the cube maps, the number of weights and the scheme.
    ///
    /// # Errors
    ///
    /// The first invalid value.
    pub fn check(resolution: usize, found: usize, scheme: PrefilterScheme) -> Result<(), Self> {
        if scheme != PrefilterScheme::Exact {
            Err(Self::Scheme)
        } else if resolution > NETWORK_RESOLUTION_MAX {
            Err(Self::Resolution { resolution })
        } else if found != WEIGHT_COUNT {
            Err(Self::Count { found })
        } else {
            Ok(())
        }
    }

    /// Checks that all weights are finite.
    ///
    /// # Errors
    ///
    /// [`LightNetworkError::Nonfinite`].
    pub fn check_weights(weights: &[f32]) -> Result<(), Self> {
        match weights.iter().filter(|weight| !weight.is_finite()).count() {
            0 => Ok(()),
            count => Err(Self::Nonfinite { count }),
        }
    }
}

impl core::fmt::Display for LightNetworkError {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Scheme => write!(
                out,
                "the light is a network, which the official prefilter does not support; use the shading of the profile \
                 specula or paper"
            ),
            Self::Resolution { resolution } => {
                write!(out, "a light network supports resolutions up to {NETWORK_RESOLUTION_MAX}, not {resolution}")
            }
            Self::Count { found } => write!(out, "a light network has {WEIGHT_COUNT} weights, not {found}"),
            Self::Nonfinite { count } => write!(out, "{count} weights of the light network are NaN or infinite"),
        }
    }
}

impl core::error::Error for LightNetworkError {}
