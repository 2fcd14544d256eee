//! Models whose reflected rays meet the scene itself, through the commands that read them.

use crate::tiny::{Tiny, specula, train};
use serde_json::Value;
use specula_core::near_field::NearField;
use specula_io::{
    latlong::{self, LatLong},
    model_folder::{self, Snapshot, near_field_at},
};
use std::{
    fs,
    path::{Path, PathBuf},
};

fn printed(command: &mut assert_cmd::Command) -> String {
    String::from_utf8(command.assert().success().get_output().stdout.clone()).unwrap()
}

fn refusal(command: &mut assert_cmd::Command) -> String {
    let output = command.assert().code(2).get_output().clone();
    String::from_utf8(output.stderr).unwrap()
}

/// Bright triangle that is larger than the scene, to the left of it.
fn wall() -> NearField<Vec<f32>> {
    let corners = [[-1.5, -9.0, -9.0], [-1.5, 20.0, -9.0], [-1.5, -9.0, 20.0]];
    let node = [-1.5, -9.0, -9.0, 0.0, -1.5, 20.0, 20.0, 1.0];
    let surface = [1.0, 0.0, 0.0, 3.0, 0.1, 0.1, 0.2, 0.2, 0.2, 0.5, 0.0, 0.0, 0.0];
    let vertices = corners.into_iter().flat_map(|corner| corner.into_iter().chain(surface));
    NearField::of_sizes([1, 1, 3], 0.01, node.into_iter().chain([0.0, 1.0, 2.0, 0.0]).chain(vertices).collect())
}

/// Model of a short training, beside a wall.
fn model_beside_a_wall(tiny: &Tiny) -> PathBuf {
    let mut training = train(tiny, "model");
    training.args(["--eval", "--executor", "cpu", "--reflections", "near"]);
    let said = String::from_utf8(training.assert().success().get_output().stderr.clone()).unwrap();
    let folder = tiny.path("model");
    let is_far = said.contains("no reflected ray hits the scene");
    assert_eq!(near_field_at(&folder, 30).is_file(), !is_far, "a model says what it does without: {said}");
    let model = model_folder::open(&folder).unwrap();
    let (info, wall) = (model.info.unwrap(), wall());
    wall.check().unwrap();
    let (comments, light) = (&model.comments, model.light.as_ref());
    let snapshot = Snapshot {
        gaussians: &model.gaussians,
        comments,
        light,
        other_lights: &[],
        near_field: Some(&wall),
        info: &info,
    };
    model_folder::save(&folder, 30, &snapshot).unwrap();
    folder
}

fn picture(model: &Path, words: &[&str]) -> Vec<u8> {
    printed(specula().arg("render").arg(model).args(["--executor", "cpu"]).args(words));
    fs::read(model.join("test/ours_30/renders/00000.png")).unwrap()
}

#[test]
fn every_command_sees_the_near_field_of_a_model() {
    let tiny = Tiny::new();
    let model = model_beside_a_wall(&tiny);
    assert!(fs::read_to_string(model.join("config.toml")).unwrap().contains("reflections = \"near\""));
    let wall = near_field_at(&model, 30);
    assert!(wall.is_file());

    let psnr = |model: &Path| {
        let said = printed(specula().arg("eval").arg(model).args(["--json", "--executor", "cpu"]));
        serde_json::from_str::<Value>(&said).unwrap()["PSNR"].as_f64().unwrap()
    };
    let sky = tiny.path("sky.hdr");
    latlong::write(&sky, &LatLong { width: 8, height: 4, rgb: vec![0.7; 96] }).unwrap();
    let relit = |model: &Path| {
        printed(specula().arg("relight").arg(model).arg("--env").arg(&sky).args(["--executor", "cpu"]));
        fs::read(model.join("relight/sky/ours_30/renders/00000.png")).unwrap()
    };
    let beside_it = (psnr(&model), relit(&model), picture(&model, &[]));
    assert_eq!(picture(&model, &["--verify-omissions"]), beside_it.2, "a plan changes nothing");
    let within = picture(&model, &["--max-error", "0.01"]);
    let exported = |name: &str| {
        let path = tiny.path(name);
        printed(specula().arg("export").arg(&model).arg("-o").arg(&path));
        fs::read(path).unwrap()
    };
    let baked = exported("one.ply");
    let info: Value = serde_json::from_str(&printed(specula().arg("info").arg(&model).arg("--json"))).unwrap();
    assert_eq!(info["near_field"]["triangles"], 1, "{info}");

    fs::remove_file(&wall).unwrap();
    let without = (psnr(&model), relit(&model), picture(&model, &[]));
    assert!(beside_it.0 != without.0 && beside_it.1 != without.1 && beside_it.2 != without.2);
    assert!(within != picture(&model, &["--max-error", "0.01"]), "certified pictures have it as well");
    assert!(baked != exported("two.ply"), "so have exported ones");
}

#[test]
fn rays_that_are_not_reflected_pixel_by_pixel_are_refused() {
    let tiny = Tiny::new();
    for (words, said) in [
        (&["--profile", "3dgs"][..], "--profile specula"),
        (&["--profile", "paper"], "--light-per pixel"),
        (&["--light-per", "gaussian"], "--light-per pixel"),
    ] {
        let mut command = specula();
        command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("model")).args(["--reflections", "near"]);
        let sentence = refusal(command.args(words));
        assert!(sentence.contains(said), "{said:?} is not in: {sentence}");
        assert!(!tiny.path("model").exists(), "nothing was written");
    }
}
