//! Copies the renderer of web pages into the program, where `scripts/build-web` has built it, and
//! warns where sources have changed since.

use std::{
    env, fs, io,
    path::{Path, PathBuf},
    time::SystemTime,
};

/// Files of the renderer.
const FILES: [&str; 2] = ["specula_web.js", "specula_web_bg.wasm"];
/// Crates that the renderer is compiled from.
const CRATES: [&str; 10] =
    ["core", "exec-cpu", "exec-gpu", "io", "mesh", "prefilter", "scene", "train", "viewer", "web"];

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let source = root.join("web/built");
    let target = env::var("OUT_DIR").expect("cargo names the folder");
    // Cargo runs this script in each build where a file that it names is missing.
    println!("cargo::rerun-if-changed={}", root.join("web").display());
    for name in FILES {
        let file = source.join(name);
        // Without a renderer the program says how to build it.
        let bytes = fs::read(&file).unwrap_or_default();
        fs::write(Path::new(&target).join(name), bytes).expect("the folder can be written to");
    }
    if let Ok(built) = modified(&source.join(FILES[1])) {
        let sources = CRATES.map(|name| root.join(name).join("src"));
        sources.iter().for_each(|folder| println!("cargo::rerun-if-changed={}", folder.display()));
        if let Some((file, _)) = sources.iter().filter_map(|folder| newest(folder)).find(|(_, time)| *time > built) {
            println!(
                "cargo::warning=pages of `specula export` get a renderer that is older than {}; run scripts/build-web \
                 and build again",
                file.strip_prefix(&root).unwrap_or(&file).display()
            );
        }
    }
}

fn modified(file: &Path) -> io::Result<SystemTime> {
    fs::metadata(file)?.modified()
}

/// File of a folder, or of those in it, that was changed last.
fn newest(folder: &Path) -> Option<(PathBuf, SystemTime)> {
    let entries = fs::read_dir(folder).ok()?.filter_map(Result::ok).map(|entry| entry.path());
    let files = entries
        .filter_map(|path| if path.is_dir() { newest(&path) } else { modified(&path).ok().map(|time| (path, time)) });
    files.max_by_key(|(_, time)| *time)
}
