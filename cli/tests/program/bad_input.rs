//! Bad input: one sentence with the file in it, exit code 2, and nothing touched.

use crate::tiny::{Tiny, specula, train};
use assert_cmd::Command;
use specula_io::latlong::{self, LatLong};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// The command fails as it should; `words` are in its sentence.
fn refuses(mut command: Command, words: &[&str]) {
    let output = command.assert().code(2).get_output().clone();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(stderr.lines().count(), 1, "one sentence is expected: {stderr}");
    assert!(stderr.starts_with("specula: "), "{stderr}");
    for word in words {
        assert!(stderr.contains(word), "{word:?} is not in: {stderr}");
    }
    assert!(output.stdout.is_empty(), "results were printed of what failed");
}

/// Training on the data set is refused, and no model is made.
fn training_is_refused(tiny: &Tiny, words: &[&str]) {
    refuses(train(tiny, "model"), words);
    assert!(!tiny.path("model").exists(), "a folder was made for a training that did not start");
}

fn edit(path: &Path, edit: impl FnOnce(String) -> String) {
    let text = fs::read_to_string(path).unwrap();
    fs::write(path, edit(text)).unwrap();
}

#[test]
fn a_missing_folder() {
    let tiny = Tiny::new();
    let mut command = specula();
    command.arg("train").arg(tiny.path("nowhere")).arg("-m").arg(tiny.path("model"));
    refuses(command, &["nowhere", "transforms_train.json"]);
    assert!(!tiny.path("model").exists(), "a folder was made for a training that did not start");
}

#[test]
fn a_folder_without_cameras() {
    let tiny = Tiny::new();
    fs::remove_file(tiny.file("transforms_train.json")).unwrap();
    training_is_refused(&tiny, &["no transforms_train.json", "data"]);
}

#[test]
fn a_missing_image() {
    let tiny = Tiny::new();
    fs::remove_file(tiny.file("train/r_3.png")).unwrap();
    training_is_refused(&tiny, &["r_3", "transforms_train.json"]);
}

#[test]
fn broken_json() {
    let tiny = Tiny::new();
    edit(&tiny.file("transforms_train.json"), |text| text.replacen(']', "", 1));
    training_is_refused(&tiny, &["transforms_train.json", "line"]);
}

#[test]
fn an_image_that_is_none() {
    let tiny = Tiny::new();
    fs::write(tiny.file("train/r_2.png"), "this is no picture").unwrap();
    training_is_refused(&tiny, &["r_2.png"]);
}

#[test]
fn an_image_without_pixels() {
    let tiny = Tiny::new();
    let path = tiny.file("train/r_2.png");
    let mut bytes = fs::read(&path).unwrap();
    bytes[16..24].fill(0);
    fs::write(&path, bytes).unwrap();
    training_is_refused(&tiny, &["r_2.png"]);
}

#[test]
fn a_camera_without_focal_length() {
    let tiny = Tiny::new();
    edit(&tiny.file("transforms_train.json"), |text| text.replacen("camera_angle_x", "camera_angle", 1));
    training_is_refused(&tiny, &["focal length", "camera_angle_x", "transforms_train.json"]);
}

#[test]
fn points_that_are_cut_short() {
    let tiny = Tiny::new();
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    fs::write(tiny.file("points3d.ply"), [header.as_bytes(), &[0; 50]].concat()).unwrap();
    training_is_refused(&tiny, &["points3d.ply", "cut short", "4 of 9"]);
}

#[test]
fn measuring_without_test_views() {
    let tiny = Tiny::new();
    fs::remove_file(tiny.file("transforms_test.json")).unwrap();
    let mut command = train(&tiny, "model");
    command.args(["--eval", "--quiet"]);
    refuses(command, &["no test views", "--eval"]);
    assert!(!tiny.path("model").exists(), "a folder was made for a training that did not start");
}

#[test]
fn an_output_folder_that_cannot_be() {
    let tiny = Tiny::new();
    fs::write(tiny.path("file"), "mine").unwrap();
    let mut command = specula();
    command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("file/model")).arg("--quiet");
    refuses(command, &["file/model", "folder"]);
    assert_eq!(fs::read_to_string(tiny.path("file")).unwrap(), "mine");
}

#[test]
fn impossible_settings() {
    let tiny = Tiny::new();
    for (words, expected) in [
        (&["--light-resolution", "100"][..], "power of two"),
        (&["--profile", "3dgs", "--light-per", "pixel"], "--light-per"),
        (&["--resolution", "3"], "1, 2, 4 or 8"),
        (&["--background", "pink"], "black, white"),
        (&["--lambda-normal", "NaN"], "finite"),
        (&["--profile", "other"], "3dgs"),
    ] {
        let mut command = specula();
        command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("model")).args(words);
        refuses(command, &[expected]);
    }
    assert!(!tiny.path("model").exists(), "a folder was made for a training that did not start");
}

#[test]
fn no_command_and_a_wrong_one() {
    refuses(specula_with(&["trian", "data"]), &["trian"]);
    refuses(specula_with(&["train"]), &["--model-path", "see specula train --help"]);
    refuses(
        specula_with(&["train", "data", "-m", "out", "--iteration", "7"]),
        &["--iterations", "see specula train --help"],
    );
    refuses(specula_with(&["--loud"]), &["see specula --help"]);
}

#[test]
fn a_part_of_a_data_set() {
    let tiny = Tiny::new();
    for part in ["train", "sparse/0"] {
        fs::create_dir_all(tiny.file(part)).unwrap();
        let mut command = specula();
        command.arg("train").arg(tiny.file(part)).arg("-m").arg(tiny.path("model"));
        refuses(command, &["part of a data set", "did you mean the folder above", "data"]);
    }
    let mut command = specula();
    command.arg("train").arg(tiny.path(".")).arg("-m").arg(tiny.path("model"));
    refuses(command, &["no data set", "did you mean", "data"]);
    let model = tiny.path("models/one");
    fs::create_dir_all(&model).unwrap();
    fs::write(model.join("specula.json"), "{}").unwrap();
    let mut command = specula();
    command.arg("train").arg(&model).arg("-m").arg(tiny.path("model"));
    refuses(command, &["is a model", "--resume"]);
}

fn specula_with(words: &[&str]) -> Command {
    let mut command = specula();
    command.args(words);
    command
}

/// A file of plain Gaussians: one vertex, all numbers `number`.
fn write_gaussians(path: &Path, number: f32, leave_out: &str) {
    let mut names: Vec<String> = ["x", "y", "z", "opacity"].map(str::to_owned).to_vec();
    for (prefix, count) in [("f_dc", 3), ("scale", 3), ("rot", 4)] {
        names.extend((0..count).map(|k| format!("{prefix}_{k}")));
    }
    names.retain(|name| name != leave_out);
    let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n".to_vec();
    for name in &names {
        bytes.extend(format!("property float {name}\n").into_bytes());
    }
    bytes.extend(b"end_header\n");
    bytes.extend(names.iter().flat_map(|_| number.to_le_bytes()));
    fs::write(path, bytes).unwrap();
}

fn renders(scene: &Path, out: &Path) -> Command {
    let mut command = specula();
    command.arg("render").arg(scene).arg("-o").arg(out).args(["--size", "16,16", "--quiet"]);
    command
}

#[test]
fn gaussians_that_cannot_be_read() {
    let tiny = Tiny::new();
    let (scene, out) = (tiny.path("scene.ply"), tiny.path("out"));

    write_gaussians(&scene, f32::NAN, "");
    refuses(renders(&scene, &out), &["scene.ply", "NaN"]);
    write_gaussians(&scene, 0.5, "scale_1");
    refuses(renders(&scene, &out), &["scene.ply", "scale_1"]);
    write_gaussians(&scene, 0.5, "");
    let whole = fs::read(&scene).unwrap();
    fs::write(&scene, &whole[..whole.len() - 3]).unwrap();
    refuses(renders(&scene, &out), &["scene.ply", "cut short"]);
    fs::write(&scene, "nothing of the kind").unwrap();
    refuses(renders(&scene, &out), &["scene.ply", "PLY"]);
    refuses(renders(&tiny.path("nowhere"), &out), &["nowhere"]);
    refuses(renders(&tiny.data(), &out), &["data", "point_cloud"]);
    assert!(!out.exists(), "a folder was made for pictures that cannot be");

    fs::write(&scene, whole).unwrap();
    renders(&scene, &out).assert().success();
    assert!(out.join("rgb/00000.png").is_file(), "a sound file is rendered");
}

#[test]
fn a_plain_scene_cannot_be_relit() {
    let tiny = Tiny::new();
    let (scene, env) = (tiny.path("scene.ply"), tiny.path("env.exr"));
    write_gaussians(&scene, 0.5, "");
    write_light(&env, 1.0);
    let mut command = specula();
    command.arg("relight").arg(&scene).arg("--env").arg(&env).arg("-o").arg(tiny.path("out"));
    refuses(command, &["plain", "--profile specula"]);
    assert!(!tiny.path("out").exists(), "a folder was made for pictures that cannot be");
}

/// Eight by four pixels of 1, the first of them `first`.
fn write_light(path: &Path, first: f32) {
    let mut rgb = vec![1.0; 3 * 8 * 4];
    rgb[0] = first;
    latlong::write(path, &LatLong { width: 8, height: 4, rgb }).unwrap();
}

fn trained(tiny: &Tiny) -> PathBuf {
    train(tiny, "model").arg("--quiet").assert().success();
    tiny.path("model")
}

#[test]
fn light_that_is_no_radiance_is_cleaned_and_counted() {
    let tiny = Tiny::new();
    let (model, env) = (trained(&tiny), tiny.path("env.exr"));
    for (number, word) in [(f32::INFINITY, "1 infinite"), (f32::NAN, "1 NaN"), (-1.0, "1 negative")] {
        write_light(&env, number);
        let mut command = specula();
        command.arg("relight").arg(&model).arg("--env").arg(&env).arg("-o").arg(tiny.path("out"));
        let output = command.assert().success().get_output().clone();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(stderr.contains(word) && stderr.contains("env.exr"), "{stderr}");
    }
    let collage = tiny.path("collage.png");
    image::RgbImage::from_pixel(8, 6, image::Rgb([90, 120, 200])).save(&collage).unwrap();
    let mut command = specula();
    command.arg("relight").arg(&model).arg("--env").arg(&collage).arg("-o").arg(tiny.path("out"));
    let stderr = String::from_utf8(command.assert().success().get_output().stderr.clone()).unwrap();
    assert!(stderr.contains("no radiance above 1") && stderr.contains("8 × 6 pixels"), "{stderr}");
    let mut command = specula();
    command.arg("relight").arg(&model).arg("--env").arg(tiny.path("night.hdr")).arg("-o").arg(tiny.path("night"));
    refuses(command, &["night.hdr"]);
    assert!(!tiny.path("night").exists(), "a folder was made for pictures that cannot be");
}

#[test]
fn pictures_of_different_sizes_are_fine() {
    let tiny = Tiny::new();
    let path = tiny.file("train/r_0.png");
    let picture = image::open(&path).unwrap();
    picture.resize_exact(20, 12, image::imageops::FilterType::Triangle).save(&path).unwrap();
    trained(&tiny);
}

#[test]
fn an_executor_that_there_is_not() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let mut command = renders(&model, &tiny.path("out"));
    // Where there is no such folder, Mesa says so.
    command.args(["--executor", "gpu:abacus"]).env("XDG_RUNTIME_DIR", tiny.path("."));
    refuses(command, &["abacus", "adapter", "--executor cpu"]);
    // Before anything is read.
    let mut command = specula();
    command.arg("train").arg(tiny.path("nowhere")).arg("-m").arg(tiny.path("other"));
    command.args(["--executor", "gpu:abacus"]).env("XDG_RUNTIME_DIR", tiny.path("."));
    refuses(command, &["abacus", "--executor cpu"]);
    let mut command = renders(&model, &tiny.path("out"));
    command.args(["--executor", "cuda"]);
    refuses(command, &["--executor", "auto, cpu, gpu"]);
}
