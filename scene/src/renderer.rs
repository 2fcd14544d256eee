//! A scene on an executor.

use specula_core::{
    camera::Camera,
    executor::{RenderRules, Renderer},
    scene::{Environment, Gaussians, Image},
};
use specula_io::picture::{self, RgbImage};
use specula_train::evaluate::{over_background, render_view};

/// Scene that was uploaded to an executor, its light filtered, with the rules of its pictures.
#[derive(Debug)]
pub struct SceneRenderer<E: Renderer> {
    exec: E,
    gaussians: Gaussians<E::Array>,
    light: Option<E::Light>,
    rules: RenderRules,
}

impl<E: Renderer> SceneRenderer<E> {
    pub(crate) fn new(
        mut exec: E,
        gaussians: &Gaussians<Vec<f32>>,
        light: Option<&Environment<Vec<f32>>>,
        rules: RenderRules,
    ) -> Result<Self, E::Error> {
        let gaussians = exec.upload_gaussians(gaussians)?;
        let light = match light {
            Some(light) => {
                let values = exec.upload(&light.values)?;
                Some(exec.prefilter(&light.with_values(values), rules.scheme, rules.levels)?)
            }
            None => None,
        };
        Ok(Self { exec, gaussians, light, rules })
    }

    /// View of the scene over a background in sRGB, with 8 bits a channel: the picture that `specula
    /// render` writes.
    ///
    /// # Errors
    ///
    /// Those of [`SceneRenderer::render`].
    pub fn picture(&mut self, camera: &Camera, background: [f32; 3]) -> Result<RgbImage, E::Error> {
        let image = self.render(camera)?;
        Ok(picture::rgb(image.width, image.height, &over_background(&image, background)))
    }

    /// View of the scene: its channels, premultiplied, then transmittance, plane by plane. Models that
    /// are shaded per pixel have more channels than were asked for; `Image::channels` counts them, and
    /// [`Channels::index_of`](specula_core::plan::Channels::index_of) finds one.
    ///
    /// # Errors
    ///
    /// Those of the executor: a picture with more splats in its tiles than can be counted, or a
    /// device that was lost.
    pub fn render(&mut self, camera: &Camera) -> Result<Image<Vec<f32>>, E::Error> {
        render_view(&mut self.exec, &self.gaussians, self.light.as_ref(), camera, &self.rules)
    }

    /// Rules of its pictures, without stages that the scene does not need.
    pub fn rules(&self) -> &RenderRules {
        &self.rules
    }
}
