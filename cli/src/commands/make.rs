//! `specula make`: from a video or photographs to a page with a relit turntable, by the other
//! commands.

use crate::{args::Make, commands::capture, dataset, failure::Failure, interrupt, output, progress, run_words};
use serde_json::Value;
use specula_capture::{Outcome, command_text};
use specula_io::{checkpoint, dataset::LoadOptions, model_folder};
use specula_report::made::{Made, Turntable};
use specula_scene::{dataset::Dataset, text::shown};
use std::{fs, path::Path};

/// Lights of the turntables, which are in the program.
const LIGHTS: [&str; 2] = ["sunset", "forest"];
/// Pictures of a turntable, and their longer edge in pixels.
const TURNTABLE: &str = "48";
const EDGE: u32 = 640;
/// Longer edge of the pictures of a quick training.
const QUICK_EDGE: u32 = 400;

/// Runs the commands whose results are missing, and writes the page.
pub(crate) fn run(args: &Make) -> Result<(), Failure> {
    let folder = |name: &str| args.output.join(name);
    let (data, model) = (folder("data"), folder("model"));
    let outcome = capture::capture(&args.inputs, &data, &args.capture)?;
    if 2 * outcome.registered < outcome.pictures {
        let Outcome { registered, pictures } = outcome;
        return Err(Failure::Input(format!(
            "only {registered} of {pictures} pictures have cameras, too few for a scene; take pictures that overlap by two \
             thirds, or train on these: {}",
            command_text(["specula", "train", &text(&data)])
        )));
    }
    let loaded = progress::silently(|| dataset::load(&data, &LoadOptions::default()))?;
    let findings = capture::findings(&data, &loaded)?;
    let has_drift = findings.iter().any(|finding| finding.kind == "exposure");
    let findings: Vec<String> = findings.iter().map(capture::sentence).collect();
    findings.iter().for_each(|finding| tracing::warn!("{finding}"));

    let mut commands = Commands::default();
    let iterations = if args.quick {
        2000
    } else if args.capture.best {
        30_000
    } else {
        7000
    };
    let mut options = training_options(args, &loaded);
    options.extend(has_drift.then(|| "--exposure".to_owned()));
    commands.train(&data, &model, iterations, &options)?;
    commands.run(&["eval", &text(&model)])?;
    let size = size_of(&loaded);
    // Surroundings that no mask cuts out would reflect the object as a mirror.
    let crop: &[&str] = if capture::material_options(&loaded).is_empty() { &[] } else { &["--crop", "auto"] };
    let has_ffmpeg = specula_capture::has_ffmpeg();
    let mut turntables = Vec::new();
    for light in LIGHTS {
        let place = folder(&if has_ffmpeg { format!("{light}.mp4") } else { light.to_owned() });
        let file = if has_ffmpeg { place.clone() } else { place.join("turntable.png") };
        if !file.is_file() {
            let (model, place) = (text(&model), text(&place));
            let turntable = ["--turntable", TURNTABLE, "--size", &size, "-o", &place];
            commands.run(&[&["relight", &model, "--env", light], crop, &turntable[..]].concat())?;
        }
        let bytes = fs::read(&file).map_err(|cause| specula_io::Error::Read { path: file.clone(), cause })?;
        turntables.push(Turntable { caption: format!("under {light}"), bytes, is_video: has_ffmpeg });
    }
    let scene = folder("scene.html");
    if !scene.is_file() {
        let [first, other] = LIGHTS;
        let lights = ["--env", first, "--page-env", other];
        commands
            .run(&[&["export", &text(&model), "--no-error", "-o", &text(&scene)][..], crop, &lights[..]].concat())?;
    }

    let mut facts = vec![["cameras".to_owned(), format!("{} of {} pictures", outcome.registered, outcome.pictures)]];
    facts.push(["iterations".into(), iterations.to_string()]);
    facts.extend(psnr_of(&model, iterations).map(|psnr| ["PSNR of held-out pictures".into(), format!("{psnr:.2} dB")]));
    let made = Made {
        title: output::stem(&args.output),
        turntables,
        scene: Some("scene.html".into()),
        facts,
        findings,
        commands: commands.0,
    };
    let page = folder("index.html");
    output::write_text(&page, &made.html()?)?;
    output::say(&format!("Page: {}", shown(&page)))
}

/// Command lines that were run.
#[derive(Debug, Default)]
struct Commands(Vec<String>);

impl Commands {
    fn run(&mut self, words: &[&str]) -> Result<(), Failure> {
        if interrupt::is_requested() {
            return Err(Failure::Interrupted("interrupted; the same command continues".into()));
        }
        let line = command_text(["specula"].iter().chain(words).copied());
        tracing::info!("{line}");
        self.0.push(line);
        run_words(["specula"].iter().chain(words).map(Into::into).collect())
    }

    /// Trains, or continues a training, unless the model is there.
    fn train(&mut self, data: &Path, model: &Path, iterations: u32, options: &[String]) -> Result<(), Failure> {
        if model_folder::latest_iteration(model).is_ok_and(|latest| latest >= iterations) {
            return Ok(());
        }
        if checkpoint::path_in(model).is_file() {
            return self.run(&["train", "-m", &text(model), "--resume"]);
        }
        let iterations = iterations.to_string();
        let (data, model) = (text(data), text(model));
        let words = ["train", &data, "-m", &model, "--eval", "--overwrite", "--iterations", &iterations];
        self.run(&words.into_iter().chain(options.iter().map(String::as_str)).collect::<Vec<_>>())
    }
}

/// Options of the training.
fn training_options(args: &Make, data: &Dataset) -> Vec<String> {
    let factor = |edge: u32| [1, 2, 4, 8].into_iter().find(|factor| data.width_max() / factor <= edge).unwrap_or(8);
    let resolution = match (args.quick, args.capture.best) {
        (true, _) => factor(QUICK_EDGE).to_string(),
        (_, true) => "-1".into(),
        _ => "auto".into(),
    };
    let materials = capture::material_options(data);
    let surroundings = if materials.is_empty() { &[][..] } else { &["--background-points", "5000"] };
    let resolution = ["-r", &resolution];
    [&resolution[..], materials, surroundings].concat().into_iter().map(str::to_owned).collect()
}

/// Size of the turntable's pictures: the shape of the data set's, with even edges.
fn size_of(data: &Dataset) -> String {
    let [width, height] = data.train.first().map_or([4, 3], |view| [view.camera.width, view.camera.height]);
    let longer = width.max(height).max(1);
    let edge = |edge: u32| (u64::from(edge) * u64::from(EDGE.min(longer)) / u64::from(longer)).max(2) as u32 & !1;
    format!("{},{}", edge(width), edge(height))
}

/// PSNR of a model, as its results have it.
fn psnr_of(model: &Path, iterations: u32) -> Option<f64> {
    let results: Value = serde_json::from_str(&fs::read_to_string(model.join("results.json")).ok()?).ok()?;
    results[model_folder::method_of(iterations)]["PSNR"].as_f64()
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}
