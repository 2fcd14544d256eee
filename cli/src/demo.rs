//! `specula demo`: a small scene from pictures to relit pictures, beside plain Gaussian splatting.

mod data;
mod page;
mod sheets;

use crate::{
    args::{Demo, MachineOptions},
    background::Background,
    dataset::{self, Dataset},
    failure::Failure,
    fit::{Start, Training, thousands},
    interrupt,
    lock::Lock,
    output, progress,
    quality::{self, MAE, MEASURES, PSNR, SSIM, Values},
    scene::Renderer,
};
use serde_json::{Map, Value, json};
use specula_core::rules::Channels;
use specula_io::{
    cameras::NamedCamera,
    dataset::LoadOptions,
    model_folder::{self, ModelInfo},
};
use specula_scene::{ExecutorChoice, Scene};
use specula_train::{
    profile,
    start::{Point, random_points},
    trainer::Settings,
};
use std::path::PathBuf;

/// Random points that both trainings start from.
const POINTS: usize = 10_000;
/// Seed of both trainings.
const SEED: u64 = 0;
/// What is compared, and in which order.
const PROFILES: [&str; 2] = ["3dgs", "specula"];

/// One of the two trainings.
#[derive(Debug)]
struct Contestant {
    name: &'static str,
    quality: Values,
    seconds: f64,
    gaussians: usize,
    scene: Scene,
    renderer: Renderer,
}

/// Unpacks, trains twice, measures, and makes pictures of everything.
pub(crate) fn run(args: &Demo) -> Result<(), Failure> {
    let _lock = lock(args)?;
    PROFILES.iter().try_for_each(|name| refuse_to_hide(args, name))?;
    let (data, points) = prepare(args)?;
    let mut contestants = Vec::new();
    for name in PROFILES {
        contestants.push(contest(name, args, &data, &points)?);
    }
    let table = table(&contestants);
    output::write_json(&args.output.join("results.json"), &results(&contestants))?;
    let [plain, ours] = contestants.try_into().expect("there are two of them");
    let sheets = sheets::write(&args.output, &data.test, plain.renderer, ours.renderer, ours.scene)?;
    page::write(&args.output, &table, args.iterations, &sheets)?;
    let page = args.output.join("index.html");
    output::say(&format!("{}\n\nPictures: {}", table.lines.join("\n"), page.display()))
}

/// Trains the shaded scene alone; returns the folder of its model.
pub(crate) fn train_shaded(args: &Demo) -> Result<PathBuf, Failure> {
    let _lock = lock(args)?;
    refuse_to_hide(args, PROFILES[1])?;
    let (data, points) = prepare(args)?;
    let Contestant { name, .. } = contest(PROFILES[1], args, &data, &points)?;
    Ok(args.output.join(name))
}

/// Refuses a folder that holds another training than an earlier demo, whose place this one takes.
fn refuse_to_hide(args: &Demo, name: &str) -> Result<(), Failure> {
    let folder = args.output.join(name);
    let data = output::absolute(&args.output.join("data"));
    let is_demo = |info: &ModelInfo| info.source_path == data && !info.rest.contains_key("command");
    if !model_folder::holds_training(&folder) || model_folder::read_info(&folder)?.as_ref().is_some_and(is_demo) {
        return Ok(());
    }
    Err(Failure::Input(format!("{folder:?} holds a model that is not of a demo; name another folder with -o")))
}

/// Keeps other trainings out of the demo's folder, which it makes.
fn lock(args: &Demo) -> Result<Lock, Failure> {
    output::make_folder(&args.output)?;
    Lock::take(&args.output, "wait until it ends, or name another folder with -o")
}

/// Unpacks the data, and draws the points.
fn prepare(args: &Demo) -> Result<(Dataset, Vec<Point>), Failure> {
    let source = args.output.join("data");
    data::unpack(&source)?;
    let data = progress::silently(|| dataset::load(&source, &LoadOptions::default()))?;
    let points = random_points(POINTS, &data.train, SEED);
    interrupt::watch()?;
    Ok((data, points))
}

fn contest(name: &'static str, args: &Demo, data: &Dataset, points: &[Point]) -> Result<Contestant, Failure> {
    let settings = Settings {
        profile: profile::by_name(name, args.iterations).expect("the demo's profiles have names"),
        iterations: args.iterations,
        seed: SEED,
        background: Background::WHITE.0,
        random_points: 0,
    };
    let reload = || Ok((data.train.clone(), points.to_vec()));
    let mut training = Training::new(&ExecutorChoice::Cpu, settings, &data.train, &Start::Points(points), &reload)?;
    let outcome = training.run(name, &[], |_| Ok(()))?;
    if outcome.is_interrupted {
        return Err(Failure::Interrupted(format!("interrupted in training {name:?}; start the demo again to see it")));
    }
    let scene = training.scene()?;
    let gaussians = scene.gaussians.count;
    let folder = args.output.join(name);
    let named = |views: &[specula_train::view::View]| {
        views.iter().map(|view| (view.name.clone(), view.camera)).collect::<Vec<NamedCamera>>()
    };
    model_folder::remove_training(&folder)?;
    model_folder::save_inputs(&folder, &named(&data.train), &named(&data.test), &dataset::cloud_of(points), &[])?;
    scene.save(&folder, args.iterations, &info(name, args, data, &scene.shading_model.words()))?;

    let mut renderer =
        Renderer::new(scene.clone(), Channels::Training, &MachineOptions::in_full(&ExecutorChoice::Cpu))?;
    let work = progress::work("measuring", data.test.len() as u64);
    let measured = renderer.measure(&data.test, Background::WHITE, false, &work)?;
    work.finish();
    model_folder::save_quality(&folder, &model_folder::method_of(args.iterations), &quality::for_files(&measured))?;
    Ok(Contestant { name, quality: quality::means(&measured), seconds: outcome.seconds, gaussians, scene, renderer })
}

fn info(name: &str, args: &Demo, data: &Dataset, words: &[&str; 3]) -> ModelInfo {
    let [shading, axis, prefilter] = *words;
    let is_plain = name == "3dgs";
    let mut rest = Map::new();
    rest.insert("axis".into(), axis.into());
    rest.insert("prefilter".into(), prefilter.into());
    rest.insert("background".into(), json!(Background::WHITE.0));
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

fn results(contestants: &[Contestant]) -> Value {
    let entry = |contestant: &Contestant| {
        let mut measures = quality::for_programs(&contestant.quality);
        measures["seconds"] = ((contestant.seconds * 10.0).round() / 10.0).into();
        measures["gaussians"] = contestant.gaussians.into();
        (contestant.name.to_owned(), measures)
    };
    Value::Object(contestants.iter().map(entry).collect())
}

/// The two trainings side by side.
#[derive(Debug)]
struct Table {
    cells: Vec<[String; 6]>,
    lines: Vec<String>,
}

fn table(contestants: &[Contestant]) -> Table {
    let heads = ["profile", "PSNR dB", "SSIM", "normals °", "seconds", "Gaussians"].map(str::to_owned);
    let row = |contestant: &Contestant| {
        let number =
            |measure: usize| contestant.quality[measure].map_or(String::new(), |value| MEASURES[measure].number(value));
        [
            contestant.name.to_owned(),
            number(PSNR),
            number(SSIM),
            number(MAE),
            format!("{:.0}", contestant.seconds),
            thousands(contestant.gaussians),
        ]
    };
    let cells: Vec<[String; 6]> = core::iter::once(heads).chain(contestants.iter().map(row)).collect();
    let line = |[name, rest @ ..]: &[String; 6]| {
        format!("{name:<8}{}", rest.iter().map(|cell| format!("{cell:>11}")).collect::<String>())
    };
    Table { lines: cells.iter().map(line).collect(), cells }
}
