//! Folders from elsewhere: nothing outside of a model folder is written, emptied or removed, what
//! is no file is not waited for, and no name controls the terminal.

use crate::tiny::{Tiny, specula, train, train_plain};
use assert_cmd::Command;
use std::{
    collections::BTreeMap,
    fs,
    os::unix::fs::symlink,
    path::{Path, PathBuf},
};

/// Command on a model.
fn on(model: &Path, words: &str) -> Command {
    let mut command = specula();
    let mut words = words.split(' ');
    command.arg("--quiet").args(words.next()).arg(model).args(words);
    command
}

/// Sentence with which a command refuses.
fn refusal(mut command: Command) -> String {
    let output = command.assert().code(2).get_output().clone();
    let sentence = String::from_utf8(output.stderr).unwrap();
    assert_eq!(sentence.lines().count(), 1, "one sentence is expected: {sentence}");
    sentence
}

fn trained(tiny: &Tiny, more: &str) -> PathBuf {
    train_plain(tiny, "model").arg("--quiet").args(more.split_whitespace()).assert().success();
    tiny.path("model")
}

/// Files below a folder, with their contents.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries
        .flat_map(|path| if path.is_dir() { contents(&path) } else { [(path.clone(), fs::read(path).unwrap())].into() })
        .collect()
}

#[test]
fn links_of_a_model_lead_to_nothing_that_is_written_or_removed() {
    let tiny = Tiny::new();
    let model = trained(&tiny, "--eval");
    let (others, aside) = (tiny.path("others"), tiny.path("aside"));
    fs::create_dir_all(others.join("iteration_7")).unwrap();
    for name in ["iteration_7/point_cloud.ply", "00000.png", "00009.png", "index.html", "views.json"] {
        fs::write(others.join(name), "mine").unwrap();
    }
    let before = contents(&others);
    let again = format!("train -s {} --overwrite -m", tiny.data().display());
    for (name, target, words) in [
        ("training.lock", "others/index.html", "train --resume -m"),
        ("point_cloud", "others", &*again),
        ("light", "others", &again),
        ("brdf_mlp/iteration_30", "others/iteration_7", &again),
        ("test", "others", "render"),
        ("test/ours_30", "others", "render"),
        ("test/ours_30", "others", "eval"),
        ("test/ours_30/gt", "others", "render"),
        ("test/ours_30/views", "others", "eval"),
    ] {
        let link = model.join(name);
        fs::create_dir_all(link.parent().unwrap()).unwrap();
        let had = fs::rename(&link, &aside).is_ok();
        symlink(tiny.path(target), &link).unwrap();
        let mut command = specula();
        command.arg("--quiet").args(words.split(' ')).arg(&model);
        let sentence = refusal(command);
        assert!(sentence.contains(name) && sentence.contains("is a link"), "{words}: {sentence}");
        assert!(contents(&others) == before, "{words} reached through {name}");
        fs::remove_file(&link).unwrap();
        if had {
            fs::rename(&aside, &link).unwrap();
        }
    }
}

#[test]
fn what_is_no_file_is_not_waited_for() {
    let tiny = Tiny::new();
    let model = trained(&tiny, "--eval");
    fs::create_dir_all(model.join("test/ours_30")).unwrap();
    for (name, words) in [
        ("config.toml", "compare"),
        ("results.json", "compare"),
        ("specula.json", "info"),
        ("test/ours_30/views.json", "render"),
    ] {
        let (path, aside) = (model.join(name), tiny.path("aside"));
        let had = fs::rename(&path, &aside).is_ok();
        symlink("/dev/zero", &path).unwrap();
        let sentence = refusal(on(&model, words));
        assert!(sentence.contains(name) && sentence.contains("not a regular file"), "{words}: {sentence}");
        fs::remove_file(&path).unwrap();
        if had {
            fs::rename(&aside, &path).unwrap();
        }
    }
    let sentence = refusal(on(&model, "relight --lights /dev/zero"));
    assert!(sentence.contains("/dev/zero") && sentence.contains("not a regular file"), "{sentence}");
}

#[test]
fn names_in_files_do_not_control_the_terminal() {
    let tiny = Tiny::new();
    let model = trained(&tiny, "--eval");
    let info = fs::read_to_string(model.join("specula.json")).unwrap();
    let hostile = info.replace("\"3dgs\"", "\"\\u001b]0;a\\u0007\\nspecula: saved\\u009b\\u202e\"");
    assert_ne!(hostile, info, "it names its profile");
    fs::write(model.join("specula.json"), hostile).unwrap();
    let header = tiny.path("light.hdr");
    fs::write(&header, "#?RADIANCE\nFORMAT=\rspecula: saved\n\n-Y 1 +X 1\n1234").unwrap();
    let prefilter = format!("prefilter -o {}", tiny.path("out.ktx2").display());
    for (command, lines) in [
        (on(&model, "info"), 40),
        (on(&model, "info --json"), 200),
        (on(&model, "compare"), 10),
        (on(&header, &prefilter), 1),
        (on(&tiny.path("\x1b[2J\u{202e}"), "info"), 1),
        (on(&model, "render --layers \x1b[31m\rrgb"), 1),
    ] {
        let mut command = command;
        let output = command.output().unwrap();
        let text = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
        let forged = |line: &str| {
            line.starts_with("specula: saved") || line.chars().any(|letter| letter.is_control() || letter == '\u{202e}')
        };
        assert!(
            !text.is_empty() && !text.lines().any(forged) && text.lines().count() <= lines,
            "{command:?}: {text:?}"
        );
        if command.get_args().any(|word| word == "--json") {
            let facts: serde_json::Value = serde_json::from_str(&text).unwrap();
            assert!(facts["training"]["profile"].as_str().unwrap().starts_with('\x1b'), "JSON is exact: {text}");
        }
    }
}

#[test]
fn numbers_that_are_finite_and_not_usable_are_refused() {
    let tiny = Tiny::new();
    train(&tiny, "model").args(["--quiet", "--executor", "cpu"]).assert().success();
    let model = tiny.path("model");
    let light = tiny.path("light.exr");
    let map = specula_io::latlong::LatLong { width: 2, height: 1, rgb: vec![1.0; 6] };
    specula_io::latlong::write(&light, &map).unwrap();
    let (file, light) = (tiny.path("lights.toml"), light.display().to_string());
    fs::write(&file, "lamp = [\"1,0,0,1e30\"]").unwrap();
    let (file, suns) = (format!("--lights {}", file.display()), "--sun 1,2 ".repeat(65));
    for (words, part) in [
        ("--sun 30,40,1e30", "lamp 0 has a strength above 1000000000"),
        ("--lamp 1e30,0,0,1", "lamp 0 has"),
        (file.as_str(), "lamp 0 has"),
        (suns.trim(), "more than 64 lamps"),
        (&format!("--env {light} --exposure 200"), "radiance of inf"),
        (&format!("--env {light} --exposure 100"), "above the maximum 1e18"),
    ] {
        let sentence = refusal(on(&model, &format!("relight {words}")));
        assert!(sentence.contains(part), "{words}: {sentence}");
    }
}

/// Room for the program, and not for a picture.
#[cfg(target_os = "linux")]
#[test]
fn want_of_memory_is_a_sentence() {
    let tiny = Tiny::new();
    let model = trained(&tiny, "");
    let program = on(&model, "render --executor cpu --turntable 1 --size 16384,8192 --threads 1");
    let mut limited = Command::new("sh");
    limited.args(["-c", "ulimit -v 2000000; exec \"$0\" \"$@\""]).arg(program.get_program()).args(program.get_args());
    let sentence = refusal(limited);
    assert!(sentence.contains("more than the system grants"), "{sentence}");
}

#[test]
fn paths_that_lead_through_what_is_not_there_are_refused() {
    let tiny = Tiny::new();
    let model = trained(&tiny, "");
    let before = contents(&model);
    let cloud = "point_cloud/iteration_30/point_cloud.ply";
    let name = |path: &str| tiny.path(path).display().to_string();
    let told = refusal(on(&model, &format!("export --no-error -o {}", name(&format!("gone/../model/{cloud}")))));
    assert!(told.contains("gone") && told.contains("does not exist"), "{told}");
    let again = format!("train --profile 3dgs --iterations 5 -s {} -m {}", name("data"), name("gone/../model"));
    let mut command = specula();
    command.arg("--quiet").args(again.split(' '));
    assert!(refusal(command).contains("does not exist"));
    assert!(contents(&model) == before && !tiny.path("gone").exists());
}

#[test]
fn descriptions_of_lights_replace_no_other_file() {
    let tiny = Tiny::new();
    train(&tiny, "model").arg("--quiet").assert().success();
    let model = tiny.path("model");
    let before = contents(&model);
    for file in ["specula.ktx2", "cameras.ktx2"] {
        let told = refusal(on(&model, &format!("export --no-error -o {}", model.join(file).display())));
        assert!(told.contains(&file.replace("ktx2", "json")), "{told}");
        let told = refusal(on(&model, &format!("prefilter --resolution 16 -o {}", model.join(file).display())));
        assert!(told.contains("is another file"), "{told}");
    }
    assert!(contents(&model) == before, "a file of the model was replaced");
    for _ in 0..2 {
        on(&model, &format!("prefilter --resolution 16 -o {}", tiny.path("light.ktx2").display())).assert().success();
    }
}

#[test]
fn a_training_that_diverges_is_not_saved() {
    let tiny = Tiny::new();
    let list = tiny.file("transforms_train.json");
    let mut json: serde_json::Value = serde_json::from_slice(&fs::read(&list).unwrap()).unwrap();
    json["frames"][1]["transform_matrix"][0][3] = 1e20.into();
    fs::write(&list, json.to_string()).unwrap();
    let mut command = train_plain(&tiny, "model");
    command.arg("--quiet");
    let told = refusal(command);
    assert!(told.contains("diverged") && told.contains("poses"), "{told}");
    assert!(!tiny.path("model/point_cloud").exists(), "a model that no command opens was saved");
}
