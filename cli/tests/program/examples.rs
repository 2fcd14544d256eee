//! Examples of every help, as a shell runs them: on a tiny scene, with trainings cut short, and
//! demos, reports and servers stopped once they work.

use crate::end_to_end::write_photographs;
use crate::pages::{commands, help};
use crate::tiny::{Tiny, specula, train, train_by_default};
use crate::view::sky;
use std::{
    env,
    ffi::OsString,
    fs,
    io::{BufRead, BufReader, Read},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::mpsc,
    thread,
};

/// Lights of the example of a file of lights.
const EVENING: &str = "env = \"sunset.hdr\"\nsun = [\"30,45\"]\n";
const MANIFEST: &str =
    "random-points = 200\niterations = 20\n[[training]]\nsource-path = \"data/chair\"\nmodel-path = \"out/many\"\n";

/// Folder in which examples find what they name.
fn folder() -> Tiny {
    let tiny = Tiny::new();
    fs::create_dir_all(tiny.path("data")).unwrap();
    let model = |mut command: assert_cmd::Command| drop(command.args(["--eval", "--quiet"]).assert().success());
    model(train(&tiny, "out/chair"));
    model(train_by_default(&tiny, "out/spheres"));
    for name in ["chair-3dgs", "chair-specula", "plain"] {
        model(train(&tiny, &format!("out/{name}")));
    }
    for name in ["chair", "toaster", "drums", "spheres", "evening"] {
        copy(&tiny, name);
    }
    let pictures = (0..8).map(|k| format!("train/r_{k} dusk\n")).chain((0..3).map(|k| format!("test/r_{k} noon\n")));
    fs::write(tiny.path("days.txt"), pictures.collect::<String>()).unwrap();
    write_photographs(&tiny.path("data/garden"));
    let garden = ["-m", "out/garden", "--profile", "3dgs", "--iterations", "20", "--quiet"];
    specula().current_dir(tiny.path("")).args(["train", "data/garden"]).args(garden).assert().success();
    let truth = tiny.path("data/spheres/relight/forest");
    fs::create_dir_all(&truth).unwrap();
    fs::copy(tiny.path("data/test/r_0.png"), truth.join("r_0.png")).unwrap();
    let light = sky(&tiny);
    for name in ["sunset.hdr", "forest.hdr"] {
        fs::write(tiny.path(name), &light).unwrap();
    }
    fs::write(tiny.path("evening.toml"), EVENING).unwrap();
    fs::write(tiny.path("scenes.toml"), MANIFEST).unwrap();
    let ply = tiny.path("out/chair/point_cloud/iteration_30/point_cloud.ply");
    fs::copy(ply, tiny.path("scene.ply")).unwrap();
    fs::copy(tiny.path("out/chair/cameras.json"), tiny.path("cameras.json")).unwrap();
    specula()
        .current_dir(tiny.path(""))
        .args(["export", "out/chair", "-o", "studio.exr", "--quiet"])
        .assert()
        .success();
    tiny
}

/// Copies the tiny data set to the folder that an example names.
fn copy(tiny: &Tiny, name: &str) {
    let to = tiny.path("data").join(name);
    for part in ["train", "test"] {
        fs::create_dir_all(to.join(part)).unwrap();
        for file in fs::read_dir(tiny.file(part)).unwrap().map(|entry| entry.unwrap().path()) {
            fs::copy(&file, to.join(part).join(file.file_name().unwrap())).unwrap();
        }
        let list = format!("transforms_{part}.json");
        fs::copy(tiny.file(&list), to.join(&list)).unwrap();
    }
}

/// Examples of all commands, as their helps have them.
fn examples() -> Vec<String> {
    let mut found = Vec::new();
    for (name, _) in commands() {
        let help = help(&[&name]);
        let lines = help.lines().skip_while(|line| !line.starts_with("Example")).skip(1);
        let examples: Vec<String> = lines.map_while(|line| line.strip_prefix("  ")).map(str::to_owned).collect();
        assert!(!examples.is_empty(), "specula {name} --help has no example");
        found.extend(examples);
    }
    found
}

/// The example with as few steps and pixels as a test has time for.
fn shortened(example: &str) -> String {
    let (line, _) = example.split_once('#').unwrap_or((example, ""));
    let mut line = line.trim_end().to_owned();
    for (long, short) in [
        ("--iterations 7k", "--iterations 20"),
        ("--iterations 7500", "--iterations 20"),
        ("--iterations 60k", "--iterations 40"),
        ("--voxels 384", "--voxels 32"),
        ("--mesh", "--mesh --voxels 32 --texture 256"),
        ("--turntable 36", "--turntable 2"),
        ("--turn-light 48", "--turn-light 2"),
        ("--size 640,480", "--size 32,24"),
        ("--size 200", "--size 16"),
        ("--resolution 128", "--resolution 32"),
        ("0.0.0.0:7008", "127.0.0.1:0"),
        // It is stopped, and later examples need the model.
        ("out/chair --view", "out/live --view"),
        (" -r 4", ""),
        (" -r 2", ""),
    ] {
        line = line.replace(long, short);
    }
    let is_new_training = ["specula train data", "specula demo"].iter().any(|start| line.starts_with(start));
    let iterations = if is_new_training && !line.contains("--iterations") { " --iterations 20" } else { "" };
    let points = if line.starts_with("specula train data") { " --random-points 200 --overwrite" } else { "" };
    if is_new_training {
        let (first, rest) = line.split_at(line.find(" -m").or(line.find(" -o")).unwrap());
        line = format!("{first}{iterations}{points}{rest}");
    }
    if line.starts_with("specula fit-light") {
        line += " --iterations 20";
    }
    if is_server(&line) && !line.contains("--listen") {
        line += if line.starts_with("specula view") { " --listen 127.0.0.1:0" } else { "=127.0.0.1:0" };
    }
    line
}

/// Whether an example goes on until it is stopped.
fn is_server(line: &str) -> bool {
    line.starts_with("specula view") || line.split(' ').any(|word| word == "--view" || word.starts_with("--view="))
}

/// Path on which a shell finds the program.
fn path_with_program() -> OsString {
    let program: PathBuf = assert_cmd::cargo::cargo_bin("specula");
    let folders = [program.parent().unwrap().to_owned()];
    let others = env::var_os("PATH").unwrap_or_default();
    env::join_paths(folders.into_iter().chain(env::split_paths(&others))).unwrap()
}

fn shell(line: &str, folder: &Path) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", line]).current_dir(folder).env("PATH", path_with_program());
    command
}

/// Runs a program that goes on for long, until it says `word`; anything at all, if that is empty.
fn starts(line: &str, folder: &Path, word: &str) {
    let mut child =
        shell(&format!("exec {line}"), folder).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let streams: [Box<dyn Read + Send>; 2] =
        [Box::new(child.stdout.take().unwrap()), Box::new(child.stderr.take().unwrap())];
    let (sender, receiver) = mpsc::channel();
    for stream in streams {
        let sender = sender.clone();
        thread::spawn(move || {
            BufReader::new(stream).lines().map_while(Result::ok).for_each(|line| drop(sender.send(line)));
        });
    }
    drop(sender);
    let mut said = Vec::new();
    let has_started = receiver.iter().any(|line| {
        said.push(line);
        said.last().is_some_and(|line| line.contains(word))
    });
    // The program may have ended already.
    let _ = child.kill();
    child.wait().unwrap();
    assert!(has_started, "{line}\n{}", said.join("\n"));
}

#[test]
fn every_example_of_every_help_runs() {
    let tiny = folder();
    let folder = tiny.path("");
    let examples = examples();
    assert!(examples.len() > 45, "{examples:?}");
    for example in &examples {
        let line = shortened(example);
        // Captures, demos, reports and searches of settings take long, and have tests of their own;
        // `make` runs commands with tests.
        let is_long = ["specula demo", "specula report", "specula capture", "specula make"]
            .iter()
            .any(|start| line.starts_with(start));
        let is_long = is_long || line.contains("--max-error");
        if is_server(&line) || is_long {
            starts(&line, &folder, if is_server(&line) { "http://" } else { "" });
            continue;
        }
        let output = shell(&line, &folder).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        let lacks_driver = line.contains("--executor gpu") && said.contains("GPU");
        assert!(output.status.success() || lacks_driver, "{line}\n{said}");
    }
}
