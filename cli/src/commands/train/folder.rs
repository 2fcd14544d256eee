//! Model folder of a training: its lock, an earlier training in it, and the checkpoint to resume
//! from.

use crate::{
    args::{LightReference, Start, Train},
    config,
    failure::Failure,
    settings,
};
use specula_core::state::TrainingState;
use specula_io::{self as io, checkpoint::Facts, model_folder};
use specula_scene::training::{self, Lock};
use specula_train::{
    profile::{KnownLight, Profile},
    trainer::Settings,
};
use std::path::Path;

/// Locks the model folder, in which no link may point elsewhere.
pub(super) fn lock(args: &Train) -> Result<Lock, Failure> {
    const REMEDY: &str = "wait until it ends, use another folder with -m, or add --ignore-lock if it crashed";
    let folder = &args.model_path;
    // Checked at the start, not after hours of training.
    model_folder::refuse_links_in(folder)?;
    match args.resuming.ignore_lock {
        true => Ok(Lock::take_or_warn(folder)?),
        false => Lock::take(folder).map_err(|error| Failure::locked(error, REMEDY)),
    }
}

/// Rejects a folder that contains another training.
pub(super) fn refuse_other_training(args: &Train) -> Result<(), Failure> {
    let folder = &args.model_path;
    if args.resuming.resume || args.resuming.overwrite || !model_folder::holds_training(folder) {
        return Ok(());
    }
    let remedy = match io::checkpoint::path_in(folder).is_file() {
        true => "continue it (--resume), replace it (--overwrite), or use another folder with -m",
        false => "replace it (--overwrite), or use another folder with -m",
    };
    Err(Failure::Input(format!("{folder:?} already contains {}; {remedy}", description_of(folder)?)))
}

/// Description of the training in a folder.
fn description_of(folder: &Path) -> Result<String, Failure> {
    let profile = model_folder::read_info(folder)?.map(|info| format!(" with profile {}", info.profile));
    let iteration = model_folder::latest_iteration(folder).map(|iteration| format!(" of {iteration} iterations"));
    Ok(match (iteration, profile) {
        (Ok(iteration), profile) => format!("a model{iteration}{}", profile.unwrap_or_default()),
        (Err(_), _) => "an interrupted training".to_owned(),
    })
}

/// Checkpoint that a training resumes from.
#[derive(Debug)]
pub(super) struct Resumed {
    pub(super) state: TrainingState<Vec<f32>>,
    pub(super) seconds: f64,
}

/// Reads the checkpoint in the model folder; rejects one with other settings or with pictures other
/// than those of the data set `source`.
pub(super) fn read_checkpoint(
    args: &Train,
    source: &Path,
    settings: &Settings,
    is_object: bool,
    facts: &Facts,
) -> Result<Resumed, Failure> {
    let saved = io::checkpoint::read(&args.model_path)?;
    let earlier = &saved.facts;
    let refuse = |reason: String| {
        let path = io::checkpoint::path_in(&args.model_path);
        Err(Failure::Input(format!(
            "cannot resume from {path:?}, which {reason}, or start again with --overwrite instead of --resume"
        )))
    };
    if let Some(difference) = config::contradiction(&facts.config, &earlier.config) {
        return refuse(format!("was trained with {difference}; keep the option as it was"));
    }
    if (facts.views, &facts.pictures) != (earlier.views, &earlier.pictures) {
        return refuse(format!(
            "was trained on {} pictures, and the {} in {source:?} differ from them; use the original data set",
            earlier.views, facts.views
        ));
    }
    if saved.state.iteration > args.iterations {
        return refuse(format!(
            "is at iteration {}, beyond --iterations {}; increase --iterations",
            saved.state.iteration, args.iterations
        ));
    }
    let settings_of = |args: &Train| -> Result<String, Failure> {
        let mut profile = Profile {
            foreground: settings.profile.foreground,
            ..settings::profile_of(args, earlier.iterations, is_object)?
        };
        if let Some(KnownLight(radiance)) = &settings.profile.known_light {
            profile = profile.under(radiance.to_vec());
        }
        if let Some(mean) = settings.profile.light_mean {
            profile = profile.with_light_mean(mean);
        }
        if settings.profile.is_of_materials() {
            profile = profile.under_several_lights();
        }
        Ok(training::settings_text(&Settings { profile, iterations: earlier.iterations, ..settings.clone() }))
    };
    if settings_of(args)? != earlier.settings {
        let start = Start { no_materials: true, ..args.start.clone() };
        let has_none = settings.profile.physical.is_some() && !args.start.relightable;
        if has_none && settings_of(&Train { start, ..args.clone() })? == earlier.settings {
            return refuse("was trained without materials; add --no-materials".to_owned());
        }
        if let Some(LightReference::Map(light)) = &args.start.light_reference {
            return refuse(format!(
                "was trained under a light other than {light:?}, or by specula {}, whose training differs; use the \
                 original file",
                earlier.program
            ));
        }
        return refuse(format!(
            "was trained by specula {}, whose training differs; continue with that version",
            earlier.program
        ));
    }
    Ok(Resumed { seconds: earlier.seconds, state: saved.state })
}
