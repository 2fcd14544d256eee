//! `specula train`: trains a model on a data set.

mod folder;
pub(crate) mod many;
mod pace;
mod result;

use crate::{
    args::{self, AT_MOST_1100, AT_MOST_1600, LONGER_EDGE, LightReference, Photographs, ProfileName, Train},
    command_line,
    commands::view::{self, Watching},
    config, dataset,
    failure::Failure,
    interrupt, memory, output, progress,
    ranks::{Ranks, share_among_threads},
    scene, settings,
    training::Session,
};
use core::net::SocketAddr;
use glam::Vec3;
use serde_json::{Value, json};
use specula_core::scene::RadianceActivation;
use specula_io::{
    self as io,
    checkpoint::Facts,
    dataset::{LightSource, LoadOptions, MaskUse},
    exposure, latlong,
    light_table::LightTable,
    model_folder::{self, ModelInfo},
};
use specula_scene::{
    backdrop::BackgroundColor,
    capture::{Capture, Photograph, Reading},
    dataset::{InitialPoints, cloud_of, has_files},
    following_light::LightFollows,
    foreground::{self, Foreground},
    light_file::MapUp,
    orientation::{self, of_gaussians, with_up},
    training::{Checkpoints, Lock, Outcome, Start, Training, model_info},
};
use specula_train::{
    exchange::Exchange,
    picture_store::PictureStore,
    profile::Profile,
    ranks::Traffic,
    start::{Point, thinned},
    trainer::Settings,
};
use specula_viewer::{LiveTraining, PhotographSource, ViewedScene};
use std::{
    path::Path,
    sync::{Arc, Mutex},
};

/// Value of `--lights-by` for a light per folder.
const FOLDERS: &str = "folders";

/// Returns whether a value of `--lights-by` is a light per folder, not a table.
fn is_folders(path: &Path) -> bool {
    path.as_os_str() == FOLDERS && !path.exists()
}

/// Trains, saves, and measures with `--eval`: as the only rank, as one of several, or on several
/// ranks that are threads.
pub(crate) fn run(args: &Train, ranks: &Ranks<'_>) -> Result<(), Failure> {
    match args.ranks {
        1 => {
            let mut exchange = (ranks.connect)();
            let connected = exchange.as_mut().map(|exchange| exchange.as_mut() as &mut dyn Exchange);
            Prepared::new(args, ranks, connected)?.train(ranks, exchange)
        }
        _ if ranks.size > 1 => {
            Err(Failure::Input("--ranks cannot be combined with mpirun; omit --ranks, or start without mpirun".into()))
        }
        count => {
            let prepared = Prepared::new(args, ranks, None)?;
            share_among_threads(count.into(), |ranks| prepared.train(ranks, (ranks.connect)()))
        }
    }
}

/// Training before its first step; shared by ranks that are threads.
struct Prepared {
    args: Train,
    settings: Settings,
    info: ModelInfo,
    facts: Facts,
    background: BackgroundColor,
    data: Capture,
    pictures: PictureStore,
    points: Vec<Point>,
    /// Checkpoint to resume from, once for each rank; the last one frees it.
    saved: Mutex<Vec<Arc<folder::Resumed>>>,
    /// Iteration of the checkpoint, and seconds of the steps before it.
    resumed: Option<(u32, f64)>,
    _lock: Option<Lock>,
}

impl Prepared {
    /// Reads data set and checkpoint; the first rank creates the model folder.
    fn new(args: &Train, ranks: &Ranks<'_>, exchange: Option<&mut dyn Exchange>) -> Result<Self, Failure> {
        warn_of_ignored(args);
        let rank_count = ranks.size.max(args.ranks.into());
        if rank_count > 1 && args.watch.view.is_some() {
            return Err(Failure::Input("--view does not support several ranks; omit --view".into()));
        }
        if rank_count > 1 && args.minutes.is_some() {
            return Err(Failure::Input("--minutes does not support several ranks; use --iterations".into()));
        }
        let args = with_resolution(args)?;
        // Fails before the data is read.
        settings::profile_of(&args, args.iterations, false)?;
        // The folder is created and locked after everything else is validated.
        let is_first = ranks.is_first();
        refuse_data_set(&args)?;
        let lock = if is_first && args.model_path.is_dir() { Some(folder::lock(&args)?) } else { None };
        if is_first {
            folder::refuse_other_training(&args)?;
        }
        let mut data = load(&args, ranks.local, exchange)?;
        let is_object = data.holds_objects();
        let profile = profile_of(&args, &data)?;
        light_pictures(&args, &profile, &mut data)?;
        let profile = under_lights(&args, profile, &data)?;
        let points = match args.resuming.resume {
            true => Vec::new(),
            false => thinned_points(data.take_points(points_of(&args), args.seed), &profile),
        };
        let pictures = data.take_store();
        let background = background_of(&args, &data);
        let (iterations, seed) = (args.iterations, args.seed);
        let settings = Settings { profile, iterations, seed, background: background.0, random_points: 0 };
        let (args, settings) = within_minutes(args, settings, &data, &pictures, &points)?;
        let info = info_of(&args, &settings, &data)?;
        let facts = data.describe(&settings, config::text_of(&args)?);
        let saved = if args.resuming.resume {
            Some(folder::read_checkpoint(&args, source_of(&args)?, &settings, is_object, &facts)?)
        } else {
            None
        };
        if saved.is_none() && !points.is_empty() && !data.shows_any_of(&points) {
            tracing::warn!(
                "no camera sees an initial point, so nothing can be trained; check the focal lengths and principal \
                 points of the cameras"
            );
        }
        let lock = if is_first {
            output::make_folder(&args.model_path)?;
            let lock = lock.map_or_else(|| folder::lock(&args), Ok)?;
            prepare_folder(&args, &settings.profile, &data, &points, &facts, saved.as_ref())?;
            Some(lock)
        } else {
            None
        };
        let resumed = saved.as_ref().map(|saved| (saved.state.iteration, saved.seconds));
        let saved = saved.map(Arc::new).map_or_else(Vec::new, |saved| vec![saved; args.ranks.into()]);
        let saved = Mutex::new(saved);
        Ok(Self { args, settings, info, facts, background, data, pictures, points, saved, resumed, _lock: lock })
    }

    /// Trains as one rank. The first one writes the model.
    fn train(&self, ranks: &Ranks<'_>, exchange: Option<Box<dyn Exchange>>) -> Result<(), Failure> {
        let Self { args, settings, info, facts, background, data, pictures, points, resumed, .. } = self;
        let is_first = ranks.is_first();
        let saved = self.saved.lock().map_or(None, |mut saved| saved.pop());
        let start = saved.as_ref().map_or(Start::Points(points), |saved| Start::Checkpoint(&saved.state));
        let session = Session::new(pictures, points).of(ranks);
        let mut session = session.showing(data.train.iter().map(|photograph| &photograph.camera));
        let choice = ranks.executor(&args.executor);
        let training = Training::new(&choice, settings.clone(), pictures, &start, &mut session)?;
        let seconds = resumed.map_or(0.0, |(_, seconds)| seconds);
        let mut training = training.with_checkpoints(self.checkpoints(is_first), seconds);
        drop(saved);
        if let Some(exchange) = exchange {
            training.join(exchange, &facts.pictures)?;
            tracing::info!("training on {} ranks", ranks.size);
        }
        let cameras = data.evaluation_cameras();
        let watching = match args.watch.view {
            Some(address) => Some(watch(args, address, &mut training, data, *background)?),
            None => None,
        };
        interrupt::watch()?;

        // The other ranks wait while the first one saves and measures.
        let pauses = if is_first { [&args.save_iterations[..], &args.test_iterations].concat() } else { Vec::new() };
        let views = result::Views { data, cameras, background: *background };
        let live = watching.as_ref().map(Watching::live);
        let session = session.with(|training| result::pause(args, training, info, &views), live);
        let outcome = session.run(&mut training, "training", settings, &pauses)?;
        note_traffic(ranks, &training, outcome);
        if !is_first {
            return Ok(());
        }
        result::finish(args, &mut training, info.clone(), outcome, &views)?;
        let result = || Ok((training.scene()?, training.iteration()));
        watching.map_or(Ok(()), |watching| watching.stay(result))
    }

    /// Checkpoints, which the first rank writes.
    fn checkpoints(&self, is_first: bool) -> Checkpoints {
        let Self { args, facts, resumed, .. } = self;
        let checkpoints = Checkpoints::new(&args.model_path, args.resuming.checkpoint_every, facts.clone());
        let checkpoints = if is_first { checkpoints } else { checkpoints.of_another_rank() };
        match resumed {
            Some((iteration, _)) => checkpoints.resumed_at(*iteration),
            None => checkpoints,
        }
    }
}

/// Arguments and settings with as many iterations as `--minutes` allows, if it is given.
fn within_minutes(
    args: Train,
    settings: Settings,
    data: &Capture,
    pictures: &PictureStore,
    points: &[Point],
) -> Result<(Train, Settings), Failure> {
    let Some(minutes) = args.minutes else { return Ok((args, settings)) };
    let has_lights = data.light_names.len() > 1;
    let profile_at = |iterations: u32| {
        let profile = settings::profile_of(&args, iterations, data.holds_objects())?;
        Ok(if has_lights { profile.under_several_lights() } else { profile })
    };
    let cameras: Vec<_> = data.train.iter().map(|photograph| photograph.camera).collect();
    let same = settings.clone();
    let iterations = pace::iterations_within(minutes, same, &args.executor, pictures, points, &cameras, profile_at)?;
    let args = Train { iterations, ..args };
    // Its notes were printed for the first profile.
    let profile = progress::silently(|| under_lights(&args, profile_of(&args, data)?, data))?;
    Ok((args, Settings { profile, iterations, ..settings }))
}

/// Profile of a training on a data set.
fn profile_of(args: &Train, data: &Capture) -> Result<Profile, Failure> {
    let is_object = data.holds_objects();
    let mut profile = settings::profile_of(args, args.iterations, is_object)?;
    if is_object && args.profile == ProfileName::Specula {
        let materials = if profile.physical.is_some() && !args.start.relightable {
            ", with relightable materials (--no-materials omits them)"
        } else {
            ""
        };
        tracing::info!("every picture has alpha or a mask, so the settings are those for objects{materials}");
    }
    if profile.light.is_none() && args.start.foreground != Foreground::All {
        return Err(Failure::Input(
            "--foreground applies to reflections, which the profile does not have; omit it, or use --profile specula"
                .to_owned(),
        ));
    }
    if profile.light.is_some() {
        profile.foreground = args.start.foreground.ball(data.orientation.as_ref(), data.origin);
        profile.foreground.iter().for_each(|ball| tracing::info!("{}", foreground::description(ball)));
    }
    match &args.start.light_reference {
        Some(reference) => under_known_light(profile, reference, data),
        None => Ok(profile),
    }
}

/// Profile under a known light, or one with a known mean.
fn under_known_light(profile: Profile, reference: &LightReference, data: &Capture) -> Result<Profile, Failure> {
    let Some(light) = profile.light else {
        return Err(Failure::Input(format!("--profile {} has no light; omit --light-reference", profile.name)));
    };
    if light.activation == RadianceActivation::Network {
        return Err(Failure::Input("a known light is a cube map; omit --light mlp or --light-reference".into()));
    }
    let path = match reference {
        LightReference::Map(path) => path,
        LightReference::Mean(mean) => {
            tracing::info!("light: mean radiance {reference}");
            return Ok(profile.with_light_mean(*mean));
        }
    };
    let up = data.orientation.as_ref().map_or(Vec3::Z, orientation::up);
    let map = scene::read_env(path, 0.0)?;
    let radiance = latlong::to_cube(&map, light.resolution, MapUp::Scene.orientation(up));
    tracing::info!("light: {path:?}, not trained");
    Ok(profile.under(radiance))
}

/// Puts each picture under its light, if the options or the data set name it.
fn light_pictures(args: &Train, profile: &Profile, data: &mut Capture) -> Result<(), Failure> {
    let args::Start { light_follows: follows, lights_by, .. } = &args.start;
    let source = match (lights_by, *follows) {
        (None, LightFollows::Scene) if !data.lists_lights() => return Ok(()),
        (None, LightFollows::Scene) => "light of transforms.json",
        (None, _) => "--light-follows",
        (Some(_), _) => "--lights-by",
    };
    let no_light = || Failure::Input(format!("--profile {} has no light; omit {source}", profile.name));
    if profile.light.is_none() && data.left_out.is_empty() {
        return Err(no_light());
    }
    if data.lists_lights() && (lights_by.is_some() || *follows != LightFollows::Scene) {
        tracing::warn!("{source} replaces the lights that the data set names");
    }
    match (lights_by, *follows) {
        (Some(path), _) if is_folders(path) => data.light_by_folder()?,
        (Some(path), _) => data.light_by_table(&LightTable::read(path)?)?,
        (None, LightFollows::Scene) => data.light_by_list()?,
        (None, _) => data.follow(*follows),
    }
    // A table of one light may only leave pictures out.
    if profile.light.is_none() && (data.light_names.len() > 1 || data.has_turned_lights()) {
        return Err(no_light());
    }
    if data.has_turned_lights() && !data.holds_objects() && data.masks() == 0 {
        if *follows != LightFollows::Camera {
            return Err(Failure::Input(format!(
                "{source} needs pictures cut out by alpha or masks, since what is behind a turned object does not turn; \
                 add masks (docs/datasets.md), or omit the option"
            )));
        }
        tracing::warn!(
            "no picture is cut out by alpha or masks, so --light-follows camera takes all that they show for lit by \
             lamps on the camera"
        );
    }
    Ok(())
}

/// Profile for the lights of the pictures.
fn under_lights(args: &Train, profile: Profile, data: &Capture) -> Result<Profile, Failure> {
    let names = &data.light_names;
    if names.len() < 2 {
        return Ok(profile);
    }
    let fault = if profile.physical.is_none() {
        "are fitted by materials; add --relightable, and omit --no-materials and --profile paper or official"
    } else if args.views_per_step > 1 || args.ranks > 1 {
        "are trained one picture per step, on one rank; omit --views-per-step and --ranks"
    } else if args.start.light_reference.is_some() {
        "cannot all be the one of --light-reference; omit it"
    } else if args.max_error.is_some() {
        "are fitted by materials, which --max-error does not support; omit it"
    } else {
        let count = |light: usize| data.train.iter().filter(|one| one.camera.light as usize == light).count();
        let lights = names.iter().enumerate().map(|(light, name)| format!("{name:?} of {} pictures", count(light)));
        tracing::info!("{} lights, one material: {}", names.len(), lights.collect::<Vec<_>>().join(", "));
        return Ok(profile.under_several_lights());
    };
    Err(Failure::Input(format!("pictures under {} lights {fault}", names.len())))
}

/// Notes the bytes that a rank sent and the time that it waited.
fn note_traffic(ranks: &Ranks<'_>, training: &Training, outcome: Outcome) {
    let Some(Traffic { sent, seconds }) = training.traffic() else { return };
    let megabytes = sent as f64 / 1e6;
    tracing::info!(
        target: progress::RANKS_TARGET,
        "rank {} sent {megabytes:.1} MB to others, and sent or waited for {seconds:.1} of {:.1} s",
        ranks.rank,
        outcome.seconds
    );
}

/// Data set folder.
fn source_of(args: &Train) -> Result<&Path, Failure> {
    let none =
        || Failure::Input("neither the command line nor the settings file names a data set; add its folder".into());
    args.source().ok_or_else(none)
}

/// Refuses to write a model to the folder of a data set.
fn refuse_data_set(args: &Train) -> Result<(), Failure> {
    let folder = &args.model_path;
    let is_same =
        |source: &Path| source.canonicalize().is_ok_and(|source| folder.canonicalize().is_ok_and(|own| own == source));
    if args.source().is_some_and(is_same) {
        return Err(Failure::Input(format!("{folder:?} is the data set itself; use another folder with -m")));
    }
    if has_files(folder) && !model_folder::holds_training(folder) {
        return Err(Failure::Input(format!("{folder:?} is another data set; use another folder with -m")));
    }
    Ok(())
}

/// Warns of options that have no effect, most of them from GaussianShader's command lines.
fn warn_of_ignored(args: &Train) {
    if args.brdf_dim.is_some() {
        tracing::warn!(
            "--brdf_dim is ignored: the profile sets the harmonics of the residual colour; use --sh-degree N"
        );
    }
    if args.start.sh_degree.is_some_and(|degree| degree < 0) {
        tracing::warn!("--sh_degree -1 is ignored: the profile sets the harmonics; use --sh-degree 0 to 3");
    }
    if args.start.random_points.is_some() && args.start.background_points > 0 {
        tracing::warn!(
            "--background-points is ignored: it adds to the points of a data set, which --random-points replaces"
        );
    }
}

/// Replaces `-r -1` and `-r auto` by a factor.
fn with_resolution(args: &Train) -> Result<Train, Failure> {
    const WIDEST: u32 = 1600;
    let mut settled = args.clone();
    if [AT_MOST_1600, AT_MOST_1100].contains(&args.resolution) {
        settled.resolution = 1;
        let first = io::dataset::load_one(source_of(args)?, &options_of(&settled), false, 0)?;
        let [width, height] = first.map_or([0; 2], |view| [view.image.width, view.image.height]);
        let factor_for =
            |edge: u32, most: u32| [1, 2, 4, 8].into_iter().find(|factor| edge / factor <= most).unwrap_or(8);
        if args.resolution == AT_MOST_1600 {
            settled.resolution = factor_for(width, WIDEST);
        } else {
            settled.resolution = factor_for(width.max(height), LONGER_EDGE);
        }
        let (factor, width_here) = (settled.resolution, width / settled.resolution);
        if args.resolution == AT_MOST_1100 {
            tracing::info!("-r auto is -r {factor} for pictures of {width} × {height} pixels");
        } else if factor > 1 {
            tracing::info!(
                "-r -1 is -r {factor} for pictures that are {width} pixels wide, which makes them {width_here} wide; the \
                 authors' programs make them {WIDEST}"
            );
        }
    }
    Ok(settled)
}

fn options_of(args: &Train) -> LoadOptions {
    let Photographs { images, test_every, masks, input_space, .. } = args.photographs.clone();
    let points = args.start.points.clone();
    LoadOptions {
        downscale: args.resolution,
        with_test: args.eval,
        points,
        images,
        test_every,
        origin: None,
        masks,
        lights: match &args.start.lights_by {
            None => LightSource::Unknown,
            Some(path) if is_folders(path) => LightSource::Known,
            Some(path) => LightSource::Table { path: path.clone(), only: None },
        },
        without: Vec::new(),
        space: input_space,
    }
}

fn load(args: &Train, local: usize, exchange: Option<&mut dyn Exchange>) -> Result<Capture, Failure> {
    let source = source_of(args)?;
    let points = (!args.resuming.resume).then(|| points_of(args));
    let budget = |neighbours: usize| picture_memory(args, neighbours);
    let reading =
        Reading { folder: source, options: &options_of(args), points, seed: args.seed, local, budget: &budget };
    let mut data = dataset::read(&reading, exchange)?;
    if args.photographs.scene_up.is_some() {
        let cameras = || data.train.iter().chain(&data.test).map(|photograph| &photograph.camera);
        data.orientation = data.orientation.map(|found| match args.photographs.scene_up {
            Some(up) => with_up(found, up.into(), cameras()),
            None => found,
        });
        data.orientation.iter().for_each(dataset::note_orientation);
    }
    if args.photographs.masks != MaskUse::Auto && data.masks() == 0 {
        return Err(Failure::Input(format!(
            "no picture of {source:?} has a mask, so --masks {} has no effect; put masks into {source:?}/masks, named as \
             the pictures, or omit the option",
            args.photographs.masks.name()
        )));
    }
    if args.eval && data.test.is_empty() {
        return Err(Failure::Input(format!(
            "{source:?} has no test views to measure; add transforms_test.json with its pictures, \
             hold out photographs of COLMAP and transforms.json with --test-every, or omit --eval"
        )));
    }
    if data.train.is_empty() {
        let count = data.test.len();
        return Err(Failure::Input(format!(
            "all pictures of {source:?} are held out ({count}), so none are left to train on; omit --eval, or set \
             --test-every 0"
        )));
    }
    Ok(data)
}

/// Maximum bytes of decoded pictures per rank, given the number of ranks on the machine: the
/// option, else half of the free memory, divided among these ranks.
fn picture_memory(args: &Train, neighbours: usize) -> u64 {
    const GIBIBYTE: f64 = (1 << 30) as f64;
    match args.picture_memory {
        Some(size) => (size * GIBIBYTE) as u64,
        None => memory::available().map_or(u64::MAX, |free| free / 2 / neighbours as u64),
    }
}

fn background_of(args: &Train, data: &Capture) -> BackgroundColor {
    let white = args.white_background.then_some(BackgroundColor::WHITE);
    args.background.or(white).unwrap_or_else(|| BackgroundColor::default_for(data.has_alpha()))
}

/// Writes settings, cameras and points to the model folder before the first step.
fn prepare_folder(
    args: &Train,
    profile: &Profile,
    data: &Capture,
    points: &[Point],
    facts: &Facts,
    saved: Option<&folder::Resumed>,
) -> Result<(), Failure> {
    let folder = &args.model_path;
    if args.resuming.overwrite {
        model_folder::remove_training(folder)?;
    }
    config::save(folder, &facts.config)?;
    if let Some(folder::Resumed { state, .. }) = saved {
        let (taken, all) = (state.iteration, args.iterations);
        match taken == all {
            true => tracing::info!("all {all} iterations are done already; increase --iterations to train longer"),
            false => tracing::info!("continuing from iteration {taken} of {all}"),
        }
        return Ok(());
    }
    save_inputs(args, profile, data, points)?;
    Ok(exposure::remove(folder)?)
}

fn points_of(args: &Train) -> InitialPoints {
    InitialPoints { random: args.start.random_points, background: args.start.background_points }
}

/// Initial points, at most the profile's maximum number of Gaussians.
fn thinned_points(points: Vec<Point>, profile: &Profile) -> Vec<Point> {
    let (found, most) = (points.len(), profile.densification.count_max.max(1));
    if found > most {
        tracing::warn!("only {most} of {found} initial points are used, the limit of --max-gaussians");
    }
    thinned(points, most)
}

fn info_of(args: &Train, settings: &Settings, data: &Capture) -> Result<ModelInfo, Failure> {
    let mut info = model_info(settings, [data.train.len(), data.test.len()], data.orientation);
    info.set_light_names(&data.light_names);
    info.set_left_out(&data.left_out);
    info.rest.insert("images".into(), args.photographs.images.as_str().into());
    info.rest.insert("test_every".into(), args.photographs.test_every.into());
    info.rest.insert("masks".into(), args.photographs.masks.name().into());
    info.rest.insert("input_space".into(), args.photographs.input_space.name().into());
    info.rest.insert("command".into(), arguments().into());
    Ok(ModelInfo {
        eval: args.eval,
        origin: data.origin,
        downscale: args.resolution,
        source_path: output::absolute(source_of(args)?),
        ..info
    })
}

/// Arguments of the program, with invalid Unicode replaced.
fn arguments() -> String {
    command_line::given().arguments.join(" ".as_ref()).to_string_lossy().into_owned()
}

fn save_inputs(args: &Train, profile: &Profile, data: &Capture, points: &[Point]) -> Result<(), Failure> {
    let [train, test] =
        [&data.train, &data.test].map(|all| all.iter().map(Photograph::named_camera).collect::<Vec<_>>());
    let is_white = background_of(args, data) == BackgroundColor::WHITE;
    let cfg_args: [(&str, Value); 8] = [
        ("sh_degree", profile.layout.sh_degree.map_or(json!(-1), Value::from)),
        ("source_path", output::absolute(source_of(args)?).into()),
        ("model_path", output::absolute(&args.model_path).into()),
        ("images", args.photographs.images.as_str().into()),
        ("resolution", args.resolution.into()),
        ("white_background", is_white.into()),
        ("data_device", "cpu".into()),
        ("eval", args.eval.into()),
    ];
    Ok(model_folder::save_inputs(&args.model_path, &train, &test, &cloud_of(points), data.origin, &cfg_args)?)
}

/// Serves a page that shows the training.
fn watch(
    args: &Train,
    address: SocketAddr,
    training: &mut Training,
    data: &Capture,
    background: BackgroundColor,
) -> Result<Watching, Failure> {
    let live = Arc::new(LiveTraining::new(args.iterations, training.iteration()));
    let photographs = PhotographSource {
        folder: source_of(args)?.to_owned(),
        options: LoadOptions { origin: Some(data.origin), ..options_of(args) },
    };
    let scene = training.scene()?;
    let viewed = ViewedScene {
        name: args.model_path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        orientation: data.orientation.unwrap_or_else(|| of_gaussians(&scene.gaussians)),
        scene,
        views: data.test.iter().chain(&data.train).map(Photograph::named_camera).collect(),
        held_out: data.test.len(),
        origin: data.origin,
        photographs: Some(photographs),
        background: background.0,
    };
    view::watch(args, address, viewed, live)
}
