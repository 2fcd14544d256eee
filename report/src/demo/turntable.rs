//! Turntable of the demo: the scene on ground that catches its shadow, under a light and a sun that
//! turn.

use super::trainings::Orbit;
use crate::error::Result;
use specula_core::{camera::Camera, lamps::RAYS, rules::Channels, scene::Image};
use specula_io::{
    latlong::{LatLong, UpAxis},
    picture::{self, DynamicImage},
};
use specula_scene::{
    ExecutorChoice, RenderOptions, Scene, SceneRenderer,
    backdrop::{Backdrop, BackgroundColor},
    ground::Ground,
    lamps::{LampColor, SceneLamps, SunChoice, turned},
};
use std::{path::Path, sync::Arc};

/// Sun, low and warm, and wide enough for soft shadows.
const SUN: SunChoice =
    SunChoice { azimuth: 30.0, elevation: 38.0, strength: 2.5, diameter: 4.0, color: LampColor([255, 226, 196]) };
/// Share of the environment's light beside the sun.
const ENVIRONMENT: f32 = 0.6;
/// Full turns of the light while the camera goes around once, against it.
const TURNS: f32 = -1.0;
/// Duration of a frame in milliseconds.
const FRAME_MS: u16 = 120;

/// Renders a scene of materials from the cameras of an orbit and writes an animation.
pub(super) fn write(path: &Path, scene: &Scene, orbit: &Orbit, map: &LatLong) -> Result<()> {
    let mut scene = scene.clone();
    let occluder = scene.near_field.clone();
    let map = LatLong { rgb: map.rgb.iter().map(|radiance| ENVIRONMENT * radiance).collect(), ..map.clone() };
    let lamps = vec![SUN.lamp(orbit.up, 0.0)];
    scene.add_lamps(SceneLamps { lamps, rays: RAYS, occluder: occluder.clone() })?;
    scene.relight(&map, UpAxis::Z);
    let options = RenderOptions::full_precision(ExecutorChoice::Cpu);
    let mut renderer = SceneRenderer::new(scene.clone(), Channels::Color, &options)?;
    let rules = *renderer.rules();
    let mut frames: Vec<DynamicImage> = Vec::with_capacity(orbit.cameras.len());
    for (index, camera) in orbit.cameras.iter().enumerate() {
        let turn = 360.0 * TURNS * index as f32 / orbit.cameras.len() as f32;
        if let Some(lamps) = &mut scene.lamps {
            lamps.lamps = vec![SUN.lamp(orbit.up, turn)];
            renderer.set_lamps(&lamps.lamps)?;
        }
        scene.relight(&map, turned(UpAxis::Z.into(), orbit.up, turn));
        renderer.set_surface(&scene.gaussians, scene.near_field())?;
        if let Some(light) = scene.light_for(&rules) {
            renderer.set_light(SceneRenderer::SCENE_LIGHT, &light, &rules)?;
        }
        let ground = occluder
            .as_deref()
            .and_then(|occluder| Ground::new(occluder, orbit.up, None, scene.light.as_ref(), scene.lamps.as_ref()));
        frames.push(frame(&renderer.render(camera)?, camera, ground));
    }
    Ok(picture::write_animation(path, &frames, FRAME_MS)?)
}

fn frame(image: &Image<Vec<f32>>, camera: &Camera, ground: Option<Ground>) -> DynamicImage {
    let white = Backdrop::Color(BackgroundColor::WHITE);
    let backdrop = match ground {
        Some(ground) => Backdrop::Ground(Box::new(white), Arc::new(ground)),
        None => white,
    };
    backdrop.picture(image, camera)
}
