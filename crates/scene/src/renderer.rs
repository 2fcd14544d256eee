//! Renderer of a scene on any executor.

use crate::{
    Scene, SceneError,
    device::{Device, RenderOptions},
    environment::RESOLUTION_SLOW,
    lamps::{SceneLamps, reflected_by},
    overlap::overlap,
};
use core::{fmt, ops::Range};
use specula_core::{
    camera::Camera,
    cutoffs::Cutoffs,
    executor::{Feature, Occluder, Renderer, Unsupported},
    light_network::LightNetworkError,
    near_field::NearField,
    pack::Storage,
    pipeline,
    plan::{Needs, Plan},
    rules::{Channels, RenderRules},
    scene::{Environment, Gaussians, Image},
};
use specula_cpu::{CpuViewer, stages::prefilter::Light};
#[cfg(feature = "gpu")]
use specula_gpu::GpuExecutor;
use specula_io::picture::{self, RgbImage};
use specula_mesh::surface::Surface;
use specula_train::{
    evaluate::{over_background, read_image, render_view, rules_to_measure},
    view::View,
};
use std::sync::Arc;

/// Gaussians and filtered lights on an executor: the object-safe side of a [`SceneRenderer`].
///
/// Lights lie in slots, counted from 0. A view under an empty slot has no specular term.
pub trait RenderBackend: Send {
    /// Renders a view under the light of a slot: its channels, premultiplied, then transmittance,
    /// plane by plane.
    ///
    /// # Errors
    ///
    /// Those of the executor.
    fn render(&mut self, slot: usize, camera: &Camera, rules: &RenderRules) -> Result<Image<Vec<f32>>, SceneError>;

    /// Filters a light into a slot, replacing its light.
    ///
    /// # Errors
    ///
    /// Those of the executor, such as a resolution that the prefilter does not support; or
    /// [`SceneError::Immutable`].
    fn set_light(&mut self, slot: usize, light: &Environment<Vec<f32>>, rules: &RenderRules) -> Result<(), SceneError>;

    /// Adds lamps to the light of a slot, replacing earlier lamps; the light is not filtered again.
    /// Views without illuminating rules ignore lamps. If the executor rejects the lamps, the slot
    /// is empty.
    ///
    /// # Errors
    ///
    /// Lamps with a fault ([`specula_core::lamps::check`]), those of the executor, or
    /// [`SceneError::Immutable`].
    fn add_lamps(&mut self, slot: usize, lamps: &SceneLamps) -> Result<(), SceneError>;

    /// Renders a view behind surfaces with these depths, one for each pixel
    /// ([`mod@specula_core::occlusion`]).
    ///
    /// # Errors
    ///
    /// Those of the executor; [`SceneError::Unsupported`] by default.
    fn render_occluded(
        &mut self,
        slot: usize,
        camera: &Camera,
        rules: &RenderRules,
        depths: &[f32],
    ) -> Result<Image<Vec<f32>>, SceneError> {
        let _ = (slot, camera, rules, depths);
        Err(SceneError::Unsupported(Unsupported::feature(Feature::Occlusions)))
    }

    /// Median depth of each pixel of a view, row by row ([`Renderer::median_depths`]).
    ///
    /// # Errors
    ///
    /// Those of the executor; [`SceneError::Unsupported`] by default.
    fn median_depths(&mut self, camera: &Camera, rules: &RenderRules) -> Result<Vec<f32>, SceneError> {
        let _ = (camera, rules);
        Err(SceneError::Unsupported(Unsupported::feature(Feature::MedianDepths)))
    }

    /// Replaces some of the Gaussians by those with the same indices; lights stay.
    ///
    /// # Errors
    ///
    /// Those of the executor; [`SceneError::Immutable`] by default.
    fn write_gaussians(&mut self, gaussians: &Gaussians<Vec<f32>>, range: Range<usize>) -> Result<(), SceneError> {
        let _ = (gaussians, range);
        Err(SceneError::Immutable)
    }

    /// Replaces Gaussians, near field and lamps, and removes all lights.
    ///
    /// # Errors
    ///
    /// Those of the executor, such as arrays that are too large; or [`SceneError::Immutable`].
    fn set_scene(&mut self, scene: &Scene) -> Result<(), SceneError>;
}

impl fmt::Debug for dyn RenderBackend {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("RenderBackend")
    }
}

/// Gaussians and filtered lights on an executor.
pub struct UploadedScene<E: Renderer> {
    exec: E,
    gaussians: Gaussians<E::Array>,
    near_field: Option<E::NearField>,
    lamps: Option<UploadedLamps<E::NearField>>,
    occluders: Occluders<E::NearField>,
    lights: Vec<Option<E::Light>>,
    /// Rounds a filtered light to its storage.
    store: fn(E::Light, Storage) -> E::Light,
    storage: Storage,
}

/// Lamps, and the surface that casts their shadows on an executor.
struct UploadedLamps<N> {
    lamps: SceneLamps,
    occluder: Option<N>,
}

/// Last shadow-casting surface.
struct Occluders<N> {
    /// Surface, and its upload on an executor.
    latest: Option<(Arc<Surface>, N)>,
}

impl<N: Clone> Occluders<N> {
    /// Surface on the executor, uploaded unless it is the last one.
    fn get<E: Renderer<NearField = N>>(
        &mut self,
        exec: &mut E,
        surface: Option<&Arc<Surface>>,
    ) -> Result<Option<N>, E::Error> {
        let Some(surface) = surface else { return Ok(None) };
        match &self.latest {
            Some((known, uploaded)) if Arc::ptr_eq(known, surface) => Ok(Some(uploaded.clone())),
            _ => {
                let uploaded = upload_near_field(exec, surface)?;
                self.latest = Some((surface.clone(), uploaded.clone()));
                Ok(Some(uploaded))
            }
        }
    }
}

/// Interreflected light of lamps; `None` for previews.
fn reflected(lamps: &SceneLamps) -> Vec<f32> {
    let occluder = lamps.occluder.as_ref().filter(|_| lamps.reflects());
    occluder.map_or_else(Vec::new, |occluder| reflected_by(occluder, lamps))
}

impl<E: Renderer> UploadedScene<E>
where
    E::Error: Into<SceneError>,
{
    fn new(
        mut exec: E,
        Scene { gaussians, near_field, lamps, .. }: &Scene,
        store: fn(E::Light, Storage) -> E::Light,
        storage: Storage,
    ) -> Result<Self, SceneError> {
        let gaussians = exec.upload_gaussians(gaussians).map_err(Into::into)?;
        let occluders = Occluders { latest: None };
        let lights = Vec::new();
        let mut uploaded = Self { exec, gaussians, near_field: None, lamps: None, occluders, lights, store, storage };
        uploaded.set_surface(near_field.as_ref(), lamps.as_ref()).map_err(Into::into)?;
        Ok(uploaded)
    }

    /// Uploads the near field and the occluder of the lamps, which is often the same surface.
    fn set_surface(&mut self, near_field: Option<&Arc<Surface>>, lamps: Option<&SceneLamps>) -> Result<(), E::Error> {
        self.near_field = self.occluders.get(&mut self.exec, near_field)?;
        self.lamps = match lamps {
            Some(lamps) => {
                let occluder = self.occluders.get(&mut self.exec, lamps.occluder.as_ref())?;
                Some(UploadedLamps { lamps: lamps.clone(), occluder })
            }
            None => None,
        };
        Ok(())
    }

    /// Scene on an executor with rounded storage.
    ///
    /// # Errors
    ///
    /// Those of the executor, such as a scene that is too large.
    pub fn with_executor(exec: E, scene: &Scene) -> Result<Self, SceneError> {
        Self::new(exec, scene, |light, _| light, Storage::F32)
    }

    /// Renders a view under the light of a slot, and leaves it on the executor.
    ///
    /// # Errors
    ///
    /// Those of the executor.
    pub fn frame(&mut self, slot: usize, camera: &Camera, rules: &RenderRules) -> Result<E::Frame, E::Error> {
        let light = self.lights.get(slot).and_then(Option::as_ref);
        pipeline::render(&mut self.exec, &self.gaussians, light, camera, rules)
    }

    /// Executor for reading frames.
    pub fn executor(&mut self) -> &mut E {
        &mut self.exec
    }
}

impl<E: Renderer> fmt::Debug for UploadedScene<E> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("UploadedScene")
    }
}

impl<E> RenderBackend for UploadedScene<E>
where
    E: Renderer + Send,
    E::Array: Send,
    E::Light: Send,
    E::NearField: Send,
    E::Error: Into<SceneError>,
{
    fn render(&mut self, slot: usize, camera: &Camera, rules: &RenderRules) -> Result<Image<Vec<f32>>, SceneError> {
        let light = self.lights.get(slot).and_then(Option::as_ref);
        render_view(&mut self.exec, &self.gaussians, light, camera, rules).map_err(Into::into)
    }

    fn set_light(&mut self, slot: usize, light: &Environment<Vec<f32>>, rules: &RenderRules) -> Result<(), SceneError> {
        if light.is_network() {
            LightNetworkError::check_weights(&light.values).map_err(|error| SceneError::Executor(Box::new(error)))?;
        }
        let values = self.exec.upload(&light.values).map_err(Into::into)?;
        let light = self.exec.prefilter(&light.with_values(values), rules.scheme, rules.levels).map_err(Into::into)?;
        let count = self.lights.len().max(slot + 1);
        self.lights.resize_with(count, || None);
        let mut light = (self.store)(light, self.storage);
        if let Some(near_field) = &self.near_field {
            light = self.exec.surround(light, near_field).map_err(Into::into)?;
        }
        if let Some(UploadedLamps { lamps, occluder }) = &self.lamps {
            let reflected = reflected(lamps);
            let occluder = occluder.as_ref().map(|surface| Occluder { surface, reflected: &reflected });
            light = self.exec.add_lamps(light, &lamps.lamps, lamps.rays, occluder).map_err(Into::into)?;
        }
        self.lights[slot] = Some(light);
        Ok(())
    }

    fn add_lamps(&mut self, slot: usize, lamps: &SceneLamps) -> Result<(), SceneError> {
        let SceneLamps { lamps: all, rays, occluder } = lamps;
        specula_core::lamps::check(all, *rays).map_err(|error| SceneError::Executor(Box::new(error)))?;
        let Self { exec, occluders, lights, .. } = self;
        let surface = occluders.get(exec, occluder.as_ref()).map_err(Into::into)?;
        let reflected = reflected(lamps);
        let occluder = surface.as_ref().map(|surface| Occluder { surface, reflected: &reflected });
        if let Some(light) = lights.get_mut(slot).and_then(Option::take) {
            lights[slot] = Some(exec.add_lamps(light, all, *rays, occluder).map_err(Into::into)?);
        }
        Ok(())
    }

    fn render_occluded(
        &mut self,
        slot: usize,
        camera: &Camera,
        rules: &RenderRules,
        depths: &[f32],
    ) -> Result<Image<Vec<f32>>, SceneError> {
        let Self { exec, gaussians, lights, .. } = self;
        let light = lights.get(slot).and_then(Option::as_ref);
        let render = |exec: &mut E| {
            let occlusion = exec.upload(depths)?;
            let frame = pipeline::render_occluded(exec, gaussians, light, camera, rules, &occlusion)?;
            read_image(exec, &frame, gaussians.layout, camera, rules)
        };
        render(exec).map_err(Into::into)
    }

    fn median_depths(&mut self, camera: &Camera, rules: &RenderRules) -> Result<Vec<f32>, SceneError> {
        let mut depths = vec![0.0; camera.width as usize * camera.height as usize];
        let array = pipeline::median_depths(&mut self.exec, &self.gaussians, camera, rules).map_err(Into::into)?;
        self.exec.download(&array, &mut depths).map_err(Into::into)?;
        Ok(depths)
    }

    fn write_gaussians(&mut self, gaussians: &Gaussians<Vec<f32>>, range: Range<usize>) -> Result<(), SceneError> {
        self.exec.write_gaussians(&mut self.gaussians, gaussians, range).map_err(Into::into)
    }

    fn set_scene(&mut self, scene: &Scene) -> Result<(), SceneError> {
        self.gaussians = self.exec.upload_gaussians(&scene.gaussians).map_err(Into::into)?;
        self.lights.clear();
        self.set_surface(scene.near_field.as_ref(), scene.lamps.as_ref()).map_err(Into::into)
    }
}

/// Uploads Gaussians, rounded to their storage, to an executor with these options.
fn upload(
    device: Device,
    scene: &Scene,
    cutoffs: Cutoffs,
    storage: Storage,
) -> Result<Box<dyn RenderBackend>, SceneError> {
    Ok(match device {
        Device::Cpu => Box::new(UploadedScene::new(CpuViewer::with_cutoffs(cutoffs), scene, rounded, storage)?),
        // The viewer rounds what it stores.
        #[cfg(feature = "gpu")]
        Device::Gpu(gpu, _) => {
            let mut exec = GpuExecutor::viewer(*gpu, storage);
            exec.set_order(cutoffs.order());
            Box::new(UploadedScene::new(exec, scene, |light, _| light, storage)?)
        }
    })
}

/// Uploads a near field.
///
/// # Errors
///
/// Those of the executor.
pub(crate) fn upload_near_field<E: Renderer>(
    exec: &mut E,
    near_field: &NearField<Vec<f32>>,
) -> Result<E::NearField, E::Error> {
    exec.upload_near_field(&near_field.with_values(near_field.values.as_slice()))
}

fn rounded(mut light: Light, storage: Storage) -> Light {
    light.round(storage);
    light
}

impl Scene {
    /// Scene on an executor, ready for pictures with these channels. Stages that the scene does not
    /// need are skipped, which changes no bit of its pictures.
    ///
    /// # Errors
    ///
    /// Those of the executor, such as a scene that is too large.
    pub fn renderer<E>(&self, exec: E, channels: Channels) -> Result<SceneRenderer, SceneError>
    where
        E: Renderer + Send + 'static,
        E::Array: Send,
        E::Light: Send,
        E::NearField: Send,
        E::Error: Into<SceneError>,
    {
        SceneRenderer::with_executor(exec, self, channels)
    }
}

/// Rules of pictures of a scene with these needs: with the stages that it needs, or with all.
fn rules_of(scene: &Scene, needs: &Needs, channels: Channels, is_unplanned: bool) -> RenderRules {
    let Plan { rules, full, .. } = scene.plan_for(needs, channels);
    if is_unplanned { full } else { rules }
}

/// Scene on an executor, its lights filtered, with the rules of its pictures. A view is rendered
/// under the light of its camera.
///
/// The executor is chosen at run time by [`SceneRenderer::new`], or is the caller's own
/// ([`SceneRenderer::with_executor`]). Other lights may be filtered in addition to the scene's own
/// and selected view by view ([`SceneRenderer::render_lit`]).
#[derive(Debug)]
pub struct SceneRenderer {
    backend: Box<dyn RenderBackend>,
    channels: Channels,
    /// True if all stages run, needed or not.
    is_unplanned: bool,
    /// Needs of the scene, which the rules meet.
    needs: Needs,
    rules: RenderRules,
}

impl SceneRenderer {
    /// Slot of the scene's own light, the first of several; the others follow.
    pub const SCENE_LIGHT: usize = 0;

    /// Renderer of views with these channels. Stages that the scene does not need are skipped,
    /// which changes no bit of its pictures.
    ///
    /// # Errors
    ///
    /// A device that cannot be opened ([`RenderOptions`]), or those of its executor.
    pub fn new(scene: Scene, channels: Channels, options: &RenderOptions) -> Result<Self, SceneError> {
        let scene = scene.rounded(options.storage);
        Self::uploaded(&scene, channels, false, options)
    }

    /// Renderer of views with these channels and all stages: the reference for
    /// [`SceneRenderer::new`].
    ///
    /// # Errors
    ///
    /// Those of [`SceneRenderer::new`].
    pub fn unplanned(scene: Scene, channels: Channels, options: &RenderOptions) -> Result<Self, SceneError> {
        let scene = scene.rounded(options.storage);
        Self::uploaded(&scene, channels, true, options)
    }

    /// Renderer of views with these channels, for lights that are set later: the scene's own is not
    /// filtered.
    ///
    /// # Errors
    ///
    /// Those of [`SceneRenderer::new`].
    pub fn without_light(scene: Scene, channels: Channels, options: &RenderOptions) -> Result<Self, SceneError> {
        let scene = Scene { light: None, other_lights: Vec::new(), ..scene.rounded(options.storage) };
        Self::uploaded(&scene, channels, false, options)
    }

    /// Renderer on the caller's executor.
    ///
    /// # Errors
    ///
    /// Those of the executor, such as a scene that is too large.
    pub fn with_executor<E>(exec: E, scene: &Scene, channels: Channels) -> Result<Self, SceneError>
    where
        E: Renderer + Send + 'static,
        E::Array: Send,
        E::Light: Send,
        E::NearField: Send,
        E::Error: Into<SceneError>,
    {
        let backend = Box::new(UploadedScene::new(exec, scene, |light, _| light, Storage::F32)?);
        let renderer = Self::with_backend(backend, scene, channels);
        renderer.lit_as(scene)
    }

    /// Renderer on a backend with the Gaussians and the light of `scene`.
    pub fn with_backend(backend: Box<dyn RenderBackend>, scene: &Scene, channels: Channels) -> Self {
        let needs = scene.needs();
        let rules = rules_of(scene, &needs, channels, false);
        Self { backend, channels, is_unplanned: false, needs, rules }
    }

    /// Renderer of a scene with rounded Gaussians.
    fn uploaded(
        scene: &Scene,
        channels: Channels,
        is_unplanned: bool,
        options: &RenderOptions,
    ) -> Result<Self, SceneError> {
        let needs = scene.needs();
        let rules = rules_of(scene, &needs, channels, is_unplanned);
        let light = scene.light_for(&rules);
        if let Some(Environment { resolution: resolution @ RESOLUTION_SLOW.., .. }) = light {
            tracing::info!("filtering a light of six times {resolution} × {resolution} texels; this takes a while");
        }
        let cutoffs = Cutoffs::DEFAULT.with_projection(options.projection).with_order(options.order);
        let backend = upload(options.open()?, scene, cutoffs, options.storage)?;
        Self { backend, channels, is_unplanned, needs, rules }.lit_as(scene)
    }

    fn lit_as(mut self, scene: &Scene) -> Result<Self, SceneError> {
        self.set_lights_of(scene)?;
        Ok(self)
    }

    /// Filters the lights of a scene into the first slots.
    fn set_lights_of(&mut self, scene: &Scene) -> Result<(), SceneError> {
        let lights = scene.light_for(&self.rules).into_iter().chain(scene.other_lights_for(&self.rules));
        lights.enumerate().try_for_each(|(slot, light)| self.backend.set_light(slot, &light, &self.rules))
    }

    /// View of the scene over a background in sRGB, with 8 bits a channel: the picture that
    /// `specula render` writes.
    ///
    /// # Errors
    ///
    /// Those of [`SceneRenderer::render`].
    pub fn picture(&mut self, camera: &Camera, background: [f32; 3]) -> Result<RgbImage, SceneError> {
        let image = self.render(camera)?;
        Ok(picture::rgb(image.width, image.height, &over_background(&image, background)))
    }

    /// View of the scene: its channels, premultiplied, then transmittance, plane by plane. Models
    /// that are shaded per pixel have more channels than requested; `Image::channels` counts them,
    /// and [`Channels::index_of`](specula_core::rules::Channels::index_of) finds one.
    ///
    /// # Errors
    ///
    /// Those of the executor, such as too many splats in the tiles of a picture, or a lost device.
    pub fn render(&mut self, camera: &Camera) -> Result<Image<Vec<f32>>, SceneError> {
        self.backend.render(camera.light as usize, camera, &self.rules)
    }

    /// View of the scene under the light of a slot, by rules of the caller.
    ///
    /// # Errors
    ///
    /// Those of [`SceneRenderer::render`].
    pub fn render_lit(
        &mut self,
        slot: usize,
        camera: &Camera,
        rules: &RenderRules,
    ) -> Result<Image<Vec<f32>>, SceneError> {
        self.backend.render(slot, camera, rules)
    }

    /// Renders views of a data set one after another, with normals if the true ones are known, and
    /// passes them to `finish` on other threads ([`overlap`]).
    ///
    /// # Errors
    ///
    /// Those of [`SceneRenderer::render`] and of `finish`.
    pub fn render_views<T, E>(
        &mut self,
        views: &[View],
        progress: impl FnMut(usize) + Send,
        finish: impl Fn(&View, &Image<Vec<f32>>) -> Result<T, E> + Sync,
    ) -> Result<Vec<T>, E>
    where
        T: Send,
        E: From<SceneError> + Send,
    {
        let Self { backend, rules, .. } = self;
        let render = |index: usize| {
            let View { camera, .. } = &views[index];
            Ok(backend.render(camera.light as usize, camera, &rules_to_measure(&views[index], rules))?)
        };
        overlap(views.len(), progress, render, |index, image| finish(&views[index], &image))
    }

    /// Filters a light into a slot, by the scheme and the levels of `rules`. Its resolution must be
    /// one that the prefilter supports ([`fitting`](crate::environment::fitting)).
    ///
    /// # Errors
    ///
    /// Those of the executor; [`SceneError::Immutable`] for backends that keep their light.
    pub fn set_light(
        &mut self,
        slot: usize,
        light: &Environment<Vec<f32>>,
        rules: &RenderRules,
    ) -> Result<(), SceneError> {
        self.backend.set_light(slot, light, rules)
    }

    /// Adds lamps to the light of a slot, replacing earlier lamps; the light is not filtered again.
    /// Only illuminating rules show them
    /// ([`Plan::illuminated`](specula_core::plan::Plan::illuminated)).
    ///
    /// # Errors
    ///
    /// Invalid lamps; those of the executor, which leave the slot empty; or
    /// [`SceneError::Immutable`] for backends that keep their light.
    pub fn add_lamps(&mut self, slot: usize, lamps: &SceneLamps) -> Result<(), SceneError> {
        self.backend.add_lamps(slot, lamps)
    }

    /// Replaces the scene: its Gaussians, rounded to the storage of the renderer
    /// ([`Scene::rounded`]), near field, lamps and light. Stages are planned for the new scene.
    /// Lights of other slots are removed.
    ///
    /// # Errors
    ///
    /// Those of the executor; [`SceneError::Immutable`] for backends that keep their scene.
    pub fn set_scene(&mut self, scene: &Scene) -> Result<(), SceneError> {
        self.backend.set_scene(scene)?;
        self.needs = scene.needs();
        self.rules = rules_of(scene, &self.needs, self.channels, self.is_unplanned);
        self.set_lights_of(scene)
    }

    /// Uploads some Gaussians of a scene again, those in `range`, rounded to the storage of the
    /// renderer ([`Scene::rounded`]). The scene has as many Gaussians as before; light, near field
    /// and lamps are not read.
    ///
    /// Stages that only the changed Gaussians need run from now on. If these need a light, or
    /// levels of it, that no other Gaussian needs, the whole scene is replaced as by
    /// [`SceneRenderer::set_scene`], and the result is true: lights of other slots were removed.
    ///
    /// # Errors
    ///
    /// Another number of Gaussians or other planes than before, or a range beyond them; those of
    /// [`SceneRenderer::set_scene`].
    pub fn update(&mut self, scene: &Scene, range: Range<usize>) -> Result<bool, SceneError> {
        self.backend.write_gaussians(&scene.gaussians, range.clone())?;
        self.needs = self.needs.with(&scene.gaussians, range);
        let rules = rules_of(scene, &self.needs, self.channels, self.is_unplanned);
        if (rules.is_lit, rules.levels) != (self.rules.is_lit, self.rules.levels) {
            self.set_scene(scene)?;
            return Ok(true);
        }
        self.rules = rules;
        Ok(false)
    }

    pub(crate) fn backend_mut(&mut self) -> &mut dyn RenderBackend {
        &mut *self.backend
    }

    /// Rules of its pictures, without stages that the scene does not need.
    pub fn rules(&self) -> &RenderRules {
        &self.rules
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ExecutorChoice, ShadingModel};
    use glam::Vec3;
    use specula_core::scene::{
        LOG_SCALE, Layout, MEAN, OPACITY, QUAT, ROUGHNESS, RadianceActivation, TINT, len_of_values,
    };

    /// A mirror that a scene without a light, without tint and without harmonics does not need.
    fn scene(tint: f32, is_lit: bool) -> Scene {
        let layout = Layout::shaded(Some(1));
        let mut gaussians = Gaussians { count: 1, layout, values: vec![0.0; len_of_values(1, layout)] };
        gaussians.set(0, MEAN, [0.0, 0.0, 0.0]);
        gaussians.set(0, LOG_SCALE, [-1.0, -1.0, -4.0]);
        gaussians.set(0, QUAT, [1.0, 0.0, 0.0, 0.0]);
        gaussians.set(0, OPACITY, [4.0]);
        gaussians.set(0, TINT, [tint; 3]);
        gaussians.set(0, ROUGHNESS, [-2.0]);
        gaussians.set(0, layout.sh_end() - 1, [if is_lit { 0.6 } else { 0.0 }]);
        let values = (0..18 * 16 * 16).map(|k| 0.1 + 0.2 * (k % 7) as f32).collect();
        let light = Environment { resolution: 16, activation: RadianceActivation::Identity, values };
        let light = Some(light).filter(|_| is_lit);
        Scene {
            gaussians,
            light,
            near_field: None,
            lamps: None,
            other_lights: Vec::new(),
            shading_model: ShadingModel::DEFERRED,
        }
    }

    #[test]
    fn another_scene_is_planned_as_a_new_renderer_plans_it() {
        let options = RenderOptions::full_precision(ExecutorChoice::Cpu);
        let camera = Camera::look_at(Vec3::new(0.0, -2.0, 1.0), Vec3::ZERO, Vec3::Z, 0.7, 32, 24);
        let fresh = |scene: &Scene| SceneRenderer::new(scene.clone(), Channels::Color, &options).unwrap();
        let [plain, shiny] = [scene(-60.0, false), scene(1.0, true)];
        let [of_plain, of_shiny] = [&plain, &shiny].map(|scene| fresh(scene).render(&camera).unwrap());
        assert!(of_plain != of_shiny, "the scenes differ");
        let mut renderer = fresh(&plain);
        for (scene, expected) in [(&shiny, &of_shiny), (&plain, &of_plain)] {
            renderer.set_scene(scene).unwrap();
            assert!(renderer.render(&camera).unwrap() == *expected);
            assert_eq!(renderer.rules(), fresh(scene).rules());
        }
    }

    #[test]
    fn changed_gaussians_are_planned_and_drawn_as_in_a_new_renderer() {
        let options = RenderOptions::full_precision(ExecutorChoice::Cpu);
        let camera = Camera::look_at(Vec3::new(0.0, -2.0, 1.0), Vec3::ZERO, Vec3::Z, 0.7, 32, 24);
        let mut changed = scene(-60.0, true);
        // Without harmonics its tint is lost in rounding, and no light is filtered.
        let last = changed.gaussians.layout.sh_end() - 1;
        changed.gaussians.set(0, last, [0.0]);
        let mut renderer = SceneRenderer::new(changed.clone(), Channels::Color, &options).unwrap();
        let plain = renderer.render(&camera).unwrap();
        // A move needs nothing new; a mirror needs light that was not filtered; a rough mirror
        // needs other levels of it.
        let changes: [(usize, f32, bool); 3] = [(MEAN, 0.1, false), (TINT, 1.0, true), (ROUGHNESS, 4.0, true)];
        for (plane, number, is_whole) in changes {
            changed.gaussians.set(0, plane, [number]);
            assert_eq!(renderer.update(&changed, 0..1).unwrap(), is_whole, "plane {plane}");
            let expected = SceneRenderer::new(changed.clone(), Channels::Color, &options).unwrap().render(&camera);
            let actual = renderer.render(&camera).unwrap();
            assert!(actual == expected.unwrap() && actual != plain, "plane {plane}");
        }
        assert!(matches!(renderer.update(&changed, 0..2), Err(SceneError::Cpu(_))), "there is one Gaussian");
    }
}
