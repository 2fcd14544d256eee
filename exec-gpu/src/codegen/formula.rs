//! Functions of WGSL from core's formulas.

use crate::codegen::trace::{Traced, trace};
use core::fmt::Write;
use specula_core::{real::Real, vector::Vec3};

/// Parameter or result of a formula.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Name in WGSL; an expression for a parameter that is no argument of the function.
    pub name: String,
    /// Number of components: one to four are a scalar or a vector, more an array.
    pub len: usize,
    /// Binding in the shader.
    pub binding: FieldBinding,
}

/// Source of a parameter's components, or destination of a result's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldBinding {
    /// Argument of the function, or member of its return value.
    Argument,
    /// Variable of the shader.
    Variable,
    /// Function of the shader, called with each component's index; for a result, also with the
    /// component.
    Call,
}

/// Argument, or member of the return value.
pub fn field(name: &str, len: usize) -> Field {
    Field { name: name.to_owned(), len, binding: FieldBinding::Argument }
}
/// Variable of the shader.
pub fn variable(name: &str, len: usize) -> Field {
    Field { name: name.to_owned(), len, binding: FieldBinding::Variable }
}
/// Components that a function of the shader returns or takes, one by one.
pub fn call(name: &str, len: usize) -> Field {
    Field { name: name.to_owned(), len, binding: FieldBinding::Call }
}

/// Formula of core with flat parameters and results; implemented through `formula!`.
pub trait Formula {
    /// Name of the function in WGSL.
    fn name(&self) -> String;
    /// Parameters, in order.
    fn parameters(&self) -> Vec<Field>;
    /// Results, in order.
    fn results(&self) -> Vec<Field>;
    /// Evaluates the formula over any number.
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R>;
}

/// List of [`Field`]s: `name: len` is an argument or a member of the return value, `..fields`
/// appends others.
macro_rules! fields {
    (@push $list:ident) => {};
    (@push $list:ident ..$more:expr $(, $($rest:tt)*)?) => {
        $list.extend($more);
        $crate::codegen::formula::fields!(@push $list $($($rest)*)?);
    };
    (@push $list:ident $name:ident: $len:expr $(, $($rest:tt)*)?) => {
        $list.extend([$crate::codegen::formula::field(stringify!($name), $len)]);
        $crate::codegen::formula::fields!(@push $list $($($rest)*)?);
    };
    ($($list:tt)*) => {{
        let mut list: Vec<$crate::codegen::formula::Field> = Vec::new();
        $crate::codegen::formula::fields!(@push list $($list)*);
        list
    }};
}
pub(crate) use fields;

/// Implements [`Formula`] for a type:
///
/// ```ignore
/// formula!(GradLength, |_, inputs| grad_length(grad: 2, half_size: 2) -> (length: 1) {
///     [grad_length(inputs.array(), inputs.array())]
/// });
/// ```
///
/// The bound names are `self` and the [`Inputs`]; parameters and results are written as [`fields!`]
/// takes them; the body returns [`Components`].
macro_rules! formula {
    (
        $formula:ty, |$this:pat_param, $inputs:pat_param|
        $name:ident($($parameters:tt)*) -> ($($results:tt)*) $body:block
    ) => {
        impl $crate::codegen::formula::Formula for $formula {
            fn name(&self) -> String {
                stringify!($name).to_owned()
            }
            #[allow(unused_variables, reason = "few formulas have parameters that depend on their fields")]
            fn parameters(&self) -> Vec<$crate::codegen::formula::Field> {
                let $this = self;
                $crate::codegen::formula::fields!($($parameters)*)
            }
            #[allow(unused_variables, reason = "few formulas have results that depend on their fields")]
            fn results(&self) -> Vec<$crate::codegen::formula::Field> {
                let $this = self;
                $crate::codegen::formula::fields!($($results)*)
            }
            #[allow(unused_variables, reason = "not all formulas have fields")]
            fn evaluate<R: specula_core::real::Real>(
                &self,
                $inputs: &mut $crate::codegen::formula::Inputs<'_, R>,
            ) -> Vec<R> {
                let $this = self;
                $crate::codegen::formula::flat($body)
            }
        }
    };
}
pub(crate) use formula;

/// Results of a formula: arrays, vectors, and tuples of them; a single number is an array of one.
pub trait Components<R> {
    /// Appends all numbers, in order.
    fn append_to(self, numbers: &mut Vec<R>);
}

/// The numbers of some values, in a row.
pub fn flat<R: Real>(components: impl Components<R>) -> Vec<R> {
    let mut numbers = Vec::new();
    components.append_to(&mut numbers);
    numbers
}

impl<R: Real> Components<R> for Vec3<R> {
    fn append_to(self, numbers: &mut Vec<R>) {
        numbers.extend(self.to_array());
    }
}

impl<R: Real, const N: usize> Components<R> for [R; N] {
    fn append_to(self, numbers: &mut Vec<R>) {
        numbers.extend(self);
    }
}

impl<R: Real> Components<R> for Vec<R> {
    fn append_to(mut self, numbers: &mut Self) {
        numbers.append(&mut self);
    }
}

macro_rules! components_of_tuples {
    ($($($name:ident)+;)*) => {$(
        impl<R, $($name: Components<R>),+> Components<R> for ($($name,)+) {
            #[expect(non_snake_case, reason = "members are named as their types")]
            fn append_to(self, numbers: &mut Vec<R>) {
                let ($($name,)+) = self;
                $($name.append_to(numbers);)+
            }
        }
    )*};
}

components_of_tuples! {
    A B;
    A B C;
    A B C D;
    A B C D E;
    A B C D E F;
    A B C D E F G;
    A B C D E F G H;
}

/// Cursor over the numbers of a formula's parameters.
#[derive(Debug)]
pub struct Inputs<'a, R> {
    numbers: &'a [R],
}

impl<'a, R: Real> Inputs<'a, R> {
    /// A cursor over all numbers, in the order of the parameters.
    pub fn new(numbers: &'a [R]) -> Self {
        Self { numbers }
    }
    /// Reads a number.
    pub fn number(&mut self) -> R {
        let [number] = self.array();
        number
    }
    /// Reads three numbers.
    pub fn vec3(&mut self) -> Vec3<R> {
        let [x, y, z] = self.array();
        Vec3 { x, y, z }
    }
    /// Reads `N` numbers.
    pub fn array<const N: usize>(&mut self) -> [R; N] {
        let (array, rest) = self.numbers.split_first_chunk().expect("parameters have that many numbers");
        self.numbers = rest;
        *array
    }
    /// Reads `len` numbers.
    pub fn slice(&mut self, len: usize) -> &'a [R] {
        let (slice, rest) = self.numbers.split_at(len);
        self.numbers = rest;
        slice
    }
}

/// WGSL type of `len` numbers.
pub fn type_of(len: usize) -> String {
    match len {
        1 => "f32".to_owned(),
        2..=4 => format!("vec{len}f"),
        _ => format!("array<f32, {len}>"),
    }
}

/// Expressions of a parameter's components.
fn numbers_of(field: &Field) -> impl Iterator<Item = String> + '_ {
    (0..field.len).map(move |k| match (field.binding, field.len) {
        (FieldBinding::Call, _) => format!("{}({k}u)", field.name),
        (_, 1) => field.name.clone(),
        (_, 2..=4) => format!("{}.{}", field.name, ["x", "y", "z", "w"][k]),
        _ => format!("{}[{k}]", field.name),
    })
}

/// The formula as a function of WGSL. Several returned results make a structure, named as the
/// function in camel case.
pub fn function(formula: &impl Formula) -> String {
    let (name, parameters, results) = (formula.name(), formula.parameters(), formula.results());
    let inputs: Vec<String> = parameters.iter().flat_map(numbers_of).collect();
    let (mut statements, numbers) = trace(&inputs, |numbers| formula.evaluate(&mut Inputs::new(numbers)));
    assert_eq!(numbers.len(), results.iter().map(|field| field.len).sum::<usize>(), "{name} gives what it says");

    let mut numbers = numbers.into_iter();
    let mut returned = Vec::new();
    for field in &results {
        let numbers: Vec<String> = numbers.by_ref().take(field.len).collect();
        match field.binding {
            FieldBinding::Argument => returned.push((field, value_of(&numbers))),
            FieldBinding::Variable => push(&mut statements, &format!("{} = {};", field.name, value_of(&numbers))),
            FieldBinding::Call => {
                numbers.iter().enumerate().for_each(|(k, number)| {
                    push(&mut statements, &format!("{}({k}u, {number});", field.name));
                });
            }
        }
    }
    let arguments = arguments_of(&parameters);
    let Returned { declared, kind, statement } = Returned::new(&name, &returned);
    format!("{declared}fn {name}({arguments}){kind} {{\n{statements}{statement}}}\n")
}

/// Function of WGSL that calls other functions of the shader ([`TracedValue`]) and stores numbers
/// in its variables, which `body` returns.
///
/// [`TracedValue`]: crate::codegen::trace::TracedValue
pub(crate) fn procedure(
    name: &str,
    parameters: &[Field],
    body: impl FnOnce(&mut Inputs<'_, Traced>) -> Vec<(String, Traced)>,
) -> String {
    let inputs: Vec<String> = parameters.iter().flat_map(numbers_of).collect();
    let mut variables = Vec::new();
    let (mut statements, numbers) = trace(&inputs, |inputs| {
        let numbers;
        (variables, numbers) = body(&mut Inputs::new(inputs)).into_iter().unzip();
        numbers
    });
    for (variable, number) in variables.iter().zip(numbers) {
        push(&mut statements, &format!("{variable} = {number};"));
    }
    format!("fn {name}({}) {{\n{statements}}}\n", arguments_of(parameters))
}

/// Arguments of a function, as it declares them.
fn arguments_of(parameters: &[Field]) -> String {
    let arguments = parameters.iter().filter(|field| field.binding == FieldBinding::Argument);
    let arguments: Vec<String> = arguments.map(|field| format!("{}: {}", field.name, type_of(field.len))).collect();
    arguments.join(", ")
}

fn push(statements: &mut String, statement: &str) {
    writeln!(statements, "    {statement}").expect("strings take everything");
}

/// Expression that constructs one value from its components.
fn value_of(numbers: &[String]) -> String {
    match numbers {
        [only] => only.clone(),
        _ => format!("{}({})", type_of(numbers.len()), numbers.join(", ")),
    }
}

/// Return value of a function.
struct Returned {
    /// Declaration of its structure; empty without one.
    declared: String,
    /// Return type, as it follows the arguments.
    kind: String,
    statement: String,
}

impl Returned {
    fn new(name: &str, results: &[(&Field, String)]) -> Self {
        let returned = |declared: String, kind: &str, value: &str| Self {
            declared,
            kind: format!(" -> {kind}"),
            statement: format!("    return {value};\n"),
        };
        match results {
            [] => Self { declared: String::new(), kind: String::new(), statement: String::new() },
            [(only, value)] => returned(String::new(), &type_of(only.len), value),
            _ => {
                let structure = capitalized(name);
                let member = |field: &Field| format!("    {}: {},\n", field.name, type_of(field.len));
                let members: String = results.iter().map(|(field, _)| member(field)).collect();
                let values: Vec<&str> = results.iter().map(|(_, value)| value.as_str()).collect();
                let declared = format!("struct {structure} {{\n{members}}}\n");
                returned(declared, &structure, &format!("{structure}({})", values.join(", ")))
            }
        }
    }
}

/// Name of a structure: `splat_of` becomes `SplatOf`.
pub fn capitalized(name: &str) -> String {
    name.split('_')
        .flat_map(|word| {
            let (first, rest) = word.split_at(word.len().min(1));
            [first.to_uppercase(), rest.to_owned()]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Example;

    formula!(Example, |_, inputs| mirror_it(point: 3, ..[variable("camera.focal_px", 2), call("plane", 2)]) -> (
        mirrored: 3, sum: 1
    ) {
        let point = -inputs.vec3();
        let [focal, _] = inputs.array();
        let [_, second] = inputs.array();
        (point, [focal + second])
    });

    #[test]
    fn a_function_takes_what_it_reads_and_gives_a_structure() {
        let expected = "struct MirrorIt {\n    mirrored: vec3f,\n    sum: f32,\n}\n\
            fn mirror_it(point: vec3f) -> MirrorIt {\n    let v0 = point.x;\n    let v1 = point.y;\n    \
            let v2 = point.z;\n    let v3 = camera.focal_px.x;\n    let v6 = plane(1u);\n    let v7 = -v0;\n    \
            let v8 = -v1;\n    let v9 = -v2;\n    let v10 = v3 + v6;\n    \
            return MirrorIt(vec3f(v7, v8, v9), v10);\n}\n";
        assert_eq!(function(&Example), expected);
    }

    struct Stored;

    formula!(Stored, |_, inputs| store_it(x: 1) -> (..[variable("state", 2), call("write", 2)]) {
        let x = inputs.number();
        [x, -x, x + x, x.constant(2.0)]
    });

    #[test]
    fn results_go_to_variables_and_functions_of_the_shader() {
        let expected = "fn store_it(x: f32) {\n    let v0 = x;\n    let v1 = -v0;\n    let v2 = v0 + v0;\n    \
            state = vec2f(v0, v1);\n    write(0u, v2);\n    write(1u, 2.0f);\n}\n";
        assert_eq!(function(&Stored), expected);
    }
}
