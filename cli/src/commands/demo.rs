//! `specula demo`: a small scene from pictures to relit pictures, next to plain Gaussian splatting.

use crate::{
    args::Demo, dataset, failure::Failure, included, interrupt, output, progress, run_words, scene::measure_views,
    training::Session,
};
use specula_core::rules::Channels;
use specula_io::{
    dataset::LoadOptions,
    model_folder::{self, ModelInfo},
    within,
};
use specula_report::{
    demo::{self, LIGHTS, Orbit, Pictures, TrainedScene},
    measure,
};
use specula_scene::{
    ExecutorChoice, RenderOptions, SceneRenderer, ShadingModel,
    backdrop::BackgroundColor,
    dataset::{Dataset, cloud_of, named_cameras},
    text::shown,
    training::{Lock, Start, Training, model_info},
};
use specula_train::{
    profile,
    start::{Point, random_points},
    trainer::Settings,
};
use std::{
    ffi::OsString,
    path::{Path, PathBuf},
};

/// Number of random points that both trainings start from.
const POINTS: usize = 10_000;
/// Seed of both trainings.
const SEED: u64 = 0;
/// Profiles of the trainings: plain, then shaded.
const PROFILES: [&str; 2] = ["3dgs", "specula"];

/// Unpacks the data, trains twice, measures, and writes pictures and page.
pub(crate) fn run(args: &Demo) -> Result<(), Failure> {
    let _lock = lock(args)?;
    PROFILES.iter().try_for_each(|name| refuse_to_hide(args, name))?;
    if PROFILES.iter().any(|name| model_folder::holds_training(&args.output.join(name))) {
        tracing::info!("{} has an earlier demo, which this one replaces", shown(&args.output));
    }
    let (data, points) = prepare(args)?;
    let train = |name| train(name, args, &data, &points);
    let [plain, shaded] = [train(PROFILES[0])?, train(PROFILES[1])?];
    let rows = demo::table([&plain, &shaded]);
    output::write_json(&args.output.join("results.json"), &demo::results([&plain, &shaded]))?;

    let work = progress::work("pictures", Pictures::STEPS);
    let orbit = Orbit::new(&data.test, &shaded.scene);
    let pictures = Pictures::write(&args.output, &data.test, &plain.scene, &shaded.scene, &orbit, &|done| {
        work.done(done, String::new);
    })?;
    work.finish();
    write_ball(&args.output)?;
    let page = args.output.join("index.html");
    output::write_text(&page, &demo::page(&args.output, &rows, args.iterations, &pictures)?)?;
    let line = |[name, rest @ ..]: &[String; 6]| {
        format!("{name:<8}{}", rest.iter().map(|cell| format!("{cell:>11}")).collect::<String>())
    };
    output::say(&format!("{}\n\nPictures: {}", rows.iter().map(line).collect::<Vec<_>>().join("\n"), shown(&page)))?;
    progress::note_next(next_commands(&args.output));
    Ok(())
}

/// Writes the shaded scene as a page for browsers, with the demo's lights to choose from.
fn write_ball(folder: &Path) -> Result<(), Failure> {
    let [model, page] = [PROFILES[1], "ball.html"].map(|name| folder.join(name).into_os_string());
    let lights = LIGHTS.map(|name| folder.join("data/light").join(format!("{name}.hdr")).into_os_string());
    let words = ["specula", "export", "--no-error", "-o"].map(OsString::from);
    let words = words.into_iter().chain([page]).chain([OsString::from("--page-env")]).chain(lights);
    run_words(words.chain(["--".into(), model]).collect())
}

/// Commands that follow a demo.
fn next_commands(folder: &Path) -> [String; 2] {
    let model = shown(&folder.join(PROFILES[1]));
    let lit = "--sun 30,40,2.5 --ground --turntable 24 --size 480,480";
    [
        format!("specula view {model} --env sunset --sun 30,40,1.5 --ground"),
        format!("specula relight {model} --env sunset --exposure -1 {lit}"),
    ]
}

/// Trains only the shaded scene; returns the folder of its model.
pub(crate) fn train_shaded(args: &Demo) -> Result<PathBuf, Failure> {
    let _lock = lock(args)?;
    refuse_to_hide(args, PROFILES[1])?;
    let (data, points) = prepare(args)?;
    let TrainedScene { name, .. } = train(PROFILES[1], args, &data, &points)?;
    Ok(args.output.join(name))
}

/// Rejects a folder with a training that no demo started; an earlier demo is replaced.
fn refuse_to_hide(args: &Demo, name: &str) -> Result<(), Failure> {
    let folder = args.output.join(name);
    let data = args.output.join("data").canonicalize().ok();
    // A folder that was moved names a place that is no longer there.
    let is_own = |source: &Path| match source.canonicalize() {
        Ok(source) => Some(source) == data,
        Err(_) => source.ends_with("data"),
    };
    let is_demo = |info: &ModelInfo| is_own(Path::new(&info.source_path)) && !info.rest.contains_key("command");
    if !model_folder::holds_training(&folder) || model_folder::read_info(&folder)?.as_ref().is_some_and(is_demo) {
        return Ok(());
    }
    Err(Failure::Input(format!("{folder:?} contains a model that is not from a demo; use another folder with -o")))
}

/// Creates the demo's folder and locks it against other trainings.
fn lock(args: &Demo) -> Result<Lock, Failure> {
    output::make_folder(&args.output)?;
    for name in PROFILES.into_iter().chain(["data", Pictures::FOLDER]) {
        within::refuse_links(&args.output, &args.output.join(name))?;
    }
    output::lock(&args.output)
}

/// Unpacks the data and draws random points.
fn prepare(args: &Demo) -> Result<(Dataset, Vec<Point>), Failure> {
    let source = args.output.join("data");
    included::unpack(&source)?;
    let data = progress::silently(|| dataset::load(&source, &LoadOptions::default()))?;
    let points = random_points(POINTS, &data.train, SEED);
    interrupt::watch()?;
    Ok((data, points))
}

fn train(name: &'static str, args: &Demo, data: &Dataset, points: &[Point]) -> Result<TrainedScene, Failure> {
    let profile = profile::by_name(name, args.iterations).expect("the demo's profiles have names").for_objects();
    let settings = Settings {
        // Plain Gaussians have no materials.
        profile: profile.relightable(),
        iterations: args.iterations,
        seed: SEED,
        background: BackgroundColor::WHITE.0,
        random_points: 0,
    };
    let info = info(args, &settings, data);
    let mut session = Session::new(&data.train, points).showing(data.train.iter().map(|view| &view.camera));
    let start = Start::Points(points);
    let mut training = Training::new(&ExecutorChoice::Cpu, settings.clone(), &data.train, &start, &mut session)?;
    let outcome = session.run(&mut training, name, &settings, &[])?;
    if outcome.is_interrupted {
        return Err(Failure::Interrupted(format!("interrupted while training {name:?}; run the demo again")));
    }
    let scene = training.scene()?;
    let folder = args.output.join(name);
    model_folder::remove_training(&folder)?;
    let [train, test] = [&data.train, &data.test].map(named_cameras);
    model_folder::save_inputs(&folder, &train, &test, &cloud_of(points), data.origin, &[])?;
    scene.save(&folder, args.iterations, &info)?;

    let options = RenderOptions::full_precision(ExecutorChoice::Cpu);
    let mut renderer = SceneRenderer::new(scene.clone(), Channels::Training, &options)?;
    tracing::info!("measuring {} held-out views of {name}", data.test.len());
    let measured = measure_views(&mut renderer, &data.test, BackgroundColor::WHITE, false)?;
    model_folder::save_quality(&folder, &model_folder::method_of(args.iterations), &measure::quality(&measured))?;
    Ok(TrainedScene { name, measures: measure::means(&measured), seconds: outcome.seconds, scene })
}

fn info(args: &Demo, settings: &Settings, data: &Dataset) -> ModelInfo {
    let mut info = model_info(settings, [data.train.len(), data.test.len()], data.orientation);
    let [_, axis, prefilter, _] = ShadingModel::of_profile(&settings.profile).names();
    info.rest.insert("axis".into(), axis.into());
    info.rest.insert("prefilter".into(), prefilter.into());
    info.eval = true;
    info.source_path = output::absolute(&args.output.join("data"));
    info
}
