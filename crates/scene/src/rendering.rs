//! Pictures of a scene as files, layer by layer, and the comparison of planned pictures with
//! pictures of all stages.

use crate::{
    Layer, RenderOptions, Scene, SceneError, SceneRenderer, backdrop::Backdrop, camera_set::CameraSet,
    overlap::overlap, picture_folder::PictureFolder,
};
use rayon::prelude::*;
use specula_core::{
    camera::Camera,
    rules::{Channels, LightLayer, RenderRules},
    scene::Image,
    shade::ShadingForm,
};
use specula_io::{
    Result,
    picture::{self, DynamicImage},
    planes,
};
use specula_train::{evaluate::largest_difference, view::View};

/// Duration of a frame of an animation of this many, in milliseconds: together four seconds, if
/// each lasts 60 to 125.
pub fn frame_ms(frames: usize) -> u16 {
    (4000 / frames.max(1)).clamp(60, 125) as u16
}

/// Pictures to be rendered and written.
#[derive(Clone, Copy, Debug)]
pub struct PictureJob<'a> {
    /// Cameras.
    pub cameras: &'a CameraSet,
    /// Layers, each once.
    pub layers: &'a [Layer],
    /// Background of the colours.
    pub backdrop: &'a Backdrop,
    /// Folder.
    pub folder: &'a PictureFolder,
    /// Writes the numbers of the layers as well ([`Layer::planes`]).
    pub has_numbers: bool,
}

impl PictureJob<'_> {
    /// Renders and writes every view, and the animation of a turntable. `form` is the form of the
    /// scene's shading; `inspect` receives each view, rendered by the rules of the renderer, with
    /// its index, and `progress` the number of finished views.
    ///
    /// # Errors
    ///
    /// Those of the renderer and of `inspect`; files that cannot be written.
    pub fn run<E: From<SceneError> + Send>(
        &self,
        renderer: &mut SceneRenderer,
        form: ShadingForm,
        progress: impl FnMut(usize) + Send,
        mut inspect: impl FnMut(usize, &Image<Vec<f32>>) -> core::result::Result<(), E> + Send,
    ) -> core::result::Result<(), E> {
        let Self { cameras: CameraSet { cameras, is_turntable, .. }, folder, .. } = self;
        let rules = *renderer.rules();
        let others = LightLayer::OTHERS.into_iter().filter(|light| self.layers_with(*light).next().is_some());
        let others: Vec<LightLayer> = others.collect();
        let render = |index: usize| {
            let camera = &cameras[index].1;
            let mut image = renderer.render(camera)?;
            inspect(index, &image)?;
            let mut images = vec![(rules.light_layer, image)];
            for light_layer in &others {
                let rules = RenderRules { light_layer: *light_layer, ..rules };
                image = renderer.render_lit(camera.light as usize, camera, &rules)?;
                images.push((*light_layer, image));
            }
            Ok(images)
        };
        let finish = |index, images: Vec<(LightLayer, Image<Vec<f32>>)>| -> core::result::Result<_, E> {
            let mut colors = None;
            for (light, image) in &images {
                let written = self.write(index, *light, image, form).map_err(SceneError::from)?;
                colors = colors.or(written);
            }
            Ok(colors.filter(|_| *is_turntable))
        };
        let frames = overlap(cameras.len(), progress, render, finish)?;
        let frames: Vec<DynamicImage> = frames.into_iter().flatten().collect();
        if frames.len() > 1 {
            picture::write_animation(&folder.animation(), &frames, frame_ms(frames.len())).map_err(SceneError::from)?;
        }
        Ok(())
    }

    /// Layers to show of a view that was rendered with a light in the light channel.
    fn layers_with(&self, light: LightLayer) -> impl Iterator<Item = Layer> {
        self.layers.iter().copied().filter(move |layer| layer.light_layer() == light)
    }

    /// Writes the layers of a view with a light in the light channel; returns the colours if they
    /// are among the layers.
    fn write(
        &self,
        index: usize,
        light: LightLayer,
        image: &Image<Vec<f32>>,
        form: ShadingForm,
    ) -> Result<Option<DynamicImage>> {
        let mut colors = None;
        for layer in self.layers_with(light) {
            let picture = match layer {
                Layer::Rgb => self.backdrop.picture(image, &self.cameras.cameras[index].1),
                other => other.picture(image, form, self.backdrop.color().0).into(),
            };
            picture::write(&self.folder.picture(layer, index), &picture)?;
            if self.has_numbers {
                let path = self.folder.numbers(layer, index);
                planes::write_exr(&path, image.width, image.height, layer.planes(image))?;
            }
            if layer == Layer::Rgb {
                colors = Some(picture);
            }
        }
        Ok(colors)
    }

    /// Writes the ground truth of the first views, if it has the name and the size of the camera.
    ///
    /// # Errors
    ///
    /// A file that cannot be written.
    pub fn write_true_pictures(&self, views: &[View]) -> Result<()> {
        let pairs = self.cameras.cameras.par_iter().zip(views).enumerate();
        pairs.try_for_each(|(index, ((name, camera), view))| {
            let size = [camera.width, camera.height];
            if *name != view.name || size != [view.camera.width, view.camera.height] {
                return Ok(());
            }
            picture::write(&self.folder.true_picture(index), &self.backdrop.photograph(view))
        })
    }
}

/// Comparison of a plan's pictures, which skip stages without effect, with pictures of all stages.
#[derive(Debug)]
pub struct OmissionCheck {
    unplanned: SceneRenderer,
    channels: Channels,
    largest: f32,
}

impl OmissionCheck {
    /// Prepares pictures of a scene with these channels and all stages.
    ///
    /// # Errors
    ///
    /// Those of [`SceneRenderer::unplanned`].
    pub fn new(scene: Scene, channels: Channels, options: &RenderOptions) -> core::result::Result<Self, SceneError> {
        let unplanned = SceneRenderer::unplanned(scene, channels, options)?;
        Ok(Self { unplanned, channels, largest: 0.0 })
    }

    /// Renders a view with all stages, and compares the planned one.
    ///
    /// # Errors
    ///
    /// Those of [`SceneRenderer::render`].
    pub fn compare(&mut self, camera: &Camera, planned: &Image<Vec<f32>>) -> core::result::Result<(), SceneError> {
        let full = self.unplanned.render(camera)?;
        self.largest = self.largest.max(largest_difference(planned, &full, self.channels));
        Ok(())
    }

    /// Largest difference so far; 0 if all omissions are without effect.
    pub fn largest(&self) -> f32 {
        self.largest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ExecutorChoice, ShadingModel};
    use specula_core::scene::{Gaussians, Layout, QUAT, len_of_values};

    /// Grey Gaussian in front of the camera.
    fn scene() -> Scene {
        let layout = Layout::radiance(0);
        let values = vec![0.0; len_of_values(1, layout)];
        let mut gaussians = Gaussians { count: 1, layout, values };
        gaussians.set(0, QUAT, [1.0, 0.0, 0.0, 0.0]);
        Scene::unlit(gaussians, ShadingModel::PAPER)
    }

    #[test]
    fn the_difference_of_an_omission_is_measured() {
        let camera = Camera::look_at(glam::Vec3::X * 5.0, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, 16, 16);
        let options = RenderOptions::full_precision(ExecutorChoice::Cpu);
        let mut renderer = SceneRenderer::new(scene(), Channels::Color, &options).expect("the CPU renders");
        let mut planned = renderer.render(&camera).expect("the CPU renders");
        let mut check = OmissionCheck::new(scene(), Channels::Color, &options).expect("the CPU renders");
        check.compare(&camera, &planned).expect("the CPU renders");
        assert_eq!(check.largest(), 0.0);

        let number = &mut planned.plane_mut(1)[70];
        let added = (*number + 0.25) - *number;
        *number += added;
        check.compare(&camera, &planned).expect("the CPU renders");
        assert_eq!(check.largest(), added);
    }
}
