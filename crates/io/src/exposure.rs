//! Exposures of the training photographs: `exposure.json` in the folder of a model.
//!
//! ```text
//! {"IMG_1": [[a, a, a, b], [a, a, a, b], [a, a, a, b]], ...}
//! ```
//!
//! Names are those of `cameras.json`; of views that share a name, the second is called `NAME (2)`,
//! and so on. A photograph shows C' = A C + b for a colour C of the scene, sRGB-encoded in \[0,
//! 1\], where A is the left 3 × 3 part of the matrix and b its last column. The mean over all
//! photographs is the identity.

use crate::{budget::LIST, error::Result, json, within};
use specula_core::expose::Exposure;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// Exposures by the names of photographs.
pub type Exposures = BTreeMap<String, Exposure<f32>>;

/// Path of the exposures of a model.
pub fn path_in(folder: &Path) -> PathBuf {
    folder.join("exposure.json")
}

/// Writes the exposures of photographs.
///
/// # Errors
///
/// [`crate::Error::Write`] if the file cannot be written.
pub fn write(folder: &Path, names: &[String], exposures: &[Exposure<f32>]) -> Result<()> {
    let mut all = Exposures::new();
    for (name, exposure) in names.iter().zip(exposures) {
        all.insert(free_name(&all, name), *exposure);
    }
    json::write(&path_in(folder), &all)
}

/// First free variant of a name.
fn free_name(taken: &Exposures, name: &str) -> String {
    let others = (2_usize..).map(|number| format!("{name} ({number})"));
    let mut names = core::iter::once(name.to_owned()).chain(others);
    names.find(|name| !taken.contains_key(name)).expect("there are more numbers than names")
}

/// Reads the exposures of a model; `None` if its training did not learn exposures.
///
/// # Errors
///
/// [`crate::Error::Read`], [`crate::Error::Json`] or [`crate::Error::TooLarge`].
pub fn read(folder: &Path) -> Result<Option<Exposures>> {
    let path = path_in(folder);
    if within::holds(&path)? { json::read(&path, &LIST).map(Some) } else { Ok(None) }
}

/// Removes the exposures of an earlier training, if there are any.
///
/// # Errors
///
/// [`crate::Error::Write`] if the file cannot be removed.
pub fn remove(folder: &Path) -> Result<()> {
    within::remove_file(&path_in(folder))
}
