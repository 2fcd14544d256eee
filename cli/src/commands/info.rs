//! `specula info`: the contents of a model, a file of Gaussians or a data set.

use crate::{args::Info, commands::capture, dataset, failure::Failure, output, scene};
use serde_json::json;
use specula_io::{
    Error,
    dataset::LoadOptions,
    lint::{self, Finding},
    points_ply,
};
use specula_report::contents::Contents;
use specula_scene::{OpenedModel, number::counted, text::shown};
use std::path::Path;

/// Prints the contents.
pub(crate) fn run(args: &Info) -> Result<(), Failure> {
    if specula_io::dataset::is_dataset(&args.path) {
        return say(&of_dataset(&args.path)?, args.json);
    }
    // Points and meshes have no findings; their readers name their faults.
    let findings = if args.path.is_file() { lint::lint(&args.path).unwrap_or_default() } else { Vec::new() };
    let contents = match scene::open(&args.path, None, None) {
        Ok(opened) => of_model(&args.path, &opened, &findings)?,
        Err(Failure::File(error @ Error::OtherKind { .. })) => {
            Contents::of_points(&args.path, &points_ply::read(&args.path).map_err(|_| error)?)
        }
        Err(failure) => {
            findings.iter().for_each(|finding| tracing::warn!("{}; {}", finding.found, finding.effect));
            return Err(failure);
        }
    };
    say(&contents, args.json)?;
    if args.strict && !findings.is_empty() {
        return Err(Failure::Findings(format!("{} has {}", shown(&args.path), counted(findings.len(), "finding"))));
    }
    Ok(())
}

fn of_dataset(path: &Path) -> Result<Contents, Failure> {
    let data = dataset::load(path, &LoadOptions::default())?;
    let mut contents = Contents::of_dataset(path, &data);
    let findings = capture::findings(path, &data)?;
    contents.add_each("to improve", findings.iter().map(capture::sentence), "to_improve", json!(findings));
    Ok(contents)
}

fn say(contents: &Contents, is_json: bool) -> Result<(), Failure> {
    if is_json { output::say_json(&contents.to_json()) } else { output::say(&contents.text()) }
}

fn of_model(path: &Path, opened: &OpenedModel, findings: &[Finding]) -> Result<Contents, Failure> {
    let mut contents = Contents::of_model(path, opened)?;
    if opened.scene.light.is_none() {
        contents.remark("light", "; add one with --env if needed");
    }
    if path.is_file() {
        contents.add_findings(lint::assumed_axes(path), findings);
    }
    Ok(contents)
}
