//! Many trainings in one file: `specula train --manifest FILE`.
//!
//! The options at the top of the file apply to all trainings; each `[[training]]` adds its own.
//! Like `config.toml`, they become options beneath those of the command line ([`crate::config`]).

use crate::{
    args::{Arguments, Command, Preset, Train},
    config,
    failure::Failure,
};
use clap::ValueEnum;
use std::{collections::HashSet, ffi::OsString, path::Path};
use toml::{Table, Value};

/// Name of the tables of trainings.
const TRAINING: &str = "training";
/// Setting that is not valid above the trainings.
const PRESET: &str = "preset";
/// Options that select trainings and take a value.
const SELECTION: [&str; 2] = ["--manifest", "--task"];
/// Options without a value that select trainings.
const FLAGS: [&str; 1] = ["--list"];

/// A training of a manifest.
#[derive(Debug)]
pub(crate) struct Task {
    /// Number in the manifest, from 1.
    pub(crate) number: usize,
    /// Command line of this training, without the program's name.
    pub(crate) words: Vec<String>,
    /// Arguments of the training.
    pub(crate) train: Train,
}

/// Trainings of a manifest.
#[derive(Debug)]
pub(crate) struct Manifest {
    /// True if the trainings are only listed.
    pub(crate) is_listed: bool,
    /// Number of trainings in the file.
    pub(crate) count: usize,
    /// All of them, or the one of `--task`.
    pub(crate) tasks: Vec<Task>,
}

/// Trainings of the manifest that the arguments name, if they name one. `words` is the command
/// line. All trainings of the file are valid if any is returned.
///
/// # Errors
/// A file that cannot be read, an invalid option in it, a training without a data set or its own
/// model folder, or a `--task` out of range.
pub(crate) fn of(arguments: &Arguments, words: &[OsString]) -> Result<Option<Manifest>, Failure> {
    let Command::Train(train) = &arguments.command else { return Ok(None) };
    let Some(path) = &train.many.manifest else {
        // clap does not require an option that conflicts with a given one, such as the model
        // folder.
        if train.many.task.is_some() || train.many.list {
            return Err(Failure::Input("--task and --list need a --manifest; add one, or omit them".into()));
        }
        return Ok(None);
    };
    let tables = trainings(path)?;
    let count = tables.len();
    let mut tasks = Vec::with_capacity(count);
    let mut folders = HashSet::new();
    for (number, table) in (1..).zip(tables) {
        let place = format!("{path:?}, training {number}");
        let task = task(number, table, &place, train.resuming.preset, words)?;
        if !folders.insert(task.train.model_path.clone()) {
            let cause = format!("another training has the same model folder, {:?}", task.train.model_path);
            return Err(config::wrong(Some(&place), &cause));
        }
        tasks.push(task);
    }
    if let Some(number) = train.many.task {
        tasks.retain(|task| task.number == number);
        if tasks.is_empty() {
            return Err(Failure::Input(format!("{path:?} has trainings 1 to {count}, and --task is {number}")));
        }
    }
    Ok(Some(Manifest { is_listed: train.many.list, count, tasks }))
}

/// Settings of each training of a file, including the common ones, with absolute paths.
fn trainings(path: &Path) -> Result<Vec<Table>, Failure> {
    let wrong = |cause: &str| config::wrong(Some(&format!("{path:?}")), cause);
    let mut shared = config::read(path)?;
    let own = match shared.remove(TRAINING) {
        Some(Value::Array(tables)) => tables,
        _ => Vec::new(),
    };
    if own.is_empty() {
        return Err(wrong("it has no [[training]]"));
    }
    let folder = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let folder = folder.parent().unwrap_or(Path::new("")).to_owned();
    let whole = |own: Value| {
        let Value::Table(own) = own else { return Err(wrong("a training is a table, [[training]]")) };
        let mut table = shared.clone();
        table.extend(own);
        config::place_files(&mut table, &folder);
        Ok(table)
    };
    own.into_iter().map(whole).collect()
}

/// Training with the settings of a table beneath the options of a command line. `place` names the
/// table in errors.
fn task(
    number: usize,
    mut table: Table,
    place: &str,
    preset: Option<Preset>,
    words: &[OsString],
) -> Result<Task, Failure> {
    let wrong = |cause: &str| config::wrong(Some(place), cause);
    for key in ["source-path", "model-path"] {
        if !table.contains_key(key) {
            return Err(wrong(&format!("{key:?} is missing")));
        }
    }
    let preset = match (preset, table.remove(PRESET)) {
        (Some(preset), _) => Some(preset),
        (None, Some(Value::String(name))) => {
            Some(Preset::from_str(&name, false).map_err(|_| wrong(&format!("{name:?} is not a preset")))?)
        }
        (None, Some(_)) => return Err(wrong("a preset is a name")),
        (None, None) => None,
    };
    let words = without_selection(config::composed(&table, Some(place), preset, words)?);
    let Command::Train(train) = config::parsed(&words, Some(place))?.command else {
        unreachable!("train has the option --manifest")
    };
    let words = words.iter().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    Ok(Task { number, words, train: *train })
}

/// Command line without the options that select trainings.
fn without_selection(words: Vec<OsString>) -> Vec<OsString> {
    let mut kept = Vec::with_capacity(words.len());
    let mut words = words.into_iter();
    while let Some(word) = words.next() {
        let text = word.to_string_lossy();
        if SELECTION.contains(&&*text) {
            words.next();
            continue;
        }
        let is_assigned =
            SELECTION.iter().any(|name| text.strip_prefix(name).is_some_and(|rest| rest.starts_with('=')));
        if !is_assigned && !FLAGS.contains(&&*text) {
            kept.push(word);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::AT_MOST_1100;
    use crate::args::{self, LightReference};
    use clap::Parser;
    use std::{fs, path::PathBuf};

    const TWO: &str = "iterations = 700\neval = true\n\
                       [[training]]\nsource-path = \"data/a\"\nmodel-path = \"out/a\"\n\
                       [[training]]\nsource-path = \"data/b\"\nmodel-path = \"/b\"\nseed = 3\niterations = 9\n\
                       light-reference = \"probe.hdr\"\n";

    fn manifest(text: &str, line: &str) -> (PathBuf, Result<Option<Manifest>, Failure>) {
        let folder = tempfile::tempdir().expect("a writable folder");
        let path = folder.path().join("scenes.toml");
        fs::write(&path, text).expect("a writable folder");
        let line = line.replace("FILE", path.to_str().expect("UTF-8"));
        let words = args::words_of(line.split(' ').map(OsString::from));
        let arguments = Arguments::try_parse_from(&words).expect("a valid command line");
        (folder.path().to_owned(), of(&arguments, &words))
    }

    fn sentence(text: &str, line: &str) -> String {
        manifest(text, line).1.expect_err("it is wrong").to_string()
    }

    #[test]
    fn trainings_have_common_options_their_own_and_those_of_the_command_line() {
        let (folder, found) = manifest(TWO, "specula train --manifest=FILE --seed 5");
        let Manifest { count, tasks, .. } = found.expect("it is valid").expect("there is one");
        assert_eq!(count, 2);
        let facts = |task: &Task| (task.number, task.train.iterations, task.train.seed, task.train.eval);
        assert_eq!(tasks.iter().map(facts).collect::<Vec<_>>(), [(1, 700, 5, true), (2, 9, 5, true)]);
        assert_eq!(tasks[0].train.source(), Some(&*folder.join("data/a")), "paths begin at the manifest");
        let folders: Vec<&Path> = tasks.iter().map(|task| &*task.train.model_path).collect();
        assert_eq!(folders, [&*folder.join("out/a"), Path::new("/b")]);
        assert_eq!(tasks[1].train.start.light_reference, Some(LightReference::Map(folder.join("probe.hdr"))));
        assert!(tasks[0].train.many.manifest.is_none() && tasks[0].words[0] == "train", "{:?}", tasks[0].words);
        assert!(tasks[1].words.contains(&"--model-path=/b".to_owned()), "{:?}", tasks[1].words);
    }

    #[test]
    fn a_task_is_one_of_them() {
        let (_, found) = manifest(TWO, "specula train --manifest FILE --task 2");
        let Manifest { count, tasks, .. } = found.expect("it is valid").expect("there is one");
        assert_eq!((count, tasks.len(), tasks[0].number, tasks[0].train.seed), (2, 1, 2, 3));
        let missing = sentence(TWO, "specula train --manifest FILE --task 3");
        assert!(missing.contains("trainings 1 to 2") && missing.ends_with("--task is 3"), "{missing}");
        let alone = sentence(TWO, "specula train data -m out --task 2");
        assert!(alone.contains("need a --manifest"), "{alone}");
        let (_, found) = manifest(TWO, "specula train data -m out");
        assert!(found.expect("it is valid").is_none(), "without a manifest there are no tasks");
    }

    #[test]
    fn presets_are_for_all_or_for_one() {
        let text = format!("{TWO}preset = \"photos\"\n");
        let of = |line: &str| manifest(&text, line).1.expect("it is valid").expect("there is one").tasks;
        let factors = |tasks: &[Task]| tasks.iter().map(|task| task.train.resolution).collect::<Vec<_>>();
        assert_eq!(factors(&of("specula train --manifest FILE")), [1, AT_MOST_1100]);
        assert_eq!(factors(&of("specula train --manifest FILE --preset photos")), [AT_MOST_1100; 2]);
        assert_eq!(factors(&of("specula train --manifest FILE -r 2")), [2, 2]);
    }

    #[test]
    fn invalid_manifests_fail_before_the_first_training_with_their_place() {
        for (text, words) in [
            ("iterations = 7", "no [[training]]"),
            ("training = 7", "no [[training]]"),
            ("training = [7]", "a training is a table"),
            ("[[training]]\nmodel-path = \"a\"", "training 1: \"source-path\" is missing"),
            ("[[training]]\nsource-path = \"a\"", "training 1: \"model-path\" is missing"),
            ("[[training]]\nsource-path = \"a\"\nmodel-path = 7\nlr = 3", "\"lr\" is not a setting"),
            ("[[training]]\nsource-path = \"a\"\nmodel-path = \"b\"\npreset = \"best\"", "\"best\" is not a preset"),
            ("[[training]]\nsource-path = \"a\"\nmodel-path = \"b\"\nview = true", "use --view"),
            ("[[training]]\nsource-path = \"a\"\nmodel-path = \"b\"\nmanifest = \"c\"", "is not a setting"),
            ("[[training]]\nsource-path = ", "line 2"),
        ] {
            let sentence = sentence(text, "specula train --manifest FILE");
            assert!(sentence.contains("scenes.toml") && sentence.contains(words), "{sentence}");
        }
        let second = TWO.replace("iterations = 9", "iterations = -9");
        let second = sentence(&second, "specula train --manifest FILE --task 1");
        assert!(second.contains("training 2") && second.contains("-9"), "{second}");
        let same = TWO.replace("\"/b\"", "\"out/a\"");
        let same = sentence(&same, "specula train --manifest FILE");
        assert!(same.contains("training 2: another training has the same model folder"), "{same}");
    }
}
