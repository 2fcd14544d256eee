//! Frames of an engine on the CPU: Gaussians between its own surfaces, in its own memory, part by
//! part, while some of them move: `engine [FOLDER]`.

use core::error::Error;
use glam::{DQuat, DVec3, Vec3};
use specula_core::{
    camera::{Camera, Scissor},
    occlusion::DepthRange,
    rules::Channels,
};
use specula_cpu::CpuExecutor;
use specula_examples::ring;
use specula_io::picture;
use specula_scene::{Behind, FrameRequest, Scene, SceneRenderer, ShadingModel, Similarity, Surfaces, Target};
use std::path::PathBuf;

const WIDTH: usize = 480;
const HEIGHT: usize = 360;
/// Near plane of the engine, whose depth buffer is reversed and has no far plane.
const NEAR: f32 = 0.1;
/// Distance of the engine's wall, which stands in the middle of the ring.
const WALL: f32 = 3.5;

/// Memory of an engine, with what it has drawn before: a sky, and a wall in the left half of the
/// picture.
struct Engine {
    pixels: Vec<u8>,
    depth_buffer: Vec<f32>,
}

impl Engine {
    fn new() -> Self {
        let is_wall = |pixel: usize| pixel % WIDTH < WIDTH / 2;
        let color = |pixel: usize| if is_wall(pixel) { [90, 80, 70, 255] } else { [50, 100, 200, 255] };
        let value = |pixel: usize| if is_wall(pixel) { NEAR / WALL } else { 0.0 };
        Self {
            pixels: (0..WIDTH * HEIGHT).flat_map(color).collect(),
            depth_buffer: (0..WIDTH * HEIGHT).map(value).collect(),
        }
    }

    /// Draws the Gaussians of a renderer over it, in two parts.
    fn draw(&mut self, renderer: &mut SceneRenderer, camera: &Camera) -> Result<(), Box<dyn Error>> {
        let surfaces = Surfaces::Buffer(&self.depth_buffer, DepthRange::reversed(NEAR, f32::INFINITY));
        for x in [0, WIDTH as u32 / 2] {
            let part = Scissor { x, y: 0, width: WIDTH as u32 / 2, height: HEIGHT as u32 };
            let request = FrameRequest::new(camera).behind(surfaces).within(part);
            renderer.render_into(&request, Target::Rgba8(&mut self.pixels, 4 * WIDTH), Behind::Contents, None)?;
        }
        Ok(())
    }
}

fn camera() -> Camera {
    let eye = Vec3::new(0.0, -3.0, 1.8);
    Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.9, WIDTH as u32, HEIGHT as u32)
}

fn scene() -> Scene {
    Scene::unlit(ring(), ShadingModel::PAPER)
}

/// Lifts the second half of the Gaussians, and uploads only these.
fn lift(scene: &mut Scene, renderer: &mut SceneRenderer) -> Result<(), Box<dyn Error>> {
    let moved = scene.gaussians.count / 2..scene.gaussians.count;
    let lift = Similarity::new(DQuat::from_rotation_x(0.3), 1.0, DVec3::Z * 0.4);
    lift.transform(&mut scene.gaussians, moved.clone());
    renderer.update(scene, moved)?;
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).map(PathBuf::from).unwrap_or_default();
    let mut scene = scene();
    let mut renderer = scene.renderer(CpuExecutor::new(), Channels::Color)?;
    for name in ["ring.png", "lifted.png"] {
        let mut engine = Engine::new();
        engine.draw(&mut renderer, &camera())?;
        let plane = |c: usize| engine.pixels.chunks_exact(4).map(move |pixel| f32::from(pixel[c]) / 255.0);
        let colors: Vec<f32> = (0..3).flat_map(plane).collect();
        picture::write_rgb(&folder.join(name), WIDTH, HEIGHT, &colors, None)?;
        lift(&mut scene, &mut renderer)?;
    }
    Ok(())
}

#[test]
fn splats_are_before_the_wall_and_move() {
    let (mut scene, camera) = (scene(), camera());
    let mut renderer = scene.renderer(CpuExecutor::new(), Channels::Color).unwrap();
    let picture = |renderer: &mut SceneRenderer, has_wall: bool| {
        let mut engine = Engine::new();
        if !has_wall {
            engine.depth_buffer.fill(0.0);
        }
        engine.draw(renderer, &camera).unwrap();
        engine.pixels
    };
    let (ring, without_wall) = (picture(&mut renderer, true), picture(&mut renderer, false));
    let empty = Engine::new().pixels;
    let differs = |a: &[u8], b: &[u8], side: usize| {
        let pixels = a.as_chunks::<4>().0.iter().zip(b.as_chunks::<4>().0).enumerate();
        pixels.filter(|(k, (a, b))| k % WIDTH * 2 / WIDTH == side && a != b).count()
    };
    assert!(differs(&ring, &empty, 0) > 1000, "splats are before the wall");
    assert!(differs(&ring, &without_wall, 0) > 1000, "others are behind it");
    assert_eq!(differs(&ring, &without_wall, 1), 0, "there is no wall on the right");

    lift(&mut scene, &mut renderer).unwrap();
    let lifted = picture(&mut renderer, true);
    assert!(differs(&ring, &lifted, 1) > 1000, "half of the ring has moved");
    let mut fresh = scene.renderer(CpuExecutor::new(), Channels::Color).unwrap();
    assert!(picture(&mut fresh, true) == lifted, "and is where a new renderer draws it");
}
