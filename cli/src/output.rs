//! Results: lines on stdout, and files that are written atomically.

use crate::failure::Failure;
use specula_io::{Error, whole_file, within};
use specula_scene::{text::printable, training::Lock};
use std::{
    fs,
    io::{self, Write},
    path::{Component, Path, PathBuf},
};

/// Prints a result as a line on stdout, or as lines, without characters that control a terminal.
///
/// # Errors
/// [`Failure::BrokenPipe`] if stdout is closed, else [`Failure::Input`].
pub(crate) fn say(lines: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    lines.split('\n').try_for_each(|line| writeln!(out, "{}", printable(line)))?;
    out.flush()?;
    Ok(())
}

/// Prints JSON on stdout.
///
/// # Errors
/// Those of [`say`].
pub(crate) fn say_json(value: &serde_json::Value) -> Result<(), Failure> {
    say(&format!("{value:#}"))
}

/// Absolute path as text.
pub(crate) fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).to_string_lossy().into_owned()
}

/// Folder of a file.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// File extension in lower case.
pub(crate) fn ending(path: &Path) -> Option<String> {
    Some(path.extension()?.to_str()?.to_ascii_lowercase())
}

/// File name without its extension, never `.` or `..`: the whole name for `..hdr`.
pub(crate) fn stem(path: &Path) -> String {
    let stem = path.file_stem().filter(|stem| !["", ".", ".."].contains(&stem.to_str().unwrap_or("-")));
    stem.or_else(|| path.file_name()).unwrap_or_default().to_string_lossy().into_owned()
}

/// Name of a model: that of its file without the extension, or of its folder; of the folder above
/// for `model`, as `specula make` writes.
pub(crate) fn name_of_model(path: &Path) -> String {
    let path = PathBuf::from(absolute(path));
    let above = path.parent().filter(|_| path.ends_with("model"));
    stem(above.unwrap_or(&path))
}

/// Rejects a path with `..` after a folder that does not exist: once the folder exists, the path
/// may lead elsewhere, past all checks.
fn refuse_detour(path: &Path) -> Result<(), Failure> {
    let mut before = PathBuf::new();
    for part in path.components() {
        if part == Component::ParentDir && !before.as_os_str().is_empty() && !before.is_dir() {
            return Err(Failure::Input(format!("{path:?} leads through {before:?}, which does not exist")));
        }
        before.push(part);
    }
    Ok(())
}

/// Locks an output folder against other runs of the program.
///
/// # Errors
///
/// The lock cannot be taken.
pub(crate) fn lock(folder: &Path) -> Result<Lock, Failure> {
    const REMEDY: &str = "wait until it ends, or use another folder with -o";
    Lock::take(folder).map_err(|error| Failure::locked(error, REMEDY))
}

/// Creates a folder and tests that it is writable, before long work. Removes temporary files of a
/// killed program.
///
/// # Errors
/// [`Failure::File`] if the folder cannot be created or written to.
pub(crate) fn make_folder(folder: &Path) -> Result<(), Failure> {
    refuse_detour(folder)?;
    let written = fs::create_dir_all(folder).and_then(|()| tempfile::tempfile_in(folder)).and_then(|mut file| {
        file.write_all(&[0; 4096])?;
        file.sync_data()
    });
    whole_file::remove_unfinished(folder, 0);
    written.map_err(|cause| Error::Write { path: folder.to_owned(), cause }.into())
}

/// Writes a file below a folder like [`write_bytes`], but follows no link within the folder.
///
/// # Errors
/// [`Failure::File`] if the file cannot be written, or a folder on its way is a link.
pub(crate) fn write_within(root: &Path, below: impl AsRef<Path>, bytes: &[u8]) -> Result<(), Failure> {
    let path = root.join(below);
    within::refuse_links(root, path.parent().unwrap_or(root))?;
    write_bytes(&path, bytes)
}

/// Writes indented JSON.
///
/// # Errors
/// Those of [`write_bytes`].
pub(crate) fn write_json(path: &Path, value: &serde_json::Value) -> Result<(), Failure> {
    write_text(path, &format!("{value:#}\n"))
}

/// Writes a text file.
///
/// # Errors
/// Those of [`write_bytes`].
pub(crate) fn write_text(path: &Path, text: &str) -> Result<(), Failure> {
    write_bytes(path, text.as_bytes())
}

/// Writes a file atomically, by way of a temporary file beside it.
///
/// # Errors
/// [`Failure::File`] if the file cannot be written.
pub(crate) fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    Ok(whole_file::write_bytes(path, bytes)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_that_make_wrote_has_the_name_of_its_folder() {
        let name = |path: &str| name_of_model(Path::new(path));
        assert_eq!([name("out/vase"), name("out/vase/model"), name("vase.ply")], ["vase", "vase", "vase"]);
    }
}
