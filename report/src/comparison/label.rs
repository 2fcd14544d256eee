//! Labels of runs in a table: the profile, and the settings in which runs differ.

use crate::comparison::run::Run;
use specula_scene::text::shown;
use std::collections::{BTreeMap, BTreeSet};

/// Settings of paths and of the execution, which do not change the result.
const NOT_SHOWN: [&str; 6] =
    ["source-path", "executor", "checkpoint-every", "save-iterations", "test-iterations", "profile"];

/// Label of each run: equal for runs with equal settings in several scenes, distinct within a
/// scene.
pub(super) fn labels(runs: &[Run]) -> Vec<String> {
    let profiles: Vec<String> = runs.iter().map(|run| run.profile.clone()).collect();
    let differing = differing(runs);
    let with_settings: Vec<String> = runs.iter().map(|run| profile_and_settings(run, &differing)).collect();
    let folders = runs.iter().map(|run| shown(&run.folder)).collect();
    [profiles, with_settings].into_iter().find(|labels| are_distinct(runs, labels)).unwrap_or(folders)
}

/// Whether no label occurs twice in a scene.
fn are_distinct(runs: &[Run], labels: &[String]) -> bool {
    let mut used = BTreeSet::new();
    runs.iter().zip(labels).all(|(run, label)| used.insert((&run.scene, label)))
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

/// Profile followed by these settings as they are typed.
fn profile_and_settings(run: &Run, keys: &[String]) -> String {
    let setting = |key: &String| match run.settings.get(key)? {
        toml::Value::Boolean(is_on) => is_on.then(|| key.clone()),
        toml::Value::String(text) => Some(format!("{key} {text}")),
        other => Some(format!("{key} {other}")),
    };
    let settings: Vec<String> = keys.iter().filter_map(setting).collect();
    if settings.is_empty() { run.profile.clone() } else { format!("{}, {}", run.profile, settings.join(", ")) }
}
