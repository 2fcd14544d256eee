//! Trainings of pictures under several lights.

use crate::tiny::{Tiny, specula, train_by_default};
use serde_json::{Value, json};
use specula_io::model_folder::{gaussians_at, light_at, numbered_light_at};
use std::{
    fs,
    path::{Path, PathBuf},
};

fn json_of(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn stderr(command: &mut assert_cmd::Command, code: i32) -> String {
    String::from_utf8(command.assert().code(code).get_output().stderr.clone()).unwrap()
}

fn stdout(command: &mut assert_cmd::Command) -> String {
    String::from_utf8(command.assert().success().get_output().stdout.clone()).unwrap()
}

/// A data set whose last four training pictures were taken in the evening: dim and red.
fn evening() -> Tiny {
    let tiny = Tiny::new();
    for picture in 4..8 {
        let path = tiny.file(&format!("train/r_{picture}.png"));
        let mut picture = image::open(&path).unwrap().to_rgba8();
        picture.pixels_mut().for_each(|pixel| (pixel.0[1], pixel.0[2]) = (pixel.0[1] / 3, pixel.0[2] / 4));
        picture.save(&path).unwrap();
    }
    tiny
}

fn is_of_evening(split: &str, picture: usize) -> bool {
    split == "train" && picture > 3
}

/// All pictures, with their split.
fn pictures() -> impl Iterator<Item = (&'static str, usize)> {
    (0..8).map(|k| ("train", k)).chain((0..3).map(|k| ("test", k)))
}

fn write_table(tiny: &Tiny, line: impl Fn(&str, usize) -> String) -> PathBuf {
    let path = tiny.path("lights.txt");
    fs::write(&path, pictures().map(|(split, k)| format!("{split}/r_{k} {}\n", line(split, k))).collect::<String>())
        .unwrap();
    path
}

fn table(tiny: &Tiny) -> PathBuf {
    write_table(tiny, |split, k| if is_of_evening(split, k) { "evening".into() } else { "noon".into() })
}

fn train(tiny: &Tiny, model: &str, by: Option<&Path>) -> assert_cmd::Command {
    let mut train = train_by_default(tiny, model);
    train.args(["--eval", "--executor", "cpu"]);
    if let Some(by) = by {
        train.arg("--lights-by").arg(by);
    }
    train
}

/// Gaussians and lights of a model, as bytes.
fn bits(tiny: &Tiny, model: &str) -> [Vec<u8>; 3] {
    let model = tiny.path(model);
    [gaussians_at(&model, 30), light_at(&model, 30), numbered_light_at(&model, 30, 1)]
        .map(|path| fs::read(path).unwrap_or_default())
}

#[test]
fn two_lights_are_trained_resumed_measured_and_rendered() {
    let tiny = evening();
    let table = table(&tiny);
    let said = stderr(&mut train(&tiny, "model", Some(&table)), 0);
    assert!(said.contains("\"noon\" of 4 pictures") && said.contains("\"evening\" of 4 pictures"), "{said}");
    let (model, whole) = (tiny.path("model"), bits(&tiny, "model"));
    assert!(whole[1] != whole[2] && !whole[2].is_empty(), "each has its own light");
    let info = json_of(&model.join("specula.json"));
    assert_eq!((&info["lights"], &info["shading"]), (&json!(["noon", "evening"]), &json!("physical")));
    let cameras = json_of(&model.join("cameras.json"));
    // Test views come first.
    assert_eq!([0, 3, 6].map(|camera| &cameras[camera]["light"]), [&Value::Null; 3]);
    assert_eq!([7, 10].map(|camera| &cameras[camera]["light"]), [&json!(1); 2]);
    train(&tiny, "model", Some(&table)).arg("--resume").assert().success();
    assert!(bits(&tiny, "model") == whole, "the same bits");
    let said = stdout(specula().arg("info").arg(&model));
    assert!(said.contains("1 \"noon\", of 4 training pictures; 2 \"evening\", of 4 training pictures"), "{said}");

    let eval = |words: &[&str]| {
        let said = stdout(specula().arg("eval").arg(&model).args(["--json", "--executor", "cpu"]).args(words));
        serde_json::from_str::<Value>(&said).unwrap()["PSNR"].as_f64().unwrap()
    };
    let trained = json_of(&model.join("results.json"))["ours_30"]["PSNR"].as_f64().unwrap();
    assert!((eval(&[]) - trained).abs() < 0.01, "held-out views are under their own light");
    assert!((eval(&["--light", "1"]) - trained).abs() < 0.01 && (eval(&["--light", "2"]) - trained).abs() > 0.01);
    let own = eval(&["--split", "train"]);
    assert!(own != eval(&["--split", "train", "--light", "1"]), "training views are, too");

    let render = |folder: &str, words: &[&str]| {
        let folder = tiny.path(folder);
        specula().arg("render").arg(&model).arg("-o").arg(&folder).args(words).assert().success();
        let name = |index: usize| folder.join(format!("rgb/{index:05}.png"));
        [0, 7].map(|index| fs::read(name(index)).unwrap())
    };
    let all = render("all", &["--split", "all"]);
    let [first, second] = ["1", "2"].map(|light| render(light, &["--split", "all", "--light", light]));
    assert!(all[0] == first[0] && all[1] == second[1] && first != second && all != first);
}

#[test]
fn lists_folders_and_tables_name_the_same_lights() {
    let tiny = evening();
    train(&tiny, "table", Some(&table(&tiny))).assert().success();
    let expected = bits(&tiny, "table");
    // A table in the data set is proposed, unless it is in use.
    let inside = tiny.file("lights.csv");
    fs::copy(table(&tiny), &inside).unwrap();
    assert!(stderr(specula().arg("info").arg(tiny.data()), 0).contains("add --lights-by "));
    assert!(!stderr(&mut train(&tiny, "inside", Some(&inside)), 0).contains("lights.csv\" ("));
    fs::remove_file(&inside).unwrap();
    for split in ["train", "test"] {
        let path = tiny.file(&format!("transforms_{split}.json"));
        let mut list = json_of(&path);
        for (k, frame) in list["frames"].as_array_mut().unwrap().iter_mut().enumerate() {
            frame["light"] = if is_of_evening(split, k) { "evening".into() } else { "noon".into() };
        }
        fs::write(&path, list.to_string()).unwrap();
    }
    train(&tiny, "list", None).assert().success();
    assert!(bits(&tiny, "list") == expected);

    for split in ["train", "test"] {
        let path = tiny.file(&format!("transforms_{split}.json"));
        let mut list = json_of(&path);
        for (k, frame) in list["frames"].as_array_mut().unwrap().iter_mut().enumerate() {
            let folder = if is_of_evening(split, k) { "evening" } else { "noon" };
            fs::create_dir_all(tiny.file(&format!("{split}/{folder}"))).unwrap();
            let name = |folder: &str| tiny.file(&format!("{split}/{folder}r_{k}.png"));
            fs::rename(name(""), name(&format!("{folder}/"))).unwrap();
            frame["file_path"] = format!("./{split}/{folder}/r_{k}").into();
            frame.as_object_mut().unwrap().remove("light");
        }
        fs::write(&path, list.to_string()).unwrap();
    }
    train(&tiny, "folders", Some(Path::new("folders"))).assert().success();
    assert!(bits(&tiny, "folders") == expected);
}

#[test]
fn one_light_by_name_is_the_light_of_a_training_without_names() {
    let tiny = Tiny::new();
    train(&tiny, "plain", None).assert().success();
    train(&tiny, "named", Some(&write_table(&tiny, |_, _| "noon".into()))).assert().success();
    assert!(bits(&tiny, "plain") == bits(&tiny, "named"));
    for file in ["specula.json", "cameras.json"] {
        let text = fs::read_to_string(tiny.path("named").join(file)).unwrap();
        assert!(!text.contains("\"light\"") && !text.contains("\"lights\""), "{text}");
    }
    // A group of turned objects shares the light unless it names one.
    let turned = |light: &str| {
        let line = |split: &str, k| if is_of_evening(split, k) { format!("b 90{light}") } else { "a 0".into() };
        train(&tiny, "turned", Some(&write_table(&tiny, line))).arg("--overwrite").assert().success();
        !bits(&tiny, "turned")[2].is_empty()
    };
    assert!(!turned("") && turned(" own"));
    assert!(!turned(""), "no light of the former model is left");
}

#[test]
fn lights_that_cannot_be_trained_are_refused_in_a_sentence() {
    let tiny = evening();
    let known = table(&tiny);
    train(&tiny, "model", Some(&known)).assert().success();
    let whole = bits(&tiny, "model");
    let refused = |by: &Path, words: &[&str], parts: &[&str]| {
        let said = stderr(train(&tiny, "model", Some(by)).arg("--overwrite").args(words), 2);
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
        assert!(bits(&tiny, "model") == whole, "nothing is lost");
    };
    refused(&known, &["--no-materials"], &["2 lights", "--relightable"]);
    refused(&known, &["--profile", "paper"], &["2 lights", "--relightable"]);
    refused(&known, &["--profile", "3dgs"], &["no light"]);
    refused(&known, &["--views-per-step", "2"], &["one picture per step"]);
    refused(&known, &["--ranks", "2"], &["one rank"]);
    refused(&known, &["--light-reference", "0.5"], &["--light-reference"]);
    refused(&known, &["--max-error", "0.01"], &["--max-error"]);
    refused(Path::new("folders"), &[], &["\"test\"", "no training picture"]);
    let own = |light: &str| if light == "a" { "a".to_owned() } else { light.into() };
    let single = |split: &str, k: usize| own(if split == "train" && k == 0 || split == "test" { "b" } else { "a" });
    refused(&write_table(&tiny, single), &[], &["only one training picture", "\"b\""]);

    let list = tiny.file("transforms_train.json");
    let text = fs::read_to_string(&list).unwrap();
    let spoilt = "\"light_rotation\": [[2, 0, 0], [0, 1, 0], [0, 0, 1]], \"transform_matrix\"";
    fs::write(&list, text.replacen("\"transform_matrix\"", spoilt, 1)).unwrap();
    let said = stderr(train(&tiny, "model", None).arg("--overwrite"), 2);
    assert!(said.contains("light_rotation") && said.contains("r_0"), "{said}");
    assert!(bits(&tiny, "model") == whole, "nothing is lost");
}

#[test]
fn lights_that_a_model_does_not_have_are_refused() {
    let tiny = evening();
    train(&tiny, "model", Some(&table(&tiny))).assert().success();
    let model = tiny.path("model");
    let open = |words: &[&str], code: i32| {
        stderr(specula().args(words).arg(&model).args(["-o"]).arg(tiny.path("out.ply")), code)
    };
    let said = open(&["export", "--light", "3"], 2);
    assert!(said.contains("2 lights") && said.contains("no light 3"), "{said}");
    assert!(open(&["export"], 0).contains("light 1 of 2, \"noon\""));
    for light in ["2", "evening"] {
        assert!(open(&["export", "--light", light], 0).contains("light 2 of 2, \"evening\""), "{light}");
    }
    let said = open(&["export", "--light", "dusk"], 2);
    assert!(said.contains("\"noon\", \"evening\"") && said.contains("no light \"dusk\""), "{said}");
    open(&["export", "--env", "sunset"], 0);
    let said = stderr(specula().arg("render").arg(&model).args(["--env", "sunset", "--light", "1"]), 2);
    assert!(said.contains("omit --light"), "{said}");
    let said = stderr(specula().arg("render").arg(&model).args(["--background", "env"]), 2);
    assert!(said.contains("--light N"), "{said}");

    // Files of another model.
    let eval = || stderr(specula().arg("eval").arg(&model), 2);
    let second = numbered_light_at(&model, 30, 1);
    let bytes = fs::read(&second).unwrap();
    let mut other = specula();
    other.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("other")).args(["--light-resolution", "32"]);
    other.args(["--executor", "cpu", "--iterations", "1", "--random-points", "50"]).assert().success();
    fs::copy(light_at(&tiny.path("other"), 1), &second).unwrap();
    assert!(eval().contains("another model"));
    fs::remove_file(&second).unwrap();
    assert!(eval().contains("environment_2.exr") && eval().contains("does not exist"));
    fs::write(&second, bytes).unwrap();
    let cameras = fs::read_to_string(model.join("cameras.json")).unwrap();
    fs::write(model.join("cameras.json"), cameras.replacen("\"light\": 1", "\"light\": 4", 1)).unwrap();
    let said = eval();
    assert!(said.contains("light 5") && said.contains("cameras.json"), "{said}");
}

/// Means of red and blue of a map.
fn red_and_blue(path: &Path) -> [f64; 2] {
    let map = image::open(path).unwrap().to_rgb32f();
    [0, 2].map(|channel| map.pixels().map(|pixel| f64::from(pixel.0[channel])).sum::<f64>())
}

#[test]
fn pictures_are_left_out_and_their_light_is_fitted_to_the_model() {
    let tiny = evening();
    let without = write_table(&tiny, |split, k| if is_of_evening(split, k) { "-".into() } else { "noon".into() });
    let said = stderr(&mut train(&tiny, "model", Some(&without)), 0);
    assert!(said.contains("4 training pictures") && said.contains("leaves 4 pictures out"), "{said}");
    let model = tiny.path("model");
    let info = json_of(&model.join("specula.json"));
    assert_eq!((&info["left_out"], &info["train_views"]), (&json!(["r_4", "r_5", "r_6", "r_7"]), &json!(4)));
    let eval = stdout(specula().arg("eval").arg(&model).args(["--json", "--split", "all", "--executor", "cpu"]));
    let views = serde_json::from_str::<Value>(&eval).unwrap()["views"].as_array().unwrap().len();
    assert_eq!(views, 7, "those of the training and those held out");

    crate::tiny::train_plain(&tiny, "plain").arg("--lights-by").arg(&without).assert().success();
    let info = json_of(&tiny.path("plain/specula.json"));
    assert_eq!(info["left_out"].as_array().unwrap().len(), 4, "plain Gaussians, too");

    let all = table(&tiny);
    let fit = |light: &str, out: &str, words: &[&str]| {
        let mut fit = specula();
        fit.arg("fit-light").arg(&model).arg(tiny.data()).args([
            "--lights-by",
            all.to_str().unwrap(),
            "--light",
            light,
        ]);
        fit.args(["--iterations", "60", "--executor", "cpu", "-o"]).arg(tiny.path(out)).args(words);
        fit
    };
    let said = stdout(&mut fit("evening", "evening.exr", &["--fit", "3", "--json"]));
    let measured: Value = serde_json::from_str(&said).unwrap();
    assert_eq!(measured["views"].as_array().unwrap().len(), 1, "the fourth picture");
    assert!(measured["PSNR"].as_f64().is_some_and(|psnr| psnr > 10.0), "{said}");
    stdout(&mut fit("noon", "lights/noon.hdr", &[]));
    let [evening, noon] = ["evening.exr", "lights/noon.hdr"].map(|name| red_and_blue(&tiny.path(name)));
    assert!(evening[0] / evening[1] > 1.5 * noon[0] / noon[1], "the evening is red: {evening:?}, {noon:?}");

    for (light, out, words, parts) in [
        ("dusk", "x.exr", &[][..], &["no picture", "\"dusk\"", "\"evening\", \"noon\""][..]),
        ("evening", "x.png", &[], &["x.png", ".exr or .hdr"]),
        ("evening", "x.exr", &["--fit", "4"], &["--fit 4", "none of 4 photographs"]),
    ] {
        let said = stderr(&mut fit(light, out, words), 2);
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
        assert!(!tiny.path(out).exists());
    }
    let mut plain = specula();
    plain.arg("fit-light").arg(tiny.path("plain")).arg(tiny.data()).arg("-o").arg(tiny.path("x.exr"));
    assert!(stderr(&mut plain, 2).contains("--relightable"));
    let lacking = tiny.path("lacking.txt");
    fs::write(&lacking, "train/r_0 noon\ntrain/r_1 noon\n").unwrap();
    let said = stderr(&mut train(&tiny, "none", Some(&lacking)), 2);
    assert!(said.contains("does not name 9 of the pictures") && said.contains("the light - leaves"), "{said}");
    assert!(!said.contains("loading"), "before any picture is read: {said}");
}
