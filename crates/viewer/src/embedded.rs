//! Viewer without a server: requests are answered within a program, which renders the pictures.

use crate::{
    SetupEnvironment, ViewerError,
    http::HttpError,
    lights::Lights,
    new_light::{LIGHT_MAX, UploadParameters, refuse_large, too_large},
    request::{Content, FrameRequest, LightSetting, query},
    setup::LightSetup,
    viewed::{PreparedScene, ViewedScene, described},
    worker::{PlannedPicture, RenderWorker},
};
use axum::http::Uri;
use serde_json::Value;
use specula_core::{
    camera::Camera,
    pack::Storage,
    rules::RenderRules,
    scene::{Environment, Image},
};
use specula_io::{Input, picture::RgbImage};
use specula_scene::{Layer, Scene, SceneError, SceneRenderer, light_file::MapUp};
use std::sync::Arc;

/// Viewer whose program renders the pictures that requests ask for, as a page in a browser does.
///
/// Requests are query strings of the page. [`EmbeddedViewer::plan`] describes a picture, and
/// [`EmbeddedViewer::finish`] is given its channels.
#[derive(Debug)]
pub struct EmbeddedViewer {
    worker: RenderWorker,
    lights: Arc<Lights>,
    description: Value,
    setup: LightSetup,
}

/// Picture to render: camera, light and rules.
#[derive(Debug)]
pub struct PlannedFrame {
    request: FrameRequest,
    planned: PlannedPicture,
}

impl PlannedFrame {
    /// Camera.
    pub const fn camera(&self) -> &Camera {
        &self.planned.camera
    }

    /// Slot of the light on the renderer.
    pub const fn slot(&self) -> usize {
        self.planned.slot
    }

    /// Whether its colours and transmittance are enough, without other channels.
    pub fn shows_colors(&self) -> bool {
        self.request.content == Content::Layer(Layer::Rgb)
    }

    /// Rules of the picture.
    pub const fn rules(&self) -> &RenderRules {
        &self.planned.rules
    }
}

/// Picture of a request.
#[derive(Clone, Debug)]
pub struct ShownFrame {
    /// Layer that was asked for, sRGB.
    pub picture: RgbImage,
    /// Name of the view of the data set that it shows.
    pub view: Option<String>,
    /// Point of the scene, where one was asked for and is there.
    pub point: Option<[f32; 3]>,
}

impl EmbeddedViewer {
    /// Viewer of a scene that `load` puts on a renderer.
    ///
    /// # Errors
    ///
    /// Those of `load`.
    pub fn new(
        viewed: ViewedScene,
        load: impl FnOnce(Scene) -> Result<SceneRenderer, SceneError>,
    ) -> Result<Self, ViewerError> {
        let PreparedScene { mut worker, lights, description } = viewed.prepare(Storage::F32, load)?;
        worker.cast_known_shadows();
        Ok(Self { worker, lights, description, setup: LightSetup::default() })
    }

    /// Adds a light, a cube map that had the file name `name` as a lat-long map; returns its
    /// identifier.
    pub fn add_cube(&self, cube: Environment<Vec<f32>>, name: &str, up: MapUp) -> u32 {
        self.lights.add_cube(cube, name, up).id
    }

    /// Lets the page start with a light that was added.
    pub fn start_under(&mut self, id: u32) {
        self.setup.environment = SetupEnvironment::Added(id);
    }

    /// Description of the scene and its lights, as the page reads it.
    pub fn description(&self) -> Value {
        described(&self.description, &self.lights, &self.setup)
    }

    /// Plans the picture of a request, and puts its light on the renderer.
    ///
    /// # Errors
    ///
    /// A request that cannot be, and those of the renderer.
    pub fn plan(&mut self, query: &str) -> Result<PlannedFrame, ViewerError> {
        let uri = uri_of(query)?;
        let asks_for_point = uri.query().is_some_and(|query| query.split('&').any(|pair| pair.starts_with("at=")));
        let request = if asks_for_point { FrameRequest::of_point(&uri) } else { FrameRequest::of_frame(&uri) };
        let request = request.map_err(refused)?;
        let planned = self.worker.plan(&request)?;
        Ok(PlannedFrame { request, planned })
    }

    /// Picture of its channels, plane by plane, as [`specula_scene::SceneRenderer::render`] has
    /// them, or of its colours and transmittance alone.
    ///
    /// # Errors
    ///
    /// A light that was replaced meanwhile.
    pub fn finish(&mut self, frame: &PlannedFrame, image: &Image<Vec<f32>>) -> Result<ShownFrame, ViewerError> {
        let frame = self.worker.finish(&frame.request, &frame.planned, image)?;
        Ok(ShownFrame { picture: frame.picture, view: frame.view, point: frame.point })
    }

    /// Adds a lat-long map from the contents of a file, which a query names. Returns its label with
    /// warnings, as the page reads them.
    ///
    /// # Errors
    ///
    /// Contents that are no light, or more than are read.
    pub fn add_light(&self, text: &str, bytes: &[u8]) -> Result<Value, ViewerError> {
        if self.description["shaded"] != true {
            return Err(ViewerError::Request(
                "the scene is plain Gaussian splatting, whose colours include their light".to_owned(),
            ));
        }
        let parameters: UploadParameters = query(&uri_of(text)?).map_err(refused)?;
        parameters.extension().map_err(refused)?;
        if bytes.len() > LIGHT_MAX {
            return Err(refused(too_large()));
        }
        let UploadParameters { name, up } = &parameters;
        let input = Input::memory(name, bytes);
        refuse_large(input, name)?;
        let (label, warnings) = self.lights.add(input, name, *up)?;
        let mut answer = label.json();
        answer["notes"] = warnings.into();
        Ok(answer)
    }

    /// Preview of the light that a query names, as a JPEG.
    ///
    /// # Errors
    ///
    /// A light that is not there.
    pub fn preview(&self, text: &str) -> Result<Vec<u8>, ViewerError> {
        let setting: LightSetting = query(&uri_of(text)?).map_err(refused)?;
        self.lights.preview(setting).ok_or_else(|| ViewerError::Request("there is no such light".to_owned()))
    }
}

fn refused(error: HttpError) -> ViewerError {
    ViewerError::Request(error.message)
}

fn uri_of(query: &str) -> Result<Uri, ViewerError> {
    format!("/?{query}").parse().map_err(|error| ViewerError::Request(format!("{query:?} is no query: {error}")))
}
