//! The library beside the program: the same pictures, to the last bit.

use crate::tiny::{SIZE, Tiny, specula};
use assert_cmd::assert::Assert;
use image::RgbImage;
use serde_json::Value;
use specula_core::{executor::BufferLength, rules::Channels};
use specula_cpu::{CpuError, CpuExecutor};
use specula_scene::OpenedModel;
use std::{fs, path::Path};

/// Short training on the CPU with held-out views, whose light any profile can filter.
fn trained(tiny: &Tiny, model: &str, iterations: u32, words: &[&str]) -> Assert {
    let mut command = specula();
    command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path(model)).args(["--eval", "--executor", "cpu"]);
    command.args(["--iterations", &iterations.to_string(), "--random-points", "200"]).args(words).assert()
}

#[test]
fn a_model_opened_by_the_library_is_drawn_as_the_program_draws_it() {
    let tiny = Tiny::new();
    for profile in ["specula", "paper", "official", "3dgs"] {
        let folder = tiny.path(profile);
        trained(&tiny, profile, 30, &["--profile", profile]).success();
        specula().arg("render").arg(&folder).args(["--executor", "cpu"]).assert().success();

        let model = OpenedModel::open(&folder).unwrap();
        let mut renderer = model.scene.renderer(CpuExecutor::new(), Channels::Color).unwrap();
        let cameras = model.test_cameras().unwrap();
        assert_eq!(cameras.len(), 3, "the held-out views of {profile}");
        for (index, (_, camera)) in cameras.iter().enumerate() {
            let own = renderer.picture(camera, model.background()).unwrap();
            let path = folder.join(format!("test/ours_30/renders/{index:05}.png"));
            let written = image::open(&path).unwrap().to_rgb8();
            assert!(own.as_raw() == written.as_raw(), "view {index} of {profile} differs");
            assert!(own.pixels().any(|pixel| pixel != own.get_pixel(0, 0)), "{profile} shows something");
        }
    }
}

#[test]
fn a_training_is_not_hidden_by_another_in_its_folder() {
    let tiny = Tiny::new();
    let model = tiny.path("model");
    trained(&tiny, "model", 30, &[]).success();
    specula().arg("render").arg(&model).assert().success();
    let before = fs::read(model.join("results.json")).unwrap();
    let refusal = trained(&tiny, "model", 20, &["--profile", "3dgs"]).code(2).get_output().stderr.clone();
    let refusal = String::from_utf8(refusal).unwrap();
    assert!(refusal.contains("a model of 30 iterations with profile specula"), "{refusal}");
    assert!(["--resume", "--overwrite", "-m"].iter().all(|remedy| refusal.contains(remedy)), "{refusal}");
    assert_eq!(fs::read(model.join("results.json")).unwrap(), before, "a refusal changes nothing");

    trained(&tiny, "model", 20, &["--profile", "3dgs", "--overwrite"]).success();
    let info = specula().arg("info").arg(&model).arg("--json").output().unwrap();
    let info: Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!([&info["iteration"], &info["training"]["profile"]], [&Value::from(20), &Value::from("3dgs")], "{info}");
    let results: Value = serde_json::from_slice(&fs::read(model.join("results.json")).unwrap()).unwrap();
    let methods: Vec<&String> = results.as_object().unwrap().keys().collect();
    assert_eq!(methods, ["ours_20"], "results of the model before are gone");
    assert!(!model.join("test/ours_30").exists(), "and its pictures");
}

/// Pixels of the middle of a picture, as wide as another.
fn middle(path: &Path, width: u32) -> RgbImage {
    let picture = image::open(path).unwrap().to_rgb8();
    let left = (picture.width() - width) / 2;
    image::imageops::crop_imm(&picture, left, 0, width, picture.height()).to_image()
}

#[test]
fn a_picture_of_another_shape_is_not_stretched_and_lies_in_a_folder_of_its_own() {
    let tiny = Tiny::new();
    trained(&tiny, "model", 30, &[]).success();
    let model = tiny.path("model");
    specula().arg("render").arg(&model).assert().success();
    let default = model.join("test/ours_30/renders/00000.png");
    let before = fs::read(&default).unwrap();
    specula().arg("render").arg(&model).args(["--size", "64,32"]).assert().success();
    assert_eq!(fs::read(&default).unwrap(), before, "pictures beside the ground truth keep its size");
    let wide = model.join("test/ours_30_64x32/renders/00000.png");
    let [default, wide] = [&default, &wide].map(|path| middle(path, SIZE));
    let difference = default.iter().zip(wide.iter()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(difference <= Some(1), "the same view with more beside it: {difference:?} levels of difference");
    assert!(!model.join("test/ours_30_64x32/gt").exists(), "there is no ground truth of that size");
}

#[test]
fn a_buffer_that_is_too_short_for_a_frame_is_refused() {
    use specula_core::{executor::Renderer, pipeline::render};
    let tiny = Tiny::new();
    trained(&tiny, "model", 3, &[]).success();
    let model = OpenedModel::open(&tiny.path("model")).unwrap();
    let mut exec = CpuExecutor::new();
    let gaussians = exec.upload_gaussians(&model.scene.gaussians).unwrap();
    let (_, camera) = model.cameras().unwrap().remove(0);
    let rules = model.scene.plan(Channels::Color).full;
    let frame = render(&mut exec, &gaussians, None, &camera, &rules).unwrap();
    // Colour and transmittance, as was asked for; but light per pixel blends normals, tint and
    // roughness as well.
    let pixels = (camera.width * camera.height) as usize;
    let [found, expected] = [4, rules.blended(model.scene.gaussians.layout).count() + 1].map(|planes| planes * pixels);
    let refusal = exec.read_frame(&frame, &mut vec![0.0; found]);
    assert_eq!(refusal, Err(CpuError::BufferLength(BufferLength { expected, found })));
}
