//! `scripts/benchmark` on a suite of two tiny scenes.

use crate::{
    python::{has_python, python},
    tiny::Tiny,
};
use image::{GrayImage, RgbImage};
use serde_json::Value;
use std::{
    fs,
    path::{Path, PathBuf},
    process::Output,
};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../scripts/benchmark");
/// Modules that the script imports beyond those of every Python.
const MODULES: &str = "json";
/// Words of trainings that take a second.
const WORDS: [&str; 11] =
    ["--profiles", "3dgs", "--seeds", "0,1", "--iterations", "30", "--executor", "cpu", "--", "--random-points", "200"];
/// Seeds of [`WORDS`].
const SEEDS: [&str; 2] = ["0", "1"];
/// Tolerance of numbers that were summed in another order.
const ROUNDING: f64 = 1e-9;

/// `ball` and `car` in the layout of Ref-NeRF: pictures of `ball` are opaque, with their coverage
/// beside them.
struct Suite(Tiny);

impl Suite {
    fn new() -> Self {
        let suite = Self(Tiny::new());
        let [ball, car] = ["ball", "car"].map(|scene| suite.data().join(scene));
        copy(&suite.0.data(), &ball);
        copy(&suite.0.data(), &car);
        for split in ["train", "test"] {
            let pictures = fs::read_dir(ball.join(split)).unwrap().map(|entry| entry.unwrap().path());
            let views: Vec<PathBuf> = pictures.filter(|path| !path.to_string_lossy().contains("_normal")).collect();
            views.iter().for_each(|picture| separate_coverage(picture));
        }
        suite
    }

    fn data(&self) -> PathBuf {
        self.0.path("suite")
    }

    fn out(&self) -> PathBuf {
        self.0.path("out")
    }

    fn run(&self, words: &[&str]) -> Output {
        let mut command = python();
        command.args([SCRIPT, "shiny-blender"]).arg(self.data()).arg(self.out());
        command.args(["--program", env!("CARGO_BIN_EXE_specula")]).args(words);
        command.output().unwrap()
    }

    /// Standard output and standard error of a run that succeeds.
    fn printed(&self, words: &[&str]) -> [String; 2] {
        let output = self.run(words);
        let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
        assert!(output.status.success(), "{err}");
        [out, err]
    }

    fn model(&self, scene: &str, seed: &str) -> PathBuf {
        self.out().join(scene).join(format!("3dgs-{seed}"))
    }

    /// A measure of each seed as the program recorded it.
    fn recorded(&self, scene: &str, measure: &str) -> [f64; 2] {
        SEEDS.map(|seed| {
            let results = fs::read(self.model(scene, seed).join("results.json")).unwrap();
            serde_json::from_slice::<Value>(&results).unwrap()["ours_30"][measure].as_f64().unwrap()
        })
    }

    /// Numbers of a row of `table.csv` by the heads of their columns.
    fn row(&self, scene: &str) -> impl Fn(&str) -> f64 {
        let table = fs::read_to_string(self.out().join("table.csv")).unwrap();
        let mut lines = table.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
        let heads = lines.next().unwrap();
        let cells = lines.find(|cells| cells[0] == scene).unwrap_or_else(|| panic!("{scene} is not in {table}"));
        move |head| cells[heads.iter().position(|other| other == head).unwrap()].parse().unwrap()
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}

/// Composites a picture over white, and stores its alpha beside it.
fn separate_coverage(path: &Path) {
    let picture = image::open(path).unwrap().to_rgba8();
    let (width, height) = picture.dimensions();
    let stem = path.file_stem().unwrap().to_string_lossy().into_owned();
    let alpha = GrayImage::from_fn(width, height, |x, y| image::Luma([picture.get_pixel(x, y)[3]]));
    alpha.save(path.with_file_name(format!("{stem}_alpha.png"))).unwrap();
    let color = |x, y| match picture.get_pixel(x, y).0 {
        [.., 0] => image::Rgb([255; 3]),
        [r, g, b, _] => image::Rgb([r, g, b]),
    };
    RgbImage::from_fn(width, height, color).save(path).unwrap();
}

#[test]
fn a_dry_run_names_every_command_and_writes_nothing() {
    if !has_python(MODULES) {
        return;
    }
    let suite = Suite::new();
    let words = ["--scenes", "car,ball", "--seeds", "0,7", "-r", "2", "--lpips", "vgg.onnx", "--dry-run"];
    let [printed, _] = suite.printed(&words);
    let trainings: Vec<&str> = printed.lines().filter(|line| line.contains(" train ")).collect();
    assert_eq!(trainings.len(), 2 * 3 * 2, "two scenes, three profiles, two seeds: {printed}");
    let last = "--eval --profile specula --seed 7 --background white --iterations 30000 --resolution 2";
    assert!(trainings[11].contains(last), "{printed}");
    assert_eq!(
        printed.lines().filter(|line| line.contains(" eval ") && line.ends_with("--lpips vgg.onnx")).count(),
        12
    );
    assert!(!suite.out().exists());

    let refused = suite.run(&["--dry-run"]);
    let words = String::from_utf8(refused.stderr).unwrap();
    assert!(!refused.status.success() && words.contains("coffee, helmet, teapot, toaster"), "{words}");
}

#[test]
fn one_command_trains_and_measures_a_suite_and_continues_where_it_was_interrupted() {
    if !has_python(MODULES) {
        return;
    }
    let suite = Suite::new();
    let words = [&["--scenes", "ball,car"][..], &WORDS].concat();
    let [table, said] = suite.printed(&words);
    assert!(said.contains("[4/4] car, 3dgs, seed 1"), "{said}");
    assert_eq!(fs::read_to_string(suite.out().join("table.md")).unwrap(), table);
    assert!(table.contains("\n| ball | 3dgs | 2 | ") && table.contains(" ± "), "{table}");
    assert!(fs::read_to_string(suite.out().join("runs.tex")).unwrap().contains("\n\\begin{tabular}"));

    for measure in ["PSNR", "SSIM", "MAE", "MAE_weighted"] {
        let [ball, car] = ["ball", "car"].map(|scene| suite.recorded(scene, measure));
        assert_ne!(ball[0], ball[1], "{measure}: seeds differ");
        let suite_means = [0, 1].map(|seed| (ball[seed] + car[seed]) / 2.0);
        for (scene, [one, other]) in [("ball", ball), ("car", car), ("all scenes", suite_means)] {
            let row = suite.row(scene);
            assert!((row(measure) - (one + other) / 2.0).abs() < ROUNDING, "{scene}: {measure}");
            let deviation = (one - other).abs() / 2.0_f64.sqrt();
            assert!((row(&format!("{measure} deviation")) - deviation).abs() < ROUNDING, "{scene}: {measure}");
        }
    }
    assert!(suite.row("car")("seconds") > 0.0 && suite.row("car")("gaussians") >= 1.0);

    let results = |seed| suite.model("car", seed).join("results.json");
    let [first, second] = SEEDS.map(|seed| fs::read(results(seed)).unwrap());
    fs::remove_file(results("1")).unwrap();
    let [_, said] = suite.printed(&words);
    assert_eq!(said.matches("finished before").count(), 3, "{said}");
    assert!(said.contains("all 30 iterations are done already"), "the checkpoint is continued: {said}");
    assert_eq!(SEEDS.map(|seed| fs::read(results(seed)).unwrap()), [first, second]);

    let other: Vec<&str> = words.iter().map(|word| if *word == "30" { "31" } else { *word }).collect();
    let refused = suite.run(&other);
    let words = String::from_utf8(refused.stderr).unwrap();
    assert!(!refused.status.success() && words.contains("holds trainings with iterations 30, not 31"), "{words}");
}
