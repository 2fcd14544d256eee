//! Errors and times of lamps: shadow rays, shadows, and interreflections.

use crate::{
    error::{Error, Result},
    tradeoff::progress::StartProgress,
};
use core::time::Duration;
use glam::Vec3;
use specula_accuracy::{
    error::{Errors, Sums},
    reference::Exact,
    trial::Spread,
};
use specula_core::{
    camera::Camera,
    lamps::{RAYS, RAYS_MAX},
    near_field::{NearField, VERTEX_ALBEDO},
    rules::{Channels, channel},
    scene::Image,
};
use specula_scene::{
    ExecutorChoice, RenderOptions, Scene, SceneRenderer, Shading, Surface,
    lamps::{InvalidSun, SceneLamps, SunChoice},
};
use specula_train::evaluate::over_background;
use std::{sync::Arc, time::Instant};

/// Sun of the measurement: wide enough for soft shadows.
const SUN: &str = "40,40,3,3";
/// Shadow rays of the settings.
const RAYS_OF_SETTINGS: [usize; 6] = [1, 4, 8, RAYS, 128, RAYS_MAX];

/// Heads of the table of suns.
pub(super) const HEADS: [&str; 7] = ["shadows", "PSNR", "RMS", "max error", "FLIP", "ms", "ms to place"];

/// Setting of a sun's shadows, measured.
#[derive(Clone, Debug)]
pub struct LampSetting {
    /// Shadow rays of a pixel; `None` without shadows.
    pub rays: Option<usize>,
    /// Whether surfaces reflect the sun's light onto each other.
    pub is_reflected: bool,
    /// Errors against the largest number of rays, with interreflections.
    pub errors: Errors,
    /// Milliseconds of placing the sun, in a scene that already had one.
    pub placing: f64,
    /// Milliseconds of a picture.
    pub times: Spread,
}

impl LampSetting {
    /// Cells of [`HEADS`].
    pub(super) fn row(&self) -> [String; 7] {
        let Self { errors, placing, times, .. } = self;
        [
            self.label(),
            format!("{:.1} dB", errors.psnr),
            format!("{:.1e}", errors.rms),
            format!("{:.1e}", errors.max),
            format!("{:.1e}", errors.flip),
            format!("{:.1}", times.min),
            format!("{placing:.1}"),
        ]
    }

    fn label(&self) -> String {
        match self.rays {
            None => "no shadows".into(),
            Some(rays) => {
                let default = if rays == RAYS && self.is_reflected { " (default)" } else { "" };
                let rest = if self.is_reflected { "" } else { ", nothing reflected" };
                format!("{rays} ray{}{rest}{default}", if rays == 1 { "" } else { "s" })
            }
        }
    }
}

/// Scene with the means to measure a sun on it.
#[derive(Debug)]
pub struct LampSubject<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Up direction.
    pub up: Vec3,
    /// Views.
    pub cameras: &'a [Camera],
    /// Background in sRGB.
    pub background: [f32; 3],
}

/// Measures a sun on a scene, on the CPU; nothing if the scene has no physical materials, or no
/// shadow-casting surface. Errors are those of sRGB colours over a background.
///
/// # Errors
///
/// Those of [`SceneRenderer::render`].
pub fn lamp_settings(
    subject: &LampSubject<'_>,
    repeats: u32,
    progress: &StartProgress<'_>,
) -> Result<Vec<LampSetting>> {
    let LampSubject { scene, up, cameras, background } = *subject;
    let Some(surface) = scene.near_field.as_ref().filter(|_| scene.gaussians.layout.is_physical) else {
        return Ok(Vec::new());
    };
    let sun: SunChoice = SUN.parse().map_err(|error: InvalidSun| Error::Input(error.to_string()))?;
    let of =
        |rays: usize, occluder: Option<Arc<Surface>>| SceneLamps { lamps: vec![sun.lamp(up, 0.0)], rays, occluder };
    // The same surface, black: it casts shadows and reflects nothing.
    let black = Arc::new(surface.recolored(blacken));
    let mut settings = vec![(None, false, of(1, None)), (Some(RAYS_MAX), false, of(RAYS_MAX, Some(black)))];
    // Fewer than eight rays are a preview without interreflections.
    settings.extend(RAYS_OF_SETTINGS.map(|rays| (Some(rays), rays >= 8, of(rays, Some(surface.clone())))));

    let mut lit = scene.clone().shaded(Shading::Physical)?;
    lit.add_lamps(of(RAYS_MAX, Some(surface.clone())))?;
    let mut renderer =
        SceneRenderer::new(lit, Channels::Training, &RenderOptions::full_precision(ExecutorChoice::Cpu))?;
    let exact =
        pictures(&mut renderer, cameras)?.0.iter().map(|picture| exact(picture, background)).collect::<Vec<_>>();

    let advance = progress("suns", settings.len() as u64);
    let mut measured = Vec::new();
    for (rays, is_reflected, lamps) in settings {
        // The first placement traces the surface's view of itself, which is cached.
        renderer.add_lamps(SceneRenderer::SCENE_LIGHT, &lamps)?;
        let begin = Instant::now();
        renderer.add_lamps(SceneRenderer::SCENE_LIGHT, &lamps)?;
        let placing = milliseconds(begin.elapsed());
        let mut sums = Sums::default();
        for (picture, exact) in pictures(&mut renderer, cameras)?.0.iter().zip(&exact) {
            sums.add(picture, exact, background);
        }
        let times = (0..repeats).map(|_| Ok(pictures(&mut renderer, cameras)?.1 / cameras.len().max(1) as f64));
        let times = Spread::of(times.collect::<Result<_>>()?);
        measured.push(LampSetting { rays, is_reflected, errors: sums.errors(), placing, times });
        advance(measured.len() as u64);
    }
    Ok(measured)
}

fn blacken(surface: &mut NearField<Vec<f32>>) {
    surface.vertices_mut().iter_mut().for_each(|numbers| numbers[VERTEX_ALBEDO..VERTEX_ALBEDO + 3].fill(0.0));
}

/// Pictures of the views, and the milliseconds of all.
fn pictures(renderer: &mut SceneRenderer, cameras: &[Camera]) -> Result<(Vec<Image<Vec<f32>>>, f64)> {
    let begin = Instant::now();
    let all = cameras.iter().map(|camera| renderer.render(camera)).collect::<core::result::Result<Vec<_>, _>>()?;
    Ok((all, milliseconds(begin.elapsed())))
}

fn milliseconds(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

/// A picture as the exact one.
fn exact(picture: &Image<Vec<f32>>, background: [f32; 3]) -> Exact {
    let shown = over_background(picture, background).into_iter().map(f64::from).collect();
    let pixels = 0..picture.pixel_count();
    let transmittance = picture.plane(picture.channels - 1);
    Exact {
        colors: Image { width: picture.width, height: picture.height, channels: 3, values: shown },
        normals: pixels.clone().map(|pixel| [0, 1, 2].map(|k| picture.plane(channel::NORMAL + k)[pixel])).collect(),
        coverage: pixels.map(|pixel| 1.0 - f64::from(transmittance[pixel])).collect(),
    }
}
