//! Cameras of Metashape, against the same ones in COLMAP's format.

use crate::photographs::{HEIGHT, Scene, WIDTH, assert_says, picture};
use core::fmt::Write;
use glam::{DMat3, DVec3};
use specula_io::{
    Result,
    dataset::{self, Dataset, LoadOptions},
};
use std::{fs, path::Path};

/// Transform of the chunk to the world.
const SCALE: f64 = 2.0;
const SHIFT: DVec3 = DVec3::new(1.0, -2.0, 3.0);

fn turn() -> DMat3 {
    DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(-0.4)
}

fn load(folder: &Path) -> Result<Dataset> {
    dataset::load(folder, &LoadOptions { test_every: 0, ..LoadOptions::default() }, |_, _| {})
}

/// Three pictures through a lens of OpenCV's model.
fn colmap() -> Dataset {
    let lens = vec![21.5, 21.0, 12.5, 7.5, 0.05, -0.02, 0.001, -0.002];
    let scene = Scene { cameras: vec![(4, "OPENCV", lens)], ..Scene::pinhole() };
    load(scene.folder().path()).unwrap()
}

fn row_major(matrix: DMat3) -> String {
    matrix.transpose().to_cols_array().map(|number| number.to_string()).join(" ")
}

/// File of the same cameras, with `more` for the lens and `of_chunk` after the cameras.
fn document(data: &Dataset, lens: &str, transform: &str) -> String {
    let mut cameras = String::new();
    for (k, view) in data.train.iter().enumerate() {
        let world_from_camera = view.camera.camera_from_world.as_dmat3().transpose();
        let local = turn().transpose() * world_from_camera;
        let at = turn().transpose() * (view.camera.position.as_dvec3() - SHIFT) / SCALE;
        let row = |r: usize| format!("{} {} {} {}", local.row(r).x, local.row(r).y, local.row(r).z, at[r]);
        let (name, rows) = (&view.name, [row(0), row(1), row(2)].join(" "));
        writeln!(
            cameras,
            "<camera id=\"{k}\" sensor_id=\"3\" component_id=\"0\" label=\"{name}.png\">\
             <transform>{rows} 0 0 0 1</transform></camera>"
        )
        .unwrap();
    }
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document version=\"2.0.0\">\n  <chunk label=\"Chunk 1\">\n\
         <sensors><sensor id=\"3\" label=\"unknown\" type=\"frame\"><resolution width=\"{WIDTH}\" height=\"{HEIGHT}\"/>\
         <calibration type=\"frame\" class=\"initial\"><f>9</f></calibration>\
         <calibration type=\"frame\" class=\"adjusted\"><resolution width=\"{WIDTH}\" height=\"{HEIGHT}\"/>{lens}\
         </calibration></sensor></sensors>\n{transform}\n\
         <cameras><group id=\"0\" label=\"Group 1\">{cameras}</group>\
         <camera id=\"7\" sensor_id=\"3\" label=\"lost\"/></cameras></chunk>\n</document>\n"
    )
}

const LENS: &str =
    "<f>21</f><cx>0.5</cx><cy>-0.5</cy><b1>0.5</b1><k1>0.05</k1><k2>-0.02</k2><p1>-0.002</p1><p2>0.001</p2>";

fn component() -> String {
    let [x, y, z] = SHIFT.to_array();
    format!(
        "<components><component id=\"0\"><transform><rotation locked=\"false\">{}</rotation>\
         <translation locked=\"false\">{x} {y} {z}</translation><scale locked=\"false\">{SCALE}</scale></transform>\
         </component></components>",
        row_major(turn())
    )
}

fn folder(document: &str, images: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir_all(folder.path().join(images)).unwrap();
    for name in ["a", "b", "c"] {
        picture().save(folder.path().join(images).join(name).with_extension("png")).unwrap();
    }
    fs::write(folder.path().join("cameras.xml"), document).unwrap();
    folder
}

#[test]
fn cameras_and_lenses_are_those_of_colmap() {
    let expected = colmap();
    for images in ["images", ""] {
        let found = load(folder(&document(&expected, LENS, &component()), images).path()).unwrap();
        assert_eq!(found.train.len(), 3);
        for (found, expected) in found.train.iter().zip(&expected.train) {
            assert_eq!((&found.name, &found.image), (&expected.name, &expected.image), "the same pictures undistorted");
            let (a, b) = (found.camera, expected.camera);
            assert_eq!((a.focal_px, a.principal_px), (b.focal_px, b.principal_px));
            assert!(a.camera_from_world.abs_diff_eq(b.camera_from_world, 1e-6));
            assert!(a.position.abs_diff_eq(b.position, 1e-5), "{} and {}", a.position, b.position);
        }
        assert!(found.report.source.contains("Metashape"), "{}", found.report.source);
        assert_says(&found.notes.concat(), &["skipped 1 cameras that are not aligned", "lost"]);
    }
}

#[test]
fn fisheyes_and_chunks_without_components_are_read() {
    let expected = {
        let lens = vec![21.0, 21.0, 12.0, 8.0, 0.05, -0.02, 0.01, 0.0];
        load(Scene { cameras: vec![(5, "OPENCV_FISHEYE", lens)], ..Scene::pinhole() }.folder().path()).unwrap()
    };
    let lens = "<f>21</f><k1>0.05</k1><k2>-0.02</k2><k3>0.01</k3>";
    let chunk = component().replace("<components><component id=\"0\">", "").replace("</component></components>", "");
    let text = document(&expected, lens, &chunk)
        .replace("type=\"frame\" class=\"adjusted\"", "type=\"fisheye\" class=\"adjusted\"");
    let found = load(folder(&text, "images").path()).unwrap();
    assert_eq!(found.train[1].image, expected.train[1].image);
    assert!(found.train[1].camera.position.abs_diff_eq(expected.train[1].camera.position, 1e-5));
}

#[test]
fn what_is_not_read_is_refused_with_a_remedy() {
    let data = colmap();
    let good = document(&data, LENS, &component());
    let refusal = |text: &str| load(folder(text, "images").path()).unwrap_err().to_string();
    assert_says(&refusal(&good[..good.len() - 12]), &["cameras.xml", "not XML", "export the cameras again"]);
    assert_says(&refusal(&good.replace("<k1>", "<k4>1</k4><k1>")), &["camera \"a.png\"", "k4"]);
    assert_says(&refusal(&good.replace("<f>21</f>", "")), &["focal"]);
    assert_says(
        &refusal(&good.replace("type=\"frame\" class=\"adjusted\"", "type=\"spherical\" class=\"adjusted\"")),
        &["spherical", "Convert Images"],
    );
    assert_says(&refusal(&good.replace("sensor_id=\"3\"", "sensor_id=\"4\"")), &["sensor 4"]);
    assert_says(&refusal(&good.replace("<transform>", "<transform>7 ")), &["no rotation with a position"]);
    assert_says(&refusal(&good.replace("component_id", "enabled=\"false\" component_id")), &["no aligned camera"]);
}
