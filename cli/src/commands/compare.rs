//! `specula compare`: a table of runs, as papers print them.

use crate::{
    args::{Compare, TableFormat},
    failure::Failure,
    output,
    scene::models_in,
};
use specula_io::model_folder;
use specula_report::comparison::{Comparison, Format, Measurement, Missing};
use specula_scene::text::shown;
use std::io::{IsTerminal, stdout};

/// Reads the files of every run, and prints or writes the table.
pub(crate) fn run(args: &Compare) -> Result<(), Failure> {
    let format = format_of(args)?;
    for run in args.runs.iter().filter(|run| !model_folder::holds_training(run)) {
        let models = models_in(run);
        if !models.is_empty() {
            let models = models.iter().map(|model| shown(model)).collect::<Vec<_>>().join(" ");
            return Err(Failure::Input(format!("{run:?} is not a model, but contains some: specula compare {models}")));
        }
    }
    let comparison = Comparison::read(&args.runs)?;
    if !comparison.is_measured() {
        let first = shown(&args.runs[0]);
        return Err(Failure::Input(format!(
            "no run was measured; run specula eval {first}, and the same for the others"
        )));
    }
    let warnings = warnings(&comparison);
    let text = comparison.to_text(format, &warnings);
    // A table on the terminal has its warnings below it.
    let is_on_terminal = args.output.is_none() && stdout().is_terminal();
    let is_shown = |warning: &String| is_on_terminal && text.contains(warning.as_str());
    let untold = warnings.iter().filter(|warning| !is_shown(warning)).cloned();
    comparison.missing().iter().map(advice).chain(untold).for_each(|note| tracing::info!("{note}"));

    match &args.output {
        Some(path) => output::write_text(path, &text),
        None => output::say(text.trim_end()),
    }
}

/// Sentence about a missing measure, with the command that computes it.
fn advice(missing: &Missing) -> String {
    let option = match missing.measurement {
        Measurement::Standard => "",
        Measurement::Lpips => " --lpips FILE.onnx",
        Measurement::FittedExposure => " --exposure",
    };
    let folder = shown(&missing.folder);
    format!("{folder} has no {}; run specula eval {folder}{option}", missing.measure)
}

/// Sentences about runs measured at another iteration, on training views, or not comparable.
fn warnings(comparison: &Comparison) -> Vec<String> {
    let unmeasured = comparison.unmeasured().map(|(folder, iteration)| {
        let folder = shown(folder);
        format!("{folder} has iteration {iteration}, which was not measured; run specula eval {folder}")
    });
    let seen = comparison.without_held_out_views().map(|folder| {
        format!(
            "{} was trained without --eval, on all views of its data set; its metrics are on training views",
            shown(folder)
        )
    });
    unmeasured.chain(seen).chain(comparison.differences()).collect()
}

/// Format that was requested, or that of the file's extension.
fn format_of(args: &Compare) -> Result<Format, Failure> {
    match (args.format, &args.output) {
        (Some(TableFormat::Markdown), _) | (None, None) => Ok(Format::Markdown),
        (Some(TableFormat::Csv), _) => Ok(Format::Csv),
        (Some(TableFormat::Latex), _) => Ok(Format::Latex),
        (None, Some(path)) => match output::ending(path).as_deref() {
            Some("md" | "markdown") => Ok(Format::Markdown),
            Some("csv") => Ok(Format::Csv),
            Some("tex") => Ok(Format::Latex),
            _ => Err(Failure::Input(format!("{path:?} has no known extension; use .md, .csv or .tex"))),
        },
    }
}
