//! Files on disk, and their contents in memory.

use crate::{
    budget::SCENE,
    error::{Error, Result},
    within,
};
use std::{
    borrow::Cow,
    fs::{self, File},
    io::{self, BufReader, Cursor, Read, Seek, SeekFrom},
    path::Path,
};

/// File to read: on disk, or in memory if there is no file system.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    path: &'a Path,
    bytes: Option<&'a [u8]>,
}

impl<'a> Input<'a> {
    /// File at a path.
    pub const fn file(path: &'a Path) -> Self {
        Self { path, bytes: None }
    }

    /// Contents of a file; errors call it `name`.
    pub fn memory(name: &'a str, bytes: &'a [u8]) -> Self {
        Self { path: Path::new(name), bytes: Some(bytes) }
    }

    /// Path, or the name of contents in memory.
    pub const fn path(self) -> &'a Path {
        self.path
    }

    /// True if the file is in a folder.
    pub(crate) const fn is_on_disk(self) -> bool {
        self.bytes.is_none()
    }

    /// Reader from the first byte.
    ///
    /// # Errors
    ///
    /// [`Error::Read`] if the file cannot be opened.
    pub(crate) fn open(self) -> Result<BufReader<Opened<'a>>> {
        Ok(BufReader::new(match self.bytes {
            Some(bytes) => Opened::Memory(Cursor::new(bytes)),
            None => Opened::File(within::open(self.path)?),
        }))
    }

    /// All bytes.
    ///
    /// # Errors
    ///
    /// [`Error::Read`] if the file cannot be read.
    pub(crate) fn bytes(self) -> Result<Cow<'a, [u8]>> {
        match self.bytes {
            Some(bytes) => Ok(bytes.into()),
            None => Ok(SCENE.read(self.path)?.into()),
        }
    }

    /// Length in bytes.
    ///
    /// # Errors
    ///
    /// [`Error::Read`] if the file cannot be read.
    pub(crate) fn len(self) -> Result<u64> {
        match self.bytes {
            Some(bytes) => Ok(bytes.len() as u64),
            None => Ok(fs::metadata(self.path).map_err(Error::reading(self.path))?.len()),
        }
    }
}

/// Open file, or its contents.
#[derive(Debug)]
pub(crate) enum Opened<'a> {
    File(File),
    Memory(Cursor<&'a [u8]>),
}

impl Read for Opened<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::File(file) => file.read(buffer),
            Self::Memory(bytes) => bytes.read(buffer),
        }
    }
}

impl Seek for Opened<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Self::File(file) => file.seek(to),
            Self::Memory(bytes) => bytes.seek(to),
        }
    }
}
