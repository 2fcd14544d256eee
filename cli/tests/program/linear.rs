//! Trainings of linear pictures, with radiance above white.

use crate::tiny::{Tiny, specula, train_plain};
use assert_cmd::Command;
use image::{Rgba, Rgba32FImage};
use serde_json::Value;
use specula_core::color::linear_from_srgb;
use std::fs;

/// Brightness of the linear pictures against those of 8 bits.
const BRIGHTER: f32 = 8.0;

/// The tiny data set as OpenEXR, brighter, with colours multiplied by alpha; the pictures of 8 bits
/// are cut off.
fn write_linear(tiny: &Tiny, pictures: &str, count: usize) {
    for index in 0..count {
        let path = tiny.file(&format!("{pictures}/r_{index}.png"));
        let shown = image::open(&path).unwrap().to_rgba8();
        let linear = Rgba32FImage::from_fn(shown.width(), shown.height(), |x, y| {
            let [r, g, b, a] = shown.get_pixel(x, y).0.map(|byte| f32::from(byte) / 255.0);
            let number = |number: f32| BRIGHTER * a * linear_from_srgb(number);
            Rgba([number(r), number(g), number(b), a])
        });
        linear.save(path.with_extension("exr")).unwrap();
        fs::remove_file(path).unwrap();
    }
}

/// Words of a training of plain Gaussians that sees bright ones.
fn train(tiny: &Tiny, model: &str) -> Command {
    let mut command = specula();
    command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path(model)).arg("--eval");
    command.args(["--iterations", "1000", "--random-points", "200", "--profile", "3dgs", "--executor", "cpu"]);
    command
}

fn measures(tiny: &Tiny, model: &str) -> Value {
    let results: Value = serde_json::from_slice(&fs::read(tiny.path(model).join("results.json")).unwrap()).unwrap();
    results.as_object().unwrap().values().next().unwrap().clone()
}

#[test]
fn linear_pictures_are_fitted_above_white() {
    let tiny = Tiny::new();
    write_linear(&tiny, "train", 8);
    write_linear(&tiny, "test", 3);
    let output = train(&tiny, "linear").assert().success().get_output().clone();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("11 pictures are linear, with radiance above white"), "{said}");
    assert!(String::from_utf8(output.stdout).unwrap().contains("PSNR of linear radiance"));

    let numbers = tiny.path("numbers");
    specula().arg("render").arg(tiny.path("linear")).args(["--exr", "-o"]).arg(&numbers).assert().success();
    let rendered = image::open(numbers.join("rgb/00000.exr")).unwrap().to_rgba32f();
    let most = rendered.pixels().flat_map(|pixel| pixel.0).fold(0.0, f32::max);
    assert!(most > 0.5 * BRIGHTER, "the brightest pixel has {most}");

    // The same pictures as a display shows them say nothing of it.
    train(&tiny, "shown").args(["--input-space", "srgb"]).assert().success();
    let [linear, shown] = ["linear", "shown"].map(|model| measures(&tiny, model));
    assert!(linear["PSNR_linear"].is_number() && linear["PSNR"].is_number(), "{linear}");
    assert!(shown["PSNR_linear"].is_number(), "numbers of OpenEXR are not cut off in any space: {shown}");
}

#[test]
fn unknown_spaces_are_refused() {
    let tiny = Tiny::new();
    let refused = train_plain(&tiny, "model").args(["--input-space", "aces"]).assert().code(2).get_output().clone();
    let said = String::from_utf8(refused.stderr).unwrap();
    assert!(said.contains("expected auto, srgb, linear or acescg"), "{said}");
}
