//! Error of exported Gaussians: their pictures against those of the original scene.

use crate::{RenderOptions, Scene, SceneError, SceneRenderer, ShadingModel, upright::Upright};
use core::fmt;
use specula_core::{camera::Camera, metrics::psnr, rules::Channels, scene::Gaussians};
use specula_train::evaluate::{mean_squared_error, over_background};

/// Mean squared error that stands for zero: one wrong 8-bit step in one of a thousand pixels.
const SQUARED_ERROR_MIN: f64 = 1e-3 / (255.0 * 255.0);

/// Reference pictures of a scene for its exported Gaussians.
#[derive(Clone, Debug)]
pub struct ReferencePictures {
    cameras: Vec<Camera>,
    background: [f32; 3],
    options: RenderOptions,
    /// Colours over the background, camera by camera.
    pictures: Vec<Vec<f32>>,
}

impl ReferencePictures {
    /// Renders a scene over a background in sRGB. `progress` receives the number of pictures so
    /// far.
    ///
    /// # Errors
    ///
    /// Those of [`SceneRenderer::new`] and of [`SceneRenderer::render`].
    pub fn render(
        scene: Scene,
        cameras: Vec<Camera>,
        background: [f32; 3],
        options: RenderOptions,
        progress: impl FnMut(usize),
    ) -> Result<Self, SceneError> {
        let pictures = pictures(scene, &cameras, background, &options, progress)?;
        Ok(Self { cameras, background, options, pictures })
    }

    /// Number of pictures.
    pub fn count(&self) -> usize {
        self.pictures.len()
    }

    /// Compares the pictures of exported Gaussians, which may be placed upright.
    ///
    /// # Errors
    ///
    /// Those of [`ReferencePictures::render`].
    pub fn compare(
        &self,
        gaussians: Gaussians<Vec<f32>>,
        placed: Option<&Upright>,
        progress: impl FnMut(usize),
    ) -> Result<PictureError, SceneError> {
        let scene = Scene::unlit(gaussians, ShadingModel::PAPER);
        self.compare_scene(scene, placed, progress)
    }

    /// Compares the pictures of another scene, which may be placed upright.
    ///
    /// # Errors
    ///
    /// Those of [`ReferencePictures::render`].
    pub fn compare_scene(
        &self,
        scene: Scene,
        placed: Option<&Upright>,
        progress: impl FnMut(usize),
    ) -> Result<PictureError, SceneError> {
        let camera = |camera: &Camera| placed.map_or(*camera, |upright| upright.camera(camera));
        let cameras: Vec<Camera> = self.cameras.iter().map(camera).collect();
        self.compare_from(scene, &cameras, progress)
    }

    fn compare_from(
        &self,
        scene: Scene,
        cameras: &[Camera],
        progress: impl FnMut(usize),
    ) -> Result<PictureError, SceneError> {
        let pictures = pictures(scene, cameras, self.background, &self.options, progress)?;
        let pairs = self.pictures.iter().zip(&pictures);
        let errors: Vec<f64> = pairs.map(|(reference, exported)| mean_squared_error(reference, exported)).collect();
        let views = errors.len();
        if errors.iter().all(|error| *error == 0.0) {
            return Ok(PictureError { views, psnr: None });
        }
        let sum: f64 = errors.iter().map(|error| psnr(error.max(SQUARED_ERROR_MIN))).sum();
        Ok(PictureError { views, psnr: Some(sum / views as f64) })
    }
}

/// Difference between exported Gaussians and their scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureError {
    /// Number of pictures.
    pub views: usize,
    /// Mean PSNR in dB; none if no picture differs.
    pub psnr: Option<f64>,
}

impl fmt::Display for PictureError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { views, psnr } = self;
        match psnr {
            None => write!(out, "its pictures equal specula's own ({views} views)"),
            Some(psnr) => write!(out, "PSNR {psnr:.2} dB against specula's own pictures ({views} views)"),
        }
    }
}

/// Colours of a scene over a background, camera by camera.
fn pictures(
    scene: Scene,
    cameras: &[Camera],
    background: [f32; 3],
    options: &RenderOptions,
    mut progress: impl FnMut(usize),
) -> Result<Vec<Vec<f32>>, SceneError> {
    let mut renderer = SceneRenderer::new(scene, Channels::Color, options)?;
    let mut pictures = Vec::new();
    for camera in cameras {
        pictures.push(over_background(&renderer.render(camera)?, background));
        progress(pictures.len());
    }
    Ok(pictures)
}
