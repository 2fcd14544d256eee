//! Lock of a model folder, which keeps other trainings from writing to it.

use crate::SceneError;
use core::time::Duration;
use serde::{Deserialize, Serialize};
use specula_io::{Result, budget::FACTS, model_folder, within};
use std::{
    fs::{self, File, TryLockError},
    io::{self, Write},
    path::{Path, PathBuf},
    time::SystemTime,
};

/// Name of the locked file. It remains, empty, when the lock is released: if it were removed, a
/// program that had opened it before could lock it while another one locks a new file. Comparing
/// the names afterwards does not help on network file systems, which cache them.
const NAME: &str = "training.lock";

/// Lock of a folder, released when dropped. The operating system releases it in any case when the
/// program ends.
#[derive(Debug)]
pub struct Lock {
    folder: PathBuf,
    /// Locked file; `None` if the folder is used without a lock.
    file: Option<File>,
}

/// Program that holds a lock, as recorded in its file.
#[derive(Debug, Deserialize, PartialEq, Serialize)]
struct Holder {
    pid: u32,
    host: String,
    /// Start in UTC, in the format of RFC 3339.
    started: String,
    command: String,
}

impl Lock {
    /// Locks an existing folder.
    ///
    /// # Errors
    ///
    /// [`SceneError::Locked`] if another program holds the lock, [`SceneError::File`] if the folder
    /// cannot be written to.
    pub fn take(folder: &Path) -> core::result::Result<Self, SceneError> {
        match within::lock(&folder.join(NAME))? {
            Ok(file) => Ok(Self::held(folder, file)),
            Err(TryLockError::WouldBlock) => Err(SceneError::Locked(holder_message(folder))),
            Err(TryLockError::Error(cause)) => {
                tracing::warn!(
                    "the file system of {folder:?} has no locks ({cause}); do not start a second training in it"
                );
                Ok(Self { folder: folder.to_owned(), file: None })
            }
        }
    }

    /// Locks an existing folder, or only warns if another program holds the lock.
    ///
    /// # Errors
    ///
    /// A folder that cannot be written to.
    pub fn take_or_warn(folder: &Path) -> Result<Self> {
        if let Ok(file) = within::lock(&folder.join(NAME))? {
            return Ok(Self::held(folder, file));
        }
        tracing::warn!("{}; ignoring its lock", holder_message(folder));
        Ok(Self { folder: folder.to_owned(), file: None })
    }

    fn held(folder: &Path, mut file: File) -> Self {
        // The lock holds even if its holder cannot be recorded.
        let _ = sign(&mut file);
        model_folder::remove_unfinished(folder);
        Self { folder: folder.to_owned(), file: Some(file) }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        if let Some(file) = &self.file {
            model_folder::remove_unfinished(&self.folder);
            let _ = file.set_len(0);
        }
    }
}

/// Writes the holder: this program.
fn sign(file: &mut File) -> io::Result<()> {
    let words: Vec<String> = std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
    let holder =
        Holder { pid: std::process::id(), host: host(), started: written(SystemTime::now()), command: words.join(" ") };
    file.set_len(0)?;
    writeln!(file, "{:#}", serde_json::to_value(holder)?)?;
    file.sync_data()
}

/// Time in the format of RFC 3339; years before 1970, from clocks without a battery, become 1970.
fn written(time: SystemTime) -> String {
    humantime::format_rfc3339_seconds(time.max(SystemTime::UNIX_EPOCH)).to_string()
}

/// Host name from files and variables.
fn host() -> String {
    let file = fs::read_to_string("/proc/sys/kernel/hostname").map(|name| name.trim().to_owned());
    let variable = |name: &str| std::env::var(name);
    file.ok().or_else(|| variable("HOSTNAME").or_else(|_| variable("COMPUTERNAME")).ok()).unwrap_or("a machine".into())
}

/// Sentence that names the holder of a folder's lock.
fn holder_message(folder: &Path) -> String {
    let text = FACTS.read(&folder.join(NAME)).unwrap_or_default();
    let holder = match serde_json::from_slice(&text) {
        Ok(Holder { pid, host, started, command }) => {
            let since = humantime::parse_rfc3339(&started).ok().and_then(|start| start.elapsed().ok());
            let since = since.map_or(String::new(), |since| {
                let whole = humantime::format_duration(Duration::from_secs(since.as_secs()));
                format!(", started {whole} ago")
            });
            format!("process {pid} on {host}{since}: {command}")
        }
        Err(_) => "unknown which".to_owned(),
    };
    format!("another training is writing to {folder:?} ({holder})")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_before_1970_are_valid() {
        let before = SystemTime::UNIX_EPOCH - Duration::from_secs(3600);
        assert_eq!(written(before), "1970-01-01T00:00:00Z");
    }

    #[test]
    fn a_folder_has_one_lock_that_names_its_holder() {
        let folder = tempfile::tempdir().expect("a writable folder");
        let unfinished = folder.path().join(".unfinished-x");
        fs::write(&unfinished, "half").expect("a writable folder");
        let lock = Lock::take(folder.path()).expect("nobody holds it");
        assert!(!unfinished.exists(), "unfinished files are removed when a training starts");
        let refused = Lock::take(folder.path()).expect_err("it is held");
        let sentence = refused.to_string();
        let pid = format!("process {} on ", std::process::id());
        assert!(sentence.contains(&pid) && matches!(refused, SceneError::Locked(_)), "{sentence}");
        fs::write(&unfinished, "half").expect("a writable folder");
        drop(Lock::take_or_warn(folder.path()).expect("it is taken anyway"));
        assert!(unfinished.exists(), "another training may be writing it");

        drop(lock);
        assert!(!unfinished.exists(), "and when it ends");
        assert_eq!(fs::read_to_string(folder.path().join(NAME)).expect("it stays"), "", "nobody holds it");
        drop(Lock::take(folder.path()).expect("nobody holds it any more"));
    }
}
