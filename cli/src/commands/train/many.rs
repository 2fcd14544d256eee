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

/// Outcome of a training that did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    /// It ran to its end.
    Trained,
    /// Its folder held it already.
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

/// Trains each task of a manifest. A training that fails does not end the others.
///
/// # Errors
/// The failure of an only training; [`Failure::Interrupted`]; otherwise [`Failure::Input`] with the
/// folders of all that failed.
pub(crate) fn run(manifest: &Manifest, ranks: &Ranks<'_>) -> Result<(), Failure> {
    let Manifest { count, tasks, .. } = manifest;
    if ranks.size > 1 && tasks.len() > 1 {
        return Err(Failure::Input(format!("ranks share one training at a time; select one of {count} with --task")));
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

/// Starts a training, continues it from its checkpoint, or keeps what is finished.
fn train(task: &Task, ranks: &Ranks<'_>) -> Result<Outcome, Failure> {
    let args = &super::with_resolution(&task.train)?;
    args.executor.check()?;
    if args.resuming.overwrite {
        return super::run(args, ranks).map(|()| Outcome::Trained);
    }
    let folder = &args.model_path;
    if let Some(difference) = config::difference_from(folder, args)?.filter(|_| model_folder::holds_training(folder)) {
        return Err(Failure::Input(format!(
            "{folder:?} holds a training with {difference}; replace it (--overwrite), or name another model-path"
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

/// Refuses a finished model of another data set, which is still where it was trained from.
fn refuse_other_data(args: &Train) -> Result<(), Failure> {
    let Some(info) = model_folder::read_info(&args.model_path)? else { return Ok(()) };
    let trained_on = Path::new(&info.source_path).canonicalize();
    let asked_for = args.source().and_then(|source| source.canonicalize().ok());
    match (trained_on, asked_for) {
        (Ok(then), Some(now)) if then != now => Err(Failure::Input(format!(
            "{:?} holds a model of another data set, {then:?}; replace it (--overwrite), or name another model-path",
            args.model_path
        ))),
        _ => Ok(()),
    }
}

/// Whether the folder of a training holds its last iteration, measured if that was asked for.
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
