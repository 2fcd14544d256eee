//! Viewer of a scene: its server, its render worker, and their start.

use crate::{
    ViewerError,
    guard::Guard,
    live::LiveTraining,
    queue::Queue,
    render_thread::spawn,
    server::{listen, serve},
    setup::LightSetup,
    state::ServerState,
    url,
    viewed::{PreparedScene, ViewedScene},
};
use core::net::{Ipv4Addr, SocketAddr};
use specula_core::{rules::Channels, scene::Environment};
use specula_io::Input;
use specula_scene::{RenderOptions, Scene, SceneError, SceneRenderer, light_file::MapUp};
use std::{
    sync::Arc,
    thread::{self, JoinHandle},
    time::SystemTime,
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
    /// Address to listen at; port 0 selects any free port.
    pub address: SocketAddr,
    /// Access token. Without one, requests to a loopback address need none, and a random token is
    /// generated for all other addresses.
    pub token: Option<String>,
    /// Executor and precision of the renderer.
    pub render: RenderOptions,
}

impl ViewerOptions {
    /// Default address of a viewer: `127.0.0.1:7008`.
    pub const DEFAULT_ADDRESS: SocketAddr = SocketAddr::new(core::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 7008);
}

impl Default for ViewerOptions {
    /// Viewer on the loopback interface, without a token.
    fn default() -> Self {
        Self { address: Self::DEFAULT_ADDRESS, token: None, render: RenderOptions::default() }
    }
}

/// Light added to a viewer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AddedLight {
    /// Identifier, counted from 1.
    pub id: u32,
    /// Warnings about its contents, such as invalid radiance.
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
    /// Binds the address, loads the scene on its executor and starts the render thread. Nothing is
    /// served before [`Viewer::serve`] or [`Viewer::spawn`].
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

    /// Viewer on the caller's renderer: `load` uploads the scene, rounded to the storage of
    /// `options`, to an executor.
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
        if SystemTime::now() < SystemTime::UNIX_EPOCH {
            return Err(ViewerError::Clock);
        }
        // The address is bound first, because loading takes long.
        let runtime = Builder::new_current_thread().enable_all().max_blocking_threads(BLOCKING_THREADS).build();
        let runtime = runtime.map_err(ViewerError::Runtime)?;
        let listener = runtime.block_on(listen(options.address))?;
        let address = listener.local_addr().map_err(ViewerError::Runtime)?;
        let guard = Guard::new(options.address.ip(), options.token.as_deref())?;
        let upload_folder = tempfile::tempdir().map_err(ViewerError::UploadFolder)?;

        let PreparedScene { worker, lights, description, .. } = viewed.prepare(options.render.storage, load)?;
        let is_shaded = description["shaded"] == true;
        let queue = Arc::new(Queue::new());
        spawn(worker, queue.clone(), live.clone());
        let folder = upload_folder.path().to_owned();
        let state = Arc::new(ServerState::new(guard, queue, lights, description, is_shaded, live, folder));
        Ok(Self { state, runtime, listener, address, upload_folder })
    }

    /// Adds a lat-long map of radiance to the lights of the scene.
    ///
    /// # Errors
    ///
    /// A file that cannot be read as a light.
    pub fn add_light(&self, file: Input<'_>, up: MapUp) -> Result<AddedLight, ViewerError> {
        let name = file.path().file_name().unwrap_or_default().to_string_lossy();
        let (label, warnings) = self.state.lights.add(file, &name, up)?;
        Ok(AddedLight { id: label.id, warnings })
    }

    /// Adds a light of the scene's training, such as that of other pictures, by its name.
    pub fn add_trained_light(&self, light: Environment<Vec<f32>>, name: &str) {
        self.state.lights.add_trained(light, name);
    }

    /// Sets the first light of the page, unless the address names another; only the first call has
    /// an effect.
    ///
    /// # Errors
    ///
    /// Numbers out of range; suns, lamps or ground on a scene without physical materials.
    pub fn start_under(&self, setup: LightSetup) -> Result<(), ViewerError> {
        setup.check(self.state.description["physical"] == true)?;
        self.state.start_under(setup);
        Ok(())
    }

    /// URLs of the page, with the token in their fragment: one for each network interface if the
    /// viewer listens at the unspecified address.
    pub fn urls(&self) -> Vec<String> {
        url::urls(self.address, self.state.guard.token())
    }

    /// QR code of the first URL in lines of text; `None` for a viewer on the loopback interface.
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
    /// A server that ended unexpectedly.
    pub fn serve(self, is_stopped: impl Fn() -> bool) -> Result<(), ViewerError> {
        let Self { state, runtime, listener, upload_folder: _upload_folder, .. } = self;
        runtime.block_on(serve(listener, state, is_stopped))
    }

    /// Serves on a thread until `is_stopped` returns true, while a training continues. An error of
    /// the server is logged.
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
/// Dropping this does not stop the thread and only removes the folder of uploaded lights: a program
/// that ends does not wait for its viewer.
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
