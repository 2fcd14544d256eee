//! Copies the renderer of web pages into the program, where `scripts/build-web` has built it.

use std::{env, fs, path::Path};

/// Files of the renderer.
const FILES: [&str; 2] = ["specula_web.js", "specula_web_bg.wasm"];

fn main() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../web/built");
    let target = env::var("OUT_DIR").expect("cargo names the folder");
    for name in FILES {
        let file = source.join(name);
        println!("cargo::rerun-if-changed={}", file.display());
        // Without a renderer the program says how to build it.
        let bytes = fs::read(&file).unwrap_or_default();
        fs::write(Path::new(&target).join(name), bytes).expect("the folder can be written to");
    }
}
