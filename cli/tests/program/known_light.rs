//! Trainings under a light that is known.

use crate::tiny::{Tiny, specula, train_relightable};
use serde_json::Value;
use specula_core::cubemap::solid_angles;
use specula_io::latlong::{self, LatLong};
use std::fs;

/// Light that is brighter above than below.
fn write_light(tiny: &Tiny, above: f32) {
    let rgb = (0..3 * 32 * 16).map(|index| if index < 3 * 32 * 8 { above } else { 0.25 * above }).collect();
    latlong::write(&tiny.file("env.hdr"), &LatLong { width: 32, height: 16, rgb }).unwrap();
}

#[test]
fn a_known_light_stays_as_it_is_and_is_not_trained() {
    let tiny = Tiny::new();
    write_light(&tiny, 1.5);
    let known = |name: &str| {
        let mut command = train_relightable(&tiny, name);
        command.args(["--eval", "--executor", "cpu", "--light-reference", "env.hdr"]);
        command.current_dir(tiny.data());
        command
    };
    known("model").assert().success();
    let model = tiny.path("model");
    let report = specula().arg("eval").arg(&model).args(["--json", "--executor", "cpu"]).assert().success();
    let report: Value = serde_json::from_slice(&report.get_output().stdout).unwrap();
    let [scale, correlation] = ["scale", "correlation"].map(|key| report["light"][key].as_f64().unwrap());
    assert!((scale - 1.0).abs() < 0.05 && correlation > 0.99, "the map in texels of a cube: {report}");
    assert!(fs::read_to_string(model.join("config.toml")).unwrap().contains("light-reference = "));

    // Another light makes another training, which does not continue this one.
    let whole = fs::read(model.join("point_cloud/iteration_30/point_cloud.ply")).unwrap();
    known("again").args(["--checkpoint-every", "20"]).assert().success();
    known("again").args(["--checkpoint-every", "20", "--resume"]).assert().success();
    assert!(fs::read(tiny.path("again/point_cloud/iteration_30/point_cloud.ply")).unwrap() == whole, "the same bits");
    // From any folder.
    let mut command = specula();
    command.args(["train", "--resume", "-m", "again"]).current_dir(tiny.path("."));
    command.assert().success();
    write_light(&tiny, 3.0);
    let refused = known("again").args(["--checkpoint-every", "20", "--resume"]).assert().code(2);
    let said = String::from_utf8(refused.get_output().stderr.clone()).unwrap();
    assert!(said.lines().last().unwrap().contains("a light other than"), "{said}");
}

#[test]
fn a_known_light_that_cannot_be_is_refused() {
    let tiny = Tiny::new();
    write_light(&tiny, 1.0);
    let refused = |words: &[&str], path: &str, part: &str| {
        let mut command = specula();
        command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("model"));
        command.args(words).arg("--light-reference").arg(tiny.file(path));
        let said = String::from_utf8(command.assert().code(2).get_output().stderr.clone()).unwrap();
        assert!(said.contains(part), "{part:?}: {said}");
        assert!(!tiny.path("model").join("point_cloud").exists());
    };
    refused(&["--profile", "3dgs"], "env.hdr", "omit --light-reference");
    refused(&["--light", "mlp"], "env.hdr", "--light mlp");
    refused(&[], "no.hdr", "no.hdr");
}

#[test]
fn a_light_of_known_mean_has_it_and_its_shape_is_found() {
    /// Sums of `f32`, and a logarithm of each texel.
    const ROUNDING: f64 = 1e-4;
    let tiny = Tiny::new();
    let known = |name: &str, mean: &str| {
        let mut command = specula();
        command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path(name)).args(["--light-reference", mean]);
        command.args(["--iterations", "200", "--random-points", "200", "--light-resolution", "16"]);
        command.args(["--relightable", "--executor", "cpu", "--checkpoint-every", "150"]);
        command
    };
    known("model", "0.25,0.5,1").assert().success();
    assert!(fs::read_to_string(tiny.path("model/config.toml")).unwrap().contains(r#"light-reference = "0.25,0.5,1""#));
    let light = tiny.path("model/light/iteration_200/environment.exr");
    let (radiance, resolution) = latlong::read_cube_exr(&light).unwrap();
    let mean = mean_of(&radiance, resolution);
    for (mean, wanted) in mean.iter().zip([0.25, 0.5, 1.0]) {
        assert!((mean / wanted - 1.0).abs() < ROUNDING, "{mean:?}");
    }
    let reds = || radiance.iter().step_by(3).copied();
    let [darkest, brightest] = [reds().fold(f32::INFINITY, f32::min), reds().fold(0.0, f32::max)];
    assert!(brightest > 2.0 * darkest, "the shape is trained: {darkest} to {brightest}");

    let whole = fs::read(tiny.path("model/point_cloud/iteration_200/point_cloud.ply")).unwrap();
    known("model", "0.25,0.5,1").arg("--resume").assert().success();
    assert!(fs::read(tiny.path("model/point_cloud/iteration_200/point_cloud.ply")).unwrap() == whole, "the same bits");
    known("model", "0.5").arg("--resume").assert().code(2);
    known("other", "0").assert().code(2);
}

/// Mean of a cube map of this resolution over all directions.
fn mean_of(radiance: &[f32], resolution: usize) -> [f64; 3] {
    let mut sums = [0.0; 4];
    for (rgb, weight) in radiance.chunks(3).zip(solid_angles(resolution)) {
        (0..3).for_each(|k| sums[k] += weight * f64::from(rgb[k]));
        sums[3] += weight;
    }
    [0, 1, 2].map(|k| sums[k] / sums[3])
}
