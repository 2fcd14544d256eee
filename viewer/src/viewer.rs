//! Viewer of a scene: its server, its render worker, and their start.

use crate::{
    ViewerError,
    guard::Guard,
    lights::Lights,
    live::LiveTraining,
    queue::Queue,
    request::{self, LampSetting},
    server::{listen, serve},
    setup::LightSetup,
    state::ServerState,
    url,
    views::{PhotographSource, Views, camera_json},
    worker::RenderWorker,
};
use core::net::{Ipv4Addr, SocketAddr};
use serde_json::{Value, json};
use specula_core::{rules::Channels, shade::ShadingForm};
use specula_io::{cameras::NamedCamera, orientation::Orientation};
use specula_scene::{
    Layer, OpenedModel, RenderOptions, Scene, SceneError, SceneRenderer, lamps::direction, light_file::MapUp,
    orbit::StartView,
};
use std::{
    path::Path,
    sync::Arc,
    thread::{self, JoinHandle},
};
use tempfile::TempDir;
use tokio::{
    net::TcpListener,
    runtime::{Builder, Runtime},
};

/// Threads that encode pictures and read lights.
const BLOCKING_THREADS: usize = 4;

/// Options of a viewer.
#[derive(Clone, Debug)]
pub struct ViewerOptions {
    /// Address to listen at; port 0 stands for any free port.
    pub address: SocketAddr,
    /// Access token. Without one, requests to a loopback address need none, and a random token is
    /// generated for all other addresses.
    pub token: Option<String>,
    /// Executor and precision of the renderer.
    pub render: RenderOptions,
}

impl ViewerOptions {
    /// Address of a viewer by default: `127.0.0.1:7008`.
    pub const DEFAULT_ADDRESS: SocketAddr = SocketAddr::new(core::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 7008);
}

impl Default for ViewerOptions {
    /// Viewer on the loopback interface, without a token.
    fn default() -> Self {
        Self { address: Self::DEFAULT_ADDRESS, token: None, render: RenderOptions::default() }
    }
}

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
    /// Up direction and centre, which the camera orbits.
    pub orientation: Orientation,
    /// Data set of the photographs, for error maps.
    pub photographs: Option<PhotographSource>,
    /// Background in sRGB, from 0 to 1.
    pub background: [f32; 3],
}

impl ViewedScene {
    /// Scene of a model, with its cameras, its orientation and the background of its training;
    /// without photographs.
    ///
    /// # Errors
    ///
    /// A `cameras.json` that cannot be read.
    pub fn of_model(name: impl Into<String>, model: OpenedModel) -> Result<Self, ViewerError> {
        Ok(Self {
            name: name.into(),
            views: model.cameras()?,
            held_out: model.test_views().unwrap_or(0),
            orientation: model.orientation(None)?,
            photographs: None,
            background: model.background(),
            scene: model.scene,
        })
    }
}

/// Light that was added to a viewer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AddedLight {
    /// Identifier, counted from 1.
    pub id: u32,
    /// Warnings about its contents, such as numbers that are no radiance.
    pub warnings: Vec<String>,
}

/// Viewer that is ready to serve.
#[derive(Debug)]
pub struct Viewer {
    state: Arc<ServerState>,
    runtime: Runtime,
    listener: TcpListener,
    address: SocketAddr,
    /// Folder of uploaded lights, removed with its files when it is dropped.
    upload_folder: TempDir,
}

impl Viewer {
    /// Binds the address, loads the scene on its executor and starts to render on a thread. Nothing
    /// is served before [`Viewer::serve`] or [`Viewer::spawn`].
    ///
    /// # Errors
    ///
    /// An address that cannot be bound, or a device that cannot be opened or is too small.
    pub fn bind(
        options: &ViewerOptions,
        viewed: ViewedScene,
        live: Option<Arc<LiveTraining>>,
    ) -> Result<Self, ViewerError> {
        let load = |scene| SceneRenderer::without_light(scene, Channels::Layers, &options.render);
        Self::with_renderer(options, viewed, live, load)
    }

    /// Viewer on the renderer of the caller: `load` puts the scene, which is rounded to the storage
    /// of `options`, on an executor.
    ///
    /// # Errors
    ///
    /// An address that cannot be bound, and those of `load`.
    pub fn with_renderer(
        options: &ViewerOptions,
        viewed: ViewedScene,
        live: Option<Arc<LiveTraining>>,
        load: impl FnOnce(Scene) -> Result<SceneRenderer, SceneError>,
    ) -> Result<Self, ViewerError> {
        // The address comes first, since loading takes long.
        let runtime = Builder::new_current_thread().enable_all().max_blocking_threads(BLOCKING_THREADS).build();
        let runtime = runtime.map_err(ViewerError::Runtime)?;
        let listener = runtime.block_on(listen(options.address))?;
        let address = listener.local_addr().map_err(ViewerError::Runtime)?;
        let guard = Guard::new(options.address.ip(), options.token.as_deref())?;
        let upload_folder = tempfile::tempdir().map_err(ViewerError::UploadFolder)?;

        let ViewedScene { name, scene, views, held_out, orientation, photographs, background } = viewed;
        let StartView { known: views, first, start, centre, up } = StartView::new(&orientation, views);
        let views = Views::new(views, held_out, photographs);
        let is_physical = scene.gaussians.layout.is_physical;
        let lights = Arc::new(Lights::new(scene.light.clone(), scene.resolution_of_others(), up, is_physical));
        let is_shaded = scene.gaussians.layout.is_shaded();
        let description = json!({
            "name": name,
            "gaussians": scene.gaussians.count,
            "shaded": is_shaded,
            "physical": is_physical,
            "layers": layers(&scene, &views),
            "views": views.json(),
            "first": first,
            "start": camera_json(&start),
            "centre": centre.to_array(),
            "up": up.to_array(),
            "azimuth_zero": direction(0.0, 0.0, up).as_vec3().to_array(),
            "lamps_max": LampSetting::COUNT_MAX,
            "background": background,
            "pixels_max": request::PIXELS_MAX,
        });
        let (storage, near) = (options.render.storage, start.near);
        let worker = RenderWorker::new(scene, storage, load, lights.clone(), views, background, near)?;
        let queue = Arc::new(Queue::new());
        worker.spawn(queue.clone(), live.clone());
        let folder = upload_folder.path().to_owned();
        let state = Arc::new(ServerState::new(guard, queue, lights, description, is_shaded, live, folder));
        Ok(Self { state, runtime, listener, address, upload_folder })
    }

    /// Adds a lat-long map of radiance to the lights of the scene.
    ///
    /// # Errors
    ///
    /// A file that cannot be read as a light.
    pub fn add_light(&self, file: &Path, up: MapUp) -> Result<AddedLight, ViewerError> {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let (label, warnings) = self.state.lights.add(file, &name, up)?;
        Ok(AddedLight { id: label.id, warnings })
    }

    /// Lets the page start with a light, unless an address names another; the first call counts.
    ///
    /// # Errors
    ///
    /// Numbers that no request may contain; suns or lamps on a scene without physical materials.
    pub fn start_under(&self, setup: LightSetup) -> Result<(), ViewerError> {
        if setup.has_lamps() && self.state.description["physical"] != true {
            return Err(SceneError::NoMaterials.into());
        }
        setup.check()?;
        self.state.start_under(setup);
        Ok(())
    }

    /// URLs of the page, with the token in their fragment: one for each network interface where the
    /// viewer listens at the unspecified address.
    pub fn urls(&self) -> Vec<String> {
        url::urls(self.address, self.state.guard.token())
    }

    /// QR code of the first URL in lines of text; none for a viewer on the loopback interface.
    pub fn qr_code(&self) -> Option<String> {
        if self.address.ip().is_loopback() {
            return None;
        }
        self.urls().first().and_then(|url| url::qr_code(url))
    }

    /// Serves until `is_stopped` returns true, which is polled every 100 ms.
    ///
    /// # Errors
    ///
    /// A server that ended by itself.
    pub fn serve(self, is_stopped: impl Fn() -> bool) -> Result<(), ViewerError> {
        let Self { state, runtime, listener, upload_folder: _upload_folder, .. } = self;
        runtime.block_on(serve(listener, state, is_stopped))
    }

    /// Serves on a thread until `is_stopped` returns true, so that a training continues meanwhile.
    /// An error of the server is logged.
    pub fn spawn(self, is_stopped: impl Fn() -> bool + Send + 'static) -> ViewerThread {
        let Self { state, runtime, listener, upload_folder, .. } = self;
        let thread = thread::spawn(move || {
            if let Err(error) = runtime.block_on(serve(listener, state, is_stopped)) {
                tracing::warn!("{error}; the training continues without a viewer");
            }
        });
        ViewerThread { thread, _upload_folder: upload_folder }
    }
}

/// Viewer that serves on a separate thread.
///
/// The thread lives on when this is dropped, and only the folder of uploaded lights is removed: a
/// program that ends does not wait for its viewer.
#[derive(Debug)]
pub struct ViewerThread {
    thread: JoinHandle<()>,
    _upload_folder: TempDir,
}

impl ViewerThread {
    /// Waits until the viewer is stopped.
    pub fn join(self) {
        // A panic was reported by its thread.
        let _ = self.thread.join();
    }
}

/// Names of the layers that the scene has, as the page lists them.
fn layers(scene: &Scene, views: &Views) -> Vec<Value> {
    let (layout, form) = (scene.gaussians.layout, scene.shading_model.shading.form);
    let forms = [Some(form), layout.is_physical.then_some(ShadingForm::Physical)];
    let exists = |layer: &Layer| forms.iter().flatten().any(|form| layer.exists(layout, *form));
    let layers = Layer::EACH.into_iter().filter(exists);
    let error = views.has_photographs().then(|| request::ERROR.into());
    layers.map(|layer| layer.name().into()).chain(error).collect()
}
