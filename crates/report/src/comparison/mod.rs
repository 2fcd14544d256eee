//! Tables that compare trained runs, as papers print them.

mod comparability;
mod format;
mod label;
mod quantity;
mod run;
mod table;

pub use format::Format;
pub use quantity::Measurement;

use crate::error::Result;
use quantity::Quantity;
use run::Run;
use std::path::{Path, PathBuf};

/// Runs side by side.
#[derive(Debug)]
pub struct Comparison {
    runs: Vec<Run>,
}

/// Missing measure of a run that could be computed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing {
    /// Folder of the run.
    pub folder: PathBuf,
    /// Label of the measure.
    pub measure: &'static str,
    /// Kind of measurement that computes it.
    pub measurement: Measurement,
}

impl Comparison {
    /// Reads the folders of models.
    ///
    /// # Errors
    ///
    /// A folder without a model, or a file that cannot be parsed.
    pub fn read(folders: &[impl AsRef<Path>]) -> Result<Self> {
        Ok(Self { runs: folders.iter().map(|folder| Run::read(folder.as_ref())).collect::<Result<_>>()? })
    }

    /// Whether any run has a measure.
    pub fn is_measured(&self) -> bool {
        self.runs.iter().any(|run| run.measured.iter().any(Option::is_some))
    }

    /// Measures that some runs lack, by measure.
    pub fn missing(&self) -> Vec<Missing> {
        let missing_of = |quantity: Quantity| {
            let lacking = self.runs.iter().filter(move |run| quantity.is_missing(run, &self.runs));
            lacking.map(move |run| Missing {
                folder: run.folder.clone(),
                measure: quantity.label().0,
                measurement: quantity.measurement(),
            })
        };
        Quantity::all().flat_map(missing_of).collect()
    }

    /// Runs whose newest iteration was not measured, with that iteration.
    pub fn unmeasured(&self) -> impl Iterator<Item = (&Path, u32)> {
        self.runs.iter().filter_map(|run| Some((run.folder.as_path(), run.unmeasured?)))
    }

    /// Measured runs without test views.
    pub fn without_held_out_views(&self) -> impl Iterator<Item = &Path> {
        self.runs.iter().filter(|run| run.held_nothing_out).map(|run| run.folder.as_path())
    }

    /// Reasons why runs of one scene are not comparable.
    pub fn differences(&self) -> Vec<String> {
        let scenes = table::scenes(&self.runs).into_iter();
        scenes.flat_map(|scene| comparability::differences_in(scene, &self.runs)).collect()
    }

    /// Table as text, with these warnings if the format supports them. Nothing is marked as best if
    /// runs are not comparable.
    pub fn to_text(&self, format: Format, warnings: &[String]) -> String {
        // Programs read CSV.
        let are_all_wanted = matches!(format, Format::Csv);
        format::text(format, &table::tables(&self.runs, &label::labels(&self.runs), are_all_wanted), warnings)
    }
}
