//! Labels of runs in a table: the profile, and the settings in which runs differ.

use crate::comparison::run::Run;
use specula_scene::text::shown;
use std::collections::{BTreeMap, BTreeSet};

/// Settings of paths and of the execution, which do not change the result.
const NOT_SHOWN: [&str; 6] =
    ["source-path", "executor", "checkpoint-every", "save-iterations", "test-iterations", "profile"];

/// Setting that only selects a sample of one result.
const SEED: &str = "seed";

/// Label of each run: equal for runs with equal settings in several scenes. Within a scene, runs
/// with one label differ only in their seed.
pub(super) fn labels(runs: &[Run]) -> Vec<String> {
    let profiles: Vec<String> = runs.iter().map(|run| run.profile.clone()).collect();
    let mut differing = differing(runs);
    let with_seeds: Vec<String> = runs.iter().map(|run| profile_and_settings(run, &differing)).collect();
    differing.retain(|key| key != SEED);
    let with_settings: Vec<String> = runs.iter().map(|run| profile_and_settings(run, &differing)).collect();
    let folders = runs.iter().map(|run| shown(&run.folder)).collect();
    let all = [profiles, with_settings, with_seeds];
    all.into_iter().find(|labels| are_distinct(runs, labels)).unwrap_or(folders)
}

/// Whether runs of a scene with one label differ only in their seed.
fn are_distinct(runs: &[Run], labels: &[String]) -> bool {
    let labelled: Vec<(&Run, &String)> = runs.iter().zip(labels).collect();
    labelled.iter().enumerate().all(|(index, (run, label))| {
        let mut before = labelled[..index].iter().filter(|(other, same)| run.scene == other.scene && label == same);
        before.all(|(other, _)| is_other_sample(run, other))
    })
}

/// True if two runs of a scene differ only in their seed, among settings that shape a result.
fn is_other_sample(one: &Run, other: &Run) -> bool {
    let settings = |run: &Run| {
        let shaping = run.settings.iter().filter(|(key, _)| !NOT_SHOWN.contains(&key.as_str()) && *key != SEED);
        shaping.map(|(key, value)| (key.clone(), value.clone())).collect::<Vec<_>>()
    };
    let [Some(seed), Some(other_seed)] = [one, other].map(|run| run.settings.get(SEED)) else { return false };
    seed != other_seed && one.profile == other.profile && settings(one) == settings(other)
}

/// Settings in which runs of one scene and profile differ.
fn differing(runs: &[Run]) -> Vec<String> {
    let mut groups: BTreeMap<(&str, &str), Vec<&Run>> = BTreeMap::new();
    for run in runs {
        groups.entry((&run.scene, &run.profile)).or_default().push(run);
    }
    let differ = |key: &str| {
        let in_group = |group: &Vec<&Run>| group.iter().any(|run| run.settings.get(key) != group[0].settings.get(key));
        groups.values().any(in_group)
    };
    let keys: BTreeSet<&String> = runs.iter().flat_map(|run| run.settings.keys()).collect();
    keys.into_iter().filter(|key| !NOT_SHOWN.contains(&key.as_str()) && differ(key)).cloned().collect()
}

/// Profile followed by these settings as options.
fn profile_and_settings(run: &Run, keys: &[String]) -> String {
    let setting = |key: &String| match run.settings.get(key)? {
        toml::Value::Boolean(is_on) => is_on.then(|| key.clone()),
        toml::Value::String(text) => Some(format!("{key} {text}")),
        other => Some(format!("{key} {other}")),
    };
    let settings: Vec<String> = keys.iter().filter_map(setting).collect();
    if settings.is_empty() { run.profile.clone() } else { format!("{}, {}", run.profile, settings.join(", ")) }
}
