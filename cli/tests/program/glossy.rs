//! `scripts/glossy-synthetic.py`, where there is a Python with what it needs.

use crate::python::{has_python, python};
use specula_io::{
    cameras,
    dataset::{self, LoadOptions},
};
use std::{fs, path::Path, process::Output};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../scripts/glossy-synthetic.py");
/// Numbers go through text with seventeen digits, and then to `f32`.
const ROUNDING_PX: f32 = 1e-3;

/// Twelve views of a scene as its authors lay it out, a list of test views, and where a point is
/// seen in each.
const SCENE: &str = r#"
import json, pickle, sys
from pathlib import Path
import numpy as np
from PIL import Image

folder = Path(sys.argv[1])
point, seen = np.array([0.3, -0.2, 0.4]), []
for index in range(12):
    turn, tilt = 0.5 * index, 0.3 + 0.05 * index
    eye = 3 * np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)])
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.hstack([rotation, -(rotation @ eye)[:, None]])
    matrix = np.array([[50.0, 0, 17.5], [0, 55.0, 12], [0, 0, 1]])
    image = np.full((24, 32, 3), 10 * index, np.uint8)
    depth = np.full((24, 32), 65535, np.uint16)
    depth[:, :16] = 65535 // 5
    Image.fromarray(image).save(folder / f"{index}.png")
    Image.fromarray(depth).save(folder / f"{index}-depth.png")
    pickle.dump([pose, matrix], open(folder / f"{index}-camera.pkl", "wb"))
    pixel = matrix @ (pose @ np.append(point, 1))
    seen.append((pixel[:2] / pixel[2]).tolist())
pickle.dump((["3", "10"], [str(k) for k in range(12) if k not in (3, 10)]), open(folder / "split.pkl", "wb"))
class Evil:
    def __reduce__(self):
        return (print, ("opened",))
pickle.dump(Evil(), open(folder / "evil.pkl", "wb"))
json.dump(seen, open(folder / "seen.json", "w"))
"#;

/// Modules that the script imports.
const MODULES: &str = "numpy, PIL";

fn convert(scene: &Path, out: &Path, list: &str) -> Output {
    python().arg(SCRIPT).args([scene, out]).arg("--split").arg(scene.join(list)).output().unwrap()
}

#[test]
fn a_scene_of_glossy_synthetic_becomes_one_of_nerf_synthetic() {
    if !has_python(MODULES) {
        return;
    }
    let root = tempfile::tempdir().unwrap();
    let [scene, out] = ["scene", "out"].map(|name| root.path().join(name));
    fs::create_dir_all(&scene).unwrap();
    assert!(python().args(["-c", SCENE]).arg(&scene).status().unwrap().success());
    let done = convert(&scene, &out, "split.pkl");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));

    let seen: Vec<[f32; 2]> = serde_json::from_slice(&fs::read(scene.join("seen.json")).unwrap()).unwrap();
    for (list, count) in [("transforms_train.json", 10), ("transforms_test.json", 2)] {
        let views = cameras::load_transforms(&out.join(list), [1, 1], [0.0; 3]).unwrap();
        assert_eq!(views.len(), count);
        for (name, camera) in views {
            let index: usize = name.trim_start_matches("r_").parse().unwrap();
            let point = camera.camera_from_world * (glam::Vec3::new(0.3, -0.2, 0.4) - camera.position);
            for axis in 0..2 {
                let pixel = camera.focal_px[axis] * point[axis] / point.z + camera.principal_px[axis];
                assert!((pixel - seen[index][axis]).abs() < ROUNDING_PX, "{name}: {pixel}, not {}", seen[index][axis]);
            }
        }
    }
    let data = dataset::load(&out, &LoadOptions::default(), |_, _| ()).unwrap();
    let names: Vec<&str> = data.test.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["r_3", "r_10"]);
    let row = &data.test[0].image.rgba[..4 * 32];
    assert_eq!((&row[..4], &row[4 * 31..]), (&[30, 30, 30, 255][..], &[30, 30, 30, 0][..]), "nothing is on the right");
}

#[test]
fn a_pickle_that_is_more_than_arrays_is_not_opened() {
    if !has_python(MODULES) {
        return;
    }
    let root = tempfile::tempdir().unwrap();
    let scene = root.path().join("scene");
    fs::create_dir_all(&scene).unwrap();
    assert!(python().args(["-c", SCENE]).arg(&scene).status().unwrap().success());
    let refused = convert(&scene, &root.path().join("out"), "evil.pkl");
    let words = String::from_utf8(refused.stderr).unwrap();
    assert!(!refused.status.success() && words.contains("evil.pkl: it asks for builtins.print"), "{words}");
    assert!(!String::from_utf8(refused.stdout).unwrap().contains("opened"), "nothing of it was run");
}
