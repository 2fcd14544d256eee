//! Demo to its end, with few steps.

use crate::tiny::specula;
use std::{fs, path::Path};

/// Steps of each training: the fewest that build a surface, which stands on ground.
const ITERATIONS: &str = "2";

/// Pixels in the lowest tenth of the first frame of an animation that are darker than white: the
/// shadow on the ground below the balls.
fn shadowed_pixels(path: &Path) -> usize {
    let frame = image::open(path).unwrap().into_rgb8();
    let from = 9 * frame.height() / 10;
    frame.enumerate_pixels().filter(|(_, y, pixel)| *y >= from && pixel.0.iter().all(|level| *level < 250)).count()
}

#[test]
fn a_demo_ends_with_a_page_a_scene_for_browsers_and_a_model_to_relight() {
    let root = tempfile::tempdir().unwrap();
    let out = root.path().join("demo");
    let mut demo = specula();
    let output =
        demo.args(["demo", "--iterations", ITERATIONS, "-o"]).arg(&out).assert().success().get_output().clone();
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.contains("3dgs") && said.contains("specula") && said.contains("index.html"), "{said}");

    let page = fs::read_to_string(out.join("index.html")).unwrap();
    for part in ["src=\"turntable.png\"", "class=\"slider\"", "type=\"range\"", "href=\"ball.html\"", "--ground"] {
        assert!(page.contains(part), "{part:?} is not in index.html");
    }
    let sources = page.split("<img src=\"").skip(1).map(|rest| rest.split('"').next().unwrap());
    let missing: Vec<&str> = sources.filter(|source| !out.join(source).is_file()).collect();
    assert!(missing.is_empty(), "{missing:?}");
    assert!(shadowed_pixels(&out.join("turntable.png")) > 100, "the balls stand on ground");
    assert!(fs::metadata(out.join("ball.html")).unwrap().len() > 1 << 20, "a page with its renderer");

    let relit = out.join("relit");
    let words = ["--sun", "30,40", "--turntable", "1", "--size", "16,16", "--executor", "cpu", "--quiet", "-o"];
    specula().arg("relight").arg(out.join("specula")).args(words).arg(&relit).assert().success();
    assert!(relit.join("rgb/00000.png").is_file());
}
