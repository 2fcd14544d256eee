//! From a formula of core to a function of WGSL.

use crate::trace::trace;
use core::fmt::Write;
use specula_core::{real::Real, vector::Vec3};

/// What a formula is given, or gives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name in WGSL; for a parameter that is no argument of the function, an expression.
    pub name: String,
    /// How many numbers it has: one to four are a scalar or a vector, more an array.
    pub len: usize,
    /// Where its numbers come from.
    pub place: Place,
}

/// Where the numbers of a parameter come from, or those of a result go to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// An argument of the function, or what it returns.
    Argument,
    /// A variable of the shader.
    Variable,
    /// A function of the shader, called with the number's index, and with the number itself if it is a result.
    Call,
}

/// An argument, or a result.
pub fn field(name: &str, len: usize) -> Field {
    Field { name: name.to_owned(), len, place: Place::Argument }
}
/// A variable of the shader.
pub fn variable(name: &str, len: usize) -> Field {
    Field { name: name.to_owned(), len, place: Place::Variable }
}
/// Numbers that a function of the shader gives or takes, one by one.
pub fn call(name: &str, len: usize) -> Field {
    Field { name: name.to_owned(), len, place: Place::Call }
}

/// Something that core computes, with its numbers in a row.
pub trait Formula {
    /// The function's name.
    fn name(&self) -> String;
    /// What it is given, in order.
    fn parameters(&self) -> Vec<Field>;
    /// What it gives, in order.
    fn results(&self) -> Vec<Field>;
    /// The formula itself.
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R>;
}

/// The numbers of the parameters, taken one after the other.
#[derive(Debug)]
pub struct Inputs<'a, R> {
    numbers: &'a [R],
}

impl<'a, R: Real> Inputs<'a, R> {
    /// All numbers, in the order of the parameters.
    pub fn new(numbers: &'a [R]) -> Self {
        Self { numbers }
    }
    /// The next number.
    pub fn number(&mut self) -> R {
        let [number] = self.array();
        number
    }
    /// The next three.
    pub fn vec3(&mut self) -> Vec3<R> {
        let [x, y, z] = self.array();
        Vec3 { x, y, z }
    }
    /// The next `N`.
    pub fn array<const N: usize>(&mut self) -> [R; N] {
        let (array, rest) = self.numbers.split_first_chunk().expect("parameters have that many numbers");
        self.numbers = rest;
        *array
    }
    /// The next `len`.
    pub fn slice(&mut self, len: usize) -> &'a [R] {
        let (slice, rest) = self.numbers.split_at(len);
        self.numbers = rest;
        slice
    }
}

/// The type of so many numbers.
pub fn type_of(len: usize) -> String {
    match len {
        1 => "f32".to_owned(),
        2..=4 => format!("vec{len}f"),
        _ => format!("array<f32, {len}>"),
    }
}

/// The expressions of a parameter's numbers.
fn numbers_of(field: &Field) -> impl Iterator<Item = String> + '_ {
    (0..field.len).map(move |k| match (field.place, field.len) {
        (Place::Call, _) => format!("{}({k}u)", field.name),
        (_, 1) => field.name.clone(),
        (_, 2..=4) => format!("{}.{}", field.name, ["x", "y", "z", "w"][k]),
        _ => format!("{}[{k}]", field.name),
    })
}

/// The formula as a function of WGSL. More than one result that it returns make a structure, named as the function with
/// a capital.
pub fn function(formula: &impl Formula) -> String {
    let (name, parameters, results) = (formula.name(), formula.parameters(), formula.results());
    let inputs: Vec<String> = parameters.iter().flat_map(numbers_of).collect();
    let (mut statements, numbers) = trace(&inputs, |numbers| formula.evaluate(&mut Inputs::new(numbers)));
    assert_eq!(numbers.len(), results.iter().map(|field| field.len).sum::<usize>(), "{name} gives what it says");

    let mut numbers = numbers.into_iter();
    let mut returned = Vec::new();
    for field in &results {
        let numbers: Vec<String> = numbers.by_ref().take(field.len).collect();
        match field.place {
            Place::Argument => returned.push((field, value_of(&numbers))),
            Place::Variable => push(&mut statements, &format!("{} = {};", field.name, value_of(&numbers))),
            Place::Call => {
                numbers.iter().enumerate().for_each(|(k, number)| {
                    push(&mut statements, &format!("{}({k}u, {number});", field.name));
                });
            }
        }
    }
    let arguments = parameters.iter().filter(|field| field.place == Place::Argument);
    let arguments: Vec<String> = arguments.map(|field| format!("{}: {}", field.name, type_of(field.len))).collect();
    let Returned { declared, kind, statement } = Returned::new(&name, &returned);
    format!("{declared}fn {name}({}){kind} {{\n{statements}{statement}}}\n", arguments.join(", "))
}

fn push(statements: &mut String, statement: &str) {
    writeln!(statements, "    {statement}").expect("strings take everything");
}

/// The expression of these numbers as one value.
fn value_of(numbers: &[String]) -> String {
    match numbers {
        [only] => only.clone(),
        _ => format!("{}({})", type_of(numbers.len()), numbers.join(", ")),
    }
}

/// What a function returns.
struct Returned {
    /// The structure that it returns, if it does.
    declared: String,
    /// As it follows the arguments.
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

/// The name of a structure: `splat_of` becomes `SplatOf`.
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

    impl Formula for Example {
        fn name(&self) -> String {
            "mirror_it".to_owned()
        }
        fn parameters(&self) -> Vec<Field> {
            vec![field("point", 3), variable("camera.focal_px", 2), call("plane", 2)]
        }
        fn results(&self) -> Vec<Field> {
            vec![field("mirrored", 3), field("sum", 1)]
        }
        fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
            let point = -inputs.vec3();
            let [focal, _] = inputs.array();
            let [_, second] = inputs.array();
            vec![point.x, point.y, point.z, focal + second]
        }
    }

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

    impl Formula for Stored {
        fn name(&self) -> String {
            "store_it".to_owned()
        }
        fn parameters(&self) -> Vec<Field> {
            vec![field("x", 1)]
        }
        fn results(&self) -> Vec<Field> {
            vec![variable("state", 2), call("put", 2)]
        }
        fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
            let x = inputs.number();
            vec![x, -x, x + x, x.constant(2.0)]
        }
    }

    #[test]
    fn results_go_to_variables_and_functions_of_the_shader() {
        let expected = "fn store_it(x: f32) {\n    let v0 = x;\n    let v1 = -v0;\n    let v2 = v0 + v0;\n    \
            state = vec2f(v0, v1);\n    put(0u, v2);\n    put(1u, 2.0f);\n}\n";
        assert_eq!(function(&Stored), expected);
    }
}
