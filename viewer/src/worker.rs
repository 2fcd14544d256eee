//! Render worker: a thread that owns the scene on its executor and renders one picture at a time.

use crate::{
    ViewerError,
    lights::{Cube, Lights, OF_SCENE},
    live::LiveTraining,
    queue::Queue,
    request::{Content, FrameRequest, LightSetting, Pose, Viewpoint},
    views::Views,
};
use core::time::Duration;
use specula_core::{
    camera::Camera,
    metrics::psnr,
    pack::Storage,
    plan::Needs,
    rules::{Channels, RenderRules, channel},
    scene::{Image, Layout},
};
use specula_io::picture::{self, RgbImage};
use specula_scene::{
    Layer, Scene, SceneError, SceneRenderer, Shading, ShadingModel,
    backdrop::over_environment,
    environment::{fitting, levels_of},
};
use specula_train::evaluate::{mean_squared_error, over_background};
use std::{sync::Arc, thread, time::Instant};
use tokio::sync::oneshot;

/// Filtered lights in memory: several clients may each use another.
const SLOTS: usize = 6;
/// Error that is shown in the brightest colour, of a range of 1.
const ERROR_SHOWN_MAX: f32 = 0.25;

/// Requested picture, and the channel of its reply.
#[derive(Debug)]
pub(crate) struct Job {
    pub(crate) request: FrameRequest,
    pub(crate) reply: oneshot::Sender<Result<Frame, ViewerError>>,
}

/// Rendered picture.
#[derive(Debug)]
pub(crate) struct Frame {
    pub(crate) picture: RgbImage,
    /// Name of the view of the data set that it shows.
    pub(crate) view: Option<String>,
    /// PSNR against the photograph in dB, where they were compared.
    pub(crate) psnr: Option<f64>,
    /// Point of the scene at the requested position.
    pub(crate) point: Option<[f32; 3]>,
    /// Time of rendering.
    pub(crate) time: Duration,
}

/// Light in a slot of the renderer, and the rules of pictures under it by their channels.
#[derive(Debug)]
struct FilteredLight {
    setting: LightSetting,
    slot: usize,
    rules: [RenderRules; 3],
    /// Rules of the layers of physical materials.
    of_materials: RenderRules,
}

/// Channels of pictures, in ascending order of their cost.
const CHANNELS: [Channels; 3] = [Channels::Color, Channels::Training, Channels::Layers];

/// Scene on an executor.
#[derive(Debug)]
pub(crate) struct RenderWorker {
    renderer: SceneRenderer,
    storage: Storage,
    layout: Layout,
    shading_model: ShadingModel,
    needs: Needs,
    /// Whether there is a surface that reflected rays may meet.
    has_surface: bool,
    lights: Arc<Lights>,
    /// In the order of their last use.
    filtered: Vec<FilteredLight>,
    views: Views,
    /// sRGB, from 0 to 1.
    background: [f32; 3],
    near: f32,
}

impl RenderWorker {
    /// Worker for a scene, rounded to its storage, on the renderer that `load` puts it on.
    ///
    /// # Errors
    ///
    /// Those of `load`.
    pub(crate) fn new(
        scene: Scene,
        storage: Storage,
        load: impl FnOnce(Scene) -> Result<SceneRenderer, SceneError>,
        lights: Arc<Lights>,
        views: Views,
        background: [f32; 3],
        near: f32,
    ) -> Result<Self, SceneError> {
        let scene = scene.rounded(storage);
        let (layout, shading_model, needs) = (scene.gaussians.layout, scene.shading_model, Needs::of(&scene.gaussians));
        let has_surface = scene.near_field.is_some();
        let renderer = load(scene)?;
        let filtered = Vec::new();
        Ok(Self {
            renderer,
            storage,
            layout,
            shading_model,
            needs,
            has_surface,
            lights,
            filtered,
            views,
            background,
            near,
        })
    }

    /// Renders the jobs of a queue on a new thread, until the queue is closed.
    pub(crate) fn spawn(mut self, queue: Arc<Queue<Job>>, live: Option<Arc<LiveTraining>>) {
        /// Closes the queue when the thread ends, even by a panic, so that no client waits for it.
        struct CloseOnDrop(Arc<Queue<Job>>);
        impl Drop for CloseOnDrop {
            fn drop(&mut self) {
                self.0.close();
            }
        }
        thread::spawn(move || {
            let queue = CloseOnDrop(queue);
            self.warm_up();
            while let Some(Job { request, reply }) = queue.0.next() {
                // The client closed its connection while it waited.
                if reply.is_closed() {
                    continue;
                }
                let latest = live.as_ref().and_then(|live| live.take());
                let updated = latest.map_or(Ok(()), |scene| self.set_scene(scene));
                // The receiver is gone where the client closed its connection meanwhile.
                let _ = reply.send(updated.and_then(|()| self.render(&request)));
            }
        });
    }

    /// Replaces the scene by a later one of the same training.
    fn set_scene(&mut self, scene: Scene) -> Result<(), ViewerError> {
        let scene = scene.rounded(self.storage);
        self.needs = Needs::of(&scene.gaussians);
        self.renderer.set_surface(&scene.gaussians, scene.near_field.as_deref())?;
        self.has_surface = scene.near_field.is_some();
        self.lights.set_scene_light(scene.light);
        self.filtered.clear();
        Ok(())
    }

    /// Filters the scene's own light before the first request, since the first filter takes
    /// longest.
    fn warm_up(&mut self) {
        // Errors are repeated in the response to the first request.
        let _ = self.filtered(OF_SCENE);
    }

    /// Renders a picture.
    fn render(&mut self, request: &FrameRequest) -> Result<Frame, ViewerError> {
        let start = Instant::now();
        let (camera, view) = self.camera(request)?;
        let layer = self.layer(request.content)?;
        let image = self.image(&camera, layer, request.light)?;
        let name = view.map(|index| self.views.name(index).to_owned());
        let (picture, psnr) = match (request.content, view) {
            (Content::Error, Some(index)) => self.compare(&image, index, &camera)?,
            (Content::Layer(Layer::Rgb), _) if request.has_backdrop => {
                (self.over_light(&image, &camera, request.light)?, None)
            }
            _ => (layer.picture(&image, self.shading_model.shading.form, self.background), None),
        };
        let point = match request.content {
            Content::Point(at) => point_at(&image, &camera, at),
            _ => None,
        };
        Ok(Frame { picture, view: name, psnr, point, time: start.elapsed() })
    }

    /// Colours over the light; over the background colour for a scene without a light.
    fn over_light(
        &self,
        image: &Image<Vec<f32>>,
        camera: &Camera,
        setting: LightSetting,
    ) -> Result<RgbImage, ViewerError> {
        let light = self.light(setting)?;
        let planes = light
            .map_or_else(|| over_background(image, self.background), |light| over_environment(image, &light, camera));
        Ok(picture::rgb(image.width, image.height, &planes))
    }

    /// Camera of a request, and the index of its view.
    fn camera(&self, request: &FrameRequest) -> Result<(Camera, Option<usize>), ViewerError> {
        let index = match (request.viewpoint, request.content) {
            (Viewpoint::View(index), _) => Some(index),
            (Viewpoint::Pose(pose), Content::Error) => Some(self.views.nearest(&pose).ok_or_else(no_photographs)?),
            _ => None,
        };
        let camera = match (index, request.viewpoint) {
            (Some(index), _) => fitted(self.views.camera(index).ok_or_else(|| no_view(index))?, request.size),
            (None, Viewpoint::Pose(pose)) => camera_of(&pose, request.size),
            (None, Viewpoint::View(index)) => return Err(no_view(index)),
        };
        Ok((Camera { near: self.near, ..camera }, index))
    }

    /// Layer that is rendered for a request.
    fn layer(&self, content: Content) -> Result<Layer, ViewerError> {
        match content {
            Content::Error if !self.views.has_photographs() => Err(no_photographs()),
            Content::Error => Ok(Layer::Rgb),
            Content::Point(_) => Ok(Layer::Depth),
            Content::Layer(layer) if layer.is_of_shading() && !self.layout.is_shaded() => {
                let message = format!("the scene is plain Gaussian splatting, which has no {}", layer.name());
                Err(ViewerError::Request(message))
            }
            Content::Layer(layer) if layer.is_of_materials() && !self.layout.is_physical => {
                let message = format!("the scene was trained without physical materials, which have {}", layer.name());
                Err(ViewerError::Request(message))
            }
            Content::Layer(layer) => Ok(layer),
        }
    }

    /// Shading of a layer under a light: physical materials, if there are any, show themselves and
    /// light that is not that of the training.
    fn model_of(&self, setting: LightSetting, of_materials: bool) -> ShadingModel {
        let is_own = setting == OF_SCENE;
        if self.layout.is_physical && (of_materials || !is_own) {
            self.shading_model.shaded(Shading::Physical)
        } else {
            self.shading_model
        }
    }

    fn image(&mut self, camera: &Camera, layer: Layer, setting: LightSetting) -> Result<Image<Vec<f32>>, ViewerError> {
        let channels = Layer::channels(&[layer]);
        let index = CHANNELS.iter().position(|other| *other == channels).expect("layers have one of these channels");
        let FilteredLight { slot, rules, of_materials, .. } = self.filtered(setting)?;
        let (slot, rules) = (*slot, if layer.is_of_materials() { *of_materials } else { rules[index] });
        Ok(self.renderer.render_lit(slot, camera, &rules)?)
    }

    /// Light of a setting; none for a scene that does not look it up.
    fn light(&self, setting: LightSetting) -> Result<Option<Cube>, ViewerError> {
        if self.lights.turns_network(setting) {
            return Err(ViewerError::Request(
                "the scene's light is a network, which cannot be turned; add its exported map as a light".to_owned(),
            ));
        }
        let light = self.lights.get(setting).ok_or_else(|| no_light(setting.id))?;
        Ok(light.filter(|_| self.layout.is_shaded()))
    }

    /// Filtered light of a setting, from its slot or filtered anew.
    fn filtered(&mut self, setting: LightSetting) -> Result<&FilteredLight, ViewerError> {
        let filtered = match self.filtered.iter().position(|filtered| filtered.setting == setting) {
            Some(index) => self.filtered.remove(index),
            None => self.filter(setting)?,
        };
        self.filtered.push(filtered);
        Ok(self.filtered.last().expect("it was just appended"))
    }

    fn filter(&mut self, setting: LightSetting) -> Result<FilteredLight, ViewerError> {
        let cube = self.light(setting)?;
        let rules = CHANNELS.map(|channels| self.rules(cube.as_ref(), self.model_of(setting, false), channels));
        let of_materials = self.rules(cube.as_ref(), self.model_of(setting, true), Channels::Layers);
        let slot = self.free_slot();
        // Levels of either shading.
        let of_layers = if self.layout.is_physical { &of_materials } else { &rules[CHANNELS.len() - 1] };
        if let Some(cube) = cube.filter(|_| of_layers.is_lit) {
            self.renderer.set_light(slot, &fitting(&cube, self.shading_model.scheme), of_layers)?;
        }
        Ok(FilteredLight { setting, slot, rules, of_materials })
    }

    /// Free slot; without one, that of the light that was not used for longest.
    fn free_slot(&mut self) -> usize {
        if self.filtered.len() == SLOTS {
            return self.filtered.remove(0).slot;
        }
        let is_free = |slot: &usize| self.filtered.iter().all(|filtered| filtered.slot != *slot);
        (0..SLOTS).find(is_free).expect("fewer lights than slots")
    }

    /// Rules of pictures under a light.
    fn rules(&self, cube: Option<&Cube>, model: ShadingModel, channels: Channels) -> RenderRules {
        let needs = self.needs.under(cube);
        let levels = cube.map(|cube| levels_of(cube, model.scheme));
        model
            .plan(self.layout, &needs, levels.as_ref(), channels)
            .tracing(self.has_surface && model.traces_near())
            .rules
    }

    /// Error map against the photograph of a view, and PSNR in dB.
    fn compare(
        &mut self,
        image: &Image<Vec<f32>>,
        index: usize,
        camera: &Camera,
    ) -> Result<(RgbImage, Option<f64>), ViewerError> {
        let truth = self.views.photograph(index, camera)?.over(self.background);
        let rendered = over_background(image, self.background);
        let [rendered_rgb, truth_rgb] =
            [&rendered, &truth].map(|planes| picture::rgb(image.width, image.height, planes));
        let picture = picture::error_map(&rendered_rgb, &truth_rgb, ERROR_SHOWN_MAX);
        Ok((picture, Some(psnr(mean_squared_error(&rendered, &truth)))))
    }
}

/// Camera resized to fit into a size, with its aspect ratio.
fn fitted(camera: Camera, [width, height]: [u32; 2]) -> Camera {
    let scale = f64::min(f64::from(width) / f64::from(camera.width), f64::from(height) / f64::from(camera.height));
    let [width, height] = [camera.width, camera.height].map(|edge| (f64::from(edge) * scale).round().max(1.0) as u32);
    camera.resized(width, height)
}

/// Point of the scene at a position of a picture of depths; none where the coverage is below 0.5.
fn point_at(image: &Image<Vec<f32>>, camera: &Camera, at: [f32; 2]) -> Option<[f32; 3]> {
    const COVERAGE_MIN: f32 = 0.5;
    let size = [camera.width, camera.height].map(|edge| edge as f32);
    let [column, row] = [0, 1].map(|k| ((at[k] * size[k]) as usize).min(size[k] as usize - 1));
    let pixel = row * camera.width as usize + column;
    let coverage = 1.0 - image.plane(image.channels - 1)[pixel];
    let depth = image.plane(channel::DEPTH)[pixel] / coverage;
    let ray = camera.ray_in_camera(column as f32 + 0.5, row as f32 + 0.5);
    let point = camera.position + camera.camera_from_world.transpose() * (ray * depth);
    (coverage > COVERAGE_MIN && point.is_finite()).then(|| point.to_array())
}

fn camera_of(pose: &Pose, [width, height]: [u32; 2]) -> Camera {
    Camera::look_at(pose.eye, pose.eye + pose.look, pose.up, pose.angle, width, height)
}

fn no_view(index: usize) -> ViewerError {
    ViewerError::Request(format!("the scene has no view {index}"))
}

fn no_light(id: u32) -> ViewerError {
    ViewerError::Request(format!("light {id} was replaced by later ones; upload it again"))
}

fn no_photographs() -> ViewerError {
    ViewerError::Request("there are no photographs to compare with: the data set of the scene is not known".into())
}
