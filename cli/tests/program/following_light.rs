//! Trainings under a light that turns with the camera.

use crate::tiny::{Tiny, specula, train_relightable};
use serde_json::Value;
use std::{fs, path::Path};

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn stderr(command: &mut assert_cmd::Command, code: i32) -> String {
    String::from_utf8(command.assert().code(code).get_output().stderr.clone()).unwrap()
}

#[test]
fn a_turntable_is_trained_resumed_measured_and_rendered_under_the_light_of_each_picture() {
    let tiny = Tiny::new();
    let train = |model: &str, words: &[&str]| {
        let mut train = train_relightable(&tiny, model);
        train.args(["--eval", "--executor", "cpu", "--light-follows", "turntable"]).args(words).assert().success();
        fs::read(tiny.path(model).join("point_cloud/iteration_30/point_cloud.ply")).unwrap()
    };
    let whole = train("model", &[]);
    let model = tiny.path("model");
    assert!(fs::read_to_string(model.join("config.toml")).unwrap().contains("light-follows = \"turntable\""));
    let cameras = json(&model.join("cameras.json"));
    assert!(cameras.as_array().unwrap().iter().all(|camera| camera["light_rotation"].is_array()), "{cameras}");
    assert!(train("ranks", &["--views-per-step", "2", "--ranks", "2"]) == train("one", &["--views-per-step", "2"]));

    // A checkpoint of another light is not continued.
    let mut other = train_relightable(&tiny, "model");
    let said = stderr(other.args(["--eval", "--executor", "cpu", "--resume", "--light-follows", "scene"]), 2);
    assert!(said.contains("--light-follows turntable"), "{said}");
    train("model", &["--resume"]);
    assert!(fs::read(model.join("point_cloud/iteration_30/point_cloud.ply")).unwrap() == whole, "the same bits");

    let trained = json(&model.join("results.json"))["ours_30"]["PSNR"].as_f64().unwrap();
    let report = specula().arg("eval").arg(&model).args(["--json", "--executor", "cpu"]).assert().success();
    let report: Value = serde_json::from_slice(&report.get_output().stdout).unwrap();
    assert!((report["PSNR"].as_f64().unwrap() - trained).abs() < 0.01, "{report} and {trained} dB");

    let rendered = || {
        specula().arg("render").arg(&model).args(["--executor", "cpu"]).assert().success();
        fs::read(model.join("test/ours_30/renders/00001.png")).unwrap()
    };
    let turned = rendered();
    let mut cameras = json(&model.join("cameras.json"));
    for camera in cameras.as_array_mut().unwrap() {
        camera.as_object_mut().unwrap().remove("light_rotation").unwrap();
    }
    fs::write(model.join("cameras.json"), cameras.to_string()).unwrap();
    assert!(rendered() != turned, "pictures are rendered under their own light");
}

#[test]
fn the_light_of_a_training_says_what_it_follows() {
    let tiny = Tiny::new();
    let bits = |follows: &str| {
        let mut train = train_relightable(&tiny, follows);
        train.args(["--executor", "cpu", "--light-follows", follows]).assert().success();
        fs::read(tiny.path(follows).join("point_cloud/iteration_30/point_cloud.ply")).unwrap()
    };
    let [scene, table, camera] = ["scene", "turntable", "camera"].map(bits);
    train_relightable(&tiny, "default").args(["--executor", "cpu"]).assert().success();
    let default = fs::read(tiny.path("default/point_cloud/iteration_30/point_cloud.ply")).unwrap();
    assert!(default == scene && scene != table && scene != camera);
    assert!(!fs::read_to_string(tiny.path("scene/config.toml")).unwrap().contains("light-follows"));
}

#[test]
fn lights_that_cannot_follow_are_refused() {
    let tiny = Tiny::new();
    let train = |words: &[&str], code: i32| {
        let mut train = specula();
        train.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("model")).args(["--iterations", "2"]).args(words);
        stderr(&mut train, code)
    };
    let said = train(&["--profile", "3dgs", "--light-follows", "camera"], 2);
    assert!(said.contains("omit --light-follows"), "{said}");
    assert!(train(&["--light-follows", "sun"], 2).contains("scene, turntable or camera"));
    for picture in 0..8 {
        let picture = tiny.file(&format!("train/r_{picture}.png"));
        image::open(&picture).unwrap().to_rgb8().save(&picture).unwrap();
    }
    let said = train(&["--light-follows", "turntable"], 2);
    assert!(said.contains("masks") && !tiny.path("model").exists(), "{said}");
    assert!(train(&["--light-follows", "camera", "--light-resolution", "16"], 0).contains("lamps on the camera"));
}

/// A quarter turn of the object, for half of the pictures.
fn write_table(tiny: &Tiny, test: usize) -> std::path::PathBuf {
    let line = |split: &str, k: usize| match k < 4 {
        true => format!("{split}/r_{k} first 0\n"),
        false => format!("{split}/r_{k} second 90\n"),
    };
    let lines: String = (0..8).map(|k| line("train", k)).chain((0..test).map(|k| line("test", k))).collect();
    let path = tiny.path("lights.txt");
    fs::write(&path, lines).unwrap();
    path
}

#[test]
fn objects_are_turned_by_a_table() {
    let tiny = Tiny::new();
    let table = write_table(&tiny, 3);
    let train = || {
        let mut train = train_relightable(&tiny, "model");
        train.args(["--eval", "--executor", "cpu", "--overwrite", "--lights-by"]).arg(&table);
        train
    };
    train().assert().success();
    let cameras = json(&tiny.path("model/cameras.json"));
    let turn = |index: usize| cameras[index]["light_rotation"][1][0].as_f64().unwrap();
    // Test views come first.
    assert_eq!([0, 3, 6].map(turn), [0.0; 3]);
    assert!([7, 10].map(turn).iter().all(|sine| (sine - 1.0).abs() < 1e-6), "{cameras}");
    write_table(&tiny, 2);
    let said = stderr(&mut train(), 2);
    assert!(said.contains("r_2") && said.contains("add a line"), "{said}");
    fs::write(&table, "train/r_0 first\n").unwrap();
    let said = stderr(&mut train(), 2);
    assert!(said.contains("line 1") && said.contains("lights.txt"), "{said}");
    assert!(tiny.path("model/point_cloud/iteration_30").is_dir(), "nothing is lost");
}
