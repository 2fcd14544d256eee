//! Modules of the page as one script, for a page in one file.
//!
//! Imports and exports of the modules have one form each, on separate lines: `import { a, b }
//! from "./x.js";`, and `export` before a declaration. A module becomes a function that returns its
//! exports.

use core::fmt::Write;

/// Joins modules, each with its file name, by the imports of the last.
///
/// # Panics
///
/// If an imported module does not exist, a bug of the page that a test finds.
pub(super) fn bundle(modules: &[(&str, &str)]) -> String {
    let mut script = "const modules = {};\n".to_owned();
    let mut done = Vec::new();
    if let Some((name, _)) = modules.last() {
        append(name, modules, &mut done, &mut script);
    }
    script
}

fn append<'a>(name: &'a str, modules: &[(&'a str, &'a str)], done: &mut Vec<&'a str>, script: &mut String) {
    if done.contains(&name) {
        return;
    }
    done.push(name);
    let (_, text) = modules.iter().find(|(other, _)| *other == name).unwrap_or_else(|| panic!("{name} does not exist"));
    text.lines().filter_map(import).for_each(|(_, from)| append(from, modules, done, script));
    let mut exports = Vec::new();
    // Writing to a text does not fail.
    let _ = writeln!(script, "modules[\"{name}\"] = (() => {{");
    for line in text.lines().filter(|line| !line.trim_start().starts_with("// ")) {
        if let Some((names, from)) = import(line) {
            let _ = writeln!(script, "const {{{}}} = modules[\"{from}\"];", names.replace(" as ", ": "));
        } else if let Some(declaration) = line.strip_prefix("export ") {
            exports.extend(declared(declaration));
            let _ = writeln!(script, "{declaration}");
        } else {
            let _ = writeln!(script, "{line}");
        }
    }
    let _ = writeln!(script, "return {{ {} }};\n}})();", exports.join(", "));
}

/// Names and module of an import.
fn import(line: &str) -> Option<(&str, &str)> {
    let (names, from) = line.strip_prefix("import {")?.split_once("} from \"./")?;
    Some((names, from.strip_suffix("\";")?))
}

/// Name that a declaration declares.
fn declared(declaration: &str) -> Option<&str> {
    let mut words = declaration.split([' ', '(', '=', ';']).filter(|word| !["async", ""].contains(word));
    let is_declaration = ["const", "let", "function", "class"].contains(&words.next()?);
    words.next().filter(|_| is_declaration)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modules_are_joined_in_the_order_of_their_imports() {
        let modules = [
            ("a.js", "// about a\nexport const one = 1;\nexport async function two(x) {\n  return x;\n}"),
            ("c.js", "export class Three {}"),
            ("b.js", "import { one, two as deux } from \"./a.js\";\ndeux(one);"),
        ];
        let expected = "const modules = {};\nmodules[\"a.js\"] = (() => {\nconst one = 1;\nasync function two(x) {\n  \
                        return x;\n}\nreturn { one, two };\n})();\nmodules[\"b.js\"] = (() => {\nconst { one, two: deux } \
                        = modules[\"a.js\"];\ndeux(one);\nreturn {  };\n})();\n";
        assert_eq!(bundle(&modules), expected);
    }

    #[test]
    #[should_panic(expected = "x.js does not exist")]
    fn a_missing_module_is_an_error() {
        bundle(&[("a.js", "import { x } from \"./x.js\";")]);
    }
}
