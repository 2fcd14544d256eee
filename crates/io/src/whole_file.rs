//! Atomic writing of files: a temporary file beside the target, then a rename.

use crate::error::{Error, Result};
use std::{
    fs::{self, TryLockError},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};
use tempfile::{Builder, NamedTempFile};

/// Size of the write buffer in bytes.
const BUFFER_SIZE: usize = 1 << 20;
/// Prefix of temporary files.
const UNFINISHED: &str = ".unfinished-";

/// Writes a file with `fill`, creating its folder if needed. The target appears or changes after
/// everything is written; it keeps the permissions of a replaced file.
pub(crate) fn write(path: &Path, fill: impl FnOnce(&mut BufWriter<&mut fs::File>) -> io::Result<()>) -> Result<()> {
    write_beside(path, fill).map_err(|cause| Error::Write { path: path.to_owned(), cause })
}

/// Writes a file from bytes, creating its folder if needed. The target appears or changes after
/// everything is written.
///
/// # Errors
///
/// [`Error::Write`], if the folder or the file cannot be written.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    write(path, |out| out.write_all(bytes))
}

fn write_beside(path: &Path, fill: impl FnOnce(&mut BufWriter<&mut fs::File>) -> io::Result<()>) -> io::Result<()> {
    let folder = folder_of(path);
    fs::create_dir_all(&folder)?;

    let mut file = locked(&folder)?;
    let mut out = BufWriter::with_capacity(BUFFER_SIZE, file.as_file_mut());
    fill(&mut out)?;
    out.flush()?;
    drop(out);

    // Without this, a power failure can leave the new name without the bytes.
    file.as_file().sync_data()?;
    if let Some(earlier) = fs::symlink_metadata(path).ok().filter(fs::Metadata::is_file) {
        file.as_file().set_permissions(earlier.permissions())?;
    }
    file.persist(path).map(drop).map_err(|error| error.error)
}

fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// Removes temporary files that a killed program left in a folder and, down to `levels`, in its
/// subfolders. Keeps files that a program is still writing, and files that cannot be removed, which
/// only take space.
pub fn remove_unfinished(folder: &Path, levels: usize) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let Ok(kind) = entry.file_type() else { continue };
        if kind.is_file() && entry.file_name().to_string_lossy().starts_with(UNFINISHED) {
            remove_unlocked(&entry.path());
        } else if levels > 0 && kind.is_dir() {
            remove_unfinished(&entry.path(), levels - 1);
        }
    }
}

fn remove_unlocked(path: &Path) {
    if let Ok(file) = fs::File::open(path)
        && file.try_lock().is_ok()
    {
        let _ = fs::remove_file(path);
    }
}

/// Temporary file, locked until it is written or the program ends, if the file system has locks.
fn locked(folder: &Path) -> io::Result<NamedTempFile> {
    loop {
        let file = temporary(folder)?;
        match file.as_file().try_lock() {
            // Another program may have removed the file before it was locked.
            Ok(()) if !file.path().exists() => {}
            Err(TryLockError::WouldBlock) => {}
            _ => return Ok(file),
        }
    }
}

/// Temporary file with the permissions of any other new file.
fn temporary(folder: &Path) -> io::Result<NamedTempFile> {
    let mut builder = Builder::new();
    builder.prefix(UNFINISHED);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_folders_are_created() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b/c.txt");
        write_bytes(&path, b"hello").unwrap();
        assert_eq!(fs::read(path).unwrap(), b"hello");
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_bytes(&path, b"old").unwrap();

        let full = write(&path, |out| {
            out.write_all(b"half of the new")?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        });
        let sentence = full.unwrap_err().to_string();

        assert!(sentence.contains("a.txt") && sentence.contains("free some space"), "{sentence}");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "a temporary file stayed behind");
    }

    #[test]
    fn only_files_of_killed_programs_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let deep = folder.path().join("point_cloud/iteration_7");
        fs::create_dir_all(&deep).unwrap();
        let left = [folder.path(), &deep].map(|folder| temporary(folder).unwrap().keep().unwrap().1);
        write_bytes(&folder.path().join("a.txt"), b"").unwrap();
        assert!(left.iter().all(|path| path.is_file()), "a program that is killed leaves its file");
        remove_unfinished(folder.path(), 1);
        assert_eq!([&left[0], &left[1]].map(|path| path.is_file()), [false, true], "one is deeper than was asked for");
        remove_unfinished(folder.path(), 2);
        assert!(!left[1].is_file() && folder.path().join("a.txt").is_file(), "the wrong file is gone");
    }

    #[test]
    fn files_that_are_being_written_are_not_removed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let written = write(&path, |out| {
            remove_unfinished(folder.path(), 0);
            out.write_all(b"whole")
        });
        written.unwrap();
        assert_eq!(fs::read(path).unwrap(), b"whole");
    }

    #[test]
    fn a_file_instead_of_a_folder_is_an_error_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        write_bytes(&file, b"").unwrap();
        let sentence = write_bytes(&file.join("a.txt"), b"").unwrap_err().to_string();
        assert!(sentence.contains("file/a.txt") && sentence.contains("in the place of a folder"), "{sentence}");
    }

    #[cfg(unix)]
    #[test]
    fn new_files_have_default_permissions() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (ours, default) = (folder.path().join("ours"), folder.path().join("default"));
        write_bytes(&ours, b"").unwrap();
        fs::write(&default, b"").unwrap();
        let mode = |path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(ours), mode(default));
    }
}
