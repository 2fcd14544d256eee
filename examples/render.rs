//! A PLY of Gaussians to a picture, on the processor: `render [SCENE.ply] [PICTURE.png]`.
//!
//! The scene may be of any trainer that writes the field's layout. Without one, a ring of Gaussians is shown.

use core::error::Error;
use specula_core::{
    camera::Camera,
    executor::{RenderRules, Renderer},
    plan::Channels,
    prefilter::PrefilterScheme,
    scene::Gaussians,
    shade::ShadingRules,
};
use specula_cpu::CpuExecutor;
use specula_examples::ring;
use specula_io::{gaussian_ply, picture};
use specula_train::evaluate::{over_background, render_view};
use std::path::Path;

const WHITE: [f32; 3] = [1.0; 3];

/// Colours over white, three planes.
fn picture_of(gaussians: &Gaussians<Vec<f32>>, camera: &Camera) -> Result<Vec<f32>, Box<dyn Error>> {
    let mut exec = CpuExecutor::new();
    let scene = exec.upload_gaussians(gaussians)?;
    // Light is looked up where a scene has some; `Renderer::prefilter` makes it.
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    let image = render_view(&mut exec, &scene, None, camera, &RenderRules { is_lit: false, ..rules })?;
    Ok(over_background(&image, WHITE))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1).filter(|name| name.ends_with(".ply") || name.ends_with(".png"));
    let gaussians = match arguments.next().filter(|name| name.ends_with(".ply")) {
        Some(path) => gaussian_ply::read(Path::new(&path))?.gaussians,
        None => ring(),
    };
    let eye = glam::Vec3::new(2.0, -2.5, 1.5);
    let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.8, 640, 480);
    let colors = picture_of(&gaussians, &camera)?;
    let place = arguments.next().unwrap_or_else(|| "ring.png".to_owned());
    picture::write_rgb(Path::new(&place), 640, 480, &colors, None)?;
    println!("{} Gaussians in {place}", gaussians.count);
    Ok(())
}

#[test]
fn the_ring_is_round_and_the_rest_white() {
    let eye = glam::Vec3::new(0.0, 0.0, 3.5);
    let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Y, 0.8, 64, 64);
    let colors = picture_of(&ring(), &camera).unwrap();
    let [middle, corner] = [32 * 64 + 32, 0].map(|pixel| colors[pixel]);
    assert_eq!([middle, corner], [1.0, 1.0], "nothing is there");
    assert!(colors.iter().any(|color| *color < 0.5), "the ring is");
}
