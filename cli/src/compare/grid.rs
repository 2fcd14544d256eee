//! Tables of runs, with the best of each column, and what speaks against reading them as such.

use super::run::{GIVEN, Run};
use crate::{
    fit::thousands,
    quality::{FITTED, LPIPS, MAE, MEASURES, Measure},
};
use std::collections::BTreeSet;

/// Where cameras of one view may be apart, as a share of their distance from the origin.
const SAME_PLACE: f32 = 1e-3;

/// A column of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Quantity {
    /// One of [`MEASURES`].
    Measure(usize),
    /// PSNR under other lights, as it is or with the best factors.
    Relit {
        is_scaled: bool,
    },
    /// Condition of a training; a column where runs of one scene had different ones.
    Given(usize),
    Gaussians,
    Seconds,
    Size,
}

impl Quantity {
    /// All of them, as tables order them.
    pub(super) const ALL: [Self; 14] = [
        Self::Measure(0),
        Self::Measure(1),
        Self::Measure(2),
        Self::Measure(3),
        Self::Measure(4),
        Self::Measure(5),
        Self::Relit { is_scaled: false },
        Self::Relit { is_scaled: true },
        Self::Given(0),
        Self::Given(1),
        Self::Given(2),
        Self::Gaussians,
        Self::Seconds,
        Self::Size,
    ];

    fn of(self, run: &Run) -> Option<f64> {
        match self {
            Self::Measure(index) => run.measured[index],
            Self::Relit { is_scaled } => run.relit[usize::from(is_scaled)],
            Self::Given(index) => run.given[index],
            Self::Gaussians => run.gaussians,
            Self::Seconds => run.seconds,
            Self::Size => run.size,
        }
    }

    /// How it is measured, where some values of it are better than others.
    fn measure(self) -> Option<Measure> {
        match self {
            Self::Measure(index) => Some(MEASURES[index]),
            Self::Relit { is_scaled: false } => Some(Measure { words: "relit PSNR", ..MEASURES[0] }),
            Self::Relit { is_scaled: true } => Some(Measure { words: "relit PSNR, scaled", ..MEASURES[0] }),
            Self::Given(_) | Self::Gaussians | Self::Seconds | Self::Size => None,
        }
    }

    /// Whether a table shows it.
    fn is_shown(self, runs: &[Run]) -> bool {
        let is_known = runs.iter().any(|run| self.of(run).is_some());
        let is_unequal = || runs.iter().any(|run| self.differs(first_of(&run.scene, runs), run));
        is_known && (!matches!(self, Self::Given(_)) || is_unequal())
    }

    /// Whether two runs say of it, and not the same.
    fn differs(self, one: Option<&Run>, other: &Run) -> bool {
        matches!([one.and_then(|one| self.of(one)), self.of(other)], [Some(a), Some(b)] if a != b)
    }

    fn head(self) -> Head {
        let (words, unit) = match self {
            Self::Given(index) => (GIVEN[index].words, ""),
            Self::Gaussians => ("Gaussians", ""),
            Self::Seconds => ("training", "s"),
            Self::Size => ("size", "MB"),
            Self::Measure(_) | Self::Relit { .. } => {
                self.measure().map_or(("", ""), |own| (own.words, own.unit.trim()))
            }
        };
        Head { words: words.into(), unit, more_is_better: self.measure().map(|measure| measure.more_is_better) }
    }

    fn text(self, value: f64) -> String {
        match self.measure() {
            Some(measure) => measure.number(value),
            None if self == Self::Size => format!("{value:.1}"),
            None => thousands(value.round() as usize),
        }
    }

    /// What to do about runs that lack it although it can be had: one sentence for each.
    pub(super) fn lacks(self, runs: &[Run]) -> Vec<String> {
        let Some(measure) = self.measure() else { return Vec::new() };
        // Where normals and other lights are not known, they cannot be measured.
        let is_of_scene = matches!(self, Self::Measure(MAE) | Self::Relit { .. });
        let can_be_had = |run: &Run| {
            let other = |other: &&Run| !is_of_scene || other.scene == run.scene;
            runs.iter().filter(other).any(|other| self.of(other).is_some())
        };
        let can_have = |run: &Run| match self {
            Self::Relit { is_scaled } => run.is_shaded && !is_scaled,
            _ => true,
        };
        let lacking = runs.iter().filter(|run| self.of(run).is_none() && can_have(run) && can_be_had(run));
        let option = match self {
            Self::Measure(LPIPS) => " --lpips FILE.onnx",
            Self::Measure(FITTED) => " --exposure",
            _ => "",
        };
        let sentence = |run: &Run| {
            let folder = run.folder.display();
            format!("{folder} has no {}; run specula eval {folder}{option}", measure.words)
        };
        lacking.map(sentence).collect()
    }
}

/// What stands above a column.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Head {
    pub(super) words: String,
    pub(super) unit: &'static str,
    /// None where neither is.
    pub(super) more_is_better: Option<bool>,
}

impl Head {
    fn of_words(words: &str) -> Self {
        Self { words: words.into(), unit: "", more_is_better: None }
    }
}

/// A number of a table.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cell {
    pub(super) value: f64,
    pub(super) text: String,
    pub(super) is_best: bool,
}

/// A table, or a part of one.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Block {
    /// What it shows of several scenes; none where a column says so.
    pub(super) title: Option<Head>,
    /// The first stands above the names of the rows.
    pub(super) heads: Vec<Head>,
    pub(super) rows: Vec<(String, Vec<Option<Cell>>)>,
}

/// A table of all quantities of a scene; or for each quantity one of all scenes.
pub(super) fn blocks(runs: &[Run], labels: &[String]) -> Vec<Block> {
    let scenes = first_of_each(runs.iter().map(|run| run.scene.as_str()));
    let known = || Quantity::ALL.into_iter().filter(|quantity| quantity.is_shown(runs));
    match scenes.as_slice() {
        [scene] => vec![of_scene(scene, &known().collect::<Vec<_>>(), runs, labels)],
        scenes => known().map(|quantity| of_quantity(quantity, scenes, runs, labels)).collect(),
    }
}

fn of_scene(scene: &str, quantities: &[Quantity], runs: &[Run], labels: &[String]) -> Block {
    let is_doubtful = !doubts(runs).is_empty();
    let cell = |quantity: &Quantity, run: &Run| {
        let value = quantity.of(run)?;
        Some(Cell { value, text: quantity.text(value), is_best: false })
    };
    let row = |run: &Run| quantities.iter().map(|quantity| cell(quantity, run)).collect();
    let mut rows: Vec<(String, Vec<_>)> = labels.iter().cloned().zip(runs.iter().map(row)).collect();
    for (column, quantity) in quantities.iter().enumerate().filter(|_| !is_doubtful) {
        mark_best(&mut rows, column, *quantity);
    }
    let heads = quantities.iter().map(|quantity| quantity.head());
    Block { title: None, heads: core::iter::once(Head::of_words(scene)).chain(heads).collect(), rows }
}

fn of_quantity(quantity: Quantity, scenes: &[&str], runs: &[Run], labels: &[String]) -> Block {
    let cell = |value: f64| Cell { value, text: quantity.text(value), is_best: false };
    let of = |label: &str, scene: &str| {
        let mut own = runs.iter().zip(labels).filter(|(run, own)| run.scene == scene && *own == label);
        own.next().and_then(|(run, _)| quantity.of(run))
    };
    let row = |label: &str| {
        let values: Vec<Option<f64>> = scenes.iter().map(|scene| of(label, scene)).collect();
        let whole: Option<Vec<f64>> = values.iter().copied().collect();
        let mean = whole.map(|values| values.iter().sum::<f64>() / values.len() as f64);
        let cells = values.into_iter().chain([mean]).map(|value| value.map(cell)).collect();
        (label.to_owned(), cells)
    };
    let mut rows: Vec<_> = first_of_each(labels.iter().map(String::as_str)).into_iter().map(row).collect();
    let is_doubtful = |scene: &str| !doubts_of(scene, runs).is_empty();
    for (column, _) in scenes.iter().enumerate().filter(|(_, scene)| !is_doubtful(scene)) {
        mark_best(&mut rows, column, quantity);
    }
    if !scenes.iter().any(|scene| is_doubtful(scene)) {
        mark_best(&mut rows, scenes.len(), quantity);
    }
    let heads = ["method"].iter().chain(scenes).chain(&["mean"]).map(|words| Head::of_words(words)).collect();
    Block { title: Some(quantity.head()), heads, rows }
}

/// Each once, in the order in which they come.
fn first_of_each<'a>(all: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut seen = BTreeSet::new();
    all.filter(|one| seen.insert(*one)).collect()
}

/// Marks the best of a column, and all that are written alike, where there are several.
fn mark_best(rows: &mut [(String, Vec<Option<Cell>>)], column: usize, quantity: Quantity) {
    let Some(measure) = quantity.measure() else { return };
    let cells = || rows.iter().filter_map(|(_, cells)| cells[column].as_ref());
    let best = cells().max_by(|one, other| measure.goodness(one.value).total_cmp(&measure.goodness(other.value)));
    let Some(best) = best.filter(|_| cells().count() > 1).map(|cell| cell.text.clone()) else { return };
    for cell in rows.iter_mut().filter_map(|(_, cells)| cells[column].as_mut()) {
        cell.is_best = cell.text == best;
    }
}

/// The first run of a scene.
fn first_of<'a>(scene: &str, runs: &'a [Run]) -> Option<&'a Run> {
    runs.iter().find(|run| run.scene == scene)
}

/// In what two trainings are unequal, in words for each.
fn training_differences(one: &Run, other: &Run) -> Vec<[String; 2]> {
    let unequal = GIVEN.iter().enumerate().filter(|(index, _)| Quantity::Given(*index).differs(Some(one), other));
    let given = unequal.map(|(index, given)| {
        [one, other].map(|run| run.given[index].map_or_else(String::new, |number| (given.sentence)(number as usize)))
    });
    let sources = [one, other].map(|run| run.source.clone());
    let is_other_source = sources.iter().all(|source| !source.is_empty()) && sources[0] != sources[1];
    given.chain(is_other_source.then(|| sources.map(|source| format!("on {source}")))).collect()
}

/// Why runs of one scene are not comparable: one sentence for each that differs from the first.
pub(super) fn doubts(runs: &[Run]) -> Vec<String> {
    let scenes = first_of_each(runs.iter().map(|run| run.scene.as_str()));
    let unmeasured = runs.iter().filter_map(|run| {
        let (folder, newest) = (run.folder.display(), run.unmeasured?);
        Some(format!("{folder} holds iteration {newest}, which was not measured; specula eval {folder} does"))
    });
    unmeasured.chain(scenes.into_iter().flat_map(|scene| doubts_of(scene, runs))).collect()
}

fn doubts_of(scene: &str, runs: &[Run]) -> Vec<String> {
    let mut own = runs.iter().filter(|run| run.scene == scene && run.measured.iter().any(Option::is_some));
    let Some(first) = own.next() else { return Vec::new() };
    let sentences = |run: &Run| {
        let folders = [first, run].map(|run| run.folder.display());
        let sentence = |verb: &str, [one, other]: [String; 2]| {
            format!("not comparable: {} was {verb} {one}, and {} {other}", folders[0], folders[1])
        };
        let trained = training_differences(first, run).into_iter().map(|words| sentence("trained", words));
        let measured = difference(first, run).map(|words| sentence("measured", words));
        trained.chain(measured).collect::<Vec<String>>()
    };
    own.flat_map(sentences).collect()
}

/// The first thing that two runs were measured by otherwise.
fn difference(one: &Run, other: &Run) -> Option<[String; 2]> {
    let both = [one, other];
    let say = |words: fn(&Run) -> String| Some(both.map(words));
    if both.iter().all(|run| !run.views.is_empty()) {
        if one.views.len() != other.views.len() {
            return say(|run| format!("on {} views", run.views.len()));
        }
        let pairs = || one.views.iter().zip(&other.views);
        let size = |(_, camera): &specula_io::cameras::NamedCamera| [camera.width, camera.height];
        if let Some((one, other)) = pairs().find(|(one, other)| size(one) != size(other)) {
            return Some([one, other].map(|view| format!("on views of {} × {} pixels", size(view)[0], size(view)[1])));
        }
        if let Some((one, other)) = pairs().find(|((one, _), (other, _))| one != other) {
            return Some([one, other].map(|(name, _)| format!("on {name:?}")));
        }
        let are_apart = |one: glam::Vec3, other: glam::Vec3| one.distance(other) > SAME_PLACE * one.length().max(1e-6);
        if let Some((one, other)) = pairs().find(|(one, other)| are_apart(one.1.position, other.1.position)) {
            return Some([one, other].map(|(name, camera)| format!("on {name:?} from {}", camera.position)));
        }
    }
    match [one.background, other.background] {
        [Some(a), Some(b)] if a != b => return Some([a, b].map(|[r, g, b]| format!("over {r},{g},{b}"))),
        _ => {}
    }
    match [&one.network, &other.network] {
        [Some(a), Some(b)] if a != b => Some([a, b].map(|network| format!("with LPIPS of {network}"))),
        _ => None,
    }
}
