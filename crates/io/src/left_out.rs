//! Unused files of a data set.

use crate::{
    light_table::LightTable,
    listing::Listing,
    named::{Files, is_picture, key_of},
    shot::Shot,
};
use std::{
    collections::{BTreeMap, HashSet},
    path::{Path, PathBuf},
};

/// Maximum number of entries in a note.
const ENTRIES_MAX: usize = 8;
/// Known files that are not part of a data set: notes, licences, projects of COLMAP, and inputs of
/// measurements.
const ASIDE: [&str; 10] = ["", "md", "txt", "log", "ini", "db", "sh", "py", "ipynb", "pdf"];
const MEASURED: [&str; 5] = ["env.hdr", "env.exr", "light", "relit", "relight"];
/// Record and intermediate files of `specula capture`.
const CAPTURE: [&str; 3] = ["capture", "capture.json", "training.lock"];

/// Unused entries of a data set, with the reason: pictures without cameras, and other folders and
/// files at the top level.
pub(crate) fn left_out(files: &Files, listing: &Listing) -> Vec<String> {
    let read =
        listing.shots().chain(&listing.left_out).flat_map(files_of).chain(listing.used.iter().map(PathBuf::as_path));
    let used: HashSet<String> = read.map(|path| files.key_below(path)).collect();
    let picture_folders: HashSet<String> = listing.shots().map(|shot| files.key_below(parent(&shot.image))).collect();

    let (mut pictures, mut entries) = (BTreeMap::<&Path, usize>::new(), BTreeMap::<&Path, usize>::new());
    let is_used = |path: &Path| path.ancestors().any(|above| used.contains(&key_of(above)));
    for path in files.paths.iter().filter(|path| !is_used(path) && !is_aside(path)) {
        let count = match picture_folders.contains(&key_of(parent(path))) && is_picture(path) {
            true => pictures.entry(parent(path)).or_default(),
            false => entries.entry(path.iter().next().map_or(path, Path::new)).or_default(),
        };
        *count += 1;
    }
    let pictures = pictures
        .into_iter()
        .map(|(folder, count)| format!("{count} pictures of {:?} without a camera", files.root.join(folder)));
    let broken = files.broken.iter().map(|path| format!("{path:?} (cannot be opened)"));
    let entries = entries.into_iter().map(|(top, count)| entry(&files.root, top, count));
    let all: Vec<String> = pictures.chain(broken).chain(entries).collect();
    let more = all.len().saturating_sub(ENTRIES_MAX);
    let rest = (more > 0).then(|| format!("and {more} more"));
    all.into_iter().take(ENTRIES_MAX).chain(rest).collect()
}

fn parent(path: &Path) -> &Path {
    path.parent().unwrap_or(path)
}

fn files_of(shot: &Shot) -> impl Iterator<Item = &Path> {
    let normal = shot.normal.iter().flat_map(|normal| [Some(&normal.map), normal.coverage.as_ref()]);
    let optional = [shot.mask.as_ref(), shot.materials.albedo.as_ref(), shot.materials.surface.as_ref()];
    [Some(&shot.image)].into_iter().chain(optional).chain(normal).flatten().map(PathBuf::as_path)
}

/// Tables of lights at the top level.
pub(crate) fn light_tables(files: &Files) -> Vec<PathBuf> {
    let at_top = files.paths.iter().filter(|path| parent(path) == Path::new(""));
    at_top.filter(|path| is_light_table(&files.root, path)).cloned().collect()
}

fn is_light_table(root: &Path, top: &Path) -> bool {
    top.extension().is_some_and(|ending| ending == "csv") && LightTable::read(&root.join(top)).is_ok()
}

/// True if a file is not part of a data set.
fn is_aside(path: &Path) -> bool {
    let is_of = |name: &str, known: &[&str]| known.iter().any(|known| name.eq_ignore_ascii_case(known));
    let first = path.iter().next().unwrap_or_default();
    let ending = path.extension().unwrap_or_default();
    let is_at_top = first == path.as_os_str();
    let name = first.to_string_lossy();
    is_of(&name, &MEASURED) || is_of(&name, &CAPTURE) || is_at_top && is_of(&ending.to_string_lossy(), &ASIDE)
}

/// Folder or file at the top level, with its number of files.
fn entry(root: &Path, top: &Path, count: usize) -> String {
    let name = top.to_string_lossy();
    let factor = name.rsplit_once('_').map(|(_, factor)| factor).filter(|factor| ["2", "4", "8"].contains(factor));
    match factor {
        Some(factor) => format!("{top:?} ({count} files, copies for pictures {factor} times smaller)"),
        None if is_light_table(root, top) => {
            format!("{top:?} (does it name the light of each picture? add --lights-by {})", root.join(top).display())
        }
        None if top.extension().is_none() || count > 1 => format!("{top:?} ({count} files)"),
        None => format!("{top:?}"),
    }
}
