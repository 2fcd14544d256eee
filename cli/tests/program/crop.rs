//! Scenes cropped to their object: a ball below a ceiling.

use crate::{export::Ball, tiny::specula};
use core::f32::consts::{PI, TAU};
use glam::{Quat, Vec3};
use specula_core::{
    camera::Camera,
    scene::{Gaussians, LOG_SCALE, MEAN, OPACITY, QUAT, len_of_values},
};
use specula_io::{cameras, gaussian_ply};
use std::{fs, path::Path};

/// Gaussians along an edge of the ceiling, their distance, and the height of the ceiling above the
/// centre, farther than the cameras.
const EDGE: usize = 20;
const STEP: f32 = 0.5;
const HEIGHT: f32 = 6.0;
/// Cameras, and their distance from the centre.
const CAMERAS: usize = 24;
const DISTANCE: f32 = 4.0;

/// Ball below a ceiling, and the number of Gaussians of the ball.
fn below_a_ceiling() -> (Ball, usize) {
    let light = |_| [0.5; 3];
    let mut ball = Ball::under(light);
    let object = ball.gaussians;
    let (count, layout) = (object.count + EDGE * EDGE, object.layout);
    ball.gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    for index in 0..count {
        let source = index.min(object.count - 1);
        (0..layout.plane_count()).for_each(|plane| ball.gaussians.set(index, plane, object.get::<1>(source, plane)));
        let Some(tile) = index.checked_sub(object.count) else { continue };
        let place = [tile % EDGE, tile / EDGE].map(|k| (k as f32 - 0.5 * (EDGE - 1) as f32) * STEP);
        let down = Quat::from_axis_angle(Vec3::X, PI);
        ball.gaussians.set(index, MEAN, [place[0], place[1], HEIGHT]);
        ball.gaussians.set(index, LOG_SCALE, [STEP.ln(), STEP.ln(), 0.01_f32.ln()]);
        ball.gaussians.set(index, QUAT, [down.w, down.x, down.y, down.z]);
        ball.gaussians.set(index, OPACITY, [6.0]);
    }
    ball.save(&light);
    // Wide views from below the ball and from its height see the ceiling.
    let camera = |k: usize| {
        let (turn, height) = (7.0 * TAU * k as f32 / CAMERAS as f32, [-3.0, -1.0, 1.0][k % 3]);
        let eye = DISTANCE * Vec3::new(turn.cos(), turn.sin(), 0.4 * height).normalize();
        (format!("{k}"), Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 1.4, 96, 96))
    };
    let cameras: Vec<_> = (0..CAMERAS).map(camera).collect();
    cameras::write(&ball.model().join("cameras.json"), &cameras, [0.0; 3]).unwrap();
    (ball, object.count)
}

/// Sum of the levels of the colours in a folder.
fn brightness(folder: &Path) -> u64 {
    let pictures = fs::read_dir(folder.join("rgb")).unwrap().map(|entry| image::open(entry.unwrap().path()).unwrap());
    pictures.map(|picture| picture.into_rgb8().iter().map(|level| u64::from(*level)).sum::<u64>()).sum()
}

#[test]
fn a_scene_without_its_surroundings_is_written_and_shone_on() {
    let (ball, count) = below_a_ceiling();
    let written = |words: &[&str]| {
        let (path, _) = ball.export("scene.ply", &[words, &["--no-error"]].concat());
        gaussian_ply::read(&path).unwrap().gaussians.count
    };
    assert_eq!(written(&[]), count + EDGE * EDGE);
    assert_eq!(written(&["--crop", "auto"]), count);
    assert_eq!(written(&["--crop", "0.5"]), count, "auto is half the distance of the cameras");
    assert_eq!(written(&["--crop", "-0.25,0.25,6,0.6"]), 5, "a tile of the ceiling and its neighbours");

    let relit = |name: &str, words: &[&str]| {
        let out = ball.tiny.path(name);
        let mut relight = specula();
        relight.arg("relight").arg(ball.model()).args(["--sun", "0,90", "--scene-up", "z", "--background", "black"]);
        let output = relight.args(words).args(["--executor", "cpu", "-o"]).arg(&out).assert().success();
        (brightness(&out), String::from_utf8(output.get_output().stderr.clone()).unwrap())
    };
    let (dark, said) = relit("dark", &[]);
    assert!(said.contains("shadows 100 % of the subject") && said.contains("--crop auto"), "{said}");
    let (sunny, said) = relit("sunny", &["--crop", "auto"]);
    assert!(said.contains("2 500 of 2 900 Gaussians") && !said.contains("of the subject"), "{said}");
    let (_, said) = relit("object", &["--crop", "object"]);
    assert!(said.contains("no plane") && said.contains("2 500 of 2 900 Gaussians"), "it stands on nothing: {said}");
    assert!(sunny > 10 * dark, "{sunny} and {dark}");

    let mut render = specula();
    render.arg("render").arg(ball.model()).args(["--crop", "auto", "--layers", "rgb", "--executor", "cpu", "--quiet"]);
    render.assert().success();
    assert!(ball.model().join("test/ours_7_crop-auto/renders/00000.png").is_file(), "it overwrites no other pictures");
}

#[test]
fn regions_that_cannot_be_are_refused_with_a_remedy() {
    let ball = Ball::under(|_| [0.5; 3]);
    let out = ball.tiny.path("out");
    let refused = |command: &str, words: &[&str], part: &str| {
        let mut refused = specula();
        refused.arg(command).arg(ball.model()).args(words);
        if command != "view" {
            refused.arg("-o").arg(if command == "export" { out.with_extension("ply") } else { out.clone() });
        }
        let said = String::from_utf8(refused.assert().code(2).get_output().stderr.clone()).unwrap();
        assert!(said.lines().count() == 1 && said.contains(part), "{said}");
    };
    for wrong in ["all", "some", "0", "-1", "1,2,3", "0,0,0,0", "NaN"] {
        refused("render", &["--crop", wrong], "use auto, object, a share");
    }
    let nowhere = ["--crop", "100,0,0,1"];
    let found = "no Gaussian in --crop 100.0000,0.0000,0.0000,1.0000";
    ["render", "export", "view"].into_iter().for_each(|command| refused(command, &nowhere, found));
    refused("relight", &[&nowhere[..], &["--sun", "30,45"]].concat(), found);
    assert!(!out.exists() && !out.with_extension("ply").exists());
}
