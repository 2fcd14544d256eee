//! Scenes on WebGPU in a browser: the renderer of specula's web pages.
//!
//! The page sends the requests of [`specula_viewer`] to a [`WebViewer`] instead of a server.
//! Nothing blocks: pictures are promises, and the splats of a picture are sorted with the capacity
//! that earlier ones needed.
#![cfg(target_arch = "wasm32")]
#![forbid(unsafe_code)]

mod backend;

use backend::SharedScene;
use core::cell::RefCell;
use js_sys::{Promise, Uint8Array};
use specula_core::{pack::Storage, rules::Channels, scene::Image};
use specula_gpu::{FrameContent, Gpu, GpuError, GpuExecutor, LaterFrame};
use specula_scene::{Scene, SceneError, SceneRenderer, UploadedScene};
use specula_viewer::{EmbeddedViewer, PackedScene, PlannedFrame, ShownFrame, ViewerError};
use std::rc::Rc;
use wasm_bindgen::prelude::*;
use wasm_bindgen_futures::future_to_promise;

/// Viewer of a packed scene.
#[wasm_bindgen]
#[derive(Debug)]
pub struct WebViewer {
    viewer: Rc<RefCell<EmbeddedViewer>>,
    scene: SharedScene,
    caption: String,
}

/// Picture of a request.
#[wasm_bindgen]
#[derive(Debug)]
pub struct WebPicture {
    shown: ShownFrame,
}

#[wasm_bindgen]
impl WebPicture {
    /// Pixels in a row.
    #[wasm_bindgen(getter)]
    pub fn width(&self) -> u32 {
        self.shown.picture.width()
    }

    /// Rows.
    #[wasm_bindgen(getter)]
    pub fn height(&self) -> u32 {
        self.shown.picture.height()
    }

    /// Red, green, blue and an opaque alpha of each pixel.
    #[wasm_bindgen(getter)]
    pub fn rgba(&self) -> Vec<u8> {
        self.shown.picture.pixels().flat_map(|pixel| [pixel.0[0], pixel.0[1], pixel.0[2], u8::MAX]).collect()
    }

    /// Name of the view of the data set that it shows.
    #[wasm_bindgen(getter)]
    pub fn view(&self) -> Option<String> {
        self.shown.view.clone()
    }

    /// Point of the scene, if one was requested and exists.
    #[wasm_bindgen(getter)]
    pub fn point(&self) -> Option<Vec<f32>> {
        self.shown.point.map(Vec::from)
    }
}

#[wasm_bindgen]
impl WebViewer {
    /// Opens a packed scene, or a `.glb` of a name, on the adapter that the browser prefers: a
    /// promise of a viewer.
    pub fn open(name: &str, bytes: &[u8]) -> Promise {
        let packed = PackedScene::open(name, bytes);
        future_to_promise(async move {
            let packed = packed.map_err(thrown)?;
            let gpu = Gpu::request().await.map_err(|error| thrown(SceneError::from(error).into()))?;
            Self::on(gpu, packed).map(JsValue::from).map_err(thrown)
        })
    }

    /// Description of the scene and its lights, as JSON.
    pub fn scene(&self) -> String {
        let mut description = self.viewer.borrow().description();
        description["caption"] = self.caption.as_str().into();
        description.to_string()
    }

    /// Picture or point that a query asks for: a promise of a [`WebPicture`].
    pub fn frame(&self, query: String) -> Promise {
        let (viewer, scene) = (self.viewer.clone(), self.scene.clone());
        future_to_promise(async move {
            let planned = viewer.borrow_mut().plan(&query).map_err(thrown)?;
            let image = rendered(&scene, &planned).await.map_err(|error| thrown(error.into()))?;
            let shown = viewer.borrow_mut().finish(&planned, &image).map_err(thrown)?;
            Ok(WebPicture { shown }.into())
        })
    }

    /// Adds a lat-long map that a query names, from the contents of its file; returns its label and
    /// warnings as JSON.
    ///
    /// # Errors
    ///
    /// A sentence, where the file is no light.
    pub fn add_light(&self, query: &str, bytes: &[u8]) -> Result<String, JsValue> {
        Ok(self.viewer.borrow().add_light(query, bytes).map_err(thrown)?.to_string())
    }

    /// Preview of the light that a query names, as a JPEG.
    ///
    /// # Errors
    ///
    /// A sentence, where there is no such light.
    pub fn preview(&self, query: &str) -> Result<Uint8Array, JsValue> {
        let bytes = self.viewer.borrow().preview(query).map_err(thrown)?;
        Ok(Uint8Array::from(bytes.as_slice()))
    }
}

impl WebViewer {
    fn on(gpu: Gpu, packed: PackedScene) -> Result<Self, ViewerError> {
        let caption = packed.caption.clone();
        let mut loaded = None;
        let load = |scene: Scene| {
            let mut exec = GpuExecutor::viewer(gpu, Storage::F32);
            exec.read_later();
            let shared = SharedScene::new(UploadedScene::with_executor(exec, &scene)?);
            loaded = Some(shared.clone());
            Ok(SceneRenderer::with_backend(Box::new(shared), &scene, Channels::Layers))
        };
        let viewer = EmbeddedViewer::new(packed, load)?;
        let scene = loaded.expect("the scene was loaded");
        Ok(Self { viewer: Rc::new(RefCell::new(viewer)), scene, caption })
    }
}

/// Channels of a picture. One with more splats than the pictures before is rendered twice.
async fn rendered(scene: &SharedScene, planned: &PlannedFrame) -> Result<Image<Vec<f32>>, SceneError> {
    let camera = planned.camera();
    let content = if planned.shows_colors() { FrameContent::Colors } else { FrameContent::Channels };
    loop {
        let later = {
            let mut scene = scene.lock();
            let frame = scene.frame(planned.slot(), camera, planned.rules())?;
            scene.executor().read_frame_later(&frame, content)?
        };
        let LaterFrame { values, planes: channels, capacity } = later.await?;
        scene.lock().executor().grant(capacity);
        if let Some(values) = values {
            let (width, height) = (camera.width as usize, camera.height as usize);
            return Ok(Image { width, height, channels, values });
        }
    }
}

/// Error of JavaScript with the sentence of an error, as a reader of a page can act upon it.
fn thrown(error: ViewerError) -> JsValue {
    let sentence = match &error {
        ViewerError::Scene(SceneError::Gpu(error)) => sentence(error),
        _ => error.to_string(),
    };
    js_sys::Error::new(&sentence).into()
}

fn sentence(error: &GpuError) -> String {
    match error {
        GpuError::NoAdapter { .. } => {
            "This browser has WebGPU, but no graphics adapter for it, so only a still picture is shown. Turn on hardware \
             acceleration in its settings, or use another browser."
                .to_owned()
        }
        GpuError::NoDevice { reason, .. } => {
            format!("the graphics adapter gives no device ({reason}); reload the page")
        }
        GpuError::TooLimited { reason, .. } => {
            format!(
                "the graphics adapter allows less than WebGPU's defaults, so only a still picture is shown: {reason}"
            )
        }
        GpuError::OutOfMemory => {
            "the graphics device has no memory left; close other pages, or make the window smaller".to_owned()
        }
        GpuError::TooLarge { what, bytes, limit } => format!(
            "{what} take {bytes} bytes, and the graphics adapter allows {limit} of an array; make the window smaller, or \
             export fewer Gaussians"
        ),
        GpuError::Lost { reason } => format!("the browser lost the graphics device ({reason}); reload the page"),
        GpuError::Refused { reason } => format!("the browser refused a command: {reason}"),
        other => other.to_string(),
    }
}
