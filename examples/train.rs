//! A data set to a model: `train DATASET OUT.ply [ITERATIONS]`. DATASET may be anything that
//! `specula train` reads.

use core::error::Error;
use specula_core::scene::Gaussians;
use specula_cpu::CpuExecutor;
use specula_io::{
    dataset::{self, LoadOptions},
    gaussian_ply,
};
use specula_train::{
    profile::by_name,
    start::Point,
    trainer::{Settings, Trainer},
    view::View,
};
use std::path::Path;

/// Number of random points, for data sets without any.
const RANDOM_POINTS: usize = 5000;

/// Fits plain Gaussians; `progress` hears of every step: its number, and the PSNR of late steps in
/// dB.
fn fit(
    views: &[View],
    points: &[Point],
    iterations: u32,
    mut progress: impl FnMut(u32, f64),
) -> Result<Gaussians<Vec<f32>>, Box<dyn Error>> {
    // Or "specula" for a scene that can be put under another light.
    let profile = by_name("3dgs", iterations).ok_or("no such profile")?;
    let settings = Settings { profile, iterations, seed: 0, background: [1.0; 3], random_points: RANDOM_POINTS };
    let mut trainer = Trainer::new(CpuExecutor::new(), settings, views, points)?;
    while !trainer.is_finished() {
        trainer.step()?;
        progress(trainer.iteration(), trainer.psnr().unwrap_or(f64::NAN));
    }
    Ok(trainer.download()?.gaussians)
}

/// The pictures of a data set, as a training takes them.
fn views_of(folder: &Path) -> Result<Vec<View>, Box<dyn Error>> {
    let data = dataset::load(folder, &LoadOptions::default(), |_, _| {})?;
    let view = |view: dataset::View| View {
        name: view.name,
        camera: view.camera,
        rgba: view.image.rgba,
        unclipped: None,
        normals: None,
    };
    Ok(data.train.into_iter().map(view).collect())
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, place, rest @ ..] = arguments.as_slice() else {
        println!("train DATASET OUT.ply [ITERATIONS]");
        return Ok(());
    };
    let iterations = rest.first().map_or(Ok(1000), |number| number.parse())?;
    let gaussians = fit(&views_of(Path::new(folder))?, &[], iterations, |iteration, psnr| {
        if iteration.is_multiple_of(100) {
            println!("{iteration} of {iterations}: {psnr:.2} dB");
        }
    })?;
    gaussian_ply::write(Path::new(place), &gaussians, &[])?;
    println!("{} Gaussians in {place}", gaussians.count);
    Ok(())
}

#[test]
fn a_grey_square_is_learned() {
    let eye = glam::Vec3::new(0.0, -3.0, 0.5);
    let camera = specula_core::camera::Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, 32, 32);
    let views = [View {
        name: "square".into(),
        camera,
        rgba: [100, 100, 100, 255].repeat(32 * 32),
        unclipped: None,
        normals: None,
    }];
    let mut heard = Vec::new();
    fit(&views, &[], 60, |_, psnr| heard.push(psnr)).unwrap();
    assert_eq!(heard.len(), 60, "every step is heard of");
    assert!(heard[59] > heard[0] + 1.0, "{heard:?}");
}
