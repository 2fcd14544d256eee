//! Reasons why runs of one scene are not comparable.

use crate::comparison::{
    quantity::Quantity,
    run::{CONDITIONS, Run},
};
use glam::Vec3;
use specula_io::cameras::NamedCamera;
use specula_scene::text::shown;

/// Largest distance between cameras of equal views, relative to their distance from the origin.
const POSITION_TOLERANCE: f32 = 1e-3;

/// Sentences about runs of a scene that differ from its first measured run in training or
/// measurement.
pub(super) fn differences_in(scene: &str, runs: &[Run]) -> Vec<String> {
    let mut runs = runs.iter().filter(|run| run.scene == scene && run.measured.iter().any(Option::is_some));
    let Some(first) = runs.next() else { return Vec::new() };
    let sentences = |run: &Run| {
        let folders = [first, run].map(|run| shown(&run.folder));
        let sentence = |verb: &str, [one, other]: [String; 2]| {
            format!("not comparable: {} was {verb} {one}, but {} {other}", folders[0], folders[1])
        };
        let trained = training_differences(first, run).into_iter().map(|phrases| sentence("trained", phrases));
        let measured = measurement_difference(first, run).map(|phrases| sentence("measured", phrases));
        trained.chain(measured).collect::<Vec<String>>()
    };
    runs.flat_map(sentences).collect()
}

/// Differences of two trainings, as a phrase for each.
fn training_differences(one: &Run, other: &Run) -> Vec<[String; 2]> {
    let unequal = CONDITIONS.iter().enumerate().filter(|(index, _)| Quantity::Condition(*index).differs(one, other));
    let conditions = unequal.map(|(index, condition)| {
        [one, other]
            .map(|run| run.conditions[index].map_or_else(String::new, |number| (condition.phrase)(number as usize)))
    });
    let sources = [one, other].map(|run| run.source.clone());
    let is_other_source = sources.iter().all(|source| !source.is_empty()) && sources[0] != sources[1];
    conditions.chain(is_other_source.then(|| sources.map(|source| format!("on {source}")))).collect()
}

/// First difference of two measurements, as a phrase for each.
fn measurement_difference(one: &Run, other: &Run) -> Option<[String; 2]> {
    if [one, other].iter().all(|run| !run.views.is_empty()) {
        if one.views.len() != other.views.len() {
            return Some([one, other].map(|run| format!("on {} views", run.views.len())));
        }
        if let Some(difference) = view_difference(&one.views, &other.views) {
            return Some(difference);
        }
    }
    match [one.background, other.background] {
        [Some(a), Some(b)] if a != b => return Some([a, b].map(|[r, g, b]| format!("over {r},{g},{b}"))),
        _ => {}
    }
    match [&one.lpips_network, &other.lpips_network] {
        [Some(a), Some(b)] if a != b => Some([a, b].map(|network| format!("with LPIPS of {network}"))),
        _ => None,
    }
}

/// First difference between two lists of views in size, name or position.
fn view_difference(one: &[NamedCamera], other: &[NamedCamera]) -> Option<[String; 2]> {
    let pairs = || one.iter().zip(other);
    let size = |(_, camera): &NamedCamera| [camera.width, camera.height];
    if let Some((one, other)) = pairs().find(|(one, other)| size(one) != size(other)) {
        return Some([one, other].map(|view| format!("on views of {} × {} pixels", size(view)[0], size(view)[1])));
    }
    if let Some((one, other)) = pairs().find(|((one, _), (other, _))| one != other) {
        return Some([one, other].map(|(name, _)| format!("on {name:?}")));
    }
    let are_apart = |one: Vec3, other: Vec3| one.distance(other) > POSITION_TOLERANCE * one.length().max(1e-6);
    let (one, other) = pairs().find(|(one, other)| are_apart(one.1.position, other.1.position))?;
    Some([one, other].map(|(name, camera)| format!("on {name:?} from {}", camera.position)))
}
