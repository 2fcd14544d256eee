//! Pictures of a trained model, on the CPU: `render [MODEL] [FOLDER]`.
//!
//! MODEL is the folder of a training, or a PLY of any trainer that writes the field's layout. Each
//! held-out view becomes a PNG in FOLDER, the same as `specula render MODEL` writes, bit for bit.
//! Without a model, a ring of Gaussians is drawn.

use core::error::Error;
use specula_core::{camera::Camera, rules::Channels};
use specula_cpu::CpuExecutor;
use specula_examples::ring;
use specula_io::picture;
use specula_scene::{OpenedModel, Scene, ShadingModel};
use std::path::{Path, PathBuf};

const WHITE: [f32; 3] = [1.0; 3];

/// Writes the held-out views of a model; a view from beside it, where its cameras are not known.
fn draw_model(path: &Path, folder: &Path) -> Result<(), Box<dyn Error>> {
    let model = OpenedModel::open(path)?;
    let mut renderer = model.scene.renderer(CpuExecutor::new(), Channels::Color)?;
    let mut cameras: Vec<Camera> = model.test_cameras()?.into_iter().map(|(_, camera)| camera).collect();
    if cameras.is_empty() {
        cameras.push(camera_beside());
    }
    for (index, camera) in cameras.iter().enumerate() {
        let picture = renderer.picture(camera, model.background())?;
        picture::write(&folder.join(format!("{index:05}.png")), &picture)?;
    }
    println!("{} Gaussians in {} pictures", model.scene.gaussians.count, cameras.len());
    Ok(())
}

/// Writes a picture of a ring of plain Gaussians.
fn draw_ring(folder: &Path) -> Result<(), Box<dyn Error>> {
    let scene = Scene::unlit(ring(), ShadingModel::PAPER);
    let mut renderer = scene.renderer(CpuExecutor::new(), Channels::Color)?;
    picture::write(&folder.join("ring.png"), &renderer.picture(&camera_beside(), WHITE)?)?;
    Ok(())
}

fn camera_beside() -> Camera {
    Camera::look_at(glam::Vec3::new(2.0, -2.5, 1.5), glam::Vec3::ZERO, glam::Vec3::Z, 0.8, 640, 480)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let model = arguments.next();
    let folder = arguments.next().unwrap_or_default();
    match model {
        Some(model) => draw_model(&model, &folder),
        None => draw_ring(&folder),
    }
}

#[test]
fn the_ring_is_round_and_the_rest_white() {
    let eye = glam::Vec3::new(0.0, 0.0, 3.5);
    let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Y, 0.8, 64, 64);
    let scene = Scene::unlit(ring(), ShadingModel::PAPER);
    let picture = scene.renderer(CpuExecutor::new(), Channels::Color).unwrap().picture(&camera, WHITE).unwrap();
    let [middle, corner] = [[32, 32], [0, 0]].map(|[x, y]| picture.get_pixel(x, y).0);
    assert_eq!([middle, corner], [[255; 3]; 2], "nothing is there");
    assert!(picture.pixels().any(|pixel| pixel.0[0] < 128), "the ring is");
}

#[test]
fn a_model_is_drawn_with_its_own_shading() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ring.ply");
    specula_io::gaussian_ply::write(&path, &ring(), &[]).unwrap();
    draw_model(&path, folder.path()).unwrap();
    assert!(folder.path().join("00000.png").is_file());
}
