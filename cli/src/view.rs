//! `specula view`: a scene in a browser. A thread renders what clients ask for, one picture after the other; a server
//! hands them the page and the pictures. What a client looks at is known to the client alone, so they do not disturb
//! each other.

mod album;
mod announce;
mod connections;
mod guard;
mod lights;
pub(crate) mod live;
mod queue;
mod request;
mod server;
mod studio;
mod upload;

use crate::{
    args::{MachineOptions, Train, View, ViewUntil},
    background::Background,
    dataset,
    failure::Failure,
    interrupt,
    look::{Surroundings, own_cameras},
    orientation, output,
    scene::{self, background_of, note_oddities},
};
pub(crate) use album::Source;
use album::{Album, camera_facts};
use core::net::SocketAddr;
use guard::Guard;
use lights::Lights;
use live::Live;
use queue::Queue;
use serde_json::{Value, json};
use server::{Job, Site};
use specula_io::{cameras::NamedCamera, orientation::Orientation};
use specula_scene::{Layer, OpenedModel, Scene};
use std::{
    path::{Path, PathBuf},
    sync::Arc,
    thread::{self, JoinHandle},
};
use studio::Studio;
use tempfile::TempDir;
use tokio::{net::TcpListener, runtime::Runtime};

/// Threads that pack pictures and read lights.
const BLOCKING_THREADS: usize = 4;

/// Serves the page until Ctrl-C.
pub(crate) fn run(args: &View) -> Result<(), Failure> {
    let opened = scene::open(&args.scene, args.showing.profile)?;
    note_oddities(&opened);
    let background = background_of(&opened, args.background);
    let name = name_of(&args.scene);
    let shown = Shown {
        name,
        known: own_cameras(&opened)?.unwrap_or_default(),
        orientation: orientation::of(&opened, args.showing.scene_up)?,
        held_out: opened.test_views().unwrap_or(0),
        source: source_of(&opened),
        scene: opened.scene,
        background,
        live: None,
    };
    let place = Place { address: args.listen, token: args.token.clone() };
    let machine = args.showing.machine.clone();
    let Stage { site, lights, runtime, listener, arrivals: _arrivals } = Stage::new(shown, &place, machine)?;
    for env in &args.env {
        let (_, notes) = lights.add(env, &name_of(env), args.env_up)?;
        notes.iter().for_each(|note| tracing::info!("{note}"));
    }
    interrupt::watch()?;
    announce(&listener, &site)?;
    tracing::info!("open it in a browser; Ctrl-C ends it");
    runtime.block_on(server::serve(listener, site))
}

/// What is shown, and what is known about it.
#[derive(Debug)]
pub(crate) struct Shown {
    pub(crate) name: String,
    pub(crate) scene: Scene,
    /// Views, those that were held out first, and how many those are.
    pub(crate) known: Vec<NamedCamera>,
    pub(crate) held_out: usize,
    pub(crate) orientation: Orientation,
    pub(crate) source: Option<Source>,
    pub(crate) background: Background,
    /// The training that it is of, if it is going on.
    pub(crate) live: Option<Arc<Live>>,
}

/// Where a page is served, and the token that is asked for.
#[derive(Clone, Debug)]
pub(crate) struct Place {
    address: SocketAddr,
    token: Option<String>,
}

/// Everything that it takes to serve a page.
struct Stage {
    site: Arc<Site>,
    lights: Arc<Lights>,
    runtime: Runtime,
    listener: TcpListener,
    /// Folder of lights that come in; removed with its files when it is dropped.
    arrivals: TempDir,
}

impl Stage {
    /// Takes the address first, so that nothing is rendered in vain, and starts the thread that renders.
    fn new(shown: Shown, place: &Place, machine: MachineOptions) -> Result<Self, Failure> {
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_all().max_blocking_threads(BLOCKING_THREADS).build();
        let runtime = runtime.map_err(|error| Failure::Internal(format!("cannot serve: {error}")))?;
        let listener = runtime.block_on(server::listen(place.address))?;
        let guard = Guard::new(place.address.ip(), place.token.as_deref())?;
        let arrivals = tempfile::tempdir()
            .map_err(|error| Failure::Internal(format!("cannot make a folder for lights that come in: {error}")))?;

        let Shown { name, scene, known, held_out, orientation, source, background, live } = shown;
        let Surroundings { known, first, start, centre, up } = Surroundings::of(&orientation, known);
        let album = Album::new(known, held_out, source);
        let lights = Arc::new(Lights::new(scene.light.clone(), scene.resolution_of_others(), up));
        let facts = json!({
            "name": name,
            "gaussians": scene.gaussians.count,
            "shaded": scene.gaussians.layout.is_shaded(),
            "layers": layers(&scene, &album),
            "views": album.facts(),
            "first": first,
            "start": camera_facts(&start),
            "centre": centre.to_array(),
            "up": up.to_array(),
            "background": background.0,
            "pixels_max": request::PIXELS_MAX,
        });
        let studio = Studio::new(scene, lights.clone(), album, background, start.near, machine)?;
        let queue = Arc::new(Queue::new());
        spawn_renderer(studio, queue.clone(), live.clone());
        let site = Arc::new(Site {
            guard,
            queue,
            lights: lights.clone(),
            facts,
            live,
            uploads: Site::one_upload(),
            arrivals: arrivals.path().to_owned(),
            sending: Site::room_for_sending(),
        });
        Ok(Self { site, lights, runtime, listener, arrivals })
    }
}

/// The layers that can be shown.
fn layers(scene: &Scene, album: &Album) -> Vec<Value> {
    let is_shaded = scene.gaussians.layout.is_shaded();
    let layers = Layer::EACH.into_iter().filter(|layer| is_shaded || !layer.is_of_shading());
    let error = album.has_photographs().then(|| request::ERROR.into());
    layers.map(|layer| layer.name().into()).chain(error).collect()
}

/// Renders what is asked for, one picture after the other.
fn spawn_renderer(mut studio: Studio, queue: Arc<Queue<Job>>, live: Option<Arc<Live>>) -> JoinHandle<()> {
    /// However the thread ends, nobody waits for it any more.
    struct Closing(Arc<Queue<Job>>);
    impl Drop for Closing {
        fn drop(&mut self) {
            self.0.close();
        }
    }
    thread::spawn(move || {
        let closing = Closing(queue);
        studio.warm_up();
        while let Some(Job { ask, reply }) = closing.0.next() {
            // Who went away wants no picture.
            if reply.is_closed() {
                continue;
            }
            let latest = live.as_ref().and_then(|live| live.take());
            let shot = latest.map_or(Ok(()), |scene| studio.put(scene)).and_then(|()| studio.shoot(&ask));
            // The same, while it was made.
            let _ = reply.send(shot);
        }
    })
}

/// Says where the page is.
fn announce(listener: &TcpListener, site: &Site) -> Result<(), Failure> {
    let address = listener.local_addr().map_err(|error| Failure::Internal(format!("no address: {error}")))?;
    announce::announce(address, site.guard.token())
}

/// The page of a training, in threads of its own.
#[derive(Debug)]
pub(crate) struct Watching {
    live: Arc<Live>,
    server: JoinHandle<()>,
    stays: bool,
    _arrivals: TempDir,
}

impl Watching {
    /// Shows the scene that a training came to until Ctrl-C, where that is wished for.
    pub(crate) fn stay(self, result: impl FnOnce() -> Result<(Scene, u32), Failure>) -> Result<(), Failure> {
        if !self.stays {
            return Ok(());
        }
        let (scene, iteration) = result()?;
        self.live.finish(scene, iteration);
        tracing::info!("the training is finished, and the page stays; Ctrl-C ends it");
        let _ = self.server.join();
        Ok(())
    }
}

/// Shows a training while it goes on.
pub(crate) fn watch(args: &Train, address: SocketAddr, shown: Shown, live: Arc<Live>) -> Result<Watching, Failure> {
    let place = Place { address, token: args.watch.token.clone() };
    let machine = MachineOptions::in_full(&args.executor);
    let shown = Shown { live: Some(live.clone()), ..shown };
    let Stage { site, runtime, listener, arrivals, .. } = Stage::new(shown, &place, machine)?;
    announce(&listener, &site)?;
    let server = thread::spawn(move || {
        if let Err(failure) = runtime.block_on(server::serve(listener, site)) {
            tracing::warn!("{failure}; the training goes on unwatched");
        }
    });
    let until = args.watch.view_until.unwrap_or_else(ViewUntil::usual);
    Ok(Watching { live, server, stays: until == ViewUntil::CtrlC, _arrivals: arrivals })
}

/// Name of a file or a folder.
fn name_of(path: &Path) -> String {
    output::stem(Path::new(&output::absolute(path)))
}

/// The photographs of a model, if the data set of its training is still there.
fn source_of(opened: &OpenedModel) -> Option<Source> {
    let info = opened.info.as_ref()?;
    let options = dataset::options_of(info);
    let folder = PathBuf::from(&info.source_path);
    folder.is_dir().then_some(Source { folder, options })
}
