//! Builder of kernels' sources.

use crate::codegen::{
    formula::{Formula, function},
    real::{Exp2Fraction, Log2Mantissa},
    trace::{TracedWord, literal, trace_words},
};
use core::fmt::Write;
use specula_core::{
    bin::TILE_SIZE,
    real::{EXP2_MAX, EXP2_MIN},
    scene::BLOCK,
};

/// Invocations of a one-dimensional workgroup.
pub(crate) const WORKGROUP_SIZE: u32 = 256;

/// WGSL source of a kernel.
#[derive(Debug)]
pub(crate) struct Source(String);

impl Source {
    /// A source with the constants and functions of every kernel.
    pub(crate) fn new() -> Self {
        Self(String::new())
            .number("TILE_SIZE", TILE_SIZE as f32)
            .count("TILE_EDGE", TILE_SIZE as usize)
            .count("BLOCK", BLOCK)
            .count("GROUP", WORKGROUP_SIZE as usize)
            .with(include_str!("index.wgsl"))
    }
    /// Appends text.
    pub(crate) fn with(mut self, text: &str) -> Self {
        self.0.push('\n');
        self.0.push_str(text);
        self
    }
    /// Appends declarations that several kernels share.
    pub(crate) fn part(self, part: impl FnOnce(Self) -> Self) -> Self {
        part(self)
    }
    /// Appends a constant of type `f32`.
    pub(crate) fn number(self, name: &str, value: f32) -> Self {
        self.constant(name, "f32", &literal(value))
    }
    /// Appends a constant of type `u32`.
    pub(crate) fn count(self, name: &str, value: usize) -> Self {
        self.constant(name, "u32", &format!("{value}u"))
    }
    /// Appends a constant of type `bool`.
    pub(crate) fn flag(self, name: &str, value: bool) -> Self {
        self.constant(name, "bool", &value.to_string())
    }
    fn constant(mut self, name: &str, kind: &str, value: &str) -> Self {
        writeln!(self.0, "const {name}: {kind} = {value};").expect("strings take everything");
        self
    }
    /// Appends a formula as a function.
    pub(crate) fn formula(self, formula: &impl Formula) -> Self {
        self.with(&function(formula))
    }
    /// Appends a formula over words as a function of `u32`.
    pub(crate) fn word_formula<const N: usize>(
        self,
        name: &str,
        parameters: [&str; N],
        formula: impl FnOnce([TracedWord; N]) -> TracedWord,
    ) -> Self {
        let (statements, results) = trace_words(&parameters.map(str::to_owned), formula);
        let arguments = parameters.map(|name| format!("{name}: u32")).join(", ");
        self.with(&format!("fn {name}({arguments}) -> u32 {{\n{statements}    return {};\n}}\n", results[0]))
    }
    /// Appends a function that repeats a statement for 0, 1, … `count` − 1. Private arrays are in
    /// registers only if all of their indices are constants, so loops over them are unrolled.
    pub(crate) fn unrolled(self, signature: &str, count: usize, statement: impl Fn(usize) -> String) -> Self {
        let statements: String = (0..count).map(|k| format!("    {}\n", statement(k))).collect();
        self.with(&format!("fn {signature} {{\n{statements}}}\n"))
    }
    /// Appends powers and logarithms, which formulas call.
    pub(crate) fn real(self) -> Self {
        self.number("EXP2_MIN", EXP2_MIN)
            .number("EXP2_MAX", EXP2_MAX)
            .count("FRAC_1_SQRT_2_BITS", core::f32::consts::FRAC_1_SQRT_2.to_bits() as usize)
            .formula(&Exp2Fraction)
            .formula(&Log2Mantissa)
            .with(include_str!("real.wgsl"))
    }
    /// Appends tests and sort keys of numbers by their bits.
    pub(crate) fn bits(self) -> Self {
        self.with(include_str!("bits.wgsl"))
    }
    /// The whole text.
    pub(crate) fn text(self) -> String {
        self.0
    }
}
