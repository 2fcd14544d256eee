//! Inputs of a capture: videos, and pictures in folders.

use crate::error::{Error, Result};
use specula_io::{
    RAW_ENDINGS,
    dataset::{has_image_ending, is_picture, is_video},
};
use std::path::{Path, PathBuf};
use walkdir::WalkDir;

/// An input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Input {
    Video(PathBuf),
    /// A folder, and paths of its pictures below it, by name.
    Pictures {
        folder: PathBuf,
        paths: Vec<PathBuf>,
    },
}

impl Input {
    /// Lists an input.
    ///
    /// # Errors
    ///
    /// A path that does not exist or has neither video nor pictures, or pictures that are not read.
    pub(crate) fn list(path: &Path) -> Result<Vec<Self>> {
        if path.is_file() {
            return match (is_video(path), is_displayed(path)) {
                (true, _) => Ok(vec![Self::Video(path.to_owned())]),
                (_, true) => {
                    let (folder, name) = (path.parent().unwrap_or(Path::new("")), path.file_name().unwrap_or_default());
                    Ok(vec![Self::Pictures { folder: folder.to_owned(), paths: vec![name.into()] }])
                }
                _ => Err(refuse(path, "is neither a video nor a JPEG, PNG, WebP or TIFF picture")),
            };
        }
        if !path.is_dir() {
            return Err(refuse(path, "does not exist; give a video or a folder of pictures"));
        }
        // Pictures of a data set are in a folder of their own, beside masks and smaller copies.
        let inner = path.join("images");
        let folder = if inner.is_dir() { inner } else { path.to_owned() };
        let entries = WalkDir::new(&folder)
            .sort_by_file_name()
            .into_iter()
            .filter_entry(|entry| entry.depth() == 0 || !entry.file_name().to_string_lossy().starts_with('.'));
        let files: Vec<PathBuf> =
            entries.flatten().map(|entry| entry.into_path()).filter(|path| path.is_file()).collect();
        let below = |path: &PathBuf| path.strip_prefix(&folder).map(Path::to_owned).ok();
        let paths: Vec<PathBuf> = files.iter().filter(|path| is_displayed(path)).filter_map(below).collect();
        let mut found: Vec<Self> = files.iter().filter(|path| is_video(path)).cloned().map(Self::Video).collect();
        let unread: Vec<&PathBuf> =
            files.iter().filter(|path| is_picture(path) && !is_displayed(path) && !is_video(path)).collect();
        match (unread.first(), paths.is_empty() && found.is_empty()) {
            (Some(first), true) => return Err(Error::Input(unread_remedy(first, unread.len()))),
            (Some(first), false) => tracing::warn!("skipped: {}", unread_remedy(first, unread.len())),
            (None, true) => return Err(refuse(path, "has neither pictures (JPEG, PNG, WebP, TIFF) nor a video")),
            (None, false) => {}
        }
        if !paths.is_empty() {
            found.insert(0, Self::Pictures { folder, paths });
        }
        Ok(found)
    }

    /// Paths of its pictures, none of a video.
    pub(crate) fn into_pictures(self) -> Vec<PathBuf> {
        match self {
            Self::Video(_) => Vec::new(),
            Self::Pictures { paths, .. } => paths,
        }
    }

    /// Path of the input.
    pub(crate) fn path(&self) -> &Path {
        match self {
            Self::Video(path) | Self::Pictures { folder: path, .. } => path,
        }
    }
}

/// Whether cameras are estimated from a picture: one of a format that is read, other than OpenEXR,
/// whose numbers are not those of a display.
fn is_displayed(path: &Path) -> bool {
    has_image_ending(path) && !path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("exr"))
}

fn refuse(path: &Path, what: &str) -> Error {
    Error::Input(format!("{path:?} {what}"))
}

/// Sentence for pictures in a format that is not read.
fn unread_remedy(first: &Path, count: usize) -> String {
    let ending = first.extension().unwrap_or_default().to_string_lossy();
    let folder = first.parent().unwrap_or(Path::new("")).display();
    let remedy = match ending.to_lowercase().as_str() {
        "heic" | "heif" => {
            format!("for f in {folder}/*.{ending}; do heif-convert -q 95 \"$f\" \"${{f%.*}}.jpg\"; done")
        }
        _ => format!("magick mogrify -format jpg -quality 95 {folder}/*.{ending}"),
    };
    let mut linear = RAW_ENDINGS.iter().chain(&["exr"]);
    let then = if linear.any(|known| ending.eq_ignore_ascii_case(known)) {
        "; to train on their linear light afterwards, see \"Linear pictures\" in docs/photographs.md"
    } else {
        ""
    };
    format!(
        "{count} pictures such as {first:?} are in .{ending}, from which no cameras are estimated; convert them to JPEG: \
         {remedy}{then}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        folder
    }

    #[test]
    fn pictures_and_videos_of_a_folder_are_listed_by_name() {
        let data = folder(&["b.JPG", "a/c.png", "walk.MOV", ".hidden/d.jpg", "notes.txt"]);
        let found = Input::list(data.path()).unwrap();
        let paths = ["a/c.png", "b.JPG"].map(PathBuf::from).to_vec();
        assert_eq!(found[0], Input::Pictures { folder: data.path().into(), paths });
        assert_eq!(found[1], Input::Video(data.path().join("walk.MOV")));
    }

    #[test]
    fn inputs_without_pictures_end_in_a_sentence_with_a_remedy() {
        let heic = folder(&["1.HEIC", "2.HEIC"]);
        let sentence = Input::list(heic.path()).unwrap_err().to_string();
        assert!(sentence.contains("2 pictures") && sentence.contains("heif-convert"), "{sentence}");
        let empty = folder(&["notes.txt"]);
        for path in [empty.path().to_owned(), empty.path().join("notes.txt"), empty.path().join("none")] {
            let sentence = Input::list(&path).unwrap_err().to_string();
            assert!(sentence.contains("video"), "{sentence}");
        }
    }
}
