//! Writes the bindings of the web renderer, its WebAssembly and the JavaScript that calls it, into
//! a folder: `bindings RENDERER.wasm FOLDER`.
//!
//! The tool of wasm-bindgen does the same; here its library has the version of this workspace's
//! lock file, which the renderer needs.

use std::process::ExitCode;
use wasm_bindgen_cli_support::Bindgen;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [renderer, folder] = &arguments[..] else {
        eprintln!("usage: bindings RENDERER.wasm FOLDER");
        return ExitCode::from(2);
    };
    let mut bindings = Bindgen::new();
    bindings.input_path(renderer).typescript(false).remove_name_section(true).remove_producers_section(true);
    let written = bindings.no_modules(true).and_then(|b| b.generate(folder));
    match written {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e:#}");
            ExitCode::FAILURE
        }
    }
}
