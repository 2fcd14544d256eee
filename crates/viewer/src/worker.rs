//! Render worker: owns the scene on its executor and renders one picture at a time.

use crate::{
    ViewerError,
    lights::{Cube, Lights, OF_SCENE},
    request::{Content, FrameRequest, LampSetting, LightSetting, Pose, Viewpoint},
    views::Views,
};
use specula_core::{
    camera::Camera,
    metrics::psnr,
    pack::Storage,
    plan::{Needs, Plan},
    rules::{Channels, RenderRules, channel},
    scene::{Gaussians, Image, Layout},
    shade::ShadingForm,
};
use specula_io::picture::{self, RgbImage};
use specula_scene::{
    Layer, Scene, SceneError, SceneRenderer, Shading, ShadingModel, Surface,
    backdrop::{Backdrop, BackgroundColor},
    environment::{fitting, levels_of},
    ground::{Ground, GroundPlane},
    lamps::{SceneLamps, fused_surface},
};
use specula_train::evaluate::{mean_squared_error, over_background};
use std::sync::Arc;

/// Filtered lights in memory, for several clients with different lights.
const SLOTS: usize = 6;
/// Error that maps to the brightest colour, on a scale from 0 to 1.
const ERROR_SHOWN_MAX: f32 = 0.25;

/// Picture of a request before rendering.
#[derive(Debug)]
pub(crate) struct PlannedPicture {
    pub(crate) camera: Camera,
    /// Slot of its light in the renderer.
    pub(crate) slot: usize,
    pub(crate) rules: RenderRules,
    /// Index of the view of the data set.
    view: Option<usize>,
    layer: Layer,
}

/// Rendered picture.
#[derive(Debug)]
pub(crate) struct Frame {
    pub(crate) picture: RgbImage,
    /// Name of the view of the data set.
    pub(crate) view: Option<String>,
    /// PSNR against the photograph in dB, if they were compared.
    pub(crate) psnr: Option<f64>,
    /// Point of the scene at the requested position.
    pub(crate) point: Option<[f32; 3]>,
}

/// Light in a slot of the renderer, and the plans of pictures under it by their channels.
#[derive(Debug)]
struct FilteredLight {
    setting: LightSetting,
    slot: usize,
    /// Plans of view-dependent colours.
    of_view: [Plan; 3],
    /// Plans of physical materials; those of view-dependent colours if there are none.
    of_materials: [Plan; 3],
    /// Lamps in addition to the light.
    lamps: Option<SceneLamps>,
}

/// Surface that casts the shadows of lamps.
#[derive(Debug)]
enum ShadowSurface {
    /// Surface of the scene, if there is one.
    Known(Option<Arc<Surface>>),
    /// Gaussians to fuse into the surface on first use.
    Unfused(Gaussians<Vec<f32>>),
}

impl ShadowSurface {
    /// Near field of a scene; without one, its Gaussians if lamps can light it.
    fn of(scene: &Scene) -> Self {
        match &scene.near_field {
            None if scene.gaussians.layout.is_physical => Self::Unfused(scene.gaussians.clone()),
            near_field => Self::Known(near_field.clone()),
        }
    }
}

/// Ground of the last picture that has one, for pictures under the same light.
#[derive(Debug)]
struct LitGround {
    light: LightSetting,
    lamps: LampSetting,
    ground: Arc<Ground>,
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
    /// True if there is a surface that reflected rays may hit.
    has_surface: bool,
    shadow_surface: ShadowSurface,
    /// Ground below the shadow-casting surface, found on first use.
    plane: Option<Arc<GroundPlane>>,
    ground: Option<LitGround>,
    lights: Arc<Lights>,
    /// In the order of their last use.
    filtered: Vec<FilteredLight>,
    views: Views,
    /// sRGB, from 0 to 1.
    background: [f32; 3],
    near: f32,
}

impl RenderWorker {
    /// Worker for a scene, rounded to its storage, on the renderer that `load` returns.
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
        let (has_surface, shadow_surface) = (scene.near_field.is_some(), ShadowSurface::of(&scene));
        let renderer = load(scene)?;
        let filtered = Vec::new();
        Ok(Self {
            renderer,
            storage,
            layout,
            shading_model,
            needs,
            has_surface,
            shadow_surface,
            plane: None,
            ground: None,
            lights,
            filtered,
            views,
            background,
            near,
        })
    }

    /// Disables shadows of a scene without a surface, if the renderer cannot fuse one.
    pub(crate) fn cast_known_shadows(&mut self) {
        if let ShadowSurface::Unfused(_) = self.shadow_surface {
            self.shadow_surface = ShadowSurface::Known(None);
        }
    }

    /// Replaces the scene by a later one of the same training.
    pub(crate) fn set_scene(&mut self, scene: Scene) -> Result<(), ViewerError> {
        let scene = scene.rounded(self.storage);
        self.needs = Needs::of(&scene.gaussians);
        let (light, scene) = (scene.light.clone(), Scene { light: None, ..scene });
        self.renderer.set_scene(&scene)?;
        self.has_surface = scene.near_field.is_some();
        self.shadow_surface = ShadowSurface::of(&scene);
        (self.plane, self.ground) = (None, None);
        self.lights.set_scene_light(light);
        self.filtered.clear();
        Ok(())
    }

    /// Filters the scene's own light before the first request, because the first filter takes
    /// longest.
    pub(crate) fn warm_up(&mut self) {
        // The first request reports errors again.
        let _ = self.filtered(OF_SCENE);
    }

    /// Renders a picture.
    pub(crate) fn render(&mut self, request: &FrameRequest) -> Result<Frame, ViewerError> {
        let planned = self.plan(request)?;
        let image = self.renderer.render_lit(planned.slot, &planned.camera, &planned.rules)?;
        self.finish(request, &planned, &image)
    }

    /// Prepares the light of a picture, and describes its rendering.
    pub(crate) fn plan(&mut self, request: &FrameRequest) -> Result<PlannedPicture, ViewerError> {
        let (camera, view) = self.camera(request)?;
        let layer = self.layer(request.content)?;
        let (slot, rules) = self.lit(layer, request)?;
        Ok(PlannedPicture { camera, slot, rules, view, layer })
    }

    /// Picture of a request from its channels.
    pub(crate) fn finish(
        &mut self,
        request: &FrameRequest,
        planned: &PlannedPicture,
        image: &Image<Vec<f32>>,
    ) -> Result<Frame, ViewerError> {
        let PlannedPicture { camera, view, layer, .. } = planned;
        let name = view.map(|index| self.views.name(index).to_owned());
        let (picture, psnr) = match (request.content, view) {
            (Content::Error, Some(index)) => self.compare(image, *index, camera)?,
            (Content::Layer(Layer::Rgb), _) if request.has_backdrop || request.has_ground => {
                (self.backdrop(request)?.picture(image, camera).into_rgb8(), None)
            }
            _ => (layer.picture(image, self.shading_model.shading.form, self.background), None),
        };
        let point = match request.content {
            Content::Point(at) => point_at(image, camera, at),
            _ => None,
        };
        Ok(Frame { picture, view: name, psnr, point })
    }

    /// Background of a picture: the light, or the background colour for a scene without a light;
    /// with ground, if it is requested.
    fn backdrop(&mut self, request: &FrameRequest) -> Result<Backdrop, ViewerError> {
        let light = if request.has_backdrop { self.light(request.light)? } else { None };
        let backdrop = match light {
            Some(light) => Backdrop::Environment(light),
            // Shadows are not seen on black.
            None if request.has_ground && self.background == [0.0; 3] => Backdrop::Color(BackgroundColor::WHITE),
            None => Backdrop::Color(BackgroundColor(self.background)),
        };
        if !request.has_ground {
            return Ok(backdrop);
        }
        Ok(Backdrop::Ground(Box::new(backdrop), self.ground(request)?))
    }

    /// Ground under the light of a request.
    fn ground(&mut self, request: &FrameRequest) -> Result<Arc<Ground>, ViewerError> {
        if let Some(LitGround { light, lamps, ground }) = &self.ground
            && (light, lamps) == (&request.light, &request.lamps)
        {
            return Ok(ground.clone());
        }
        let plane = self.plane()?;
        let (sky, lamps) = (self.light(request.light)?, self.lamps(request)?);
        let ground = Arc::new(Ground::new(plane, sky.as_ref(), lamps.as_ref()));
        self.ground = Some(LitGround { light: request.light, lamps: request.lamps.clone(), ground: ground.clone() });
        Ok(ground)
    }

    fn plane(&mut self) -> Result<Arc<GroundPlane>, ViewerError> {
        if let Some(plane) = &self.plane {
            return Ok(plane.clone());
        }
        let surface = self.occluder()?;
        let plane = surface.and_then(|surface| GroundPlane::new(surface, self.lights.up(), None));
        self.plane.clone_from(&plane);
        plane.ok_or_else(|| ViewerError::Request("the scene has no surface that casts shadows on ground".into()))
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

    /// True if a layer shows physical materials: by default their own layers, and any layer under a
    /// light other than that of the training.
    fn shows_materials(&self, layer: Layer, request: &FrameRequest) -> Result<bool, ViewerError> {
        let is_physical = self.layout.is_physical;
        if !is_physical && !request.lamps.is_dark() {
            let message = format!(
                "{}, so suns and lamps cannot light it; train on its photographs with --relightable",
                SceneError::NoMaterials
            );
            return Err(ViewerError::Request(message));
        }
        match request.shading {
            Some(Shading::Physical) if !is_physical => Err(SceneError::NoMaterials.into()),
            _ if layer.is_of_materials() || !request.lamps.is_dark() => Ok(true),
            Some(shading) => Ok(shading == Shading::Physical),
            None => {
                let is_own = self.shading_model.shading.form == ShadingForm::Physical;
                Ok(is_physical && (is_own || request.light != OF_SCENE))
            }
        }
    }

    /// Slot of a request's light, lamps included, and the rules of a layer under it.
    fn lit(&mut self, layer: Layer, request: &FrameRequest) -> Result<(usize, RenderRules), ViewerError> {
        let channels = Layer::channels(&[layer]);
        let index = CHANNELS.iter().position(|other| *other == channels).expect("layers have one of these channels");
        let shows_materials = self.shows_materials(layer, request)?;
        let lamps = self.lamps(request)?;
        let FilteredLight { slot, of_view, of_materials, lamps: known, .. } = self.filtered(request.light)?;
        let plan = if shows_materials { of_materials[index] } else { of_view[index] };
        let rules = RenderRules { light_layer: layer.light_layer(), ..plan.illuminated(lamps.is_some()).rules };
        let slot = *slot;
        let is_known = lamps.as_ref().is_none_or(|lamps| known.as_ref().is_some_and(|known| is_same(known, lamps)));
        if let Some(lamps) = lamps.filter(|_| !is_known) {
            // Without its lamps the slot is unused.
            let mut filtered = self.filtered.pop().expect("it was used last");
            self.renderer.add_lamps(slot, &lamps)?;
            filtered.lamps = Some(lamps);
            self.filtered.push(filtered);
        }
        Ok((slot, rules))
    }

    /// Lamps of a request, with the shadow-casting surface; `None` without lamps.
    fn lamps(&mut self, request: &FrameRequest) -> Result<Option<SceneLamps>, ViewerError> {
        let LampSetting { rays, .. } = request.lamps;
        if request.lamps.is_dark() {
            return Ok(None);
        }
        let occluder = self.occluder()?;
        Ok(Some(SceneLamps { lamps: request.lamps.lamps(self.lights.up(), request.light.turn), rays, occluder }))
    }

    /// Shadow-casting surface, fused on first use if the scene has none.
    fn occluder(&mut self) -> Result<Option<Arc<Surface>>, ViewerError> {
        let gaussians = match &self.shadow_surface {
            ShadowSurface::Known(surface) => return Ok(surface.clone()),
            ShadowSurface::Unfused(gaussians) => gaussians,
        };
        tracing::info!("fusing views into the shadow-casting surface");
        let surface = fused_surface(&mut self.renderer, gaussians, &self.views.training_cameras(), |_, _| ())?;
        self.shadow_surface = ShadowSurface::Known(surface.clone());
        Ok(surface)
    }

    /// Light of a setting; `None` for a scene without light lookups.
    fn light(&self, setting: LightSetting) -> Result<Option<Cube>, ViewerError> {
        if self.lights.turns_network(setting) {
            return Err(ViewerError::Request(
                "the scene's light is a network, which cannot be turned; add its exported map as a light".to_owned(),
            ));
        }
        let light = self.lights.get(setting).ok_or_else(|| no_light(setting.id))?;
        Ok(light.filter(|_| self.layout.is_shaded()))
    }

    /// Filtered light of a setting, from its slot or newly filtered.
    fn filtered(&mut self, setting: LightSetting) -> Result<&FilteredLight, ViewerError> {
        let filtered = match self.filtered.iter().position(|filtered| filtered.setting == setting) {
            Some(index) => self.filtered.remove(index),
            None => self.filter(setting)?,
        };
        self.filtered.push(filtered);
        Ok(self.filtered.last().expect("it was just appended"))
    }

    fn filter(&mut self, setting: LightSetting) -> Result<FilteredLight, ViewerError> {
        // Lamps need a light; use a black one if the scene has none.
        let darkness = || self.layout.is_physical.then(|| self.lights.darkness());
        let cube = self.light(setting)?.or_else(darkness);
        let materials = if self.layout.is_physical { Shading::Physical } else { Shading::View };
        let [of_view, of_materials] =
            [Shading::View, materials].map(|shading| self.plans(cube.as_ref(), self.shading_model.shaded(shading)));
        let slot = self.free_slot();
        // Levels of both shadings.
        let layer_rules = of_materials[CHANNELS.len() - 1].illuminated(self.layout.is_physical).rules;
        if let Some(cube) = cube.filter(|_| layer_rules.is_lit) {
            self.renderer.set_light(slot, &fitting(&cube, self.shading_model.scheme), &layer_rules)?;
        }
        Ok(FilteredLight { setting, slot, of_view, of_materials, lamps: None })
    }

    /// Free slot, else that of the least recently used light.
    fn free_slot(&mut self) -> usize {
        if self.filtered.len() == SLOTS {
            return self.filtered.remove(0).slot;
        }
        let is_free = |slot: &usize| self.filtered.iter().all(|filtered| filtered.slot != *slot);
        (0..SLOTS).find(is_free).expect("fewer lights than slots")
    }

    /// Plans of pictures under a light, by their channels.
    fn plans(&self, cube: Option<&Cube>, model: ShadingModel) -> [Plan; 3] {
        let needs = self.needs.under(cube);
        let levels = cube.map(|cube| levels_of(cube, model.scheme));
        let traces_near = self.has_surface && model.traces_near();
        CHANNELS.map(|channels| model.plan(self.layout, &needs, levels.as_ref(), channels).tracing(traces_near))
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

/// True if two sets of lamps are equal, including shadows.
fn is_same(one: &SceneLamps, other: &SceneLamps) -> bool {
    let surface = |lamps: &SceneLamps| lamps.occluder.as_ref().map(Arc::as_ptr);
    one.lamps == other.lamps && one.rays == other.rays && surface(one) == surface(other)
}

/// Camera resized to fit into a size, with its aspect ratio.
fn fitted(camera: Camera, [width, height]: [u32; 2]) -> Camera {
    let scale = f64::min(f64::from(width) / f64::from(camera.width), f64::from(height) / f64::from(camera.height));
    let [width, height] = [camera.width, camera.height].map(|edge| (f64::from(edge) * scale).round().max(1.0) as u32);
    camera.resized(width, height)
}

/// Point of the scene at a position of a depth picture; `None` if the coverage is below 0.5.
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
    ViewerError::Request(format!("light {id} has been replaced by later ones; upload it again"))
}

fn no_photographs() -> ViewerError {
    ViewerError::Request("no photographs to compare with: the data set of the scene is unknown".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use specula_core::{
        lamps::RAYS,
        scene::{
            ALBEDO, AMBIENT, DIFFUSE, Environment, LOG_SCALE, MEAN, METALNESS, OPACITY, QUAT, ROUGHNESS,
            RadianceActivation, TINT, len_of_values,
        },
    };
    use specula_scene::{ExecutorChoice, RenderOptions};

    const SIZE: [u32; 2] = [64, 48];
    const UP: Vec3 = Vec3::Z;

    /// A floor of flat Gaussians, and a ball above it that casts a shadow.
    fn scene() -> Scene {
        let floor = (0..400).map(|k| (Vec3::new((k % 20) as f32 * 0.2 - 1.9, (k / 20) as f32 * 0.2 - 1.9, 0.0), -4.0));
        let ball = [(Vec3::new(0.0, 0.0, 0.8), -1.2)];
        let means: Vec<(Vec3, f32)> = floor.chain(ball).collect();
        let layout = Layout::shaded(None).physical();
        let mut gaussians =
            Gaussians { count: means.len(), layout, values: vec![0.0; len_of_values(means.len(), layout)] };
        let planes = layout.physical_planes().unwrap();
        for (index, (mean, height)) in means.into_iter().enumerate() {
            gaussians.set(index, MEAN, mean.to_array());
            gaussians.set(index, LOG_SCALE, [-1.6, -1.6, height]);
            gaussians.set(index, QUAT, [1.0, 0.0, 0.0, 0.0]);
            gaussians.set(index, OPACITY, [4.0]);
            gaussians.set(index, DIFFUSE, [0.4, -0.2, -1.0]);
            gaussians.set(index, TINT, [-1.0; 3]);
            gaussians.set(index, ROUGHNESS, [0.5]);
            gaussians.set(index, planes + ALBEDO, [0.5, 0.0, -0.5]);
            gaussians.set(index, planes + METALNESS, [-3.0]);
            gaussians.set(index, planes + AMBIENT, [1.0; 3]);
        }
        let values = (0..18 * 16 * 16).map(|k| 0.1 + 0.05 * (k % 7) as f32).collect();
        let light = Environment { resolution: 16, activation: RadianceActivation::Identity, values };
        Scene {
            gaussians,
            light: Some(light),
            near_field: None,
            lamps: None,
            other_lights: Vec::new(),
            shading_model: ShadingModel::DEFERRED,
        }
    }

    fn options() -> RenderOptions {
        RenderOptions::full_precision(ExecutorChoice::Cpu)
    }

    /// Cameras whose depths are fused.
    fn around() -> impl Iterator<Item = Camera> {
        let eyes = (0..8).map(|k| Vec3::new((k as f32).cos() * 4.0, (k as f32).sin() * 4.0, 3.0));
        eyes.map(|eye| Camera { near: 0.01, ..Camera::look_at(eye, Vec3::ZERO, UP, 0.9, 160, 160) })
    }

    fn worker(scene: &Scene) -> RenderWorker {
        let lights = Arc::new(Lights::new(scene.light.clone(), 16, UP, scene.gaussians.layout.is_physical));
        let load = |scene| SceneRenderer::without_light(scene, Channels::Layers, &options());
        let views = Views::new(around().map(|camera| (String::new(), camera)).collect(), 0, None);
        RenderWorker::new(scene.clone(), Storage::F32, load, lights, views, [0.0; 3], 0.01).unwrap()
    }

    fn request(more: &str) -> FrameRequest {
        let query = format!("eye=0,-5,3&look=0,5,-2.6&up=0,0,1&angle=50&size={},{}{more}", SIZE[0], SIZE[1]);
        FrameRequest::of_frame(&format!("/frame?{query}").parse().unwrap()).unwrap()
    }

    fn shown(worker: &mut RenderWorker, more: &str) -> RgbImage {
        worker.render(&request(more)).unwrap().picture
    }

    /// The picture of the same request by the renderer of the scene.
    fn expected(scene: &Scene, more: &str) -> RgbImage {
        let request = request(more);
        let Viewpoint::Pose(pose) = request.viewpoint else { unreachable!("it has a pose") };
        let camera = Camera { near: 0.01, ..camera_of(&pose, SIZE) };
        let lamps = request.lamps.lamps(UP, request.light.turn);
        let mut scene = scene.clone();
        let occluder = scene.near_field.clone().or_else(|| surface(&scene));
        scene.add_lamps(SceneLamps { lamps, rays: request.lamps.rays, occluder }).unwrap();
        SceneRenderer::new(scene, Channels::Color, &options()).unwrap().picture(&camera, [0.0; 3]).unwrap()
    }

    fn surface(scene: &Scene) -> Option<Arc<Surface>> {
        let mut renderer = SceneRenderer::without_light(scene.clone(), Channels::Training, &options()).unwrap();
        let cameras: Vec<Camera> = around().collect();
        fused_surface(&mut renderer, &scene.gaussians, &cameras, |_, _| ()).unwrap()
    }

    #[test]
    fn pictures_under_lamps_equal_those_of_the_renderer_to_the_last_bit() {
        let plain = scene();
        let near_field = surface(&plain);
        assert!(near_field.is_some(), "the floor and the ball are seen");
        let around = Scene { near_field, ..plain.clone() };
        let sun = "&suns=30,50,4,3:ffcc88";
        let others = ["&suns=30,50,4,3:ffcc88&rays=4", "&suns=200,20&lamps=1,-1,2,6,0.3", "&lamps=0,0,2,3"];
        for scene in [plain, around] {
            let mut worker = worker(&scene);
            let before = shown(&mut worker, "");
            let sunny = shown(&mut worker, sun);
            assert_eq!(sunny, expected(&scene, sun));
            assert_ne!(sunny, shown(&mut worker, "&shading=physical"), "the sun shines");
            for other in others {
                let picture = shown(&mut worker, other);
                assert_eq!(picture, expected(&scene, other), "{other}");
                assert_ne!(picture, sunny, "{other}");
            }
            assert_eq!(shown(&mut worker, sun), sunny, "independent of requests in between");
            assert_eq!(shown(&mut worker, ""), before, "and nothing is left of lamps");
            assert_eq!(worker.filtered.len(), 1, "the light is filtered once");
        }
    }

    #[test]
    fn lamps_without_another_light_cast_shadows() {
        let mut scene = scene();
        let mut worker = worker(&scene);
        let dark = shown(&mut worker, "&light=none");
        assert!(dark.iter().all(|byte| *byte == 0), "nothing shines");
        let sun = "&light=none&suns=0,90,3,0";
        let sunny = shown(&mut worker, sun);
        scene.darken();
        assert_eq!(sunny, expected(&scene, sun));
        let unshaded = {
            worker.shadow_surface = ShadowSurface::Known(None);
            shown(&mut worker, sun)
        };
        let darker = sunny.iter().zip(unshaded.iter()).filter(|(shaded, open)| shaded < open).count();
        assert!(darker > 50, "{darker} numbers lie in the shadow of the ball");
        assert_eq!(shown(&mut worker, "&light=none"), dark);
    }

    #[test]
    fn ground_catches_shadows_under_the_light_of_the_request() {
        let scene = scene();
        let mut worker = worker(&scene);
        let open = shown(&mut worker, "");
        let sky = shown(&mut worker, "&ground=on");
        assert_ne!(open, sky);
        let picture = |more: &str, scene: &Scene, occluder: &Arc<Surface>| {
            let request = request(more);
            let Viewpoint::Pose(pose) = request.viewpoint else { unreachable!("it has a pose") };
            let camera = Camera { near: 0.01, ..camera_of(&pose, SIZE) };
            let plane = GroundPlane::new(occluder.clone(), UP, None).unwrap();
            let ground = Ground::new(plane, scene.light.as_ref(), scene.lamps.as_ref());
            let backdrop = Backdrop::Ground(Box::new(Backdrop::Color(BackgroundColor::WHITE)), Arc::new(ground));
            let mut renderer = SceneRenderer::new(scene.clone(), Channels::Color, &options()).unwrap();
            backdrop.picture(&renderer.render(&camera).unwrap(), &camera).into_rgb8()
        };
        let occluder = surface(&scene).unwrap();
        assert_eq!(sky, picture("", &scene, &occluder), "white where black would hide shadows");
        let sun = "&suns=30,50,4,3:ffcc88&ground=on";
        let mut sunny = scene.clone();
        let lamps = request(sun).lamps.lamps(UP, 0.0);
        sunny.add_lamps(SceneLamps { lamps, rays: RAYS, occluder: Some(occluder.clone()) }).unwrap();
        assert_eq!(shown(&mut worker, sun), picture(sun, &sunny, &occluder), "the ground of another light is not kept");
        assert_eq!(shown(&mut worker, "&ground=on"), sky);
        (worker.shadow_surface, worker.plane, worker.ground) = (ShadowSurface::Known(None), None, None);
        let refused = worker.render(&request("&ground=on")).unwrap_err().to_string();
        assert!(refused.contains("no surface"), "{refused}");
    }

    #[test]
    fn materials_and_view_dependent_colours_are_chosen() {
        let scene = scene();
        let mut worker = worker(&scene);
        let [own, view, physical] = ["", "&shading=view", "&shading=physical"].map(|more| shown(&mut worker, more));
        assert_eq!(own, view, "the light of the training shows view-dependent colours");
        assert_ne!(view, physical);
        let [brighter, materials, colors] =
            ["&stops=1", "&stops=1&shading=physical", "&stops=1&shading=view"].map(|more| shown(&mut worker, more));
        assert_eq!(brighter, materials, "any other light shows materials");
        assert_ne!(brighter, colors);
    }

    #[test]
    fn lamps_without_materials_are_an_error() {
        let mut scene = scene();
        let layout = Layout::shaded(None);
        let mut gaussians = Gaussians { count: 16, layout, values: vec![0.0; len_of_values(16, layout)] };
        (0..16).for_each(|index| gaussians.set(index, QUAT, [1.0, 0.0, 0.0, 0.0]));
        scene.gaussians = gaussians;
        let mut worker = worker(&scene);
        for (more, word) in
            [("&suns=0,45", "--relightable"), ("&lamps=0,0,1,1", "--relightable"), ("&shading=physical", "materials")]
        {
            let refused = worker.render(&request(more)).unwrap_err().to_string();
            assert!(refused.contains("without physical materials") && refused.contains(word), "{refused}");
        }
        assert!(worker.render(&request("&shading=view")).is_ok());
        assert_eq!(request("&suns=0,45").lamps.rays, RAYS);
    }
}
