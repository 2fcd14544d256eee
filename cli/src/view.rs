//! `specula view`, and the viewer of a training: arguments become options of [`specula_viewer`].

use crate::{
    args::{EnvUp, Train, View, ViewUntil},
    background::Background,
    dataset,
    failure::Failure,
    interrupt, output,
    scene::{self, background_of, note_oddities},
};
use core::net::SocketAddr;
use specula_io::{cameras::NamedCamera, orientation::Orientation};
use specula_scene::{OpenedModel, RenderOptions, Scene, orbit::StartView};
use specula_viewer::{
    LiveTraining, MapUp, Navigation, PhotographSource, ViewedScene, Viewer, ViewerError, ViewerOptions, ViewerThread,
};
use std::{
    io::IsTerminal,
    path::{Path, PathBuf},
    sync::Arc,
};

/// Serves the page until Ctrl-C.
pub(crate) fn run(args: &View) -> Result<(), Failure> {
    let opened = scene::open(&args.scene, args.showing.profile)?;
    note_oddities(&opened);
    let background = background_of(&opened, args.background);
    let subject = Subject {
        name: name_of(&args.scene),
        views: opened.cameras()?,
        orientation: opened.orientation(args.showing.scene_up.map(Into::into))?,
        held_out: opened.test_views().unwrap_or(0),
        photographs: photographs_of(&opened),
        scene: opened.scene,
        background,
    };
    let render = (&args.showing.machine).into();
    let options = ViewerOptions { address: args.listen, token: args.token.clone(), render };
    let viewer = Viewer::bind(&options, subject.into(), None)?;
    for file in &args.env {
        let warnings = viewer.add_light(file, args.env_up.into())?;
        warnings.iter().for_each(|warning| tracing::info!("{warning}"));
    }
    interrupt::watch()?;
    print_urls(&viewer)?;
    tracing::info!("open it in a browser; Ctrl-C ends it");
    Ok(viewer.serve(interrupt::is_requested)?)
}

/// Scene to view, oriented.
#[derive(Debug)]
pub(crate) struct Subject {
    pub(crate) name: String,
    pub(crate) scene: Scene,
    /// Cameras of the data set, held-out views first.
    pub(crate) views: Vec<NamedCamera>,
    pub(crate) held_out: usize,
    pub(crate) orientation: Orientation,
    pub(crate) photographs: Option<PhotographSource>,
    pub(crate) background: Background,
}

impl From<Subject> for ViewedScene {
    fn from(subject: Subject) -> Self {
        let Subject { name, scene, views, held_out, orientation, photographs, background } = subject;
        let StartView { known: views, first, start, centre, up } = StartView::new(&orientation, views);
        let navigation = Navigation { first, start, centre, up };
        Self { name, scene, views, held_out, navigation, photographs, background: background.0 }
    }
}

impl From<EnvUp> for MapUp {
    fn from(up: EnvUp) -> Self {
        match up {
            EnvUp::Scene => Self::Scene,
            EnvUp::Y => Self::Y,
            EnvUp::Z => Self::Z,
        }
    }
}

impl From<ViewerError> for Failure {
    fn from(error: ViewerError) -> Self {
        match error {
            ViewerError::Scene(error) => error.into(),
            ViewerError::Random(_) => Self::Input(format!("{error}; choose one with --token")),
            ViewerError::Listen { .. } | ViewerError::Request(_) => Self::Input(error.to_string()),
            other => Self::Internal(other.to_string()),
        }
    }
}

/// Prints the URLs of the page to stdout, and a QR code for phones to a terminal.
fn print_urls(viewer: &Viewer) -> Result<(), Failure> {
    viewer.urls().iter().try_for_each(|url| output::say(url))?;
    if std::io::stderr().is_terminal() {
        viewer.qr_code().iter().for_each(|code| tracing::info!("for a phone:\n{code}"));
    }
    Ok(())
}

/// Viewer of a training.
#[derive(Debug)]
pub(crate) struct Watching {
    live: Arc<LiveTraining>,
    viewer: ViewerThread,
    until: ViewUntil,
}

impl Watching {
    /// Shows the result of the training until Ctrl-C, unless the page ends with the training.
    pub(crate) fn stay(self, result: impl FnOnce() -> Result<(Scene, u32), Failure>) -> Result<(), Failure> {
        if self.until == ViewUntil::Done {
            return Ok(());
        }
        let (scene, iteration) = result()?;
        self.live.finish(scene, iteration);
        tracing::info!("the training is finished, and the page stays; Ctrl-C ends it");
        self.viewer.join();
        Ok(())
    }
}

/// Serves the page of a training on a thread.
pub(crate) fn watch(
    args: &Train,
    address: SocketAddr,
    subject: Subject,
    live: Arc<LiveTraining>,
) -> Result<Watching, Failure> {
    let render = RenderOptions::full_precision(args.executor.clone());
    let options = ViewerOptions { address, token: args.watch.token.clone(), render };
    let viewer = Viewer::bind(&options, subject.into(), Some(live.clone()))?;
    print_urls(&viewer)?;
    let until = args.watch.view_until.unwrap_or_else(ViewUntil::usual);
    Ok(Watching { live, viewer: viewer.spawn(interrupt::is_requested), until })
}

/// Name of a file without its extension, or of a folder.
fn name_of(path: &Path) -> String {
    output::stem(Path::new(&output::absolute(path)))
}

/// Photographs of a model, if the data set of its training still exists.
fn photographs_of(opened: &OpenedModel) -> Option<PhotographSource> {
    let info = opened.info.as_ref()?;
    let options = dataset::options_of(info);
    let folder = PathBuf::from(&info.source_path);
    folder.is_dir().then_some(PhotographSource { folder, options })
}
