//! Tables of runs, with the best of each column.

use crate::comparison::{comparability::differences_in, quantity::Quantity, run::Run};
use std::collections::BTreeSet;

/// Head of a column.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Head {
    pub(super) label: String,
    pub(super) unit: &'static str,
    /// Direction of better values; `None` if there is none.
    pub(super) higher_is_better: Option<bool>,
}

impl Head {
    fn plain(label: &str) -> Self {
        Self { label: label.into(), unit: "", higher_is_better: None }
    }

    fn of(quantity: Quantity) -> Self {
        let (label, unit) = quantity.label();
        let higher_is_better = quantity.measure().map(|measure| measure.higher_is_better);
        Self { label: label.into(), unit, higher_is_better }
    }
}

/// Number of a table: that of a run, or the mean over runs that differ in their seed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cell {
    pub(super) value: f64,
    pub(super) text: String,
    /// Sample standard deviation over several seeds, and its text.
    pub(super) deviation: Option<(f64, String)>,
    pub(super) is_best: bool,
}

impl Cell {
    fn new(quantity: Quantity, value: f64) -> Self {
        Self { value, text: quantity.format(value), deviation: None, is_best: false }
    }

    /// Mean of runs and its deviation; none if a run lacks the quantity, or without runs.
    fn of_runs<'a>(quantity: Quantity, runs: impl Iterator<Item = &'a Run>) -> Option<Self> {
        let values: Vec<f64> = runs.map(|run| quantity.value(run)).collect::<Option<_>>()?;
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        let deviation = (values.len() > 1).then(|| (squares / (count - 1.0)).sqrt());
        let deviation = deviation.map(|deviation| (deviation, quantity.format(deviation)));
        (!values.is_empty()).then(|| Self { deviation, ..Self::new(quantity, mean) })
    }
}

/// Row of a table: its label, and a cell for each further column.
type Row = (String, Vec<Option<Cell>>);

/// Table, or a part of one.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Table {
    /// Quantity of a table of several scenes; `None` if each column has its own.
    pub(super) title: Option<Head>,
    /// Heads of the columns, starting with that of the labels.
    pub(super) heads: Vec<Head>,
    pub(super) rows: Vec<Row>,
}

/// Table of all quantities of one scene; or a table of all scenes for each quantity, and only for
/// those that compare runs unless all are wanted.
pub(super) fn tables(runs: &[Run], labels: &[String], are_all_wanted: bool) -> Vec<Table> {
    let scenes = scenes(runs);
    let shown = || Quantity::all().filter(|quantity| quantity.is_shown(runs));
    match scenes.as_slice() {
        [scene] => vec![table_of_scene(scene, &shown().collect::<Vec<_>>(), runs, labels)],
        scenes => {
            let wanted = shown().filter(|quantity| are_all_wanted || quantity.compares(runs));
            wanted.map(|quantity| table_of_quantity(quantity, scenes, runs, labels)).collect()
        }
    }
}

/// Scenes in the order of their first runs.
pub(super) fn scenes(runs: &[Run]) -> Vec<&str> {
    distinct(runs.iter().map(|run| run.scene.as_str()))
}

fn table_of_scene(scene: &str, quantities: &[Quantity], runs: &[Run], labels: &[String]) -> Table {
    let row = |label: &str| {
        let cells = quantities.iter().map(|quantity| Cell::of_runs(*quantity, labelled(scene, label, runs, labels)));
        (with_count(label, runs, labels), cells.collect())
    };
    let mut rows: Vec<Row> = distinct(labels.iter().map(String::as_str)).into_iter().map(row).collect();
    let is_of_new_views = |run: &Run| run.unmeasured.is_none() && !run.held_nothing_out;
    if is_comparable(scene, runs) && runs.iter().all(is_of_new_views) {
        quantities.iter().enumerate().for_each(|(column, quantity)| mark_best(&mut rows, column, *quantity));
    }
    let heads = core::iter::once(Head::plain(scene)).chain(quantities.iter().copied().map(Head::of)).collect();
    Table { title: None, heads, rows }
}

fn table_of_quantity(quantity: Quantity, scenes: &[&str], runs: &[Run], labels: &[String]) -> Table {
    let row = |label: &str| {
        let cells = scenes.iter().map(|scene| Cell::of_runs(quantity, labelled(scene, label, runs, labels)));
        let mut cells: Vec<Option<Cell>> = cells.collect();
        let complete: Option<Vec<f64>> = cells.iter().map(|cell| cell.as_ref().map(|cell| cell.value)).collect();
        let mean = complete.map(|values| values.iter().sum::<f64>() / values.len() as f64);
        cells.push(mean.map(|mean| Cell::new(quantity, mean)));
        (with_count(label, runs, labels), cells)
    };
    let mut rows: Vec<Row> = distinct(labels.iter().map(String::as_str)).into_iter().map(row).collect();
    for (column, _) in scenes.iter().enumerate().filter(|(_, scene)| is_comparable(scene, runs)) {
        mark_best(&mut rows, column, quantity);
    }
    if scenes.iter().all(|scene| is_comparable(scene, runs)) {
        mark_best(&mut rows, scenes.len(), quantity);
    }
    let heads = ["method"].iter().chain(scenes).chain(&["mean"]).map(|label| Head::plain(label)).collect();
    Table { title: Some(Head::of(quantity)), heads, rows }
}

/// Runs of a scene with a label.
fn labelled<'a>(
    scene: &'a str,
    label: &'a str,
    runs: &'a [Run],
    labels: &'a [String],
) -> impl Iterator<Item = &'a Run> {
    let matching = runs.iter().zip(labels).filter(move |(run, other)| run.scene == scene && *other == label);
    matching.map(|(run, _)| run)
}

/// Label with the number of seeds of each scene, if it is more than one.
fn with_count(label: &str, runs: &[Run], labels: &[String]) -> String {
    let count = |scene: &&str| labelled(scene, label, runs, labels).count();
    let counts: BTreeSet<usize> = scenes(runs).iter().map(count).filter(|count| *count > 0).collect();
    match (counts.first(), counts.last()) {
        (_, None | Some(1)) => label.to_owned(),
        (Some(least), Some(most)) if least < most => format!("{label} ({least} to {most} seeds)"),
        (_, Some(count)) => format!("{label} ({count} seeds)"),
    }
}

fn is_comparable(scene: &str, runs: &[Run]) -> bool {
    differences_in(scene, runs).is_empty()
}

/// Distinct elements in the order of their first occurrence.
fn distinct<'a>(all: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut known = BTreeSet::new();
    all.filter(|one| known.insert(*one)).collect()
}

/// Marks the best of several cells of a column, and those with equal text.
fn mark_best(rows: &mut [Row], column: usize, quantity: Quantity) {
    let Some(measure) = quantity.measure() else { return };
    let cells = || rows.iter().filter_map(|(_, cells)| cells[column].as_ref());
    let best = cells().max_by(|one, other| measure.goodness(one.value).total_cmp(&measure.goodness(other.value)));
    let Some(best) = best.filter(|_| cells().count() > 1).map(|cell| cell.text.clone()) else { return };
    for cell in rows.iter_mut().filter_map(|(_, cells)| cells[column].as_mut()) {
        cell.is_best = cell.text == best;
    }
}
