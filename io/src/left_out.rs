//! Files of a data set that no reader uses.

use crate::{
    listing::Listing,
    named::{Files, is_picture, key_of},
    shot::Shot,
};
use std::{
    collections::{BTreeMap, HashSet},
    path::{Path, PathBuf},
};

/// Most entries that are named.
const ENTRIES_MAX: usize = 8;
/// Files beside a data set that belong to none: notes, licences, projects of COLMAP, and what
/// measurements read.
const ASIDE: [&str; 9] = ["md", "txt", "log", "ini", "db", "sh", "py", "ipynb", "pdf"];
const MEASURED: [&str; 5] = ["env.hdr", "env.exr", "light", "relit", "relight"];

/// Entries of a data set that are not used, with the reason: pictures without cameras beside those
/// that have one, and other folders and files at the top.
pub(crate) fn left_out(files: &Files, listing: &Listing) -> Vec<String> {
    let shots = || listing.train.iter().chain(&listing.test);
    let used: HashSet<String> = shots()
        .flat_map(files_of)
        .chain(listing.used.iter().map(PathBuf::as_path))
        .map(|path| files.key_below(path))
        .collect();
    let parent = |path: &Path| key_of(path.parent().unwrap_or(Path::new("")));
    let folder_of = |path: &Path| files.key_below(path.parent().unwrap_or(Path::new("")));
    let of_pictures: HashSet<String> = shots().map(|shot| folder_of(&shot.image)).collect();

    let mut pictures = BTreeMap::<&Path, usize>::new();
    let mut entries = BTreeMap::<&Path, usize>::new();
    for path in &files.paths {
        let is_used = used.contains(&key_of(path)) || path.ancestors().any(|above| used.contains(&key_of(above)));
        let folder = parent(path);
        if is_used || is_aside(path) {
            continue;
        }
        if of_pictures.contains(&folder) && is_picture(path) {
            *pictures.entry(path.parent().unwrap_or(path)).or_default() += 1;
        } else {
            let top = path.components().next().map_or(path.as_path(), |top| Path::new(top.as_os_str()));
            *entries.entry(top).or_default() += 1;
        }
    }
    let pictures =
        pictures.into_iter().map(|(folder, count)| format!("{count} pictures of {folder:?} that no camera names"));
    let all: Vec<String> = pictures.chain(entries.into_iter().map(|(top, count)| entry(top, count))).collect();
    let more = all.len().saturating_sub(ENTRIES_MAX);
    let rest = (more > 0).then(|| format!("and {more} more"));
    all.into_iter().take(ENTRIES_MAX).chain(rest).collect()
}

fn files_of(shot: &Shot) -> impl Iterator<Item = &Path> {
    let normal = shot.normal.iter().flat_map(|normal| [Some(&normal.map), normal.coverage.as_ref()]);
    let optional = [shot.mask.as_ref(), shot.materials.albedo.as_ref(), shot.materials.surface.as_ref()];
    [Some(&shot.image)].into_iter().chain(optional).chain(normal).flatten().map(PathBuf::as_path)
}

/// Whether a file belongs to no data set.
fn is_aside(path: &Path) -> bool {
    let is_of = |name: &str, known: &[&str]| known.iter().any(|known| name.eq_ignore_ascii_case(known));
    let first = path.iter().next().unwrap_or_default().to_string_lossy();
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    is_of(&first, &MEASURED) || is_of(&ending, &ASIDE) || path.extension().is_none()
}

/// A folder or a file at the top, with the number of its files.
fn entry(top: &Path, count: usize) -> String {
    let name = top.to_string_lossy();
    let factor = name.rsplit_once('_').map(|(_, factor)| factor).filter(|factor| ["2", "4", "8"].contains(factor));
    match factor {
        Some(factor) => format!("{top:?} ({count} files, copies for pictures {factor} times smaller)"),
        None if top.extension().is_none() || count > 1 => format!("{top:?} ({count} files)"),
        None => format!("{top:?}"),
    }
}
