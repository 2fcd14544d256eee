//! Activation of an environment's numbers.

use crate::codegen::formula::formula;
use specula_core::{environment::radiance, scene::RadianceActivation};

/// Radiance of a stored number ([`specula_core::environment::radiance`]).
#[derive(Clone, Copy, Debug)]
pub struct RadianceOf {
    /// Activation of the environment.
    pub activation: RadianceActivation,
}

formula!(RadianceOf, |this, inputs| radiance_of_number(number: 1) -> (radiance: 1) {
    [radiance(this.activation, inputs.number())]
});
