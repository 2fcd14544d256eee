//! Suns, lamps and grounds of `relight`.

use crate::tiny::{Tiny, specula, train, train_relightable};
use std::fs;

fn printed(command: &mut assert_cmd::Command) -> String {
    String::from_utf8(command.assert().success().get_output().stdout.clone()).unwrap()
}

fn refuses(mut command: assert_cmd::Command, parts: &[&str]) {
    let stderr = String::from_utf8(command.assert().code(2).get_output().stderr.clone()).unwrap();
    assert!(parts.iter().all(|part| stderr.contains(part)), "{parts:?}: {stderr}");
}

#[test]
fn suns_and_lamps_shine_on_models_with_materials() {
    let tiny = Tiny::new();
    let model = tiny.path("model");
    printed(train_relightable(&tiny, "model").arg("--eval"));
    let picture = |words: &[&str], out: &str| {
        let mut relight = specula();
        relight.arg("relight").arg(&model).args(words).args(["--executor", "cpu", "-o"]).arg(tiny.path(out));
        printed(&mut relight);
        image::open(tiny.path(out).join("rgb/00000.png")).unwrap().to_rgb8()
    };
    let brightness = |picture: &image::RgbImage| picture.iter().map(|byte| u64::from(*byte)).sum::<u64>();
    let black = ["--background", "black"];
    let dim = picture(&[&["--sun", "30,60,0"][..], &black].concat(), "dim");
    let sunny = picture(&[&["--sun", "30,60,5"][..], &black].concat(), "sunny");
    assert!(brightness(&sunny) > brightness(&dim), "a sun shines");
    assert_eq!(sunny, picture(&[&["--sun", "30,60,5"][..], &black].concat(), "again"), "the same bits twice");

    let file = tiny.path("noon.toml");
    fs::write(&file, "sun = [\"30,60,5\"]\n").unwrap();
    let path = file.to_str().unwrap();
    assert_eq!(sunny, picture(&[&["--lights", path][..], &black].concat(), "file"), "a file says the same");
    let both = picture(&[&["--lights", path, "--lamp", "0,0,3,9,0.2"][..], &black].concat(), "both");
    assert!(brightness(&both) > brightness(&sunny), "options are added");

    // The irradiance of a sun from above is that of a brighter sun, and is no colour.
    let layers = |sun: &str, out: &str| {
        let rgb = picture(&["--sun", sun, "--layers", "rgb,irradiance,visibility"], out);
        let layer = |name: &str| image::open(tiny.path(out).join(name).join("00000.png")).unwrap().to_rgb8();
        (rgb, layer("irradiance"), layer("visibility"))
    };
    let (_, dim_irradiance, _) = layers("30,60,0", "dim-layers");
    let (rgb, irradiance, visibility) = layers("30,60,5", "layers");
    assert!(brightness(&irradiance) > brightness(&dim_irradiance), "a sun shines on materials");
    assert!(rgb != irradiance && visibility != irradiance, "layers differ");

    let turned = picture(&["--sun", "30,60", "--turn-light", "3", "--ground", "-2"], "turned");
    assert_eq!([turned.width(), turned.height()], [sunny.width(), sunny.height()]);
    assert!(tiny.path("turned/rgb/00002.png").is_file() && !tiny.path("turned/rgb/00003.png").exists());
    assert!(tiny.path("turned/turntable.png").is_file(), "there is an animation");
    let over_nothing = ["--sun", "30,60", "--turn-light", "2", "--ground", "-2", "--background", "transparent"];
    picture(&over_nothing, "clear");
    let clear = |index: u32| image::open(tiny.path("clear").join(format!("rgb/{index:05}.png"))).unwrap();
    assert!(clear(0).color().has_alpha() && clear(1).color().has_alpha());
    let alpha = |index: u32| clear(index).into_rgba8().pixels().map(|pixel| pixel.0[3]).collect::<Vec<_>>();
    assert!(alpha(0) != alpha(1), "the shadow turns with the light");

    let mut view = specula();
    view.arg("relight").arg(&model).args(["--sun", "0,30", "--shading", "view"]);
    refuses(view, &["physical materials", "--shading view"]);
}

#[test]
fn lights_that_cannot_be_are_refused_with_a_remedy() {
    let tiny = Tiny::new();
    let model = tiny.path("model");
    printed(&mut train(&tiny, "model"));
    let refused = |words: &[&str], parts: &[&str]| {
        let mut relight = specula();
        relight.arg("relight").arg(&model).args(words).arg("-o").arg(tiny.path("out"));
        refuses(relight, parts);
        assert!(!tiny.path("out").exists(), "a folder was made for pictures that cannot be");
    };
    refused(&[], &["--env", "--sun", "--lamp"]);
    refused(&["--env", "none"], &["--sun"]);
    refused(&["--sun", "30,45"], &["without physical materials", "--relightable"]);
    refused(&["--sun", "30"], &["AZIMUTH,ELEVATION"]);
    refused(&["--sun", "30,120"], &["AZIMUTH,ELEVATION"]);
    refused(&["--lamp", "1,2,3"], &["X,Y,Z,STRENGTH"]);
    refused(&["--sun", "30,45", "--shadow-rays", "0"], &["1 to"]);
    refused(&["--lights", "nowhere.toml"], &["nowhere.toml"]);
    refused(&["--sun", "30,45", "--turn-light", "3", "--layers", "albedo"], &["--turn-light", "--layers"]);
    let file = tiny.path("wrong.toml");
    fs::write(&file, "moon = 1\n").unwrap();
    refused(&["--lights", file.to_str().unwrap()], &["wrong.toml", "moon"]);
}
