//! Data sets far from the origin of their world.

use crate::tiny::{Tiny, specula, train_plain};
use serde_json::{Value, json};
use std::fs;

/// Difference of trainings in units of other sizes, in dB.
const SAME_QUALITY: f64 = 0.3;

/// Moves the world of a data set.
fn moved(shift: [f64; 3]) -> Tiny {
    let tiny = Tiny::new();
    for list in ["transforms_train.json", "transforms_test.json"] {
        let mut all: Value = serde_json::from_slice(&fs::read(tiny.file(list)).unwrap()).unwrap();
        for frame in all["frames"].as_array_mut().unwrap() {
            for (axis, shift) in shift.into_iter().enumerate() {
                let coordinate = &mut frame["transform_matrix"][axis][3];
                *coordinate = json!(coordinate.as_f64().unwrap() + shift);
            }
        }
        fs::write(tiny.file(list), all.to_string()).unwrap();
    }
    tiny
}

fn read(tiny: &Tiny, name: &str) -> Value {
    serde_json::from_slice(&fs::read(tiny.path(name)).unwrap()).unwrap()
}

fn quality(tiny: &Tiny) -> f64 {
    train_plain(tiny, "model").arg("--eval").assert().success();
    read(tiny, "model/results.json")["ours_30"]["PSNR"].as_f64().unwrap()
}

#[test]
fn a_scene_in_metres_of_a_map_is_trained_rendered_and_exported_like_a_local_one() {
    let local = quality(&Tiny::new());
    for shift in [[3.0, 0.0, -3.0], [-5e6, 4.5e6, 3e6]] {
        let there = quality(&moved(shift));
        assert!((there - local).abs() < SAME_QUALITY, "{there} dB at {shift:?}, {local} dB");
    }
    let far = moved([448_000.0, 5_411_000.0, 120.0]);
    let there = quality(&far);
    assert!((there - local).abs() < SAME_QUALITY, "{there} dB in UTM, {local} dB");
    let origin = read(&far, "model/specula.json")["origin"].clone();
    assert!((origin[1].as_f64().unwrap() - 5_411_000.0).abs() < 10.0, "{origin}");

    // Cameras of the world show the test views.
    specula().arg("render").arg(far.path("model")).args(["--layers", "rgb"]).assert().success();
    let mut command = specula();
    command.arg("render").arg(far.path("model")).arg("--cameras").arg(far.file("transforms_test.json"));
    command.args(["--layers", "rgb", "-o"]).arg(far.path("path")).assert().success();
    let picture = |name: &str| fs::read(far.path(name)).unwrap();
    assert_eq!(picture("path/rgb/00001.png"), picture("model/test/ours_30/renders/00001.png"));

    let ply = far.path("far.ply");
    let mut command = specula();
    command.arg("export").arg(far.path("model")).args(["--no-error", "-o"]).arg(&ply);
    let said = command.assert().success();
    assert!(String::from_utf8_lossy(&said.get_output().stdout).contains("origin 4480"));
    let info = specula().args(["info", "--json"]).arg(&ply).assert().success();
    let info: Value = serde_json::from_slice(&info.get_output().stdout).unwrap();
    assert_eq!(info["origin"], origin, "the file names it");
}
