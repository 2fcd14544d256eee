//! Files of a data set, found by the names in lists, whichever system wrote the lists.
//!
//! An existing file is used as named. Otherwise separators, drives, `.` and `..`, case, Unicode
//! normalisation and picture extensions of any system are accepted, and leading folders that the
//! data set does not have are dropped. If several files match, none is chosen.

use crate::{
    shot::{IMAGE_ENDINGS, RAW_ENDINGS, find_image, has_image_ending},
    within,
};
use std::{
    collections::HashMap,
    io::Read,
    path::{Component, Path, PathBuf},
};
use unicode_normalization::UnicodeNormalization;
use walkdir::{DirEntry, WalkDir};

/// Maximum number and depth of files that are searched.
const FILES_MAX: usize = 1 << 20;
const DEPTH_MAX: usize = 8;
/// Extensions of unsupported pictures and videos, beside [`RAW_ENDINGS`], which are not reported as
/// missing.
const UNREAD_ENDINGS: [&str; 13] =
    ["heic", "heif", "avif", "jxl", "jp2", "jfif", "bmp", "gif", "hdr", "mp4", "mov", "mkv", "avi"];

/// Reason why a picture has no file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Absent {
    /// No file has its name.
    Missing,
    /// Several files match.
    Ambiguous,
    /// A file with its name has an unsupported format.
    Unread(PathBuf),
}

/// Files and folders below a folder. Hidden files and trained models are skipped.
#[derive(Debug)]
pub(crate) struct Files {
    pub(crate) root: PathBuf,
    /// Paths of files below the root, in the order of their names.
    pub(crate) paths: Vec<PathBuf>,
    /// Paths of entries that cannot be opened, such as broken links.
    pub(crate) broken: Vec<PathBuf>,
    /// Indices of files by their key without picture extensions.
    by_stem: HashMap<String, Vec<usize>>,
    /// Folders by their key.
    folders: HashMap<String, PathBuf>,
}

impl Files {
    /// Searches a folder.
    pub(crate) fn below(root: &Path) -> Self {
        let mut files = Self {
            root: root.to_owned(),
            paths: Vec::new(),
            broken: Vec::new(),
            by_stem: HashMap::new(),
            folders: HashMap::new(),
        };
        let walk = WalkDir::new(root).follow_links(true).max_depth(DEPTH_MAX).sort_by_file_name().into_iter();
        for entry in walk.filter_entry(is_of_data_set).take(FILES_MAX) {
            let entry = match entry {
                Ok(entry) => entry,
                Err(error) => {
                    let path = error.path().and_then(|path| path.strip_prefix(root).ok());
                    files.broken.extend(path.map(Path::to_owned));
                    continue;
                }
            };
            let path = entry.path().strip_prefix(root).unwrap_or(entry.path()).to_owned();
            if entry.file_type().is_dir() {
                files.folders.insert(key_of(&path), path);
            } else {
                files.by_stem.entry(stem_of(&key_of(&path)).to_owned()).or_default().push(files.paths.len());
                files.paths.push(path);
            }
        }
        files
    }

    /// Folder below the root, by a name in any case.
    pub(crate) fn folder(&self, named: &Path) -> Option<&Path> {
        self.folders.get(&key_of(named)).map(PathBuf::as_path)
    }

    /// Finds a picture by its path below the root, or by an absolute one.
    pub(crate) fn picture(&self, named: &Path) -> Result<PathBuf, Absent> {
        find_image(&self.root.join(named)).map_or_else(|| self.picture_alike(named), Ok)
    }

    fn picture_alike(&self, named: &Path) -> Result<PathBuf, Absent> {
        let key = self.key_below(named);
        let alike = self.by_stem.get(stem_of(&key)).map_or(&[][..], Vec::as_slice);
        let paths = || alike.iter().map(|index| self.paths[*index].as_path());
        let read = || paths().filter(|path| has_image_ending(path));
        if let Some(path) = only(read()).or_else(|| only(read().filter(|path| key_of(path) == key))) {
            return Ok(self.root.join(path));
        }
        Err(match (read().next(), paths().find(|path| is_unread(path))) {
            (Some(_), _) => Absent::Ambiguous,
            (None, Some(path)) => Absent::Unread(path.to_owned()),
            (None, None) => Absent::Missing,
        })
    }

    /// Finds a file by its path below the root, or by an absolute one.
    pub(crate) fn file(&self, named: &Path) -> Option<PathBuf> {
        let literal = self.root.join(named);
        if literal.is_file() {
            return Some(literal);
        }
        let key = self.key_below(named);
        let alike = self.by_stem.get(stem_of(&key)).into_iter().flatten().map(|index| self.paths[*index].as_path());
        only(alike.filter(|path| key_of(path) == key)).map(|path| self.root.join(path))
    }

    /// First folder by name, other than of masks, with a picture at this path: below it, or in a
    /// copy such as `images_4` of its folder.
    pub(crate) fn folder_with(&self, named: &Path) -> Option<PathBuf> {
        let (key, own) = (key_of(named), key_of(named.parent()?));
        let stem = |key: &str| stem_of(key).to_owned();
        let (path, name) = (stem(&key), stem(key.rsplit('/').next()?));
        let is_alike = |other: &&PathBuf| {
            let other = stem(&key_of(other));
            let is_copy =
                !own.is_empty() && other.starts_with(&format!("{own}_")) && other.ends_with(&format!("/{name}"));
            (is_copy || other.ends_with(&format!("/{path}"))) && !other.contains("mask")
        };
        let found = self.paths.iter().filter(|path| has_image_ending(path)).find(is_alike)?;
        let depth = if key_of(found).contains(&path) { named.iter().count() } else { 1 };
        found.ancestors().nth(depth).map(Path::to_owned)
    }

    /// Key of a path below the root, or of an absolute one.
    pub(crate) fn key_below(&self, path: &Path) -> String {
        key_of(path.strip_prefix(&self.root).unwrap_or(path))
    }

    /// Paths below `base` of the pictures in a list; those without a file keep their names.
    /// `images` is the folder of images below `base`. Names with folders outside of the data set
    /// are noted.
    pub(crate) fn placed_all<'a>(
        &self,
        base: &Path,
        images: &Path,
        written: impl Iterator<Item = &'a str>,
        notes: &mut Vec<String>,
    ) -> Vec<PathBuf> {
        let mut moved = Vec::new();
        let place = |name| {
            let (path, is_moved) = self.placed(base, images, name, |path| self.picture(path).is_ok());
            if is_moved {
                moved.push((name, path.clone()));
            }
            path
        };
        let paths = written.map(place).collect();
        if let Some((name, path)) = moved.first() {
            let others =
                if moved.len() > 1 { format!(", and the same for {} others", moved.len() - 1) } else { String::new() };
            notes.push(format!("{name:?} is not in a folder of the data set; using {path:?}{others}"));
        }
        paths
    }

    /// File named by a list, if it exists.
    pub(crate) fn named_file(&self, written: &str) -> Option<PathBuf> {
        let (path, _) = self.placed(Path::new(""), Path::new(""), written, |path| self.file(path).is_some());
        self.file(&path)
    }

    /// Mask named by a list.
    pub(crate) fn named_mask(&self, written: &str) -> Result<PathBuf, Absent> {
        // Without its folder, the name may match the picture.
        let has_folder = |path: &Path| path.parent().is_some_and(|folder| !folder.as_os_str().is_empty());
        let is_there = |path: &Path| has_folder(path) && self.picture(path).is_ok();
        let (path, _) = self.placed(Path::new(""), Path::new(""), written, is_there);
        self.picture(&path)
    }

    /// Path below `base` of a named file, and whether leading parts were removed.
    fn placed(&self, base: &Path, images: &Path, written: &str, is_there: impl Fn(&Path) -> bool) -> (PathBuf, bool) {
        let literal = Path::new(written.trim_start_matches("./"));
        if is_there(&base.join(literal)) {
            return (literal.strip_prefix(&self.root).unwrap_or(literal).to_owned(), false);
        }
        let path = plain_path(written);
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        if is_there(&base.join(&path)) || folder.is_some_and(|folder| self.folder(&base.join(folder)).is_some()) {
            return (path, false);
        }
        let parts: Vec<Component<'_>> = path.components().collect();
        let tails = (0..parts.len()).map(|first| parts[first..].iter().collect::<PathBuf>());
        let found = tails.flat_map(|tail| [images.join(&tail), tail]).find(|place| is_there(&base.join(place)));
        found.map_or((path, false), |place| (place, true))
    }
}

/// Returns whether a walk descends into an entry.
fn is_of_data_set(entry: &DirEntry) -> bool {
    let is_hidden = entry.file_name().to_string_lossy().starts_with('.');
    entry.depth() == 0 || !(is_hidden || entry.path().join("specula.json").is_file())
}

/// The only item, if there is exactly one.
pub(crate) fn only<T>(mut items: impl Iterator<Item = T>) -> Option<T> {
    items.next().filter(|_| items.next().is_none())
}

/// Path of a name with the separators of any system, without drive, root, `.` and inner `..`.
pub(crate) fn plain_path(written: &str) -> PathBuf {
    let slashed = written.replace('\\', "/");
    let rest = match slashed.split_once(":/") {
        Some((drive, rest)) if drive.len() == 1 => rest,
        _ => &slashed,
    };
    let mut parts = Vec::new();
    for part in rest.split('/') {
        match part {
            "" | "." => {}
            ".." if parts.last().is_some_and(|last| *last != "..") => drop(parts.pop()),
            part => parts.push(part),
        }
    }
    parts.into_iter().collect()
}

/// Key of a path, equal for paths that differ only in case or Unicode normalisation.
pub(crate) fn key_of(path: &Path) -> String {
    let parts = path.components().filter(|part| matches!(part, Component::Normal(_) | Component::ParentDir));
    let parts: Vec<_> = parts.map(|part| part.as_os_str().to_string_lossy()).collect();
    parts.join("/").nfc().collect::<String>().to_lowercase()
}

/// Key without picture extensions, of which there may be two: `a.jpg.png`.
pub(crate) fn stem_of(key: &str) -> &str {
    let mut stem = key;
    while let Some((rest, ending)) = stem.rsplit_once('.')
        && !rest.is_empty()
        && [&IMAGE_ENDINGS[..], &UNREAD_ENDINGS, &RAW_ENDINGS].iter().any(|known| known.contains(&ending))
    {
        stem = rest;
    }
    stem
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    path.extension().is_some_and(|ending| endings.iter().any(|known| ending.eq_ignore_ascii_case(known)))
}

/// Whether a file is an unsupported picture, or a video, by its name.
fn is_unread(path: &Path) -> bool {
    has_ending(path, &UNREAD_ENDINGS) || has_ending(path, &RAW_ENDINGS)
}

/// Whether a file is a picture, or a video, by its name.
pub fn is_picture(path: &Path) -> bool {
    has_image_ending(path) || is_unread(path)
}

/// Unsupported picture format of a file, by its first bytes.
pub(crate) fn unread_format(path: &Path) -> Option<&'static str> {
    let mut start = [0; 12];
    within::open(path).ok()?.read_exact(&mut start).ok()?;
    let brand = (&start[4..8] == b"ftyp").then_some(&start[8..]);
    match (&start[..4], brand) {
        (_, Some(b"avif" | b"avis")) => Some("AVIF"),
        (_, Some(b"heic" | b"heix" | b"hevc" | b"mif1" | b"msf1")) => Some("HEIC"),
        (_, Some(_)) => Some("video"),
        (b"\0\0\0\x0c" | [0xff, 0x0a, ..], _) => Some("JPEG XL or JPEG 2000"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_any_system_are_paths() {
        for (written, path) in [
            (r".\images\a.png", "images/a.png"),
            ("./a/../images//a.png", "images/a.png"),
            (r"C:\data\images\a.png", "data/images/a.png"),
            ("/home/some one/a.png", "home/some one/a.png"),
            ("../../a.png", "../../a.png"),
            ("a:b.png", "a:b.png"),
        ] {
            assert_eq!(plain_path(written), Path::new(path), "{written}");
        }
    }

    #[test]
    fn keys_ignore_case_normalisation_and_extensions() {
        assert_eq!(key_of(Path::new("Images/Cafe\u{301}.JPG")), "images/caf\u{e9}.jpg");
        for name in ["a.b.png", "a.b.jpg.png", "a.b.heic", "a.b"] {
            assert_eq!(stem_of(name), "a.b");
        }
        assert_eq!(stem_of(".png"), ".png");
    }
}
