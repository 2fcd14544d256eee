//! `specula train`: trains a model on a data set.

use crate::{
    args::{AT_MOST_1600, MachineOptions, Photographs, Train},
    certified,
    commands::view::{self, Watching},
    config, dataset,
    failure::Failure,
    interrupt, output, progress,
    scene::{Renderer, measure_views},
    settings,
    training::Session,
};
use core::net::SocketAddr;
use serde_json::{Map, Value, json};
use specula_core::{camera::Camera, rules::Channels, state::TrainingState};
use specula_io::{
    self as io,
    cameras::NamedCamera,
    checkpoint::Facts,
    dataset::LoadOptions,
    exposure,
    model_folder::{self, ModelInfo, method_of},
};
use specula_report::{
    certificate::CertifiedScene,
    measure::{self, ViewMeasures},
};
use specula_scene::{
    RenderOptions, Scene, SceneRenderer, ShadingModel,
    backdrop::BackgroundColor,
    dataset::{Dataset, cloud_of},
    foreground,
    number::group_digits,
    orientation::{of_gaussians, with_up},
    training::{self, Checkpoints, Lock, Outcome, Start, Training},
};
use specula_train::{
    profile::Profile,
    start::{Point, points_behind, random_points},
    trainer::Settings,
    view::View,
};
use specula_viewer::{LiveTraining, PhotographSource, ViewedScene};
use std::{path::Path, sync::Arc};

/// Number of random points if the data set has none.
const RANDOM_POINTS: u32 = 20_000;

/// Trains, saves, and measures with `--eval`.
pub(crate) fn run(args: &Train) -> Result<(), Failure> {
    warn_of_ignored(args);
    let args = &with_resolution(args)?;
    let mut profile = settings::profile_of(args, args.iterations)?;
    // A folder that does not exist is created and locked once everything else is known to be valid.
    let lock = if args.model_path.is_dir() { Some(lock(args)?) } else { None };
    refuse_data_set(args)?;
    refuse_other_training(args)?;
    let mut data = load(args)?;
    if profile.light.is_some() {
        profile.foreground = args.start.foreground.ball(data.orientation.as_ref());
        profile.foreground.iter().for_each(|ball| tracing::info!("{}", foreground::description(ball)));
    }
    let background = background_of(args, &data);
    let settings =
        Settings { profile, iterations: args.iterations, seed: args.seed, background: background.0, random_points: 0 };
    let info = info_of(args, &settings.profile, background, &data)?;
    let facts = training::describe(&settings, config::text_of(args)?, &data.train);
    let saved = if args.resuming.resume { Some(read_checkpoint(args, &settings, &facts)?) } else { None };
    let points = if saved.is_some() { Vec::new() } else { points_of(args, &mut data) };
    output::make_folder(&args.model_path)?;
    let _lock = lock.map_or_else(|| self::lock(args), Ok)?;
    let checkpoints = prepare_folder(args, &settings.profile, &data, &points, facts, saved.as_ref())?;

    let reload = || {
        let mut data = progress::silently(|| load(args))?;
        let points = points_of(args, &mut data);
        Ok((data.train, points))
    };
    let start = saved.as_ref().map_or(Start::Points(&points), |saved| Start::Checkpoint(&saved.state));
    let seconds = saved.as_ref().map_or(0.0, |saved| saved.seconds);
    let mut session = Session::new(&reload);
    let training = Training::new(&args.executor, settings, &data.train, &start, &mut session)?;
    let mut training = training.with_checkpoints(checkpoints, seconds);
    let cameras = cameras_of(&data);
    let watching = match args.watch.view {
        Some(address) => Some(watch(args, address, &mut training, &data, background)?),
        None => None,
    };
    let names: Vec<String> = data.train.iter().map(|view| view.name.clone()).collect();
    drop((core::mem::take(&mut data.train), points, saved));
    interrupt::watch()?;

    let pauses = [args.save_iterations.as_slice(), &args.test_iterations].concat();
    let views = Views { names, test: &data.test, cameras, background };
    let live = watching.as_ref().map(Watching::live);
    let session = session.with(|training| pause(args, training, &info, &views), live);
    let outcome = session.run(&mut training, "training", args.iterations, &pauses)?;
    finish(args, &mut training, info, outcome, &views)?;
    let result = || Ok((training.scene()?, training.iteration()));
    watching.map_or(Ok(()), |watching| watching.stay(result))
}

/// Data set folder.
fn source_of(args: &Train) -> Result<&Path, Failure> {
    let none = || Failure::Input("no data set is named, nor in the file of settings; add its folder".into());
    args.source().ok_or_else(none)
}

/// Refuses to write a model into the data set folder.
fn refuse_data_set(args: &Train) -> Result<(), Failure> {
    let folder = &args.model_path;
    let is_same =
        |source: &Path| source.canonicalize().is_ok_and(|source| folder.canonicalize().is_ok_and(|own| own == source));
    if args.source().is_some_and(is_same) {
        return Err(Failure::Input(format!("{folder:?} is the data set itself; name another folder with -m")));
    }
    Ok(())
}

/// Refuses a folder that contains another training.
fn refuse_other_training(args: &Train) -> Result<(), Failure> {
    let folder = &args.model_path;
    if args.resuming.resume || args.resuming.overwrite || !model_folder::holds_training(folder) {
        return Ok(());
    }
    let remedy = match io::checkpoint::path_in(folder).is_file() {
        true => "go on with it (--resume), replace it (--overwrite), or name another folder with -m",
        false => "replace it (--overwrite), or name another folder with -m",
    };
    Err(Failure::Input(format!("{folder:?} holds {} already; {remedy}", description_of(folder)?)))
}

/// Description of the training in a folder.
fn description_of(folder: &Path) -> Result<String, Failure> {
    let profile = model_folder::read_info(folder)?.map(|info| format!(" with profile {}", info.profile));
    let iteration = model_folder::latest_iteration(folder).map(|iteration| format!(" of {iteration} iterations"));
    Ok(match (iteration, profile) {
        (Ok(iteration), profile) => format!("a model{iteration}{}", profile.unwrap_or_default()),
        (Err(_), _) => "a training that was interrupted".to_owned(),
    })
}

/// Warns of options from GaussianShader's command lines that have no effect.
fn warn_of_ignored(args: &Train) {
    if args.brdf_dim.is_some() {
        tracing::warn!(
            "--brdf_dim is ignored: a profile has its own harmonics for the residual colour; --sh-degree N sets them"
        );
    }
    if args.start.sh_degree.is_some_and(|degree| degree < 0) {
        tracing::warn!("--sh_degree -1 is ignored: a profile has its own harmonics; --sh-degree 0 to 3 sets them");
    }
}

/// Replaces `-r -1` by the factor that comes closest to it.
fn with_resolution(args: &Train) -> Result<Train, Failure> {
    const WIDEST: u32 = 1600;
    let mut settled = args.clone();
    if args.resolution == AT_MOST_1600 {
        settled.resolution = 1;
        let first = io::dataset::load_one(source_of(args)?, &options_of(&settled), false, 0)?;
        let width = first.map_or(0, |view| view.image.width);
        if width > WIDEST {
            settled.resolution = [2, 4, 8].into_iter().find(|factor| width / factor <= WIDEST).unwrap_or(8);
            let (factor, width_here) = (settled.resolution, width / settled.resolution);
            tracing::info!(
                "-r -1 is -r {factor} for pictures that are {width} pixels wide, which makes them {width_here} wide; the \
                 authors' programs make them {WIDEST}"
            );
        }
    }
    Ok(settled)
}

/// Checkpoint that a training resumes from.
#[derive(Debug)]
struct Resumed {
    state: TrainingState<Vec<f32>>,
    seconds: f64,
}

/// Reads the checkpoint in the model folder, and refuses one of a training with other settings or
/// pictures.
fn read_checkpoint(args: &Train, settings: &Settings, facts: &Facts) -> Result<Resumed, Failure> {
    let saved = io::checkpoint::read(&args.model_path)?;
    let then = &saved.facts;
    let refuse = |what: String| {
        let place = io::checkpoint::path_in(&args.model_path);
        Err(Failure::Input(format!(
            "the checkpoint {place:?} {what}, or start anew with --overwrite in place of --resume"
        )))
    };
    if let Some(what) = config::contradiction(&facts.config, &then.config) {
        return refuse(format!("is of a training with {what}; leave the option as it was"));
    }
    if (facts.views, &facts.pictures) != (then.views, &then.pictures) {
        return refuse(format!(
            "is of a training on {} pictures, and the {} in {:?} are not the same; name the folder of those",
            then.views,
            facts.views,
            source_of(args)?
        ));
    }
    if saved.state.iteration > args.iterations {
        return refuse(format!(
            "is of iteration {}, and --iterations {} is less; ask for as many at least",
            saved.state.iteration, args.iterations
        ));
    }
    let profile = Profile { foreground: settings.profile.foreground, ..settings::profile_of(args, then.iterations)? };
    let same = Settings { profile, iterations: then.iterations, ..settings.clone() };
    if training::settings_text(&same) != then.settings {
        return refuse(format!("is of specula {}, which trained otherwise; go on with that one", then.program));
    }
    Ok(Resumed { seconds: then.seconds, state: saved.state })
}

/// Locks the model folder.
fn lock(args: &Train) -> Result<Lock, Failure> {
    const REMEDY: &str = "wait until it ends, name another folder with -m, or add --ignore-lock if it is gone";
    let folder = &args.model_path;
    match args.resuming.ignore_lock {
        true => Ok(Lock::take_or_warn(folder)?),
        false => Lock::take(folder).map_err(|error| Failure::locked(error, REMEDY)),
    }
}

/// Writes settings, cameras and points to the model folder before the first step.
fn prepare_folder(
    args: &Train,
    profile: &Profile,
    data: &Dataset,
    points: &[Point],
    facts: Facts,
    saved: Option<&Resumed>,
) -> Result<Checkpoints, Failure> {
    let folder = &args.model_path;
    if args.resuming.overwrite {
        model_folder::remove_training(folder)?;
    }
    config::save(folder, &facts.config)?;
    let checkpoints = Checkpoints::new(folder, args.resuming.checkpoint_every, facts);
    if let Some(Resumed { state, .. }) = saved {
        let (taken, all) = (state.iteration, args.iterations);
        match taken == all {
            true => tracing::info!("all {all} iterations are done already; to train longer, set more --iterations"),
            false => tracing::info!("continuing from iteration {taken} of {all}"),
        }
        return Ok(checkpoints.resumed_at(taken));
    }
    save_inputs(args, profile, data, points)?;
    exposure::remove(folder)?;
    Ok(checkpoints)
}

fn options_of(args: &Train) -> LoadOptions {
    let Photographs { images, test_every, .. } = args.photographs.clone();
    let points = args.start.points.clone();
    LoadOptions { downscale: args.resolution, with_test: args.eval, points, images, test_every }
}

fn load(args: &Train) -> Result<Dataset, Failure> {
    let source = source_of(args)?;
    let mut data = dataset::load(source, &options_of(args))?;
    if args.photographs.scene_up.is_some() {
        let cameras = || data.train.iter().chain(&data.test).map(|view| &view.camera);
        data.orientation = data.orientation.map(|found| match args.photographs.scene_up {
            Some(up) => with_up(found, up.into(), cameras()),
            None => found,
        });
        data.orientation.iter().for_each(dataset::note_orientation);
    }
    if args.eval && data.test.is_empty() {
        return Err(Failure::Input(format!(
            "no test views in {source:?}, so there is nothing to measure; add transforms_test.json, hold out photographs \
             with --test-every, or omit --eval"
        )));
    }
    Ok(data)
}

fn background_of(args: &Train, data: &Dataset) -> BackgroundColor {
    let white = args.white_background.then_some(BackgroundColor::WHITE);
    args.background.or(white).unwrap_or_else(|| BackgroundColor::default_for(&data.train))
}

fn points_of(args: &Train, data: &mut Dataset) -> Vec<Point> {
    let random = |count: u32| random_points(count as usize, &data.train, args.seed);
    let with_background = |mut points: Vec<Point>| {
        points.extend(points_behind(&points, args.start.background_points as usize, &data.train, args.seed));
        points
    };
    match (args.start.random_points, data.points.take()) {
        (Some(count), _) => random(count),
        (None, Some(points)) if !points.is_empty() => with_background(points),
        (None, _) => random(RANDOM_POINTS),
    }
}

fn info_of(args: &Train, profile: &Profile, background: BackgroundColor, data: &Dataset) -> Result<ModelInfo, Failure> {
    let [shading, axis, prefilter] = ShadingModel::of_profile(profile).words();
    let is_shaded = profile.layout.is_shaded();
    let mut rest = Map::new();
    if is_shaded {
        rest.insert("axis".into(), axis.into());
        rest.insert("prefilter".into(), prefilter.into());
    }
    rest.insert("background".into(), json!(background.0));
    rest.insert("train_views".into(), data.train.len().into());
    rest.insert("test_views".into(), data.test.len().into());
    rest.insert("images".into(), args.photographs.images.as_str().into());
    rest.insert("test_every".into(), args.photographs.test_every.into());
    rest.insert("command".into(), std::env::args().skip(1).collect::<Vec<_>>().join(" ").into());
    Ok(ModelInfo {
        version: env!("CARGO_PKG_VERSION").into(),
        profile: profile.name.into(),
        shading: if is_shaded { shading } else { "radiance" }.into(),
        iterations: args.iterations,
        white_background: background == BackgroundColor::WHITE,
        eval: args.eval,
        downscale: args.resolution,
        source_path: output::absolute(source_of(args)?),
        seed: args.seed,
        orientation: data.orientation,
        rest,
        ..ModelInfo::default()
    })
}

fn named(view: &View) -> NamedCamera {
    (view.name.clone(), view.camera)
}

fn save_inputs(args: &Train, profile: &Profile, data: &Dataset, points: &[Point]) -> Result<(), Failure> {
    let named = |views: &[View]| views.iter().map(named).collect::<Vec<NamedCamera>>();
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
    let cloud = cloud_of(points);
    Ok(model_folder::save_inputs(&args.model_path, &named(&data.train), &named(&data.test), &cloud, &cfg_args)?)
}

/// Serves a page that shows the training.
fn watch(
    args: &Train,
    address: SocketAddr,
    training: &mut Training,
    data: &Dataset,
    background: BackgroundColor,
) -> Result<Watching, Failure> {
    let live = Arc::new(LiveTraining::new(args.iterations, training.iteration()));
    let photographs = PhotographSource { folder: source_of(args)?.to_owned(), options: options_of(args) };
    let scene = training.scene()?;
    let viewed = ViewedScene {
        name: args.model_path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        orientation: data.orientation.unwrap_or_else(|| of_gaussians(&scene.gaussians)),
        scene,
        views: data.test.iter().chain(&data.train).map(named).collect(),
        held_out: data.test.len(),
        photographs: Some(photographs),
        background: background.0,
    };
    view::watch(args, address, viewed, live)
}

/// Saves and measures during the run, at the iterations that the options name.
fn pause(args: &Train, training: &mut Training, info: &ModelInfo, views: &Views<'_>) -> Result<(), Failure> {
    let iteration = training.iteration();
    let scene = training.scene()?;
    if args.save_iterations.contains(&iteration) {
        save(args, training, &scene, info, views)?;
        tracing::info!("saved iteration {iteration}");
    }
    if args.test_iterations.contains(&iteration) {
        let count = scene.gaussians.count;
        let machine = MachineOptions::in_full(training.choice());
        let measured = progress::silently(|| {
            Renderer::new(scene, Channels::Training, &machine)?.measure(
                views.test,
                views.background,
                training.exposures().is_some(),
                &progress::work("", 0),
            )
        })?;
        save_quality(&args.model_path, iteration, training.seconds(), count, &measured)?;
        tracing::info!("iteration {iteration}: {}", measure::summary(&measure::means(&measured)));
    }
    Ok(())
}

/// Writes the scene, and the exposures of the pictures if they are learned.
fn save(args: &Train, training: &Training, scene: &Scene, info: &ModelInfo, views: &Views<'_>) -> Result<(), Failure> {
    if let Some(exposures) = training.exposures() {
        exposure::write(&args.model_path, &views.names, exposures)?;
    }
    Ok(scene.save(&args.model_path, training.iteration(), info)?)
}

/// Views that a result was trained on and is measured with.
#[derive(Debug)]
struct Views<'a> {
    /// Names of the training pictures.
    names: Vec<String>,
    test: &'a [View],
    cameras: Vec<Camera>,
    background: BackgroundColor,
}

/// Cameras of the test views, or else of the training views.
fn cameras_of(data: &Dataset) -> Vec<Camera> {
    let views = if data.test.is_empty() { &data.train } else { &data.test };
    views.iter().map(|view| view.camera).collect()
}

/// Saves and measures the result, and prints its measures.
fn finish(
    args: &Train,
    training: &mut Training,
    mut info: ModelInfo,
    outcome: Outcome,
    views: &Views<'_>,
) -> Result<(), Failure> {
    let Outcome { iteration, seconds, is_interrupted, .. } = outcome;
    let scene = training.scene()?;
    let count = scene.gaussians.count;
    info.rest.insert("gaussians".into(), count.into());
    info.rest.insert("seconds".into(), ((seconds * 10.0).round() / 10.0).into());
    save(args, training, &scene, &info, views)?;
    let place = model_folder::gaussians_at(&args.model_path, iteration);
    if is_interrupted {
        let model = shell_word(&args.model_path);
        let resumption = format!("; specula train -m {model} --resume continues");
        return Err(Failure::Interrupted(format!(
            "interrupted after iteration {iteration}, which is saved in {place:?}{}",
            if training.has_checkpoint() { &resumption } else { "" }
        )));
    }
    tracing::info!("saved {place:?}");
    let certified = certify_trained(args, &scene, views)?;
    if let Some(certified) = &certified {
        save_certificate(args, &mut info, certified.certificate().to_owned())?;
    }

    let facts = format!("{} Gaussians, {iteration} iterations, {seconds:.0} s{}", group_digits(count), peak_memory());
    if !args.eval {
        output::say(&facts)?;
        tracing::info!("{}", next_commands(args, scene.light.is_some()));
        return Ok(());
    }
    let is_lit = scene.light.is_some();
    let mut renderer = match &certified {
        Some(certified) => certified.renderer(&scene, Channels::Training),
        None => {
            SceneRenderer::new(scene, Channels::Training, &RenderOptions::full_precision(training.choice().clone()))?
        }
    };
    let test = views.test;
    let work = progress::work("measuring", test.len() as u64);
    let measured = measure_views(&mut renderer, test, views.background, training.exposures().is_some(), &work)?;
    work.finish();
    if let Some(certified) = &certified {
        let report = certified::report(certified);
        output::say(&report)?;
        save_certificate(args, &mut info, format!("{}; {report}", certified.certificate()))?;
    }
    save_quality(&args.model_path, iteration, seconds, count, &measured)?;
    output::say(&format!("{}  ({} test views; {facts})", measure::summary(&measure::means(&measured)), test.len()))?;
    tracing::info!("{}", next_commands(args, is_lit));
    Ok(())
}

/// Note with commands for a trained model.
fn next_commands(args: &Train, is_lit: bool) -> String {
    let model = shell_word(&args.model_path);
    let relight = if is_lit { format!(", specula relight {model} --env LIGHT.hdr") } else { String::new() };
    format!("next: specula view {model}, specula render {model} --turntable 36{relight}")
}

/// Path as a word of a shell.
fn shell_word(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |letter: char| letter.is_alphanumeric() || "-_./\\:".contains(letter);
    if text.chars().all(is_plain) { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

/// Render settings within `--max-error`; a bound that cannot be met is only a warning.
fn certify_trained(args: &Train, scene: &Scene, views: &Views<'_>) -> Result<Option<CertifiedScene>, Failure> {
    let Some(error) = args.max_error else { return Ok(None) };
    match CertifiedScene::new(scene, views.cameras.clone(), views.background.0, error, true) {
        Ok(certified) => {
            output::say(certified.certificate())?;
            Ok(Some(certified))
        }
        Err(error) => {
            tracing::warn!("{}", Failure::from(error));
            Ok(None)
        }
    }
}

/// Writes the certificate to the model folder.
fn save_certificate(args: &Train, info: &mut ModelInfo, certificate: String) -> Result<(), Failure> {
    info.rest.insert("certificate".into(), certificate.into());
    Ok(model_folder::save_info(&args.model_path, info)?)
}

/// Writes the measures of an iteration to the model folder.
fn save_quality(
    folder: &Path,
    iteration: u32,
    seconds: f64,
    gaussians: usize,
    measured: &[ViewMeasures],
) -> Result<(), Failure> {
    let quality = measure::quality(measured);
    model_folder::save_quality(folder, &method_of(iteration), &quality)?;
    Ok(model_folder::save_progress(folder, iteration, seconds, gaussians, &quality)?)
}

/// Peak memory of the program, on systems with `/proc`.
fn peak_memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kibibytes: Option<f64> = line.and_then(|line| line.trim().trim_end_matches(" kB").parse().ok());
    kibibytes.map_or(String::new(), |size| format!(", {:.2} GiB at most", size / (1024.0 * 1024.0)))
}
