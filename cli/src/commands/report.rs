//! `specula report`: error against run time, one parameter at a time and all together.

use crate::{
    args::{
        Demo, Report,
        demo::{FOLDER, ITERATIONS},
    },
    commands::demo,
    failure::Failure,
    output, progress,
    scene::{self, background_of},
};
use glam::Vec3;
use specula_accuracy::subject::Subject;
use specula_core::camera::Camera;
use specula_report::{
    certificate::subject_of,
    tradeoff::{self, LampSubject, Options, spread_cameras},
};
use specula_scene::{Scene, orientation, text::shown};
use std::path::{Path, PathBuf};

/// Measures a scene, prints the table and writes records and page.
pub(crate) fn run(args: &Report) -> Result<(), Failure> {
    output::make_folder(&args.output)?;
    let model = match &args.model {
        Some(model) => model.clone(),
        None => demo_model(&args.output)?,
    };
    let Opened { subject, scene, up } = opened(&model, args)?;
    let options = Options { repeats: args.repeats, with_stability: !args.no_stability };
    let progress = |title: &str, steps| -> Box<dyn Fn(u64) + Sync> {
        let work = progress::work(title, steps);
        Box::new(move |done| work.done(done, String::new))
    };
    let mut findings = tradeoff::measure(&shown(&model), &subject, options, &progress)?;
    let lit = LampSubject { scene: &scene, up, cameras: &subject.cameras, background: subject.background };
    findings.lamps = tradeoff::lamp_settings(&lit, args.repeats, &progress)?;
    output::write_text(&args.output.join("report.jsonl"), &tradeoff::records(&findings))?;
    let page = args.output.join("index.html");
    output::write_text(&page, &tradeoff::page(&findings)?)?;
    output::say(&tradeoff::markdown(&findings))?;
    output::say(&format!("\nPage: {}", shown(&page)))
}

/// Shaded model of an earlier demo, else of a training in `folder`.
fn demo_model(folder: &Path) -> Result<PathBuf, Failure> {
    let model = Path::new(FOLDER).join("specula");
    if model.join("specula.json").is_file() {
        return Ok(model);
    }
    tracing::info!("training the demo's scene first, which takes half a minute");
    demo::train_shaded(&Demo { output: folder.join("demo"), iterations: ITERATIONS })
}

/// Scene of a model to be measured.
struct Opened {
    subject: Subject,
    scene: Scene,
    up: Vec3,
}

fn opened(model: &Path, args: &Report) -> Result<Opened, Failure> {
    let opened = scene::open(model, None, None)?;
    let cameras: Vec<Camera> = opened.evaluation_cameras()?.into_iter().map(|(_, camera)| camera).collect();
    let cameras = spread_cameras(&cameras, args.views.into(), args.size);
    let background = background_of(&opened, None).0;
    let up = orientation::up(&opened.orientation(None)?);
    let scene = opened.scene;
    let subject = subject_of(scene.clone(), cameras, background);
    if !subject.has_reference() {
        return Err(Failure::Input(format!(
            "{model:?} has no exact pictures, because its profile, official, is defined by code; use a model of \
             profile specula, paper or 3dgs, or --profile to read it as one"
        )));
    }
    Ok(Opened { subject, scene, up })
}
