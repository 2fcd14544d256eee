//! `specula demo`: a small scene from pictures to relit pictures, beside plain Gaussian splatting.

mod data;

use crate::{
    args::{Demo, MachineOptions},
    dataset,
    failure::Failure,
    interrupt, output, progress,
    scene::Renderer,
    training::Session,
};
use serde_json::{Map, Value, json};
use specula_core::{camera::Camera, rules::Channels};
use specula_io::{
    cameras::NamedCamera,
    dataset::LoadOptions,
    model_folder::{self, ModelInfo},
};
use specula_report::{
    demo::{self, Pictures},
    measure::{self, MAE, MEASURES, PSNR, SSIM, Values},
};
use specula_scene::{
    ExecutorChoice, Scene,
    backdrop::BackgroundColor,
    dataset::{Dataset, cloud_of},
    number::group_digits,
    orbit::turntable,
    orientation,
    training::{Lock, Start, Training},
};
use specula_train::{
    profile,
    start::{Point, random_points},
    trainer::Settings,
};
use std::path::PathBuf;

/// Number of random points that both trainings start from.
const POINTS: usize = 10_000;
/// Seed of both trainings.
const SEED: u64 = 0;
/// Profiles of the trainings: plain, then shaded.
const PROFILES: [&str; 2] = ["3dgs", "specula"];
/// Frames of the animation.
const FRAMES: u32 = 36;
/// Width and height of a frame in pixels.
const FRAME_SIZE: [u32; 2] = [240, 240];

/// One of the two trainings, measured.
#[derive(Debug)]
struct Trained {
    name: &'static str,
    measures: Values,
    seconds: f64,
    scene: Scene,
}

/// Unpacks the data, trains twice, measures, and writes pictures and page.
pub(crate) fn run(args: &Demo) -> Result<(), Failure> {
    let _lock = lock(args)?;
    PROFILES.iter().try_for_each(|name| refuse_to_hide(args, name))?;
    let (data, points) = prepare(args)?;
    let train = |name| train(name, args, &data, &points);
    let [plain, shaded] = [train(PROFILES[0])?, train(PROFILES[1])?];
    let rows = table([&plain, &shaded]);
    output::write_json(&args.output.join("results.json"), &results([&plain, &shaded]))?;

    let work = progress::work("pictures", Pictures::STEPS);
    let orbit = orbit(&data, &shaded.scene);
    let pictures = Pictures::write(&args.output, &data.test, &plain.scene, &shaded.scene, &orbit, &|done| {
        work.done(done, String::new);
    })?;
    work.finish();
    let page = args.output.join("index.html");
    output::write_text(&page, &demo::page(&args.output, &rows, args.iterations, &pictures)?)?;
    let line = |[name, rest @ ..]: &[String; 6]| {
        format!("{name:<8}{}", rest.iter().map(|cell| format!("{cell:>11}")).collect::<String>())
    };
    output::say(&format!("{}\n\nPictures: {}", rows.iter().map(line).collect::<Vec<_>>().join("\n"), page.display()))
}

/// Trains the shaded scene alone; returns the folder of its model.
pub(crate) fn train_shaded(args: &Demo) -> Result<PathBuf, Failure> {
    let _lock = lock(args)?;
    refuse_to_hide(args, PROFILES[1])?;
    let (data, points) = prepare(args)?;
    let Trained { name, .. } = train(PROFILES[1], args, &data, &points)?;
    Ok(args.output.join(name))
}

/// Cameras of the animation.
fn orbit(data: &Dataset, scene: &Scene) -> Vec<Camera> {
    let [width, height] = FRAME_SIZE;
    let known = data.test.iter().map(|view| (view.name.clone(), view.camera.resized(width, height)));
    let known: Vec<NamedCamera> = known.collect();
    let found = orientation::estimate(known.iter().map(|(_, camera)| camera), &[]);
    let orientation = found.unwrap_or_else(|| orientation::of_gaussians(&scene.gaussians));
    turntable(&orientation, &known, FRAMES, None).into_iter().map(|(_, camera)| camera).collect()
}

/// Refuses a folder with a training that is not of an earlier demo; one of a demo is replaced.
fn refuse_to_hide(args: &Demo, name: &str) -> Result<(), Failure> {
    let folder = args.output.join(name);
    let data = output::absolute(&args.output.join("data"));
    let is_demo = |info: &ModelInfo| info.source_path == data && !info.rest.contains_key("command");
    if !model_folder::holds_training(&folder) || model_folder::read_info(&folder)?.as_ref().is_some_and(is_demo) {
        return Ok(());
    }
    Err(Failure::Input(format!("{folder:?} holds a model that is not of a demo; name another folder with -o")))
}

/// Creates the demo's folder and locks it against other trainings.
fn lock(args: &Demo) -> Result<Lock, Failure> {
    output::make_folder(&args.output)?;
    const REMEDY: &str = "wait until it ends, or name another folder with -o";
    Lock::take(&args.output).map_err(|error| Failure::locked(error, REMEDY))
}

/// Unpacks the data and draws random points.
fn prepare(args: &Demo) -> Result<(Dataset, Vec<Point>), Failure> {
    let source = args.output.join("data");
    data::unpack(&source)?;
    let data = progress::silently(|| dataset::load(&source, &LoadOptions::default()))?;
    let points = random_points(POINTS, &data.train, SEED);
    interrupt::watch()?;
    Ok((data, points))
}

fn train(name: &'static str, args: &Demo, data: &Dataset, points: &[Point]) -> Result<Trained, Failure> {
    let settings = Settings {
        profile: profile::by_name(name, args.iterations).expect("the demo's profiles have names"),
        iterations: args.iterations,
        seed: SEED,
        background: BackgroundColor::WHITE.0,
        random_points: 0,
    };
    let reload = || Ok((data.train.clone(), points.to_vec()));
    let mut session = Session::new(&reload);
    let start = Start::Points(points);
    let mut training = Training::new(&ExecutorChoice::Cpu, settings, &data.train, &start, &mut session)?;
    let outcome = session.run(&mut training, name, args.iterations, &[])?;
    if outcome.is_interrupted {
        return Err(Failure::Interrupted(format!("interrupted in training {name:?}; start the demo again to see it")));
    }
    let scene = training.scene()?;
    let folder = args.output.join(name);
    let named = |views: &[specula_train::view::View]| {
        views.iter().map(|view| (view.name.clone(), view.camera)).collect::<Vec<NamedCamera>>()
    };
    model_folder::remove_training(&folder)?;
    model_folder::save_inputs(&folder, &named(&data.train), &named(&data.test), &cloud_of(points), &[])?;
    scene.save(&folder, args.iterations, &info(name, args, data, &scene.shading_model.words()))?;

    let mut renderer =
        Renderer::new(scene.clone(), Channels::Training, &MachineOptions::in_full(&ExecutorChoice::Cpu))?;
    let work = progress::work("measuring", data.test.len() as u64);
    let measured = renderer.measure(&data.test, BackgroundColor::WHITE, false, &work)?;
    work.finish();
    model_folder::save_quality(&folder, &model_folder::method_of(args.iterations), &measure::quality(&measured))?;
    Ok(Trained { name, measures: measure::means(&measured), seconds: outcome.seconds, scene })
}

fn info(name: &str, args: &Demo, data: &Dataset, shading_model: &[&str; 3]) -> ModelInfo {
    let [shading, axis, prefilter] = *shading_model;
    let is_plain = name == "3dgs";
    let mut rest = Map::new();
    rest.insert("axis".into(), axis.into());
    rest.insert("prefilter".into(), prefilter.into());
    rest.insert("background".into(), json!(BackgroundColor::WHITE.0));
    rest.insert("train_views".into(), data.train.len().into());
    rest.insert("test_views".into(), data.test.len().into());
    ModelInfo {
        version: env!("CARGO_PKG_VERSION").into(),
        profile: name.into(),
        shading: if is_plain { "radiance" } else { shading }.into(),
        iterations: args.iterations,
        white_background: true,
        eval: true,
        downscale: 1,
        source_path: output::absolute(&args.output.join("data")),
        seed: SEED,
        orientation: data.orientation,
        rest,
        ..ModelInfo::default()
    }
}

fn results(trained: [&Trained; 2]) -> Value {
    let entry = |trained: &Trained| {
        let mut measures = measure::json_of_values(&trained.measures);
        measures["seconds"] = ((trained.seconds * 10.0).round() / 10.0).into();
        measures["gaussians"] = trained.scene.gaussians.count.into();
        (trained.name.to_owned(), measures)
    };
    Value::Object(trained.into_iter().map(entry).collect())
}

/// Both trainings as rows of a table, heads first.
fn table([plain, shaded]: [&Trained; 2]) -> [[String; 6]; 3] {
    let heads = ["profile", "PSNR dB", "SSIM", "normals °", "seconds", "Gaussians"].map(str::to_owned);
    let row = |trained: &Trained| {
        let value =
            |measure: usize| trained.measures[measure].map_or(String::new(), |value| MEASURES[measure].format(value));
        [
            trained.name.to_owned(),
            value(PSNR),
            value(SSIM),
            value(MAE),
            format!("{:.0}", trained.seconds),
            group_digits(trained.scene.gaussians.count),
        ]
    };
    [heads, row(plain), row(shaded)]
}
