//! Measures, files and pages of `eval` on a data set of a few pixels.

use crate::tiny::{SIZE, Tiny, specula, train, train_relightable};
use serde_json::Value;
use specula_io::latlong::{self, LatLong};
use std::{
    fs,
    path::{Path, PathBuf},
};

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn printed(command: &mut assert_cmd::Command) -> String {
    String::from_utf8(command.assert().success().get_output().stdout.clone()).unwrap()
}

fn eval(model: &Path, words: &[&str]) -> String {
    printed(specula().arg("eval").arg(model).args(words).arg("--quiet"))
}

/// Places that a page names in an attribute.
fn named(page: &str, attribute: &str) -> Vec<String> {
    let opening = format!("{attribute}=\"");
    page.split(&opening).skip(1).map(|rest| rest.split('"').next().unwrap().to_owned()).collect()
}

fn trained(tiny: &Tiny) -> PathBuf {
    printed(train(tiny, "model").args(["--eval", "--quiet"]));
    tiny.path("model")
}

#[test]
fn measures_of_other_settings_take_no_ones_place() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let default = json(&model.join("results.json"))["ours_30"].clone();
    for (words, method) in [
        (&["--storage", "f16"][..], "ours_30_f16"),
        (&["--projection", "ray"], "ours_30_ray"),
        (&["--order", "pixel"], "ours_30_pixel-order"),
        (&["--storage", "f16", "--projection", "0.01"], "ours_30_f16_within-0.01"),
        (&["--background", "black"], "ours_30_on-0,0,0"),
        (&["-r", "2"], "ours_30_r2"),
        (&["--profile", "paper"], "ours_30_as-paper"),
    ] {
        eval(&model, words);
        let results = json(&model.join("results.json"));
        assert_eq!(results["ours_30"], default, "{words:?} changed what was measured before");
        assert_ne!(results[method]["PSNR"], default["PSNR"], "{words:?} measures something else: {results}");
        assert_eq!(json(&model.join("per_view.json"))[method]["FLIP"].as_object().unwrap().len(), 3);
        assert!(model.join("test").join(method).join("index.html").is_file(), "{method} has its own page");
    }
    eval(&model, &["--background", "white", "-r", "1", "--profile", "specula", "--executor", "cpu"]);
    let again = json(&model.join("results.json"))["ours_30"].clone();
    let difference = again["PSNR"].as_f64().unwrap() - default["PSNR"].as_f64().unwrap();
    assert!(difference.abs() < 0.01, "a data set as in training has the default results: {again}");
    assert!(default["FLIP"].is_null() && again["FLIP"].as_f64().unwrap() > 0.0, "FLIP was added: {again}");
}

#[test]
fn views_that_were_trained_on_are_no_held_out_ones() {
    const TOLD: &str = "without --eval";
    let tiny = Tiny::new();
    let told = |model: &str, words: &[&str]| {
        let assert = specula().arg("eval").arg(tiny.path(model)).args(words).assert().success();
        String::from_utf8(assert.get_output().stderr.clone()).unwrap()
    };
    printed(train(&tiny, "all").arg("--quiet"));
    assert!(told("all", &[]).contains(TOLD));
    assert!(!told("all", &["--split", "train"]).contains(TOLD), "these are asked for by their name");
    assert!(!told(trained(&tiny).to_str().unwrap(), &[]).contains(TOLD));
}

/// The data set in nerfstudio's form, with a mask over all of its second test view.
fn write_masked(tiny: &Tiny) -> PathBuf {
    let list = |split: &str| json(&tiny.file(&format!("transforms_{split}.json")));
    let [train, mut test] = ["train", "test"].map(|split| list(split)["frames"].as_array().unwrap().clone());
    test[1]["mask_path"] = "mask.png".into();
    let names: Vec<Value> = test.iter().map(|frame| frame["file_path"].clone()).collect();
    let frames = [train, test].concat();
    let transforms = serde_json::json!({
        "camera_angle_x": list("test")["camera_angle_x"], "frames": frames, "test_filenames": names,
    });
    fs::write(tiny.file("transforms.json"), transforms.to_string()).unwrap();
    image::GrayImage::new(SIZE, SIZE).save(tiny.file("mask.png")).unwrap();
    for split in ["train", "test"] {
        fs::remove_file(tiny.file(&format!("transforms_{split}.json"))).unwrap();
    }
    tiny.data()
}

#[test]
fn masks_that_hide_everything_are_refused() {
    let tiny = Tiny::new();
    write_masked(&tiny);
    let path = tiny.file("transforms.json");
    let mut transforms = json(&path);
    for frame in transforms["frames"].as_array_mut().unwrap() {
        frame["mask_path"] = "mask.png".into();
    }
    fs::write(&path, transforms.to_string()).unwrap();
    let refused = train(&tiny, "model").args(["--eval", "--quiet"]).assert().code(2).get_output().clone();
    let said = String::from_utf8(refused.stderr).unwrap();
    assert!(said.contains("all pixels of the training pictures are masked"), "{said}");
    assert!(!tiny.path("model/point_cloud").exists());
}

#[test]
fn views_without_a_known_pixel_have_no_measures() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    eval(&model, &[]);
    let psnr_of_views = || json(&model.join("per_view.json"))["ours_30"]["PSNR"].as_object().unwrap().clone();
    let before: Vec<Option<f64>> = psnr_of_views().values().map(Value::as_f64).collect();
    assert_eq!(before.iter().flatten().count(), 3, "every view has a measure");

    let masked = write_masked(&tiny);
    eval(&model, &["-s", masked.to_str().unwrap()]);
    let after: Vec<Option<f64>> = psnr_of_views().values().map(Value::as_f64).collect();
    assert_eq!(after.iter().flatten().count(), 2, "one view has none: {after:?}");
    let mean = after.iter().flatten().sum::<f64>() / 2.0;
    let told = json(&model.join("results.json"))["ours_30"]["PSNR"].as_f64().unwrap();
    assert!((told - mean).abs() < 1e-4, "{told} is the mean of {after:?}");
    let known = |psnr: &f64| before.iter().flatten().any(|whole| (whole - psnr).abs() < 1e-4);
    assert!(after.iter().flatten().all(known), "what has no mask is measured as before: {before:?}, {after:?}");
}

#[test]
fn a_page_shows_every_view_beside_its_truth_the_worst_first() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let folder = model.join("test/ours_30");
    let said = eval(&model, &[]);
    assert!(said.starts_with("PSNR ") && said.contains("FLIP 0.") && said.contains("normal MAE "), "{said}");
    assert!(said.ends_with(&format!("\nPage: {}\n", folder.join("index.html").display())), "{said}");

    let page = fs::read_to_string(folder.join("index.html")).unwrap();
    let pictures = named(&page, "src");
    assert_eq!(pictures.len(), 3 * 3, "truth, picture and error of each view");
    assert!(!page.contains("http"), "nothing is asked for from outside");
    for picture in &pictures {
        assert!(image::open(folder.join(picture)).is_ok(), "{picture} is no picture");
    }
    let psnrs: Vec<f64> = named(&page, "data-m0").iter().map(|number| number.parse().unwrap()).collect();
    assert!(psnrs.len() == 3 && psnrs.is_sorted(), "{psnrs:?}");
    let order: Vec<&str> = pictures.iter().step_by(3).map(|place| &place[6..11]).collect();
    let per_view = json(&model.join("per_view.json"))["ours_30"]["PSNR"].clone();
    let recorded = order.iter().map(|index| per_view[format!("{index}.png")].as_f64().unwrap());
    assert_eq!(recorded.collect::<Vec<_>>(), psnrs, "pictures are those of the numbers beside them");

    let [truth, error] = ["truth", "error"].map(|kind| {
        let picture = image::open(folder.join(format!("views/{}-{kind}.jpg", order[0]))).unwrap().to_rgb8();
        picture.into_raw().iter().map(|byte| u64::from(*byte)).sum::<u64>()
    });
    assert!(truth > error, "a ball on white is brighter than where it was missed");
}

#[test]
fn a_scene_on_its_own_has_a_page_where_it_is_asked_for() {
    let tiny = Tiny::new();
    let ply = tiny.path("alone.ply");
    fs::copy(trained(&tiny).join("point_cloud/iteration_30/point_cloud.ply"), &ply).unwrap();
    let data = tiny.data();
    let words = ["-s", data.to_str().unwrap(), "--split", "train"];
    assert!(!eval(&ply, &words).contains("Page: "), "it has no folder");
    let out = tiny.path("out");
    let said = eval(&ply, &[&words[..], &["-o", out.to_str().unwrap()]].concat());
    assert!(said.contains("(8 train views)") && out.join("index.html").is_file(), "{said}");
    assert_eq!(fs::read_dir(out.join("views")).unwrap().count(), 3 * 8);
}

#[test]
fn relighting_is_measured_where_its_truth_is_known() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    assert!(json(&model.join("results.json"))["ours_30"]["relit_PSNR"].is_null());
    fs::create_dir_all(tiny.file("relight/sky")).unwrap();
    latlong::write(&tiny.file("relight/sky.hdr"), &LatLong { width: 16, height: 8, rgb: vec![0.5; 3 * 16 * 8] })
        .unwrap();
    latlong::write(&tiny.file("relight/untold.hdr"), &LatLong { width: 16, height: 8, rgb: vec![0.5; 3 * 16 * 8] })
        .unwrap();
    for view in ["r_0", "r_2"] {
        fs::copy(tiny.file(&format!("test/{view}.png")), tiny.file(&format!("relight/sky/{view}.png"))).unwrap();
    }
    let report: Value = serde_json::from_str(&eval(&model, &["--json"])).unwrap();
    let [sky] = report["relit"].as_array().unwrap().as_slice() else { panic!("one light has pictures: {report}") };
    assert_eq!((&sky["light"], &sky["views"]), (&"sky".into(), &2.into()));

    // The same as the command for one light says.
    let mut relight = specula();
    relight.arg("relight").arg(&model).arg("--env").arg(tiny.file("relight/sky.hdr"));
    relight.arg("--truth").arg(tiny.file("relight/sky")).arg("--json");
    let alone: Value = serde_json::from_str(&printed(&mut relight)).unwrap();
    let results = json(&model.join("results.json"))["ours_30"].clone();
    for (name, recorded) in [("PSNR", "relit_PSNR"), ("PSNR_scaled", "relit_PSNR_scaled")] {
        assert_eq!((&sky[name], &results[recorded]), (&alone[name], &alone[name]), "{name}");
    }
    assert!(alone["PSNR"].as_f64() < alone["PSNR_scaled"].as_f64());
    assert!(fs::read_to_string(model.join("test/ours_30/index.html")).unwrap().contains("Under other lights"));
}

/// Writes materials of a ball, a metal of roughness 0.2 on one side and Lambertian on the other,
/// and a light.
fn write_truth(tiny: &Tiny) {
    for view in 0..3 {
        let picture = image::open(tiny.file(&format!("test/r_{view}.png"))).unwrap().to_rgba8();
        picture.save(tiny.file(&format!("test/r_{view}_albedo.png"))).unwrap();
        let material = |x: u32, y: u32| match picture.get_pixel(x, y).0 {
            [.., 255] if x < picture.width() / 2 => image::Rgba([51, 255, 0, 255]),
            [.., 255] => image::Rgba([0, 0, 255, 255]),
            _ => image::Rgba([0; 4]),
        };
        let surface = image::RgbaImage::from_fn(picture.width(), picture.height(), material);
        surface.save(tiny.file(&format!("test/r_{view}_material.png"))).unwrap();
    }
    write_light(tiny, 1.0);
}

/// Writes a true light that is four times as bright above as below.
fn write_light(tiny: &Tiny, above: f32) {
    let rgb = (0..3 * 16 * 8).map(|index| if index < 3 * 16 * 4 { above } else { 0.25 * above }).collect();
    latlong::write(&tiny.file("env.hdr"), &LatLong { width: 16, height: 8, rgb }).unwrap();
}

#[test]
fn materials_and_light_are_measured_where_their_truth_is_known() {
    const KEYS: [&str; 4] = ["albedo_PSNR", "roughness_error", "metalness_error", "light_scale"];
    /// Words of the lines on materials and light.
    const WORDS: [&str; 4] = ["albedo", "roughness error", "metalness", "light"];
    /// Error of a ratio of scales: that of numbers in `f32`.
    const ROUNDING: f64 = 1e-4;
    let tiny = Tiny::new();
    let model = tiny.path("model");
    let told = printed(train_relightable(&tiny, "model").args(["--eval", "--quiet"]));
    let evaluated = eval(&model, &[]);
    let recorded = fs::read_to_string(model.join("results.json")).unwrap();
    for text in [&told, &evaluated, &recorded] {
        assert!(WORDS.iter().all(|word| !text.contains(word)), "without truth nothing is said: {text}");
    }
    assert!(!model.join("test/ours_30/light.png").exists());

    write_truth(&tiny);
    fs::create_dir_all(tiny.file("relight/sky")).unwrap();
    fs::copy(tiny.file("env.hdr"), tiny.file("relight/sky.hdr")).unwrap();
    fs::copy(tiny.file("test/r_1.png"), tiny.file("relight/sky/r_1.png")).unwrap();
    let said = eval(&model, &[]);
    for part in
        ["  albedo PSNR ", "\nalbedo: scaled by ", "\nlight: correlation ", " dB after scaling the albedo  (1 v"]
    {
        assert!(said.contains(part), "{part:?} is missing in {said}");
    }
    let measured = json(&model.join("results.json"))["ours_30"].clone();
    for key in KEYS.iter().chain(&["relit_PSNR_albedo_scaled", "relit_PSNR_view_scaled"]) {
        assert!(measured[key].as_f64().is_some_and(|value| value > 0.0), "{key}: {measured}");
    }
    let page = model.join("test/ours_30");
    assert!(image::open(page.join("light.png")).is_ok());
    assert!(fs::read_to_string(page.join("index.html")).unwrap().contains("src=\"light.png\""));

    let report: Value = serde_json::from_str(&eval(&model, &["--json"])).unwrap();
    assert_eq!(report["albedo_scale"].as_array().unwrap().len(), 3);
    let scale = report["light"]["scale"].as_f64().unwrap();
    write_light(&tiny, 2.0);
    let report: Value = serde_json::from_str(&eval(&model, &["--json"])).unwrap();
    let ratio = scale / report["light"]["scale"].as_f64().unwrap();
    assert!((ratio - 2.0).abs() < ROUNDING, "relative to twice the light it is half as bright: {ratio}");

    // The end of a training says the same.
    let told = printed(train_relightable(&tiny, "again").args(["--eval", "--quiet"]));
    assert!(told.contains("\nalbedo: scaled by ") && told.contains("\nlight: correlation "), "{told}");
    let again = json(&tiny.path("again").join("results.json"))["ours_30"].clone();
    assert!(KEYS.iter().all(|key| again[key].is_number()), "{again}");

    // A model without materials has nothing to compare.
    printed(train(&tiny, "plain").args(["--eval", "--quiet"]));
    let said = eval(&tiny.path("plain"), &[]);
    assert!(WORDS.iter().all(|word| !said.contains(word)), "{said}");
}

#[test]
fn broken_truths_of_materials_and_light_are_told_in_one_sentence() {
    let tiny = Tiny::new();
    let model = tiny.path("model");
    printed(train_relightable(&tiny, "model").args(["--eval", "--quiet"]));
    let refusal = || {
        let output = specula().arg("eval").arg(&model).arg("--quiet").assert().failure().get_output().clone();
        String::from_utf8(output.stderr).unwrap()
    };
    fs::write(tiny.file("env.hdr"), "no light").unwrap();
    let said = refusal();
    assert!(said.lines().count() == 1 && said.contains("env.hdr"), "{said}");
    write_truth(&tiny);
    image::RgbaImage::new(5, 7).save(tiny.file("test/r_1_albedo.png")).unwrap();
    let said = refusal();
    assert!(said.lines().count() == 1 && said.contains("r_1_albedo.png") && said.contains("5 by 7"), "{said}");
}

/// A network of a few channels with random weights; what it says is compared with the reference
/// package elsewhere.
const NETWORK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../crates/accuracy/tests/data/lpips-vgg.onnx");

#[test]
fn lpips_is_kept_with_the_network_that_measured_it() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let said = eval(&model, &["--lpips", NETWORK]);
    assert!(said.contains("  LPIPS 0."), "{said}");
    let ours = json(&model.join("results.json"))["ours_30"].clone();
    assert_eq!(ours["LPIPS_network"], "vgg with random weights, lpips 0.1.4, inputs 0..1");
    assert!(fs::read_to_string(model.join("test/ours_30/index.html")).unwrap().contains("LPIPS by vgg with random"));
    let report: Value = serde_json::from_str(&eval(&model, &["--json"])).unwrap();
    assert!(report["LPIPS"].is_null(), "it is measured where it is asked for");
    assert_eq!(json(&model.join("results.json"))["ours_30"], ours, "and stays where it is not");

    let small =
        specula().arg("eval").arg(&model).args(["-r", "8", "--lpips", NETWORK]).assert().code(2).get_output().clone();
    assert!(String::from_utf8(small.stderr).unwrap().contains("4 × 4 pixels"));
    let other = tiny.data().join("transforms_test.json");
    let refused = specula().arg("eval").arg(&model).arg("--lpips").arg(&other).assert().code(2).get_output().clone();
    assert!(
        String::from_utf8(refused.stderr).unwrap().contains("transforms_test.json\" is not a usable LPIPS network")
    );
}
