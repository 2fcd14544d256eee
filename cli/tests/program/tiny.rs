//! A data set of a few small pictures, made up for tests.

use assert_cmd::{Command, cargo::cargo_bin_cmd};
use core::fmt::Write;
use image::RgbaImage;
use std::{
    fs,
    path::{Path, PathBuf},
};
use tempfile::TempDir;

/// Pixels along an edge.
pub(crate) const SIZE: u32 = 32;
const DISTANCE: f32 = 4.0;
/// Horizontal field of view, in radians.
const ANGLE: f32 = 0.7;
const RADIUS: f32 = 1.0;

/// The program.
pub(crate) fn specula() -> Command {
    cargo_bin_cmd!("specula")
}

/// A folder that goes away, with a data set in it.
pub(crate) struct Tiny {
    root: TempDir,
}

impl Tiny {
    /// Eight views to fit and three to measure by, the latter with normals.
    pub(crate) fn new() -> Self {
        let tiny = Self { root: tempfile::tempdir().unwrap() };
        tiny.write_split("train", 8, 0.0, false);
        tiny.write_split("test", 3, 0.3, true);
        tiny
    }

    /// A path beside the data set.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.root.path().join(name)
    }

    /// The data set.
    pub(crate) fn data(&self) -> PathBuf {
        self.path("data")
    }

    /// A file of the data set.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.data().join(name)
    }

    fn write_split(&self, split: &str, count: u32, start: f32, with_normals: bool) {
        fs::create_dir_all(self.file(split)).unwrap();
        let mut frames = String::new();
        for index in 0..count {
            let turn = start + core::f32::consts::TAU * index as f32 / count as f32;
            let axes = axes(turn);
            let normals = with_normals.then(|| self.file(&format!("{split}/r_{index}_normal.png")));
            draw(&axes, &self.file(&format!("{split}/r_{index}.png")), normals.as_deref());
            let [x, y, z] = axes;
            let row = |k: usize| format!("[{}, {}, {}, {}]", x[k], y[k], z[k], DISTANCE * z[k]);
            let comma = if index > 0 { "," } else { "" };
            let rows = format!("[{}, {}, {}, [0, 0, 0, 1]]", row(0), row(1), row(2));
            write!(frames, "{comma}\n{{\"file_path\": \"./{split}/r_{index}\", \"transform_matrix\": {rows}}}")
                .unwrap();
        }
        let text = format!("{{\"camera_angle_x\": {ANGLE}, \"frames\": [{frames}\n]}}");
        fs::write(self.file(&format!("transforms_{split}.json")), text).unwrap();
    }
}

/// Right, up and backwards of a camera that looks at the origin, in the world.
fn axes(turn: f32) -> [[f32; 3]; 3] {
    let (sin, cos) = turn.sin_cos();
    let (low, high) = 0.4_f32.sin_cos();
    [[-sin, cos, 0.0], [-cos * low, -sin * low, high], [cos * high, sin * high, low]]
}

/// A ball whose colour is its normal, and the normals.
fn draw([right, up, back]: &[[f32; 3]; 3], path: &Path, normals: Option<&Path>) {
    let focal = 0.5 * SIZE as f32 / (0.5 * ANGLE).tan();
    let hit = |x: u32, y: u32| {
        let [a, b] = [x, y].map(|k| (k as f32 + 0.5 - 0.5 * SIZE as f32) / focal);
        let ray: [f32; 3] = core::array::from_fn(|k| a * right[k] - b * up[k] - back[k]);
        let eye = back.map(|component| component * DISTANCE);
        let dot = |u: &[f32; 3], v: &[f32; 3]| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
        let (squared, along) = (dot(&ray, &ray), dot(&ray, &eye));
        let root = along * along - squared * (DISTANCE * DISTANCE - RADIUS * RADIUS);
        (root > 0.0).then(|| {
            let distance = (-along - root.sqrt()) / squared;
            core::array::from_fn::<f32, 3, _>(|k| (eye[k] + distance * ray[k]) / RADIUS)
        })
    };
    let color = |normal: Option<[f32; 3]>| {
        let [r, g, b] = normal.unwrap_or_default().map(|n| (127.5 * (n + 1.0)) as u8);
        image::Rgba(if normal.is_some() { [r, g, b, 255] } else { [0; 4] })
    };
    let picture = RgbaImage::from_fn(SIZE, SIZE, |x, y| color(hit(x, y)));
    picture.save(path).unwrap();
    if let Some(path) = normals {
        picture.save(path).unwrap();
    }
}

/// Words of a training that takes a second.
pub(crate) fn train(tiny: &Tiny, model: &str) -> Command {
    let mut command = train_by_default(tiny, model);
    command.arg("--no-materials");
    command
}

/// Words of a training with the materials of its profile.
pub(crate) fn train_by_default(tiny: &Tiny, model: &str) -> Command {
    let mut command = short_training(tiny, model);
    command.args(["--light-resolution", "16"]);
    command
}

/// Words of a training with materials.
pub(crate) fn train_relightable(tiny: &Tiny, model: &str) -> Command {
    let mut command = train_by_default(tiny, model);
    command.arg("--relightable");
    command
}

/// Words of a training of plain Gaussians on the CPU.
pub(crate) fn train_plain(tiny: &Tiny, model: &str) -> Command {
    let mut command = short_training(tiny, model);
    command.args(["--profile", "3dgs", "--executor", "cpu"]);
    command
}

fn short_training(tiny: &Tiny, model: &str) -> Command {
    let mut command = specula();
    command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path(model));
    command.args(["--iterations", "30", "--random-points", "200"]);
    command
}

/// PSNR of pictures with 8 bits a channel, in dB.
pub(crate) fn psnr(one: &image::RgbImage, other: &image::RgbImage) -> f64 {
    assert_eq!(one.dimensions(), other.dimensions(), "the same size");
    let square = |(a, b): (&u8, &u8)| f64::from(a.abs_diff(*b)).powi(2);
    let mean = one.as_raw().iter().zip(other.as_raw()).map(square).sum::<f64>() / one.as_raw().len() as f64;
    10.0 * (255.0 * 255.0 / mean.max(1e-9)).log10()
}
