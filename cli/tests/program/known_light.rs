//! Trainings under a light that is known.

use crate::tiny::{Tiny, specula, train};
use serde_json::Value;
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
        let mut command = train(&tiny, name);
        command.args(["--relightable", "--eval", "--executor", "cpu", "--light-reference"]).arg(tiny.file("env.hdr"));
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
    write_light(&tiny, 3.0);
    let refused = known("again").args(["--checkpoint-every", "20", "--resume"]).assert().code(2);
    let said = String::from_utf8(refused.get_output().stderr.clone()).unwrap();
    assert!(said.lines().last().unwrap().contains("another light"), "{said}");
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
