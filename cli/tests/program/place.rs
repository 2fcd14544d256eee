//! Pictures and results of one way of rendering do not take the place of another's.

use crate::tiny::{Tiny, specula, train};
use serde_json::Value;
use std::{fs, path::Path};

fn trained(tiny: &Tiny) -> std::path::PathBuf {
    train(tiny, "model").args(["--eval", "--executor", "cpu"]).assert().success();
    tiny.path("model")
}

fn refusal(words: &[&str], model: &Path) -> String {
    let mut command = specula();
    let output = command.arg(words[0]).arg(model).args(&words[1..]).assert().code(2).get_output().clone();
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn pictures_of_another_setting_lie_in_a_folder_of_their_own() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let render = |words: &[&str]| {
        specula().arg("render").arg(&model).args(["--executor", "cpu"]).args(words).assert().success();
    };
    render(&["--layers", "rgb"]);
    let default = model.join("test/ours_30/renders/00000.png");
    let before = fs::read(&default).unwrap();
    for (words, folder) in [
        (["--background", "black"], "ours_30_on-0,0,0"),
        (["--background", "env"], "ours_30_on-env"),
        (["--background", "transparent"], "ours_30_on-nothing"),
        (["--storage", "f16"], "ours_30_f16"),
        (["--projection", "ray"], "ours_30_ray"),
        (["--order", "pixel"], "ours_30_pixel-order"),
        (["--order", "window:8"], "ours_30_window-8"),
        (["--profile", "paper"], "ours_30_as-paper"),
        (["--max-error", "0.05"], "ours_30_error-0.05"),
    ] {
        render(&[&words[..], &["--layers", "rgb"]].concat());
        assert!(model.join("test").join(folder).join("renders/00000.png").is_file(), "{words:?}");
        assert_eq!(fs::read(&default).unwrap(), before, "{words:?} changed the default pictures");
    }
}

#[test]
fn pictures_of_other_cameras_do_not_stay_beside_new_ones() {
    let tiny = Tiny::new();
    let (model, out) = (trained(&tiny), tiny.path("out"));
    let render = |words: &[&str]| {
        specula().arg("render").arg(&model).arg("-o").arg(&out).args(words).assert().success();
    };
    let count = |layer: &str| fs::read_dir(out.join(layer)).map_or(0, |entries| entries.count());
    render(&["--turntable", "4", "--layers", "rgb,normal"]);
    assert_eq!([count("rgb"), count("normal")], [4, 4]);
    fs::write(out.join("rgb/mine.png"), "mine").unwrap();
    render(&["--turntable", "2", "--layers", "rgb"]);
    assert_eq!([count("rgb"), count("normal")], [3, 0], "two new pictures, and what the program did not write");
    render(&["--turntable", "2", "--layers", "normal"]);
    assert_eq!([count("rgb"), count("normal")], [3, 2], "layers of the same cameras stay");
}

#[test]
fn measures_on_another_data_set_do_not_take_the_place_of_the_models_own() {
    let (tiny, other) = (Tiny::new(), Tiny::new());
    let model = trained(&tiny);
    let results = || -> Value { serde_json::from_slice(&fs::read(model.join("results.json")).unwrap()).unwrap() };
    specula().arg("eval").arg(&model).arg("-s").arg(tiny.data()).assert().success();
    let before = results();
    specula().arg("eval").arg(&model).arg("-s").arg(other.data()).assert().success();
    assert_eq!(results()["ours_30"], before["ours_30"]);
    assert!(results()["ours_30_of-data"]["PSNR"].is_number(), "{}", results());
}

#[test]
fn an_export_does_not_take_the_place_of_what_it_is_made_of() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let ply = model.join("point_cloud/iteration_30/point_cloud.ply");
    let before = fs::read(&ply).unwrap();
    for own in [ply.clone(), model.join("input.ply")] {
        let sentence = refusal(&["export", "-o", own.to_str().unwrap()], &model);
        assert!(sentence.contains("a file of the model itself"), "{sentence}");
    }
    assert_eq!(fs::read(&ply).unwrap(), before);
}

#[test]
fn options_that_would_change_nothing_are_refused() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    for (words, said) in [
        (&["render", "--exposure", "2"][..], "--env"),
        (&["export", "-o", "x.ply", "--exposure", "2"], "--env"),
        (&["relight", "--sun", "30,45", "--exposure", "2"], "--env"),
        (&["render", "--max-error", "5"], "1 (white)"),
        (&["render", "--max-error", "0.1", "--layers", "normal"], "add rgb"),
    ] {
        let sentence = refusal(words, &model);
        assert!(sentence.contains(said), "{words:?}: {sentence}");
    }
    let light = model.join("light/iteration_30/environment.exr");
    let sentence = refusal(&["relight", "--env", light.to_str().unwrap()], &model);
    assert!(sentence.contains("six faces") && sentence.contains("brdf_mlp.hdr"), "{sentence}");
}

#[test]
fn an_earlier_iteration_is_opened_by_its_folder() {
    let tiny = Tiny::new();
    train(&tiny, "model").args(["--eval", "--executor", "cpu", "--save-iterations", "10"]).assert().success();
    let model = tiny.path("model");
    let shown = |scene: &Path, out: &str| {
        let out = tiny.path(out);
        specula().arg("render").arg(scene).args(["--layers", "rgb", "-o"]).arg(&out).assert().success();
        fs::read(out.join("rgb/00000.png")).unwrap()
    };
    let folder = model.join("point_cloud/iteration_10");
    let early = shown(&folder, "folder");
    assert_eq!(early, shown(&folder.join("point_cloud.ply"), "file"));
    assert_ne!(early, shown(&model, "last"));
}

#[test]
fn a_shading_function_of_another_version_is_refused() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let path = model.join("specula.json");
    let mut info: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    info["shading"] = "neural".into();
    fs::write(&path, info.to_string()).unwrap();
    let sentence = refusal(&["render"], &model);
    assert!(sentence.contains("neural") && sentence.contains("--profile"), "{sentence}");
    specula().arg("render").arg(&model).args(["--profile", "specula", "--layers", "rgb"]).assert().success();
}

#[cfg(target_os = "linux")]
#[test]
fn a_model_folder_may_have_any_name() {
    use std::{ffi::OsStr, os::unix::ffi::OsStrExt};
    let tiny = Tiny::new();
    let mut command = specula();
    command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("").join(OsStr::from_bytes(b"b\xff")));
    command.args(["--iterations", "2", "--executor", "cpu", "--quiet"]).assert().success();
}

#[test]
fn no_more_points_than_gaussians_are_started_from() {
    let tiny = Tiny::new();
    let mut command = train(&tiny, "model");
    let output = command.args(["--max-gaussians", "40"]).assert().success().get_output().clone();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("40 of") && said.contains("--max-gaussians"), "{said}");
}

#[test]
fn pictures_without_a_background_lie_over_any() {
    /// Two roundings of 8 bits.
    const ROUNDING: f32 = 1.5;
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let shown = |background: &str| {
        let out = tiny.path(background);
        let mut render = specula();
        render.arg("render").arg(&model).arg("-o").arg(&out).args(["--executor", "cpu", "--layers", "rgb"]);
        render.args(["--background", background, "--turntable", "2"]).assert().success();
        assert!(out.join("turntable.png").is_file(), "there is an animation");
        image::open(out.join("rgb/00000.png")).unwrap()
    };
    let clear = shown("transparent");
    assert!(clear.color().has_alpha());
    let (clear, white) = (clear.into_rgba8(), shown("white").into_rgb8());
    assert!(clear.pixels().any(|pixel| pixel.0[3] == 0) && clear.pixels().any(|pixel| pixel.0[3] > 200));
    for (clear, white) in clear.pixels().zip(white.pixels()) {
        let share = f32::from(clear.0[3]) / 255.0;
        let over = |value: u8| f32::from(value) * share + 255.0 * (1.0 - share);
        let is_same = |c: usize| (over(clear.0[c]) - f32::from(white.0[c])).abs() <= ROUNDING;
        assert!((0..3).all(is_same), "{clear:?} over white is not {white:?}");
    }

    for words in [
        &["render", "--max-error", "0.1", "--layers", "rgb"][..],
        &["render", "--layers", "normal"],
        &["relight", "--env", "none", "--truth", "truth"],
        &["relight", "--env", "none", "--layers", "depth"],
    ] {
        let said = refusal(&[words, &["--background", "transparent"]].concat(), &model);
        assert!(said.contains("transparent"), "{words:?}: {said}");
    }
}

#[test]
fn numbers_of_layers_lie_beside_their_pictures_and_do_not_outlive_them() {
    let tiny = Tiny::new();
    let (model, out) = (trained(&tiny), tiny.path("out"));
    let render = |words: &[&str]| {
        let mut render = specula();
        render.arg("render").arg(&model).arg("-o").arg(&out).args(["--executor", "cpu"]).args(words);
        render.assert().success();
    };
    render(&["--layers", "rgb,normal,depth,roughness", "--exr"]);
    let planes = |layer: &str| -> Vec<(String, Vec<f32>)> {
        let path = out.join(layer).join("00000.exr");
        let read = exr::prelude::read_first_flat_layer_from_file(path).unwrap().layer_data;
        let channels = read.channel_data.list.into_iter();
        channels.map(|channel| (channel.name.to_string(), channel.sample_data.values_as_f32().collect())).collect()
    };
    let names = |layer: &str| planes(layer).into_iter().map(|(name, _)| name).collect::<Vec<_>>();
    assert_eq!(names("rgb"), ["A", "B", "G", "R"]);
    assert_eq!(names("normal"), ["X", "Y", "Z"]);
    assert_eq!(names("roughness"), ["Y"]);

    // The camera is 4 away from a ball of radius 1 at the origin.
    let colors = planes("rgb");
    let depths = &planes("depth")[0].1;
    let alpha = &colors[0].1;
    assert!(alpha.iter().zip(depths).all(|(alpha, depth)| (*alpha > 0.0) == depth.is_finite()));
    let normals = planes("normal");
    let square = |pixel: usize| normals.iter().map(|(_, plane)| plane[pixel] * plane[pixel]).sum::<f32>();
    assert!((0..alpha.len()).all(|pixel| alpha[pixel] < 0.5 || (square(pixel) - 1.0).abs() < 1e-3), "unit normals");
    let covered: Vec<f32> =
        alpha.iter().zip(depths).filter(|(alpha, _)| **alpha > 0.9).map(|(_, depth)| *depth).collect();
    assert!(!covered.is_empty() && covered.iter().all(|depth| (2.0..6.0).contains(depth)), "{covered:?}");
    assert!(colors[1..].iter().all(|(_, plane)| plane.iter().zip(alpha).all(|(color, alpha)| *color <= alpha + 1e-3)));

    for words in [["render", "--layers", "albedo"], ["render", "--layers", "metallic,irradiance"]] {
        let said = refusal(&words, &model);
        assert!(said.contains("trained without --relightable"), "{words:?}: {said}");
    }
    render(&["--layers", "depth"]);
    assert!(out.join("depth/00000.png").is_file() && !out.join("depth/00000.exr").exists(), "numbers of before");
    assert!(out.join("normal/00000.exr").is_file(), "numbers beside their pictures");
    render(&["--layers", "depth", "--turntable", "2"]);
    assert!(!out.join("normal/00000.exr").exists(), "numbers of other cameras");

    let foreign = tiny.path("foreign");
    fs::create_dir_all(foreign.join("depth")).unwrap();
    fs::write(foreign.join("depth/00007.exr"), "mine").unwrap();
    specula().arg("render").arg(&model).arg("-o").arg(&foreign).args(["--layers", "depth"]).assert().success();
    assert!(foreign.join("depth/00007.exr").is_file(), "a file that the program did not write");
    assert!(refusal(&["relight", "--env", "none", "--turn-light", "2", "--exr"], &model).contains("--exr"));
}
