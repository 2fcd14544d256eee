//! Polynomials of powers and logarithms, called by `real.wgsl`.

use crate::codegen::formula::formula;
use specula_core::real::{exp2_fraction, log2_mantissa};

/// Polynomial of 2^x ([`specula_core::real::exp2_fraction`]).
#[derive(Clone, Copy, Debug)]
pub struct Exp2Fraction;

formula!(Exp2Fraction, |_, inputs| exp2_fraction(x: 1) -> (power: 1) { [exp2_fraction(inputs.number())] });

/// Polynomial of log₂ ([`specula_core::real::log2_mantissa`]).
#[derive(Clone, Copy, Debug)]
pub struct Log2Mantissa;

formula!(Log2Mantissa, |_, inputs| log2_mantissa(mantissa: 1) -> (logarithm: 1) { [log2_mantissa(inputs.number())] });
