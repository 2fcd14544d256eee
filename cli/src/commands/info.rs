//! `specula info`: the contents of a model, a PLY file or a data set.

use crate::{args::Info, commands::capture, dataset, failure::Failure, output, scene};
use serde_json::json;
use specula_io::{Error, dataset::LoadOptions, points_ply};
use specula_report::contents::Contents;
use specula_scene::OpenedModel;
use std::path::Path;

/// Prints the contents.
pub(crate) fn run(args: &Info) -> Result<(), Failure> {
    let contents = if specula_io::dataset::is_dataset(&args.path) {
        of_dataset(&args.path)?
    } else {
        match scene::open(&args.path, None, None) {
            Ok(opened) => of_model(&args.path, &opened)?,
            Err(Failure::File(error @ Error::OtherKind { .. })) => {
                Contents::of_points(&args.path, &points_ply::read(&args.path).map_err(|_| error)?)
            }
            Err(failure) => return Err(failure),
        }
    };
    if args.json { output::say_json(&contents.to_json()) } else { output::say(&contents.text()) }
}

fn of_dataset(path: &Path) -> Result<Contents, Failure> {
    let data = dataset::load(path, &LoadOptions::default())?;
    let mut contents = Contents::of_dataset(path, &data);
    let findings = capture::findings(path, &data)?;
    let sentences: Vec<String> = findings.iter().map(capture::sentence).collect();
    let text = if sentences.is_empty() { "nothing".into() } else { sentences.join("\n                   ") };
    contents.add("to improve", text, json!(findings));
    Ok(contents)
}

fn of_model(path: &Path, opened: &OpenedModel) -> Result<Contents, Failure> {
    let mut contents = Contents::of_model(path, opened)?;
    if opened.scene.light.is_none() {
        contents.remark("light", "; add one with --env if needed");
    }
    Ok(contents)
}
