//! JSON files, with errors that name the file, the line and the column.

use crate::{
    error::{Error, Result},
    whole_file,
};
use serde::{Serialize, de::DeserializeOwned};
use std::{fs, path::Path};

/// Reads a value from a file.
pub(crate) fn read<T: DeserializeOwned>(path: &Path) -> Result<T> {
    parse(path, &fs::read(path).map_err(Error::reading(path))?)
}

/// Reads a value from the bytes of a file; a byte order mark, which some editors write, is skipped.
pub(crate) fn parse<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    serde_json::from_slice(bytes).map_err(Error::json(path))
}

/// Writes a value to a file, for people to read as well.
pub(crate) fn write(path: &Path, value: &impl Serialize) -> Result<()> {
    let mut text = serde_json::to_vec_pretty(value).map_err(Error::json(path))?;
    text.push(b'\n');
    whole_file::write_bytes(path, &text)
}
