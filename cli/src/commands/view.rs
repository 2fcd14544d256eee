//! `specula view`, and the viewer of a training: arguments become options of [`specula_viewer`].

use crate::{
    args::{Train, View, ViewUntil},
    dataset::note_guessed_up,
    failure::Failure,
    included::LIGHTS,
    interrupt,
    lights::NamedLights,
    output,
    scene::{self, background_of, light_input, note_oddities, refuse_plain},
};
use core::net::SocketAddr;
use specula_core::scene::Environment;
use specula_scene::{OpenedModel, RenderOptions, Scene, dataset, light_file::MapUp};
use specula_viewer::{
    AddedLight, LiveTraining, PhotographSource, ViewedScene, Viewer, ViewerError, ViewerOptions, ViewerThread,
};
use std::{
    io::IsTerminal,
    path::{Path, PathBuf},
    sync::Arc,
};

/// Serves the page until Ctrl-C.
pub(crate) fn run(args: &View) -> Result<(), Failure> {
    let mut opened = scene::open_as(&args.scene, &args.scene_options)?;
    let trained = trained_lights(&opened);
    scene::settle_light(&mut opened, &args.light)?;
    let (own, is_shaded) = (opened.own_light.unwrap_or(1), opened.scene.gaussians.layout.is_shaded());
    note_oddities(&opened);
    let lights = NamedLights::first(&args.first, &opened.scene)?;
    if !args.env.is_empty() || lights.env.is_some() {
        refuse_plain(&opened.scene)?;
    }
    let render: RenderOptions = (&args.scene_options.renderer).into();
    if is_shaded && opened.scene.light.is_none() {
        scene::fuse_near_field(&mut opened, &render)?;
    }
    let background = background_of(&opened, args.background).0;
    let orientation = opened.orientation(args.scene_options.scene_up.map(Into::into))?;
    note_guessed_up(&orientation);
    let photographs = photographs_of(&opened);
    let scene = ViewedScene::of_model(output::name_of_model(&args.scene), opened)?;
    let scene = ViewedScene { orientation, photographs, background, ..scene };
    let options = ViewerOptions { address: args.listen, token: args.token.clone(), render };
    let viewer = Viewer::bind(&options, scene, None)?;
    for (number, name, light) in trained.into_iter().filter(|(number, ..)| *number != own) {
        viewer.add_trained_light(light, &format!("light {number}, {name}"));
    }
    add_lights(&viewer, args, lights, is_shaded)?;
    interrupt::watch()?;
    print_urls(&viewer)?;
    tracing::info!("open it in a browser; Ctrl-C stops the server");
    Ok(viewer.serve(interrupt::is_requested)?)
}

/// Lights of a training under several: number from 1, name and light of each.
fn trained_lights(opened: &OpenedModel) -> Vec<(usize, String, Environment<Vec<f32>>)> {
    let lights = opened.scene.light.iter().chain(&opened.scene.other_lights).cloned();
    let name = |number| opened.light_name(number).unwrap_or_default().to_owned();
    (1..).zip(lights).map(|(number, light)| (number, name(number), light)).collect()
}

/// Adds environment maps and those of the program, and sets the page's first lights.
fn add_lights(viewer: &Viewer, args: &View, lights: NamedLights, is_shaded: bool) -> Result<(), Failure> {
    let mut first = None;
    let named = lights.env.as_ref().map(|file| (file, lights.up(args.env_up.into())));
    // As with relight, --env replaces the file's map, which can still be selected on the page.
    for (file, up) in args.env.iter().map(|file| (file, args.env_up.into())).chain(named) {
        let AddedLight { id, warnings } = viewer.add_light(light_input(file)?, up)?;
        warnings.iter().for_each(|warning| tracing::info!("{warning}"));
        first.get_or_insert(id);
    }
    if is_shaded {
        for name in LIGHTS.map(Path::new) {
            if !args.env.iter().any(|named| named == name) {
                viewer.add_light(light_input(name)?, MapUp::Scene)?;
            }
        }
    }
    Ok(viewer.start_under(lights.setup(first, &args.first))?)
}

impl From<ViewerError> for Failure {
    fn from(error: ViewerError) -> Self {
        match error {
            ViewerError::Scene(error) => error.into(),
            ViewerError::Random(_) => Self::Input(format!("{error}; set one with --token")),
            ViewerError::Listen { address, cause } => Self::Input(format!(
                "cannot listen at {address}: {cause}; use another address with view --listen or train --view, such as {} \
                 for any free port",
                SocketAddr::new(address.ip(), 0)
            )),
            ViewerError::Clock | ViewerError::Request(_) => Self::Input(error.to_string()),
            other => Self::Internal(other.to_string()),
        }
    }
}

/// Prints the URLs of the page to stdout, and a QR code for phones to a terminal.
fn print_urls(viewer: &Viewer) -> Result<(), Failure> {
    viewer.urls().iter().try_for_each(|url| output::say(url))?;
    if std::io::stderr().is_terminal() {
        let code = viewer.qr_code().map_or(String::new(), |code| format!("for a phone:\n{code}"));
        code.lines().for_each(|line| tracing::info!("{line}"));
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
    /// Feed of the page.
    pub(crate) fn live(&self) -> Arc<LiveTraining> {
        self.live.clone()
    }

    /// Shows the result of the training until Ctrl-C, unless the page ends with the training.
    pub(crate) fn stay(self, result: impl FnOnce() -> Result<(Scene, u32), Failure>) -> Result<(), Failure> {
        if self.until == ViewUntil::Done {
            return Ok(());
        }
        let (scene, iteration) = result()?;
        self.live.finish(scene, iteration);
        tracing::info!("the training is finished; the page stays until Ctrl-C");
        self.viewer.join();
        Ok(())
    }
}

/// Serves the page of a training on a thread.
pub(crate) fn watch(
    args: &Train,
    address: SocketAddr,
    scene: ViewedScene,
    live: Arc<LiveTraining>,
) -> Result<Watching, Failure> {
    let render = RenderOptions::full_precision(args.executor.clone());
    let options = ViewerOptions { address, token: args.watch.token.clone(), render };
    let viewer = Viewer::bind(&options, scene, Some(live.clone()))?;
    print_urls(&viewer)?;
    let until = args.watch.view_until.unwrap_or_else(ViewUntil::default_of_stdout);
    Ok(Watching { live, viewer: viewer.spawn(interrupt::is_requested), until })
}

/// Photographs of a model, if the data set of its training still exists.
fn photographs_of(opened: &OpenedModel) -> Option<PhotographSource> {
    let info = opened.info.as_ref()?;
    let options = dataset::options_of(info);
    let folder = PathBuf::from(&info.source_path);
    folder.is_dir().then_some(PhotographSource { folder, options })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::view::ADDRESS;

    #[test]
    fn the_default_address_is_that_of_the_library() {
        assert_eq!(ADDRESS.parse(), Ok(ViewerOptions::DEFAULT_ADDRESS));
    }
}
