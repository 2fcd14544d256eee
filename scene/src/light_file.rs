//! Environment maps from files of other programs.

use crate::SceneError;
use specula_io::latlong::{self, LatLong};
use std::path::Path;

/// Reads a lat-long map of linear radiance. Numbers that are no radiance are replaced. Returns the
/// map, and a warning for each property that a light rarely has.
///
/// # Errors
///
/// A file that cannot be read, or one with the faces of a cube.
pub fn read(path: &Path) -> Result<(LatLong, Vec<String>), SceneError> {
    let (map, replaced) = latlong::read(path)?;
    if map.height == 6 * map.width {
        return Err(SceneError::CubeMap(path.to_owned()));
    }
    let mut warnings = Vec::new();
    if replaced.total() > 0 {
        warnings.push(format!(
            "{} numbers in {path:?} are no radiance and were replaced: {} NaN, {} infinite, {} negative",
            replaced.total(),
            replaced.nan,
            replaced.infinite,
            replaced.negative
        ));
    }
    if !latlong::holds_radiance(path)? {
        warnings.push(format!(
            "{path:?} holds no radiance above 1, so no lamp or sun in it is brighter than white; .hdr and .exr do"
        ));
    }
    if map.width != 2 * map.height {
        warnings.push(format!(
            "{path:?} has {} × {} pixels, and is stretched to 2:1, as a lat-long map is; is it one?",
            map.width, map.height
        ));
    }
    Ok((map, warnings))
}
