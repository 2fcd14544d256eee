//! Viewer without a server: it answers requests within a program that renders the pictures.

use crate::{
    ViewerError,
    http::HttpError,
    lights::Lights,
    new_light::{LIGHT_MAX, UploadParameters, refuse_large, too_large},
    packed::{PackedLight, PackedScene},
    request::{Content, FrameRequest, LightSetting, query},
    setup::LightSetup,
    viewed::{PreparedScene, Start, described},
    worker::{PlannedPicture, RenderWorker},
};
use axum::http::Uri;
use serde_json::Value;
use specula_core::{camera::Camera, pack::Storage, rules::RenderRules, scene::Image};
use specula_io::{Input, picture::RgbImage};
use specula_scene::{Layer, Scene, SceneError, SceneRenderer};
use std::sync::Arc;

/// Viewer within a program that renders the requested pictures, such as a page in a browser.
///
/// Requests are query strings of the page. [`EmbeddedViewer::plan`] describes a picture, and
/// [`EmbeddedViewer::finish`] is given its channels.
#[derive(Debug)]
pub struct EmbeddedViewer {
    worker: RenderWorker,
    lights: Arc<Lights>,
    description: Value,
    setup: LightSetup,
    start: Start,
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

    /// True if colours and transmittance suffice, without other channels.
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
    /// Requested layer, sRGB.
    pub picture: RgbImage,
    /// Name of the view of the data set.
    pub view: Option<String>,
    /// Point of the scene, if one was requested and exists.
    pub point: Option<[f32; 3]>,
}

impl EmbeddedViewer {
    /// Viewer of a page's scene and lights, on the renderer that `load` returns.
    ///
    /// # Errors
    ///
    /// Those of `load`; a first light with numbers out of range, or with suns, lamps or ground on a
    /// scene without physical materials.
    pub fn new(
        packed: PackedScene,
        load: impl FnOnce(Scene) -> Result<SceneRenderer, SceneError>,
    ) -> Result<Self, ViewerError> {
        let PackedScene { viewed, lights: added, setup, .. } = packed;
        let PreparedScene { mut worker, lights, description, start } = viewed.prepare(Storage::F32, load)?;
        worker.cast_known_shadows();
        setup.check(description["physical"] == true)?;
        for PackedLight { cube, name, up } in added {
            lights.add_cube(cube, &name, up);
        }
        Ok(Self { worker, lights, description, setup, start })
    }

    /// First picture of the page, with this longer edge at most, for renderers that wait for their
    /// pictures.
    ///
    /// # Errors
    ///
    /// Those of the renderer.
    pub fn first_picture(&mut self, edge: u32) -> Result<RgbImage, ViewerError> {
        let Start { viewpoint, camera } = self.start;
        let Camera { width, height, .. } = camera.limited(edge);
        let (light, lamps) = self.setup.settings().map_err(ViewerError::Request)?;
        let request = FrameRequest {
            viewpoint,
            size: [width, height],
            content: Content::default(),
            light,
            lamps,
            shading: None,
            has_backdrop: false,
            has_ground: self.setup.has_ground,
        };
        Ok(self.worker.render(&request)?.picture)
    }

    /// Description of the scene and its lights for the page.
    pub fn description(&self) -> Value {
        described(&self.description, &self.lights, &self.setup)
    }

    /// Plans the picture of a request, and uploads its light to the renderer.
    ///
    /// # Errors
    ///
    /// Invalid requests, and errors of the renderer.
    pub fn plan(&mut self, query: &str) -> Result<PlannedFrame, ViewerError> {
        let uri = uri_of(query)?;
        let asks_for_point = uri.query().is_some_and(|query| query.split('&').any(|pair| pair.starts_with("at=")));
        let request = if asks_for_point { FrameRequest::of_point(&uri) } else { FrameRequest::of_frame(&uri) };
        let request = request.map_err(refused)?;
        let planned = self.worker.plan(&request)?;
        Ok(PlannedFrame { request, planned })
    }

    /// Picture from its channels, plane by plane, in the order of
    /// [`specula_scene::SceneRenderer::render`], or from only its colours and transmittance.
    ///
    /// # Errors
    ///
    /// A light that has been replaced.
    pub fn finish(&mut self, frame: &PlannedFrame, image: &Image<Vec<f32>>) -> Result<ShownFrame, ViewerError> {
        let frame = self.worker.finish(&frame.request, &frame.planned, image)?;
        Ok(ShownFrame { picture: frame.picture, view: frame.view, point: frame.point })
    }

    /// Adds a lat-long map from the contents of a file with the name in a query. Returns its label
    /// with warnings, for the page.
    ///
    /// # Errors
    ///
    /// Contents that are not a light, or too large.
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

    /// JPEG preview of the light in a query.
    ///
    /// # Errors
    ///
    /// A light that does not exist.
    pub fn preview(&self, text: &str) -> Result<Vec<u8>, ViewerError> {
        let setting: LightSetting = query(&uri_of(text)?).map_err(refused)?;
        self.lights.preview(setting).ok_or_else(|| ViewerError::Request("no light with this number".to_owned()))
    }
}

fn refused(error: HttpError) -> ViewerError {
    ViewerError::Request(error.message)
}

fn uri_of(query: &str) -> Result<Uri, ViewerError> {
    format!("/?{query}")
        .parse()
        .map_err(|error| ViewerError::Request(format!("{query:?} is not a valid query: {error}")))
}
