//! Settings of a training as a file: each line of `config.toml` is an option of `specula train`.
//!
//! `config.toml` is a command line: its lines become options that precede those of the shell and
//! pass through the same parser, so options are described once and errors have the same wording. A
//! preset is another layer beneath both.

use crate::{
    args::{Arguments, Command, LightReference, Preset, Train},
    failure::Failure,
    output,
};
use clap::{Arg, CommandFactory, Parser, parser::ValueSource};
use core::any::TypeId;
use specula_io::{Error, budget::FACTS, checkpoint, within};
use std::{
    ffi::OsString,
    path::{Path, PathBuf},
};
use toml::{Table, Value};

/// Options that may change when a training is resumed. Data sets are compared by their pictures,
/// not by these options.
const CHANGEABLE: [&str; 10] = [
    "iterations",
    "executor",
    "checkpoint-every",
    "save-iterations",
    "test-iterations",
    "max-error",
    "source-path",
    "images",
    "test-every",
    "scene-up",
];
/// Options that name the sources of settings, and are not settings themselves.
const NOT_IN_FILES: [&str; 8] = ["config", "ignore_lock", "list", "manifest", "overwrite", "preset", "resume", "task"];
/// Options that select the settings file, which conflict with no setting.
const SELECTION: [&str; 3] = ["list", "manifest", "task"];
/// Options that open a port or control access to it; valid only on the command line.
const NETWORK_OPTIONS: [&str; 4] = ["view", "view-until", "listen", "token"];
/// Name of the file in a model folder.
const NAME: &str = "config.toml";

/// Arguments of the command line `words`, completed from a settings file and a preset, if they name
/// any. The command line takes
/// precedence over the file, and the file over the preset.
///
/// # Errors
/// A file that cannot be read, or that contains an invalid option.
pub(crate) fn completed(arguments: Arguments, words: &[OsString]) -> Result<Arguments, Failure> {
    let Command::Train(train) = &arguments.command else { return Ok(arguments) };
    let folder = &train.model_path;
    if train.resuming.resume && !checkpoint::path_in(folder).is_file() {
        if !folder.is_dir() {
            return Err(Failure::Input(format!("there is no folder {folder:?} with a training to resume; check -m")));
        }
        if !train.resuming.ignore_lock {
            // Another training may not have written one yet.
            output::lock(folder)?;
        }
        return Err(Error::NoCheckpoint { path: folder.clone() }.into());
    }
    let saved = train.resuming.resume.then(|| folder.join(NAME));
    let path = train.resuming.config.clone().or(saved);
    if path.is_none() && train.resuming.preset.is_none() {
        return Ok(arguments);
    }
    over(path.as_deref(), train.resuming.preset, words)
}

/// Arguments of a command line, with the settings of a file beneath it and of a preset beneath
/// both.
fn over(path: Option<&Path>, preset: Option<Preset>, words: &[OsString]) -> Result<Arguments, Failure> {
    let table = path.map_or(Ok(Table::new()), read)?;
    let place = path.map(|path| format!("{path:?}"));
    parsed(&composed(&table, place.as_deref(), preset, words)?, place.as_deref())
}

/// Arguments of a command line with settings from a place.
///
/// # Errors
/// The error that clap reports, with the place.
pub(crate) fn parsed(words: &[OsString], place: Option<&str>) -> Result<Arguments, Failure> {
    Arguments::try_parse_from(words).map_err(|error| wrong(place, &crate::failure::sentence_of(&error)))
}

/// Error of settings, with a description of their place.
pub(crate) fn wrong(place: Option<&str>, cause: &str) -> Failure {
    Failure::Input(place.map_or_else(|| cause.to_owned(), |place| format!("cannot understand {place}: {cause}")))
}

/// Command line with the settings of a table and those of a preset beneath its options. `place`
/// names the table in errors.
///
/// # Errors
/// A setting that is not an option, or not valid in a file.
pub(crate) fn composed(
    table: &Table,
    place: Option<&str>,
    preset: Option<Preset>,
    words: &[OsString],
) -> Result<Vec<OsString>, Failure> {
    let wrong = |cause: &str| wrong(place, cause);
    let command = Arguments::command();
    let matches = command.clone().try_get_matches_from(words)?;
    let given = matches.subcommand_matches("train").expect("only trainings have a settings file");
    let mut train = command.find_subcommand("train").expect("it is there").clone();
    train.build();
    let is_given = |arg: &&Arg| matches!(given.value_source(arg.get_id().as_str()), Some(ValueSource::CommandLine));
    let selects = |arg: &&Arg| SELECTION.contains(&arg.get_id().as_str());
    let mut above: Vec<&Arg> = train.get_arguments().filter(|arg| is_given(arg) && !selects(arg)).collect();
    let is_overridden = |arg: &Arg, above: &[&Arg]| {
        let excludes = |one: &Arg, other: &Arg| train.get_arg_conflicts_with(one).contains(&other);
        above.iter().any(|other| *other == arg || excludes(arg, other) || excludes(other, arg))
    };
    let named = |key: &str| train.get_arguments().find(|arg| arg.get_long() == Some(key));

    let mut beneath = Vec::new();
    let mut in_file = Vec::new();
    for (key, value) in table {
        if NETWORK_OPTIONS.contains(&key.as_str()) {
            return Err(wrong(&format!(
                "{key:?} controls access to the page and is valid only on the command line; remove it and use --view"
            )));
        }
        let arg = named(key).filter(|arg| !NOT_IN_FILES.contains(&arg.get_id().as_str()));
        let arg = arg.ok_or_else(|| wrong(&format!("{key:?} is not a setting of specula train")))?;
        let word =
            word(key, value).ok_or_else(|| wrong(&format!("{key:?} has a value that is not valid for an option")))?;
        if let Some(word) = word.filter(|_| !is_overridden(arg, &above)) {
            beneath.push(OsString::from(word));
            in_file.push(arg);
        }
    }
    above.extend(in_file);
    for (key, value) in preset.map_or(&[][..], Preset::settings) {
        if !is_overridden(named(key).expect("presets are of options"), &above) {
            beneath.push(format!("--{key}={value}").into());
        }
    }
    let end = 1 + words.iter().position(|word| word == "train").expect("a training is asked for");
    Ok([&words[..end], &beneath, &words[end..]].concat())
}

/// Reads the settings in a file.
///
/// # Errors
/// A file that cannot be read, or is not TOML.
pub(crate) fn read(path: &Path) -> Result<Table, Failure> {
    let not_text = |_| Failure::Input(format!("cannot understand {path:?}: it is not UTF-8"));
    let text = String::from_utf8(FACTS.read(path)?).map_err(not_text)?;
    text.parse().map_err(|error: toml::de::Error| {
        Failure::Input(format!("cannot understand {path:?}: {}", first_line(&error, &text)))
    })
}

/// Error of the TOML parser, with its line.
fn first_line(error: &toml::de::Error, text: &str) -> String {
    let line = error.span().map_or(1, |span| 1 + text[..span.start.min(text.len())].matches('\n').count());
    format!("line {line}: {}", error.message())
}

/// Setting as a word of the command line; `Some(None)` for values equal to a missing option, `None`
/// for values that no option can have.
fn word(key: &str, value: &Value) -> Option<Option<String>> {
    let joined = |values: &[Value]| values.iter().map(plain).collect::<Option<Vec<String>>>().map(|all| all.join(","));
    Some(match value {
        Value::Boolean(is_on) => is_on.then(|| format!("--{key}")),
        Value::Array(values) if values.is_empty() => None,
        Value::Array(values) => Some(format!("--{key}={}", joined(values)?)),
        other => Some(format!("--{key}={}", plain(other)?)),
    })
}

fn plain(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Integer(number) => Some(number.to_string()),
        Value::Float(number) => Some(number.to_string()),
        _ => None,
    }
}

/// Text of `config.toml` for a training, with absolute paths.
///
/// # Errors
/// Settings that TOML cannot represent.
pub(crate) fn text_of(args: &Train) -> Result<String, Failure> {
    let unfit = |error: &dyn core::fmt::Display| Failure::Input(format!("cannot write the settings: {error}"));
    let mut table = Table::new();
    if let Some(source) = args.source() {
        table.insert("source-path".into(), output::absolute(source).into());
    }
    let settings = Table::try_from(args).map_err(|error| unfit(&error))?;
    table.extend(settings.into_iter().map(|(key, value)| (key, short(&value))));
    place_files(&mut table, Path::new(""));
    toml::to_string(&table).map_err(|error| unfit(&error))
}

/// Resolves the paths among settings against a folder, so that the working folder does not matter.
pub(crate) fn place_files(table: &mut Table, folder: &Path) {
    let command = Arguments::command();
    let train = command.find_subcommand("train").expect("it is there");
    for arg in train.get_arguments() {
        if let Some(Value::String(text)) = arg.get_long().and_then(|key| table.get_mut(key))
            && names_file(arg, text)
        {
            *text = output::absolute(&folder.join(&*text));
        }
    }
}

/// Whether the value of an option is a path.
fn names_file(arg: &Arg, text: &str) -> bool {
    let kind = arg.get_value_parser().type_id();
    let is_light = || matches!(text.parse(), Ok(LightReference::Map(_)));
    kind == TypeId::of::<PathBuf>() || kind == TypeId::of::<LightReference>() && is_light()
}

/// First setting in which a training differs from the one in a model folder, as the end of a
/// sentence; `None` without a difference, or if the folder records no settings.
///
/// # Errors
/// A `config.toml` that cannot be read, or settings that TOML cannot represent.
pub(crate) fn difference_from(folder: &Path, args: &Train) -> Result<Option<String>, Failure> {
    let path = folder.join(NAME);
    if !within::holds(&path)? {
        return Ok(None);
    }
    Ok(first_difference(&table_of(&text_of(args)?), &read(&path)?))
}

/// Writes `config.toml` to a model folder.
///
/// # Errors
/// [`Failure::File`] if it cannot be written.
pub(crate) fn save(folder: &Path, text: &str) -> Result<(), Failure> {
    output::write_text(&folder.join(NAME), text)
}

/// First setting that differs between two files and is not in [`CHANGEABLE`], as the end of a
/// sentence.
pub(crate) fn contradiction(now: &str, then: &str) -> Option<String> {
    let mut tables = [now, then].map(table_of);
    // Light files may move, like data sets: a training compares the light itself.
    let names_light = |table: &Table| {
        let light = table.get("light-reference").and_then(Value::as_str).map(str::parse);
        matches!(light, Some(Ok(LightReference::Map(_))))
    };
    if tables.iter().all(names_light) {
        tables.iter_mut().for_each(|table| drop(table.remove("light-reference")));
    }
    // A training compares the materials themselves, which earlier versions omitted by default.
    tables.iter_mut().for_each(|table| drop(table.remove("no-materials")));
    first_difference(&tables[0], &tables[1])
}

/// Value with numbers rounded to the digits of an `f32`, like those of options.
fn short(value: &Value) -> Value {
    match value {
        Value::Float(number) if f64::from(*number as f32) == *number => {
            Value::Float((*number as f32).to_string().parse().unwrap_or(*number))
        }
        Value::Array(values) => Value::Array(values.iter().map(short).collect()),
        other => other.clone(),
    }
}

fn table_of(text: &str) -> Table {
    text.parse().unwrap_or_default()
}

fn first_difference(now: &Table, then: &Table) -> Option<String> {
    let said = |table: &Table, key: &str| match table.get(key) {
        Some(value) => format!("--{key} {}", plain(&short(value)).unwrap_or_else(|| value.to_string())),
        None => format!("no --{key}"),
    };
    let mut keys = now.keys().chain(then.keys()).filter(|key| !CHANGEABLE.contains(&key.as_str()));
    let key = keys.find(|key| now.get(*key).map(short) != then.get(*key).map(short))?;
    Some(format!("{}, not {}", said(then, key), said(now, key)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::AT_MOST_1100;
    use clap::ValueEnum;
    use core::str::FromStr;
    use specula_scene::backdrop::BackgroundColor;
    use std::fs;

    fn words(line: &str) -> Vec<OsString> {
        line.split(' ').map(OsString::from).collect()
    }

    fn train_of(arguments: Arguments) -> Train {
        match arguments.command {
            Command::Train(train) => *train,
            other => panic!("{other:?} is not a training"),
        }
    }

    fn config(text: &str) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().expect("a writable folder");
        let path = folder.path().join(NAME);
        fs::write(&path, text).expect("a writable folder");
        (folder, path)
    }

    #[test]
    fn settings_round_trip_through_their_file_and_the_command_line_overrides_them() {
        let line = "specula train data -m out --profile paper --densify-grad-threshold 1.9e-4 --no-sparse -w \
                    --save-iterations 10,20 --random-points 7 --executor gpu:llvmpipe --eval --lambda-normal 0.1 \
                    --view --token abcd1234";
        let one = train_of(Arguments::parse_from(words(line)));
        let text = text_of(&one).expect("paths are UTF-8");
        assert!(!text.contains("view") && !text.contains("abcd1234"), "options of the page are not recorded: {text}");
        let (_folder, path) = config(&text);

        let again = train_of(
            over(Some(&path), None, &words("specula --quiet train -m other --config x")).expect("it was written"),
        );
        assert_eq!(text_of(&again).expect("paths are UTF-8"), text);
        let changed = "specula train drums -m other --config x --save-iterations 5 --points p.ply --profile 3dgs \
                       --background black";
        let changed = train_of(over(Some(&path), None, &words(changed)).expect("it was written"));
        assert_eq!((changed.save_iterations.as_slice(), changed.start.random_points), (&[5][..], None));
        assert_eq!((changed.white_background, changed.dataset), (false, Some("drums".into())));
        assert_eq!(changed.losses.lambda_normal, Some(0.1), "other options come from the file");
    }

    /// Every option of a training whose value is a path, as its help says.
    #[test]
    fn paths_begin_at_a_folder_and_are_kept_whole() {
        const NAMES: [&str; 6] = ["FILE", "DATASET", "MODEL", "FOLDER", "PATH", "DIR"];
        let command = Arguments::command();
        let train = command.find_subcommand("train").expect("it is there");
        let takes_path = |arg: &&Arg| {
            let names = arg.get_value_names().unwrap_or_default();
            let mut words = names.iter().flat_map(|name| name.split(|letter: char| !letter.is_ascii_alphabetic()));
            // Pictures lie within the data set.
            words.any(|word| NAMES.contains(&word)) && arg.get_long() != Some("images")
        };
        let paths: Vec<&str> = train.get_arguments().filter(takes_path).filter_map(Arg::get_long).collect();
        for path in ["source-path", "model-path", "points", "light-reference", "config", "manifest"] {
            assert!(paths.contains(&path), "{path} is not among {paths:?}");
        }
        for arg in train.get_arguments().filter(|arg| arg.get_long().is_some()) {
            assert_eq!(names_file(arg, "a/b.c"), takes_path(&arg), "{arg:?}");
        }
        let table = paths.iter().map(|path| ((*path).to_owned(), Value::String("a/../b.c".into())));
        let mut table: Table = table.chain([("images".to_owned(), "a".into())]).collect();
        place_files(&mut table, Path::new("/scenes"));
        assert!(paths.iter().all(|path| table[*path].as_str() == Some("/scenes/a/../b.c")), "{table}");
        assert_eq!(table["images"].as_str(), Some("a"), "it is within the data set");
        let mean = |text: &str| {
            let mut table = Table::from_iter([("light-reference".to_owned(), Value::String(text.into()))]);
            place_files(&mut table, Path::new("/scenes"));
            table["light-reference"].as_str().map(str::to_owned)
        };
        assert_eq!([mean("0.8,1,1"), mean("./0.8")], ["0.8,1,1", "/scenes/0.8"].map(|text| Some(text.to_owned())));
    }

    #[test]
    fn a_light_file_may_move_but_not_change_its_kind() {
        let of = |light: &str| format!("light-reference = \"{light}\"\n");
        assert_eq!(contradiction(&of("/new/probe.hdr"), &of("probe.hdr")), None);
        let other = contradiction(&of("/new/probe.hdr"), &of("0.8")).expect("one is a mean");
        assert!(other.contains("--light-reference 0.8, not"), "{other}");
        assert!(contradiction("", &of("probe.hdr")).is_some());
    }

    #[test]
    fn an_invalid_file_is_rejected_with_its_place() {
        for (text, word) in [
            ("iterations = 7\nprofile = ", "line 2"),
            ("lambda-norm = 1", "lambda-norm"),
            ("iterations = 0", "0"),
            ("profile = \"best\"", "best"),
            ("seed = {}", "seed"),
            ("[losses]\nlambda-normal = 1", "losses"),
            ("preset = \"photos\"", "preset"),
            ("view = \"0.0.0.0:7008\"", "use --view"),
            ("token = \"abcd1234\"", "use --view"),
            ("listen = \"0.0.0.0:7008\"", "use --view"),
        ] {
            let (_folder, path) = config(text);
            let refused = over(Some(&path), None, &words("specula train data -m out --config x")).map(train_of);
            let sentence = refused.expect_err("it is wrong").to_string();
            assert!(sentence.contains(NAME) && sentence.contains(word), "{sentence}");
        }
    }

    #[test]
    fn the_command_line_overrides_a_file_and_a_file_overrides_a_preset() {
        let of = |text: &str, line: &str| {
            let (_folder, path) = config(text);
            train_of(over(Some(&path), Some(Preset::Photos), &words(line)).expect("all are valid"))
        };
        let shape = |train: &Train| (train.resolution, train.iterations, train.start.background_points);
        let bare = of("", "specula train data -m out --preset photos");
        assert_eq!((shape(&bare), bare.background), ((AT_MOST_1100, 7000, 5000), Some(BackgroundColor::BLACK)));
        let file = "resolution = 2\niterations = 100\nwhite-background = false";
        let one = of(file, "specula train data -m out --preset photos -r 8 --config x");
        assert_eq!((shape(&one), one.background), ((8, 100, 5000), Some(BackgroundColor::BLACK)));
        let other = of("white-background = true", "specula train data -m out --preset photos --iterations 9");
        assert_eq!((shape(&other), other.background, other.white_background), ((AT_MOST_1100, 9, 5000), None, true));
        let third = of("", "specula train data -m out --preset photos -w --random-points 5");
        assert_eq!((third.background, third.white_background, third.start.random_points), (None, true, Some(5)));
    }

    #[test]
    fn every_preset_is_valid_and_described_in_the_help() {
        let command = Arguments::command();
        let train = command.find_subcommand("train").expect("it is there");
        let help = train.clone().render_help().to_string();
        let (_, help) = help.split_once("Presets:").expect("the help lists them");
        for preset in Preset::value_variants() {
            let train = train_of(over(None, Some(*preset), &words("specula train data -m out")).expect("it is valid"));
            let text = text_of(&train).expect("paths are UTF-8");
            let table: Table = text.parse().expect("it is a table");
            for (key, value) in preset.settings() {
                let background = BackgroundColor::from_str(value).map(|background| background.to_string());
                let said = table.get(*key).and_then(plain).expect("config.toml says what it came to");
                assert!(said == *value || background == Ok(said.clone()), "{preset:?}: {key} is {said}");
            }
            let name = preset.to_possible_value().expect("none is hidden").get_name().to_owned();
            let iterations = train.iterations.to_string();
            let (_, words) = help.split_once(&name).expect("the help names it");
            let (words, _) = words.split_once(" iterations").expect("the help says how many");
            assert!(words.ends_with(&iterations), "the help says {words:?} of {name}, which takes {iterations}");
        }
    }

    #[test]
    fn only_what_shapes_a_model_contradicts() {
        assert_eq!(contradiction("iterations = 9\nseed = 1", "iterations = 7\nseed = 1\nexecutor = \"cpu\""), None);
        let other = contradiction("profile = \"paper\"", "profile = \"specula\"");
        assert_eq!(other.as_deref(), Some("--profile specula, not --profile paper"));
        let added = contradiction("lambda-normal = 0.5", "");
        assert_eq!(added.as_deref(), Some("no --lambda-normal, not --lambda-normal 0.5"));
        assert_eq!(contradiction("normal-from = 0.1", "normal-from = 0.10000000149011612"), None, "one f32");
        let long = contradiction("normal-from = 0.2", "normal-from = 0.10000000149011612");
        assert_eq!(long.as_deref(), Some("--normal-from 0.1, not --normal-from 0.2"));
    }
}
