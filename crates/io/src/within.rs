//! Folders from elsewhere, such as a model folder out of an archive: what is written and removed
//! there stays within.
//!
//! Reading may lead through a link to a regular file, as people link what is large. Folders that
//! are links end writing and removing, before the first file. Files are written beside their place
//! and renamed ([`crate::whole_file`]), so that a link, or a name of a file that has others, is
//! replaced and what it led to stays.

use crate::error::{Error, Result};
use core::time::Duration;
use std::{
    fs::{self, File, OpenOptions, TryLockError},
    io::ErrorKind,
    path::Path,
    thread,
    time::Instant,
};

/// Most seconds to wait for a lock that other programs hold while they change a file.
const PATIENCE: Duration = Duration::from_secs(30);
/// Time between two attempts.
const PAUSE: Duration = Duration::from_millis(5);

/// Refuses a folder `path` within `root` that a link leads to.
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

/// Opens a file for reading, which a link may lead to. Reading never waits, as some files of
/// `/proc` would.
///
/// # Errors
///
/// [`Error::NotAFile`] for pipes, devices and folders, which may wait for ever or have no end, and
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

/// Returns whether there is a file to read; what is no regular file, or a link that leads nowhere,
/// is not passed over.
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

/// Removes a file, if it exists; of a link only the link.
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

/// Locks a file that exists for this purpose, and creates it where it is missing. Its content can
/// be changed: it has no other name.
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

/// Locks a file as [`lock`] does, and waits while other programs hold the lock. None, with a
/// warning, where the file system has no locks.
///
/// # Errors
///
/// Those of [`lock`]; [`Error::Busy`] where others do not release it.
pub(crate) fn wait_for_lock(path: &Path) -> Result<Option<File>> {
    let start = Instant::now();
    loop {
        match lock(path)? {
            Ok(file) => return Ok(Some(file)),
            Err(TryLockError::Error(cause)) => {
                tracing::warn!(
                    "{path:?} cannot be locked ({cause}), so results of programs at the same time may be lost"
                );
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
    // A link that appears in this moment is not followed either.
    #[cfg(unix)]
    set_flags(&mut options, rustix::fs::OFlags::NOFOLLOW);
    options.open(path).map_err(|cause| Error::Write { path: path.to_owned(), cause })
}

/// Returns whether a file has more than one name (hard links), so that its content is not only of
/// one folder.
#[cfg(unix)]
fn has_other_names(file: &File) -> bool {
    file.metadata().is_ok_and(|found| std::os::unix::fs::MetadataExt::nlink(&found) > 1)
}

/// Number of names that is not known: `false`.
#[cfg(not(unix))]
fn has_other_names(_: &File) -> bool {
    false
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn a_lock_is_no_file_of_others() {
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
    fn links_are_met_below_a_folder_and_not_on_the_way_to_it() {
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
    fn links_lead_to_files_and_what_leads_nowhere_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let [file, link] = ["file", "link"].map(|name| folder.path().join(name));
        assert!(!holds(&link).unwrap() && !holds(&link.join("below")).unwrap());
        symlink(&file, &link).unwrap();
        assert!(matches!(holds(&link), Err(Error::Read { .. })), "a link to nothing");
        fs::write(&file, "").unwrap();
        assert!(holds(&link).unwrap() && open(&link).is_ok());
    }
}
