//! Data sets far from the origin of their world.

use glam::{DVec3, Vec3};
use serde_json::{Value, json};
use specula_core::camera::Camera;
use specula_io::{
    cameras,
    dataset::{self, Dataset, LoadOptions},
    points_ply::{self, PointCloud},
};
use std::{fs, path::Path};
use tempfile::TempDir;

/// Largest error of a position that went through decimal digits and an `f32`, in the units of a
/// scene of a few units.
const ROUNDING: f32 = 1e-6;
/// Metres of UTM.
const FAR: [f64; 3] = [448_123.25, 5_411_067.75, 120.5];

/// Positions of cameras around a place.
fn eyes() -> impl Iterator<Item = DVec3> {
    (0..6).map(|k| 4.0 * DVec3::new(f64::from(k).cos(), f64::from(k).sin(), 0.3))
}

fn frames(shift: DVec3) -> Vec<Value> {
    let frame = |(k, eye): (usize, DVec3)| {
        let DVec3 { x, y, z } = eye + shift;
        let matrix = [[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]];
        json!({"file_path": format!("images/{k}.png"), "transform_matrix": matrix})
    };
    eyes().enumerate().map(frame).collect()
}

/// Data set of nerfstudio with three points in doubles, both moved by `shift`.
fn nerfstudio(shift: DVec3) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("images")).unwrap();
    for k in 0..6 {
        image::RgbImage::new(8, 6).save(folder.path().join(format!("images/{k}.png"))).unwrap();
    }
    let list = json!({"fl_x": 10.0, "ply_file_path": "points.ply", "frames": frames(shift)});
    fs::write(folder.path().join("transforms.json"), list.to_string()).unwrap();
    let points = [DVec3::ZERO, DVec3::X, DVec3::new(0.0, 0.25, -0.5)].map(|point| point + shift);
    let rows = points.map(|DVec3 { x, y, z }| format!("{x} {y} {z}\n")).concat();
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n";
    fs::write(folder.path().join("points.ply"), format!("{header}end_header\n{rows}")).unwrap();
    folder
}

fn load(folder: &Path, origin: Option<[f64; 3]>) -> Dataset {
    dataset::load(folder, &LoadOptions { test_every: 0, origin, ..LoadOptions::default() }, |_, _| {}).unwrap()
}

/// Positions of cameras, then of points.
fn positions(data: &Dataset) -> Vec<Vec3> {
    let points = data.points.iter().flat_map(|points| &points.positions);
    let points = points.map(|point| DVec3::from(*point).as_vec3());
    data.train.iter().map(|view| view.camera.position).chain(points).collect()
}

#[test]
fn cameras_and_points_far_away_are_those_of_a_local_data_set() {
    let local = load(nerfstudio(DVec3::ZERO).path(), None);
    assert_eq!(local.origin, [0.0; 3]);
    for shift in [DVec3::from(FAR), DVec3::splat(1e4), DVec3::new(-5e6, 4.5e6, 3e6)] {
        let far = load(nerfstudio(shift).path(), None);
        assert_ne!(far.origin, [0.0; 3], "{shift}");
        assert!(far.notes.iter().any(|note| note.contains("origin")), "{:?}", far.notes);
        let moved = (shift - DVec3::from(far.origin)).as_vec3();
        for (here, there) in positions(&local).into_iter().zip(positions(&far)) {
            assert!((here + moved).distance(there) < ROUNDING, "{shift}: {here} and {there}");
        }
    }
    let near = load(nerfstudio(DVec3::splat(3.0)).path(), None);
    assert_eq!(near.origin, [0.0; 3], "three units are not far");
}

#[test]
fn a_data_set_is_read_relative_to_the_origin_of_a_model() {
    let folder = nerfstudio(DVec3::from(FAR));
    let own = load(folder.path(), None);
    let other = load(folder.path(), Some([448_000.0, 5_411_000.0, 100.0]));
    let moved = (DVec3::from(own.origin) - DVec3::from(other.origin)).as_vec3();
    for (one, two) in positions(&own).into_iter().zip(positions(&other)) {
        assert!((one + moved).distance(two) < 1e-5, "{one} and {two}");
    }
}

#[test]
fn lists_of_cameras_name_their_origin() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.json");
    let camera = Camera::look_at(Vec3::new(4.0, 0.5, 0.0), Vec3::ZERO, Vec3::Z, 0.7, 10, 10);
    cameras::write(&path, &[("a".to_owned(), camera)], FAR).unwrap();
    assert_eq!(cameras::read(&path).unwrap()[0].1, camera, "relative to the origin of the file");
    let position = |origin: [f64; 3]| cameras::read_cameras(&path, [1, 1], origin).unwrap()[0].1.position;
    assert_eq!(position(FAR), camera.position, "of a model with the same origin");
    let nearby = [FAR[0] - 1.0, FAR[1], FAR[2]];
    assert!(position(nearby).distance(camera.position + Vec3::X) < ROUNDING, "of a model with another one");

    let list = json!({"w": 10, "h": 10, "fl_x": 10.0, "origin": [1.0, 2.0, 3.0], "frames": frames(DVec3::ZERO)});
    let path = folder.path().join("path.json");
    fs::write(&path, list.to_string()).unwrap();
    let position_in_path = |origin: [f64; 3]| cameras::read_cameras(&path, [1, 1], origin).unwrap()[0].1.position;
    let moved = position_in_path([0.0; 3]) - Vec3::new(1.0, 2.0, 3.0);
    assert!(position_in_path([1.0, 2.0, 3.0]).distance(moved) < ROUNDING);
}

#[test]
fn points_without_digits_are_noted() {
    let folder = nerfstudio(DVec3::ZERO);
    let path = folder.path().join("single.ply");
    let noted = |shift: f64| {
        let positions = vec![[shift, 0.0, 0.0], [shift + 1.0, 0.0, 1.0]];
        points_ply::write(&path, &PointCloud { positions, colors: vec![[0.5; 3]; 2] }).unwrap();
        let options = LoadOptions { points: Some(path.clone()), ..LoadOptions::default() };
        let data = dataset::load(folder.path(), &options, |_, _| {}).unwrap();
        data.notes.iter().any(|note| note.contains("32-bit"))
    };
    assert!(!noted(0.0) && !noted(100.0));
    assert!(noted(448_000.0) && noted(5e6));
}
