//! `specula train --manifest`: trainings one after another, or one of them.

use super::result::shell_word;
use crate::{
    args::{ResumeOptions, Train},
    config,
    failure::Failure,
    manifest::{Manifest, Task},
    output,
    ranks::Ranks,
};
use specula_io::{budget::FACTS, checkpoint, model_folder, within};
use specula_scene::text::printable;
use std::path::Path;

/// Outcome of a training without failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    /// The training ran to its end.
    Trained,
    /// The folder already contains the finished training.
    Kept,
}

/// Prints the commands of all trainings.
///
/// # Errors
/// Those of [`output::say`].
pub(crate) fn list(manifest: &Manifest) -> Result<(), Failure> {
    manifest.tasks.iter().try_for_each(|task| {
        let words: Vec<String> = task.words.iter().map(|word| shell_word(word)).collect();
        output::say(&printable(&format!("specula {}", words.join(" "))))
    })
}

/// Trains each task of a manifest, and goes on after failures.
///
/// # Errors
/// The failure of the training if there is only one; [`Failure::Interrupted`]; otherwise
/// [`Failure::Input`] with the folders of all failed trainings.
pub(crate) fn run(manifest: &Manifest, ranks: &Ranks<'_>) -> Result<(), Failure> {
    let Manifest { count, tasks, .. } = manifest;
    if ranks.size > 1 && tasks.len() > 1 {
        return Err(Failure::Input(format!(
            "several ranks can run only one training; select one of {count} with --task"
        )));
    }
    let (mut done, mut failed) = (Vec::new(), Vec::new());
    for task in tasks {
        let model = shell_word(&task.train.model_path.to_string_lossy());
        tracing::info!("[{}/{count}] {model}", task.number);
        match train(task, ranks) {
            Ok(Outcome::Kept) => {
                tracing::info!("finished before");
                done.push(model);
            }
            Ok(Outcome::Trained) => done.push(model),
            Err(failure @ (Failure::Interrupted(_) | Failure::BrokenPipe)) => return Err(failure),
            Err(failure) if tasks.len() == 1 => return Err(failure),
            Err(failure) => {
                tracing::error!("{failure}");
                failed.push(model);
            }
        }
    }
    if done.len() > 1 {
        tracing::info!("next: specula compare {}", done.join(" "));
    }
    match failed.len() {
        0 => Ok(()),
        count => Err(Failure::Input(format!("{count} of {} trainings failed: {}", tasks.len(), failed.join(", ")))),
    }
}

/// Starts a training, continues it from its checkpoint, or keeps it if it is finished.
fn train(task: &Task, ranks: &Ranks<'_>) -> Result<Outcome, Failure> {
    let args = &super::with_resolution(&task.train)?;
    args.executor.check()?;
    if args.resuming.overwrite {
        return super::run(args, ranks).map(|()| Outcome::Trained);
    }
    let folder = &args.model_path;
    if let Some(difference) = config::difference_from(folder, args)?.filter(|_| model_folder::holds_training(folder)) {
        return Err(Failure::Input(format!(
            "{folder:?} contains a training with {difference}; replace it (--overwrite), or set another model-path"
        )));
    }
    if is_finished(args)? {
        refuse_other_data(args)?;
        return Ok(Outcome::Kept);
    }
    let resume = checkpoint::path_in(folder).is_file();
    let resuming = ResumeOptions { resume, ..args.resuming.clone() };
    super::run(&Train { resuming, ..args.clone() }, ranks).map(|()| Outcome::Trained)
}

/// Rejects a finished model of another data set that still exists.
fn refuse_other_data(args: &Train) -> Result<(), Failure> {
    let Some(info) = model_folder::read_info(&args.model_path)? else { return Ok(()) };
    let trained_on = Path::new(&info.source_path).canonicalize();
    let asked_for = args.source().and_then(|source| source.canonicalize().ok());
    match (trained_on, asked_for) {
        (Ok(then), Some(now)) if then != now => Err(Failure::Input(format!(
            "{:?} contains a model of another data set, {then:?}; replace it (--overwrite), or set another model-path",
            args.model_path
        ))),
        _ => Ok(()),
    }
}

/// True if the folder contains the last iteration of its training, measured if requested.
fn is_finished(args: &Train) -> Result<bool, Failure> {
    let folder = &args.model_path;
    let is_trained = model_folder::latest_iteration(folder).is_ok_and(|iteration| iteration == args.iterations);
    Ok(is_trained && (!args.eval || is_measured(folder, args.iterations)?))
}

fn is_measured(folder: &Path, iteration: u32) -> Result<bool, Failure> {
    let path = folder.join("results.json");
    if !within::holds(&path)? {
        return Ok(false);
    }
    let results: serde_json::Value = serde_json::from_slice(&FACTS.read(&path)?).unwrap_or_default();
    Ok(results.get(model_folder::method_of(iteration)).is_some())
}
