//! `specula train --manifest`: many trainings in one file.

use crate::tiny::{Tiny, specula};
use std::{fs, path::Path};

const SHARED: &str = "iterations = 20\nrandom-points = 100\nlight-resolution = 16\nexecutor = \"cpu\"\n";

/// Manifest of two trainings on the tiny data set, and of a third in a folder without data.
fn write(tiny: &Tiny, with_fault: bool) {
    let data = |folder: &str, model: &str, more: &str| {
        format!("[[training]]\nsource-path = \"{folder}\"\nmodel-path = \"out/{model}\"\n{more}")
    };
    let fault = if with_fault { data("nothing", "none", "") } else { String::new() };
    let text = [SHARED, &data("data", "a", "eval = true\n"), &fault, &data("data", "b", "seed = 3\n")].concat();
    fs::write(tiny.path("scenes.toml"), text).unwrap();
}

fn manifest(tiny: &Tiny, more: &[&str]) -> assert_cmd::Command {
    let mut command = specula();
    command.args(["train", "--manifest"]).arg(tiny.path("scenes.toml")).args(more);
    command
}

fn said(command: &mut assert_cmd::Command, code: i32) -> [String; 2] {
    let output = command.assert().code(code).get_output().clone();
    [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap())
}

fn model(folder: &Path) -> Vec<u8> {
    fs::read(folder.join("point_cloud/iteration_20/point_cloud.ply")).unwrap()
}

#[test]
fn trainings_of_a_manifest_are_those_of_their_own_commands() {
    let tiny = Tiny::new();
    write(&tiny, false);
    let [commands, _] = said(&mut manifest(&tiny, &["--list"]), 0);
    assert_eq!(commands.lines().count(), 2, "{commands}");
    assert!(!tiny.path("out").exists(), "a list trains nothing");

    let [_, notes] = said(&mut manifest(&tiny, &[]), 0);
    assert!(notes.contains("[1/2]") && notes.contains("[2/2]") && notes.contains("specula compare"), "{notes}");
    assert!(tiny.path("out/a/results.json").is_file() && !tiny.path("out/b/results.json").exists());
    for (line, name) in commands.lines().zip(["a", "b"]) {
        let words = line.split(' ').skip(1).filter(|word| !word.starts_with("--model-path"));
        specula().args(words).arg("-m").arg(tiny.path(name)).assert().success();
        assert!(model(&tiny.path(name)) == model(&tiny.path("out").join(name)), "{name} is another model");
    }

    let before = model(&tiny.path("out/a"));
    let [_, notes] = said(&mut manifest(&tiny, &[]), 0);
    assert_eq!(notes.matches("finished before").count(), 2, "{notes}");
    let [_, notes] = said(&mut manifest(&tiny, &["--lambda-normal", "0.5", "--task", "1"]), 2);
    assert!(notes.contains("contains a training with") && notes.contains("--overwrite"), "{notes}");
    assert!(model(&tiny.path("out/a")) == before, "a training with other settings takes no one's place");
    said(&mut manifest(&tiny, &["--lambda-normal", "0.5", "--task", "1", "--overwrite"]), 0);
    assert!(model(&tiny.path("out/a")) != before, "it does where it is told to");
}

#[test]
fn a_task_is_trained_alone_and_continues() {
    let tiny = Tiny::new();
    write(&tiny, false);
    said(&mut manifest(&tiny, &["--task", "2", "--iterations", "10"]), 0);
    assert!(!tiny.path("out/a").exists(), "the other one is for another machine");
    let [_, notes] = said(&mut manifest(&tiny, &["--task=2"]), 0);
    assert!(notes.contains("continuing from iteration 10 of 20"), "{notes}");
    assert!(!model(&tiny.path("out/b")).is_empty());
}

#[test]
fn a_training_that_fails_does_not_end_the_others() {
    let tiny = Tiny::new();
    write(&tiny, true);
    let [_, notes] = said(&mut manifest(&tiny, &[]), 2);
    assert!(notes.contains("1 of 3 trainings failed") && notes.contains("nothing"), "{notes}");
    assert!(!model(&tiny.path("out/a")).is_empty() && !model(&tiny.path("out/b")).is_empty());
    let [_, notes] = said(&mut manifest(&tiny, &["--task", "4"]), 2);
    assert!(notes.contains("trainings 1 to 3"), "{notes}");
    specula().args(["train", "--task", "1"]).arg(tiny.data()).arg("-m").arg(tiny.path("c")).assert().code(2);
    manifest(&tiny, &["-m", "out"]).assert().code(2);
}

#[test]
fn a_finished_model_of_another_data_set_is_not_taken_for_the_one_asked_for() {
    let tiny = Tiny::new();
    let other = Tiny::new();
    write(&tiny, false);
    said(&mut manifest(&tiny, &["--task", "1"]), 0);
    let path = tiny.path("scenes.toml");
    let elsewhere = format!("source-path = {:?}", other.data());
    fs::write(&path, fs::read_to_string(&path).unwrap().replacen("source-path = \"data\"", &elsewhere, 1)).unwrap();
    let before = model(&tiny.path("out/a"));
    let [_, notes] = said(&mut manifest(&tiny, &["--task", "1"]), 2);
    assert!(notes.contains("another data set") && notes.contains("--overwrite"), "{notes}");
    assert!(model(&tiny.path("out/a")) == before);

    // A data set that was moved is still the same.
    fs::write(&path, fs::read_to_string(&path).unwrap().replacen(&elsewhere, "source-path = \"moved\"", 1)).unwrap();
    fs::rename(tiny.data(), tiny.path("moved")).unwrap();
    let [_, notes] = said(&mut manifest(&tiny, &["--task", "1"]), 0);
    assert!(notes.contains("finished before"), "{notes}");
}
