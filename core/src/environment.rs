//! Radiance of an environment's numbers: the activation of the light, and its gradient.

use crate::{
    cubemap::{FACE_COUNT, texel_direction},
    double::Double,
    light_network::{DEGREES, ENCODING, WEIGHT_COUNT, WEIGHT_MAX, bounded, encode, evaluate},
    math,
    real::Real,
    scene::{Environment, RadianceActivation},
    vector::vec3,
};

/// Radiance of one stored number, or of one output of a network: the number itself, or its
/// exponential.
///
/// The exponential is [`Real::exp_wide`], which has the range of a light: e⁻¹⁰⁴ is zero in `f32`.
#[inline(always)]
pub fn radiance<R: Real>(activation: RadianceActivation, number: R) -> R {
    match activation {
        RadianceActivation::Identity => number,
        RadianceActivation::Exponential | RadianceActivation::Network => number.exp_wide(),
    }
}

/// Gradient of [`radiance`] with respect to the number, from its value.
#[inline(always)]
pub fn radiance_vjp<R: Real>(activation: RadianceActivation, radiance: R, grad: R) -> R {
    match activation {
        RadianceActivation::Identity => grad,
        RadianceActivation::Exponential | RadianceActivation::Network => grad * radiance,
    }
}

/// Stored number of a radiance: the inverse of [`radiance`]. Only positive radiance if the
/// activation is exponential.
pub fn number_of(activation: RadianceActivation, radiance: f32) -> f32 {
    match activation {
        RadianceActivation::Identity => radiance,
        RadianceActivation::Exponential | RadianceActivation::Network => math::ln(radiance),
    }
}

/// Linear radiance of every texel of an environment, in order: from its numbers, or from its
/// network at roughness 0.
pub fn texels<A: AsRef<[f32]>>(light: &Environment<A>) -> impl Iterator<Item = [f32; 3]> + '_ {
    let Environment { resolution, activation, values } = light;
    let values = values.as_ref();
    let weights = light.is_network().then(|| weights_of(values));
    (0..FACE_COUNT * resolution * resolution).map(move |texel| {
        let numbers = match &weights {
            Some(weights) => {
                let area = resolution * resolution;
                let (face, row, column) = (texel / area, texel / resolution % resolution, texel % resolution);
                let encoding = encoding_of(face, column, row, *resolution, &[1.0; DEGREES.len()]);
                evaluate(weights, &encoding).numbers()
            }
            None => core::array::from_fn(|channel| values[3 * texel + channel]),
        };
        numbers.map(|number| radiance(*activation, number))
    })
}

/// Weights of a network, clamped; missing ones are zero.
pub fn weights_of(values: &[f32]) -> [f32; WEIGHT_COUNT] {
    core::array::from_fn(|index| values.get(index).map_or(0.0, |weight| bounded(*weight, WEIGHT_MAX)))
}

/// Encoding of the direction of a texel's centre.
pub fn encoding_of(
    face: usize,
    column: usize,
    row: usize,
    resolution: usize,
    attenuations: &[f64; DEGREES.len()],
) -> [f32; ENCODING] {
    let [x, y, z] = texel_direction(face, column, row, resolution).map(Double);
    encode(vec3(x, y, z), &attenuations.map(Double)).map(|number| number.0 as f32)
}
