//! Gaussians of any file but glTF, by its contents and extension.

use crate::{
    Input,
    error::Result,
    gaussian_ply::{self, GaussianFile},
    latlong::{ending, start_of},
    splat, spz,
};
use std::path::Path;

/// Format of a file of Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Ply,
    Splat,
    Spz,
}

/// Format of a file: PLY, unless the start or the extension is that of another.
pub(crate) fn format_of(path: &Path) -> Result<Format> {
    let start = start_of(Input::file(path))?;
    Ok(match ending(path).as_deref() {
        _ if start.starts_with(b"ply") => Format::Ply,
        _ if start.starts_with(b"NGSP") => Format::Spz,
        Some("spz") => Format::Spz,
        Some("splat") => Format::Splat,
        _ => Format::Ply,
    })
}

/// Reads Gaussians from a PLY, `.spz` or `.splat` file.
pub(crate) fn read(path: &Path) -> Result<GaussianFile> {
    match format_of(path)? {
        Format::Ply => gaussian_ply::read(path),
        Format::Splat => splat::read(path),
        Format::Spz => spz::read(path),
    }
}
