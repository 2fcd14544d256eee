//! Untrusted folders, such as a model folder from an archive: writing and removing stay within the
//! folder.
//!
//! Reading follows links to regular files, because users link large files. Writing and removing
//! fail before the first file if a folder is a link. Files are written to a temporary name and
//! renamed ([`crate::whole_file`]), so that a symbolic or hard link is replaced and its target is
//! unchanged.

use crate::error::{Error, Result};
use core::time::Duration;
use std::{
    fs::{self, File, OpenOptions, TryLockError},
    io::ErrorKind,
    path::Path,
    thread,
    time::Instant,
};

/// Maximum seconds to wait for the lock of another program that changes a file.
const PATIENCE: Duration = Duration::from_secs(30);
/// Time between two attempts.
const PAUSE: Duration = Duration::from_millis(5);

/// Rejects a folder `path` within `root` that is reached through a link.
///
/// # Errors
///
/// [`Error::Link`].
pub fn refuse_links(root: &Path, path: &Path) -> Result<()> {
    let below = path.ancestors().take_while(|folder| *folder != root && folder.starts_with(root));
    match below.filter(|folder| folder.is_symlink()).last() {
        Some(link) => Err(Error::Link { path: link.to_owned() }),
        None => Ok(()),
    }
}

/// Opens a file, or the target of a link, for reading. Reading never blocks, unlike some files of
/// `/proc`.
///
/// # Errors
///
/// [`Error::NotAFile`] for pipes, devices and folders, which may block or be endless, and
/// [`Error::Read`].
pub fn open(path: &Path) -> Result<File> {
    refuse_others(path)?;
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(unix)]
    set_flags(&mut options, rustix::fs::OFlags::NONBLOCK);
    options.open(path).map_err(Error::reading(path))
}

#[cfg(unix)]
fn set_flags(options: &mut OpenOptions, flags: rustix::fs::OFlags) {
    std::os::unix::fs::OpenOptionsExt::custom_flags(options, flags.bits().cast_signed());
}

/// True if there is a file to read; anything but a regular file, or a broken link, is an error.
///
/// # Errors
///
/// Those of [`open`].
pub fn holds(path: &Path) -> Result<bool> {
    match fs::symlink_metadata(path) {
        Err(cause) if matches!(cause.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(false),
        _ => refuse_others(path).map(|()| true),
    }
}

fn refuse_others(path: &Path) -> Result<()> {
    match fs::metadata(path).map_err(Error::reading(path))?.is_file() {
        true => Ok(()),
        false => Err(Error::NotAFile { path: path.to_owned() }),
    }
}

/// Removes a file or a link, if it exists; not the link's target.
///
/// # Errors
///
/// [`Error::Write`], also for a folder.
pub(crate) fn remove_file(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(cause) if cause.kind() != ErrorKind::NotFound => Err(Error::Write { path: path.to_owned(), cause }),
        _ => Ok(()),
    }
}

/// Locks a lock file, and creates it if it is missing. The file has only one name, so its content
/// may be changed.
///
/// # Errors
///
/// [`Error::Link`], [`Error::NotAFile`], and [`Error::Write`] for a file that cannot be opened.
pub fn lock(path: &Path) -> Result<core::result::Result<File, TryLockError>> {
    let file = open_to_lock(path)?;
    if let Err(refused) = file.try_lock() {
        return Ok(Err(refused));
    }
    if !has_other_names(&file) {
        return Ok(Ok(file));
    }
    fs::remove_file(path).map_err(|cause| Error::Write { path: path.to_owned(), cause })?;
    let file = open_to_lock(path)?;
    Ok(file.try_lock().map(|()| file))
}

/// Locks a file like [`lock`], and waits while other programs hold the lock. `None`, with a
/// warning, if the file system has no locks.
///
/// # Errors
///
/// Those of [`lock`]; [`Error::Busy`] if others do not release it.
pub(crate) fn wait_for_lock(path: &Path) -> Result<Option<File>> {
    let start = Instant::now();
    loop {
        match lock(path)? {
            Ok(file) => return Ok(Some(file)),
            Err(TryLockError::Error(cause)) => {
                tracing::warn!("cannot lock {path:?} ({cause}); results of concurrent programs may be lost");
                return Ok(None);
            }
            Err(TryLockError::WouldBlock) if start.elapsed() > PATIENCE => {
                return Err(Error::Busy { path: path.to_owned() });
            }
            Err(TryLockError::WouldBlock) => thread::sleep(PAUSE),
        }
    }
}

fn open_to_lock(path: &Path) -> Result<File> {
    match fs::symlink_metadata(path) {
        Ok(found) if found.is_symlink() => return Err(Error::Link { path: path.to_owned() }),
        Ok(found) if !found.is_file() => return Err(Error::NotAFile { path: path.to_owned() }),
        _ => {}
    }
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false);
    // A link that appears at this moment is not followed either.
    #[cfg(unix)]
    set_flags(&mut options, rustix::fs::OFlags::NOFOLLOW);
    options.open(path).map_err(|cause| Error::Write { path: path.to_owned(), cause })
}

/// True if a file has several names (hard links), so that other folders may share its content.
#[cfg(unix)]
fn has_other_names(file: &File) -> bool {
    file.metadata().is_ok_and(|found| std::os::unix::fs::MetadataExt::nlink(&found) > 1)
}

/// Unknown number of names: `false`.
#[cfg(not(unix))]
fn has_other_names(_: &File) -> bool {
    false
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn lock_files_replace_links_and_not_their_targets() {
        let folder = tempfile::tempdir().unwrap();
        let [thesis, path] = ["thesis", "a.lock"].map(|name| folder.path().join(name));
        fs::write(&thesis, "years of work").unwrap();

        symlink(&thesis, &path).unwrap();
        assert!(matches!(lock(&path), Err(Error::Link { .. })));
        fs::remove_file(&path).unwrap();
        symlink(folder.path().join("nothing"), &path).unwrap();
        assert!(lock(&path).is_err() && !folder.path().join("nothing").exists(), "it made a file elsewhere");
        fs::remove_file(&path).unwrap();
        fs::create_dir(&path).unwrap();
        assert!(matches!(lock(&path), Err(Error::NotAFile { .. })));
        fs::remove_dir(&path).unwrap();

        fs::hard_link(&thesis, &path).unwrap();
        let held = lock(&path).unwrap().unwrap();
        held.set_len(0).unwrap();
        assert_eq!(fs::read_to_string(&thesis).unwrap(), "years of work");
        assert!(matches!(lock(&path), Ok(Err(TryLockError::WouldBlock))), "it is held under its name");
    }

    #[test]
    fn links_are_rejected_below_a_folder_but_not_above_it() {
        let folder = tempfile::tempdir().unwrap();
        let [other, root] = ["other", "model"].map(|name| folder.path().join(name));
        fs::create_dir_all(other.join("a/b")).unwrap();
        symlink(&other, &root).unwrap();
        assert!(refuse_links(&root, &root.join("a/b/c")).is_ok(), "the user named the folder by a link");
        symlink(&other, other.join("a/b/link")).unwrap();
        let refused = refuse_links(&root, &root.join("a/b/link/a/b/link")).unwrap_err();
        assert!(matches!(refused, Error::Link { path } if path == root.join("a/b/link")));
    }

    #[test]
    fn links_to_files_are_followed_and_broken_links_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let [file, link] = ["file", "link"].map(|name| folder.path().join(name));
        assert!(!holds(&link).unwrap() && !holds(&link.join("below")).unwrap());
        symlink(&file, &link).unwrap();
        assert!(matches!(holds(&link), Err(Error::Read { .. })), "a link to nothing");
        fs::write(&file, "").unwrap();
        assert!(holds(&link).unwrap() && open(&link).is_ok());
    }
}
