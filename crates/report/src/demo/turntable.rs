//! Turntable of the demo: the scene on ground that catches its shadow, under a light and a sun that
//! turn.

use super::trainings::Orbit;
use crate::error::Result;
use specula_core::rules::Channels;
use specula_io::{
    latlong::LatLong,
    picture::{self, DynamicImage},
};
use specula_scene::{
    ExecutorChoice, Lighting, RenderOptions, Scene, SceneRenderer,
    backdrop::{Backdrop, BackgroundColor},
    ground::GroundPlane,
    lamps::{LampColor, SunChoice},
    light_file::MapUp,
};
use std::path::Path;

/// Sun, low and warm, and wide enough for soft shadows.
const SUN: SunChoice =
    SunChoice { azimuth: 30.0, elevation: 38.0, strength: 2.5, diameter: 4.0, color: LampColor([255, 226, 196]) };
/// Share of the environment's light in addition to the sun.
const ENVIRONMENT: f32 = 0.6;
/// Full turns of the light, in the opposite direction, per turn of the camera.
const TURNS: f32 = -1.0;
/// Duration of a frame in milliseconds.
const FRAME_MS: u16 = 120;

/// Renders a scene of materials from the cameras of an orbit and writes an animation.
pub(super) fn write(path: &Path, scene: &Scene, orbit: &Orbit, map: &LatLong) -> Result<()> {
    let mut scene = scene.clone();
    let map = LatLong { rgb: map.rgb.iter().map(|radiance| ENVIRONMENT * radiance).collect(), ..map.clone() };
    let mut lighting = Lighting {
        map: Some(map),
        map_up: MapUp::Z,
        suns: vec![SUN],
        ground: scene.near_field.clone().and_then(|surface| GroundPlane::new(surface, orbit.up, None)),
        occluder: scene.near_field.clone(),
        ..Lighting::default()
    };
    lighting.light(&mut scene, orbit.up)?;
    let options = RenderOptions::full_precision(ExecutorChoice::Cpu);
    let mut renderer = SceneRenderer::new(scene.clone(), Channels::Color, &options)?;
    let mut frames: Vec<DynamicImage> = Vec::with_capacity(orbit.cameras.len());
    for (index, camera) in orbit.cameras.iter().enumerate() {
        if index > 0 {
            lighting.turn = 360.0 * TURNS * index as f32 / orbit.cameras.len() as f32;
            lighting.update(&mut scene, &mut renderer, orbit.up, &options)?;
        }
        let backdrop = lighting.grounded(Backdrop::Color(BackgroundColor::WHITE), &scene);
        frames.push(backdrop.picture(&renderer.render(camera)?, camera));
    }
    Ok(picture::write_animation(path, &frames, FRAME_MS)?)
}
