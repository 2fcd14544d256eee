//! Tracing: a number that records the operations on it, and WGSL statements from the record.
//!
//! Formulas have no branches, so one evaluation with [`Traced`] records every operation. Unused
//! operations are dropped, common subexpressions are evaluated once, and operations keep their
//! order: shaders compute exactly the expressions of core.
//!
//! A composition that looks values up in between calls functions of the shader ([`TracedValue`]).
//!
//! A composition that looks values up in between calls functions of the shader ([`TracedValue`]).
//!
//! A variant, such as the shading function of a profile or a smaller number of harmonics, is the
//! same formula traced under other rules. Tests evaluate every formula on the device and compare it
//! with the `f32` and `f64` of the host.

use core::{
    array,
    cell::RefCell,
    fmt::Write,
    ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Shl, Sub},
};
use specula_core::{
    real::Real,
    vector::{Vec3, vec3},
};
use std::collections::HashMap;

/// A number in a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Traced(u32);

/// The result of a comparison in a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TracedMask(u32);

/// A 32-bit word in a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TracedWord(u32);

/// A value of any type of the shader in a record: numbers side by side, or the result of one of its
/// functions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TracedValue(u32);

/// One operation of a record; its operands are earlier ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Operation {
    /// A parameter, by its number.
    Input(u32),
    /// A constant, by its bits.
    Constant(u32),
    /// A word, by its bits.
    Word(u32),
    /// `- + …` of one number or mask.
    Prefix(&'static str, u32),
    /// A function of one number.
    Call(&'static str, u32),
    /// Two numbers or masks with an operator between them.
    Infix(u32, &'static str, u32),
    /// The first where the mask, the third, holds; else the second.
    Select(u32, u32, u32),
    /// A function of the shader. It is called even if nothing reads its result.
    Function(&'static str, [Option<u32>; ARGUMENTS_MAX]),
    /// A component or a member of a value.
    Member(u32, &'static str),
}

/// Most arguments of a function of the shader.
const ARGUMENTS_MAX: usize = 4;

#[derive(Default)]
struct Record {
    operations: Vec<Operation>,
    known: HashMap<Operation, u32>,
}

thread_local! {
    static RECORD: RefCell<Record> = RefCell::default();
}

fn push(operation: Operation) -> u32 {
    RECORD.with_borrow_mut(|record| {
        let next = record.operations.len() as u32;
        let index = *record.known.entry(operation).or_insert(next);
        if index == next {
            record.operations.push(operation);
        }
        index
    })
}

/// Traces a formula; `inputs` are the WGSL expressions of its parameters. Returns the statements,
/// and the expressions of the results.
pub(crate) fn trace(inputs: &[String], formula: impl FnOnce(&[Traced]) -> Vec<Traced>) -> (String, Vec<String>) {
    write_out(inputs, |inputs| {
        let numbers: Vec<Traced> = inputs.map(Traced).collect();
        formula(&numbers).into_iter().map(|result| result.0).collect()
    })
}

/// Traces a formula over words; see [`trace`].
pub(crate) fn trace_words<const N: usize>(
    inputs: &[String; N],
    formula: impl FnOnce([TracedWord; N]) -> TracedWord,
) -> (String, Vec<String>) {
    write_out(inputs, |inputs| {
        vec![formula(array::from_fn(|_| TracedWord(inputs.next().expect("there are N inputs")))).0]
    })
}

/// Statements of a record, and the expressions of its results; `record` gets the operations of the
/// inputs.
fn write_out(
    inputs: &[String],
    record: impl FnOnce(&mut dyn Iterator<Item = u32>) -> Vec<u32>,
) -> (String, Vec<String>) {
    RECORD.with_borrow_mut(|record| *record = Record::default());
    let recorded: Vec<u32> = (0..inputs.len() as u32).map(|k| push(Operation::Input(k))).collect();
    let results = record(&mut recorded.into_iter());
    RECORD.with_borrow(|record| {
        let is_function = |operation: &Operation| matches!(operation, Operation::Function(..));
        let mut is_needed: Vec<bool> = record.operations.iter().map(is_function).collect();
        results.iter().for_each(|result| is_needed[*result as usize] = true);
        for (index, operation) in record.operations.iter().enumerate().rev().filter(|(_, o)| !o.is_leaf()) {
            if is_needed[index] {
                operation.operands().for_each(|operand| is_needed[operand as usize] = true);
            }
        }
        let mut statements = String::new();
        for (index, operation) in record.operations.iter().enumerate() {
            if is_needed[index] && !matches!(operation, Operation::Constant(_) | Operation::Word(_)) {
                let expression = expression(operation, record, inputs);
                writeln!(statements, "    let v{index} = {expression};").expect("strings take everything");
            }
        }
        let results = results.iter().map(|result| operand(*result, record)).collect();
        (statements, results)
    })
}

impl Operation {
    fn is_leaf(&self) -> bool {
        matches!(self, Self::Input(_) | Self::Constant(_) | Self::Word(_))
    }

    fn operands(&self) -> impl Iterator<Item = u32> {
        let operands = match *self {
            Self::Input(_) | Self::Constant(_) | Self::Word(_) => [None; ARGUMENTS_MAX],
            Self::Prefix(_, a) | Self::Call(_, a) | Self::Member(a, _) => [Some(a), None, None, None],
            Self::Infix(a, _, b) => [Some(a), Some(b), None, None],
            Self::Select(a, b, mask) => [Some(a), Some(b), Some(mask), None],
            Self::Function(_, arguments) => arguments,
        };
        operands.into_iter().flatten()
    }
}

fn expression(operation: &Operation, record: &Record, inputs: &[String]) -> String {
    let of = |index: u32| operand(index, record);
    match *operation {
        Operation::Input(k) => inputs[k as usize].clone(),
        Operation::Constant(bits) => literal(f32::from_bits(bits)),
        Operation::Word(bits) => format!("{bits}u"),
        Operation::Prefix(sign, a) => format!("{sign}{}", of(a)),
        Operation::Call(function, a) => format!("{function}({})", of(a)),
        Operation::Infix(a, sign, b) => format!("{} {sign} {}", of(a), of(b)),
        Operation::Select(if_true, if_false, mask) => {
            format!("select({}, {}, {})", of(if_false), of(if_true), of(mask))
        }
        Operation::Function(name, arguments) => {
            let arguments: Vec<String> = arguments.into_iter().flatten().map(of).collect();
            format!("{name}({})", arguments.join(", "))
        }
        Operation::Member(value, name) => format!("{}.{name}", of(value)),
    }
}

/// Operation as an operand of another: its name, or its value if it is a constant.
fn operand(index: u32, record: &Record) -> String {
    match record.operations[index as usize] {
        Operation::Constant(bits) if f32::from_bits(bits).is_sign_negative() => {
            format!("({})", literal(f32::from_bits(bits)))
        }
        Operation::Constant(bits) => literal(f32::from_bits(bits)),
        Operation::Word(bits) => format!("{bits}u"),
        _ => format!("v{index}"),
    }
}

/// Literal of a finite number, which parses to the same bits.
pub(crate) fn literal(value: f32) -> String {
    debug_assert!(value.is_finite(), "WGSL has no constant for {value}");
    // The shortest text of the largest number exceeds it, which browsers reject.
    if value.abs() == f32::MAX { format!("{value:.1}f") } else { format!("{value:?}f") }
}

fn constant(value: f32) -> u32 {
    push(Operation::Constant(value.to_bits()))
}

impl TracedValue {
    /// Result of a function of the shader.
    pub(crate) fn call<const N: usize>(name: &'static str, arguments: [Self; N]) -> Self {
        let mut operands = [None; ARGUMENTS_MAX];
        operands.iter_mut().zip(arguments).for_each(|(operand, argument)| *operand = Some(argument.0));
        Self(push(Operation::Function(name, operands)))
    }
    /// Member of a structure.
    pub(crate) fn member(self, name: &'static str) -> Self {
        Self(push(Operation::Member(self.0, name)))
    }
    /// First components of a vector.
    pub(crate) fn components<const N: usize>(self) -> [Traced; N] {
        array::from_fn(|k| Traced(self.member(["x", "y", "z", "w"][k]).0))
    }
    /// Three components.
    pub(crate) fn vec3(self) -> Vec3<Traced> {
        let [x, y, z] = self.components();
        vec3(x, y, z)
    }
}

impl From<Traced> for TracedValue {
    fn from(number: Traced) -> Self {
        Self(number.0)
    }
}
impl From<[Traced; 2]> for TracedValue {
    fn from([x, y]: [Traced; 2]) -> Self {
        Self::call("vec2f", [x.into(), y.into()])
    }
}
impl From<Vec3<Traced>> for TracedValue {
    fn from(Vec3 { x, y, z }: Vec3<Traced>) -> Self {
        Self::call("vec3f", [x.into(), y.into(), z.into()])
    }
}

macro_rules! arithmetic {
    ($($operator:ident, $method:ident, $sign:literal;)*) => {$(
        impl $operator for Traced {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                Self(push(Operation::Infix(self.0, $sign, other.0)))
            }
        }
        impl $operator<f32> for Traced {
            type Output = Self;
            fn $method(self, other: f32) -> Self {
                Self(push(Operation::Infix(self.0, $sign, constant(other))))
            }
        }
    )*};
}

arithmetic! {
    Add, add, "+";
    Sub, sub, "-";
    Mul, mul, "*";
    Div, div, "/";
}

impl Neg for Traced {
    type Output = Self;
    fn neg(self) -> Self {
        Self(push(Operation::Prefix("-", self.0)))
    }
}

impl BitAnd for TracedMask {
    type Output = Self;
    fn bitand(self, other: Self) -> Self {
        Self(push(Operation::Infix(self.0, "&", other.0)))
    }
}
impl BitOr for TracedMask {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(push(Operation::Infix(self.0, "|", other.0)))
    }
}
impl Not for TracedMask {
    type Output = Self;
    fn not(self) -> Self {
        Self(push(Operation::Prefix("!", self.0)))
    }
}

impl From<u32> for TracedWord {
    fn from(bits: u32) -> Self {
        Self(push(Operation::Word(bits)))
    }
}
impl BitAnd for TracedWord {
    type Output = Self;
    fn bitand(self, other: Self) -> Self {
        Self(push(Operation::Infix(self.0, "&", other.0)))
    }
}
impl BitOr for TracedWord {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(push(Operation::Infix(self.0, "|", other.0)))
    }
}
impl Shl<u32> for TracedWord {
    type Output = Self;
    fn shl(self, places: u32) -> Self {
        Self(push(Operation::Infix(self.0, "<<", Self::from(places).0)))
    }
}

/// Each method records the operation of `f32`; `exp2`, `log2` and `is_finite` are functions of
/// `real.wgsl`.
impl Real for Traced {
    type Mask = TracedMask;

    fn constant(self, value: f32) -> Self {
        Self(constant(value))
    }
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        self * factor + addend
    }
    fn sqrt(self) -> Self {
        Self(push(Operation::Call("sqrt", self.0)))
    }
    fn exp2(self) -> Self {
        Self(push(Operation::Call("real_exp2", self.0)))
    }
    fn log2(self) -> Self {
        Self(push(Operation::Call("real_log2", self.0)))
    }
    fn floor(self) -> Self {
        Self(push(Operation::Call("floor", self.0)))
    }
    fn abs(self) -> Self {
        Self(push(Operation::Call("abs", self.0)))
    }
    fn min(self, other: Self) -> Self {
        Self::select(self.less(other), self, other)
    }
    fn max(self, other: Self) -> Self {
        Self::select(other.less(self), self, other)
    }
    fn less(self, other: Self) -> TracedMask {
        TracedMask(push(Operation::Infix(self.0, "<", other.0)))
    }
    fn less_or_equal(self, other: Self) -> TracedMask {
        TracedMask(push(Operation::Infix(self.0, "<=", other.0)))
    }
    fn select(mask: TracedMask, if_true: Self, if_false: Self) -> Self {
        Self(push(Operation::Select(if_true.0, if_false.0, mask.0)))
    }
    fn is_finite(self) -> TracedMask {
        TracedMask(push(Operation::Call("real_is_finite", self.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_formula_is_written_once_and_in_order() {
        let inputs = ["p.x".to_owned(), "p.y".to_owned(), "unused".to_owned()];
        let (statements, results) = trace(&inputs, |x| {
            let sum = x[0] + x[1];
            let again = x[0] + x[1];
            let _ = x[2] * 3.0;
            vec![sum * again - 0.5, Real::max(sum, x[0].constant(-1.0))]
        });
        let expected = "    let v0 = p.x;\n    let v1 = p.y;\n    let v3 = v0 + v1;\n    let v6 = v3 * v3;\n    \
                        let v8 = v6 - 0.5f;\n    let v10 = (-1.0f) < v3;\n    let v11 = select((-1.0f), v3, v10);\n";
        assert_eq!(statements, expected);
        assert_eq!(results, ["v8", "v11"]);
    }

    #[test]
    fn functions_of_the_shader_are_called_with_vectors_and_give_members() {
        let inputs = ["a".to_owned(), "b".to_owned()];
        let (statements, results) = trace(&inputs, |x| {
            let seen = TracedValue::call("look_up", [vec3(x[0], x[1], x[0]).into(), x[1].into()]);
            TracedValue::call("add_to_sum", [seen, [x[0], x[0].constant(2.0)].into()]);
            vec![seen.member("radiance").vec3().y]
        });
        let expected = "    let v0 = a;\n    let v1 = b;\n    let v2 = vec3f(v0, v1, v0);\n    \
                        let v3 = look_up(v2, v1);\n    let v5 = vec2f(v0, 2.0f);\n    \
                        let v6 = add_to_sum(v3, v5);\n    let v7 = v3.radiance;\n    let v9 = v7.y;\n";
        assert_eq!(statements, expected);
        assert_eq!(results, ["v9"]);
    }

    #[test]
    fn literals_of_constants_keep_every_digit() {
        for value in [0.1_f32, 1.0, 1e-30, f32::MAX, 0.282_094_8, -12_582_912.0] {
            let text = literal(value);
            assert_eq!(text.trim_end_matches('f').parse::<f32>().expect("a number"), value);
        }
    }
}
