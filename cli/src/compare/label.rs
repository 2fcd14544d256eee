//! What runs are called in a table: their profile, and in what else they differ.

use super::run::Run;
use std::collections::{BTreeMap, BTreeSet};

/// Settings that say where something is or how it is computed, not what comes out.
const NOT_TOLD: [&str; 6] =
    ["source-path", "executor", "checkpoint-every", "save-iterations", "test-iterations", "profile"];

/// A name for each run, the same for the same kind of run in several scenes; different ones within a scene.
pub(super) fn labels(runs: &[Run]) -> Vec<String> {
    let profiles: Vec<String> = runs.iter().map(|run| run.profile.clone()).collect();
    let differing = differing(runs);
    let told: Vec<String> = runs.iter().map(|run| told(run, &differing)).collect();
    let folders = runs.iter().map(|run| run.folder.display().to_string()).collect();
    [profiles, told].into_iter().find(|labels| are_apart(runs, labels)).unwrap_or(folders)
}

/// Whether no scene has a label twice.
fn are_apart(runs: &[Run], labels: &[String]) -> bool {
    let mut seen = BTreeSet::new();
    runs.iter().zip(labels).all(|(run, label)| seen.insert((&run.scene, label)))
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
    keys.into_iter().filter(|key| !NOT_TOLD.contains(&key.as_str()) && differ(key)).cloned().collect()
}

/// The profile with these settings as they are typed.
fn told(run: &Run, keys: &[String]) -> String {
    let word = |key: &String| match run.settings.get(key)? {
        toml::Value::Boolean(is_on) => is_on.then(|| key.clone()),
        toml::Value::String(text) => Some(format!("{key} {text}")),
        other => Some(format!("{key} {other}")),
    };
    let words: Vec<String> = keys.iter().filter_map(word).collect();
    if words.is_empty() { run.profile.clone() } else { format!("{}, {}", run.profile, words.join(", ")) }
}
