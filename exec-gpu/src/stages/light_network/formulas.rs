//! Bounds and activations of a light's network.

use crate::codegen::formula::formula;
use specula_core::light_network::{NUMBER_MAX, WEIGHT_MAX, bounded, bounded_vjp, rectify, rectify_vjp};

/// Weight within its bound ([`specula_core::light_network::bounded`]).
#[derive(Clone, Copy, Debug)]
pub struct BoundedWeight;

formula!(BoundedWeight, |_this, inputs| bounded_weight(number: 1) -> (weight: 1) {
    [bounded(inputs.number(), WEIGHT_MAX)]
});

/// Gradient of [`BoundedWeight`].
#[derive(Clone, Copy, Debug)]
pub struct BoundedWeightVjp;

formula!(BoundedWeightVjp, |_this, inputs| bounded_weight_vjp(number: 1, grad: 1) -> (grad: 1) {
    let [number, grad] = inputs.array();
    [bounded_vjp(number, WEIGHT_MAX, grad)]
});

/// Number of radiance within its bound ([`specula_core::light_network::bounded`]).
#[derive(Clone, Copy, Debug)]
pub struct BoundedNumber;

formula!(BoundedNumber, |_this, inputs| bounded_number(sum: 1) -> (number: 1) {
    [bounded(inputs.number(), NUMBER_MAX)]
});

/// Gradient of [`BoundedNumber`].
#[derive(Clone, Copy, Debug)]
pub struct BoundedNumberVjp;

formula!(BoundedNumberVjp, |_this, inputs| bounded_number_vjp(sum: 1, grad: 1) -> (grad: 1) {
    let [sum, grad] = inputs.array();
    [bounded_vjp(sum, NUMBER_MAX, grad)]
});

/// Output of a hidden neuron ([`specula_core::light_network::rectify`]).
#[derive(Clone, Copy, Debug)]
pub struct Rectify;

formula!(Rectify, |_this, inputs| rectify(sum: 1) -> (answer: 1) {
    [rectify(inputs.number())]
});

/// Gradient of [`Rectify`] ([`specula_core::light_network::rectify_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct RectifyVjp;

formula!(RectifyVjp, |_this, inputs| rectify_vjp(answer: 1, grad: 1) -> (grad: 1) {
    let [answer, grad] = inputs.array();
    [rectify_vjp(answer, grad)]
});
