//! Scene to view, and its description for the page.

use crate::{
    ViewerError,
    lights::{Label, Lights},
    request::{self, LampSetting, Pose, Viewpoint},
    setup::LightSetup,
    views::{PhotographSource, Views, camera_json},
    worker::RenderWorker,
};
use serde_json::{Value, json};
use specula_core::{camera::Camera, pack::Storage, shade::ShadingForm};
use specula_io::{cameras::NamedCamera, orientation::Orientation};
use specula_scene::{Layer, OpenedModel, Scene, SceneError, SceneRenderer, lamps::direction, orbit::StartView};
use std::sync::Arc;

/// Scene to view, with its cameras and photographs.
#[derive(Debug)]
pub struct ViewedScene {
    /// Name in the title of the page.
    pub name: String,
    /// Gaussians, light and shading model.
    pub scene: Scene,
    /// Cameras of the data set, held-out views first; may be empty.
    pub views: Vec<NamedCamera>,
    /// Number of held-out views.
    pub held_out: usize,
    /// Origin of scene and cameras in the world of the data set.
    pub origin: [f64; 3],
    /// Up direction and centre, which the camera orbits.
    pub orientation: Orientation,
    /// Data set of the photographs, for error maps.
    pub photographs: Option<PhotographSource>,
    /// Background in sRGB, from 0 to 1.
    pub background: [f32; 3],
}

impl ViewedScene {
    /// Scene of a model, with its cameras, orientation and background of the training, without
    /// photographs.
    ///
    /// # Errors
    ///
    /// A `cameras.json` that cannot be read.
    pub fn of_model(name: impl Into<String>, model: OpenedModel) -> Result<Self, ViewerError> {
        Ok(Self {
            name: name.into(),
            views: model.cameras()?,
            held_out: model.test_views().unwrap_or(0),
            origin: model.origin,
            orientation: model.orientation(None)?,
            photographs: None,
            background: model.background(),
            scene: model.scene,
        })
    }

    /// Prepares requests of pictures: `load` uploads the scene, rounded to its storage, to an
    /// executor.
    ///
    /// # Errors
    ///
    /// Those of `load`.
    pub(crate) fn prepare(
        self,
        storage: Storage,
        load: impl FnOnce(Scene) -> Result<SceneRenderer, SceneError>,
    ) -> Result<PreparedScene, ViewerError> {
        let Self { name, scene, views, held_out, origin, orientation, photographs, background } = self;
        let StartView { known: views, first, start, centre, up } = StartView::new(&orientation, views);
        let first_view = first.and_then(|index| Some((index, views.get(index)?.1)));
        let views = Views::new(views, held_out, photographs);
        let is_physical = scene.gaussians.layout.is_physical;
        let lights = Arc::new(Lights::new(scene.light.clone(), scene.resolution_of_others(), up, is_physical));
        let is_shaded = scene.gaussians.layout.is_shaded();
        let description = json!({
            "name": name,
            "gaussians": scene.gaussians.count,
            "shaded": is_shaded,
            "physical": is_physical,
            "shading": scene.shading_model.shading().name(),
            "layers": layers(&scene, &views),
            "views": views.json(),
            "first": first,
            "start": camera_json(&start),
            "origin": origin,
            "centre": centre.to_array(),
            "up": up.to_array(),
            "azimuth_zero": direction(0.0, 0.0, up).as_vec3().to_array(),
            "lamps_max": LampSetting::COUNT_MAX,
            "background": background,
            "pixels_max": request::PIXELS_MAX,
        });
        let worker = RenderWorker::new(scene, storage, load, lights.clone(), views, background, start.near)?;
        let start = match first_view {
            Some((index, camera)) => Start { viewpoint: Viewpoint::View(index), camera },
            None => Start { viewpoint: Viewpoint::Pose(Pose::of(&start)), camera: start },
        };
        Ok(PreparedScene { worker, lights, description, start })
    }
}

/// Scene on an executor, its lights, and its constant description.
#[derive(Debug)]
pub(crate) struct PreparedScene {
    pub(crate) worker: RenderWorker,
    pub(crate) lights: Arc<Lights>,
    pub(crate) description: Value,
    pub(crate) start: Start,
}

/// First view of the page.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Start {
    pub(crate) viewpoint: Viewpoint,
    pub(crate) camera: Camera,
}

/// Description of a scene with its lights and the first light of the page.
pub(crate) fn described(description: &Value, lights: &Lights, setup: &LightSetup) -> Value {
    let mut description = description.clone();
    description["lights"] = lights.labels().iter().map(Label::json).collect();
    description["setup"] = setup.json();
    description
}

/// Names of the scene's layers, for the page.
fn layers(scene: &Scene, views: &Views) -> Vec<Value> {
    let (layout, form) = (scene.gaussians.layout, scene.shading_model.shading.form);
    let forms = [Some(form), layout.is_physical.then_some(ShadingForm::Physical)];
    let exists = |layer: &Layer| forms.iter().flatten().any(|form| layer.exists(layout, *form));
    let layers = Layer::EACH.into_iter().filter(exists);
    let error = views.has_photographs().then(|| request::ERROR.into());
    layers.map(|layer| layer.name().into()).chain(error).collect()
}
