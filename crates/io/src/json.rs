//! JSON files, with errors that name the file, the line and the column.

use crate::{
    budget::Budget,
    error::{Error, Result},
    whole_file,
};
use serde::{Serialize, de::DeserializeOwned};
use std::path::Path;

/// Reads a value from a file within a budget. A byte order mark is skipped.
pub(crate) fn read<T: DeserializeOwned>(path: &Path, budget: &Budget) -> Result<T> {
    let bytes = budget.read(path)?;
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    serde_json::from_slice(bytes).map_err(Error::json(path))
}

/// Tests for the default of a number, which need not be written.
pub(crate) fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// Writes a value to a file as indented JSON.
pub(crate) fn write(path: &Path, value: &impl Serialize) -> Result<()> {
    let mut text = serde_json::to_vec_pretty(value).map_err(Error::json(path))?;
    text.push(b'\n');
    whole_file::write_bytes(path, &text)
}
