//! Gradient of the activation of an environment's numbers.

use crate::codegen::formula::formula;
use specula_core::{environment::radiance_vjp, scene::RadianceActivation};

/// Gradient of [`RadianceOf`](crate::stages::prefilter::formulas::RadianceOf), from the radiance
/// ([`specula_core::environment::radiance_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct RadianceVjp {
    /// Activation of the environment.
    pub activation: RadianceActivation,
}

formula!(RadianceVjp, |this, inputs| radiance_vjp(radiance: 1, grad: 1) -> (grad: 1) {
    let [radiance, grad] = inputs.array();
    [radiance_vjp(this.activation, radiance, grad)]
});
