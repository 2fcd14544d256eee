//! COLMAP's binary files: a count, then little-endian records.

use super::record::{Camera, Image, KINDS, Point, Track, UNREAD_KINDS, refuse, unknown_model};
use crate::{
    budget::SCENE,
    error::{Error, Result},
    within,
};
use std::{
    fs::File,
    io::{BufRead, BufReader, Read},
    path::Path,
};

/// Longest name of an image in bytes.
const NAME_MAX: u64 = 4096;
/// Smallest records in bytes: a camera without parameters, an image without a name, a point without
/// a track.
const CAMERA_LEN: u64 = 24;
const IMAGE_LEN: u64 = 73;
const POINT_LEN: u64 = 51;
/// Bytes of a 2D point of an image, and of an element of a point's track.
const PLACE_LEN: u64 = 24;
const TRACK_LEN: u64 = 8;

/// Reader of records, with the number of bytes that remain.
struct Records<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    left: u64,
    /// Kind of record, for error messages.
    what: &'static str,
    count: u64,
    index: u64,
}

impl<'a> Records<'a> {
    /// Opens a file that begins with the count of its records, each of at least `len_min` bytes.
    fn open(path: &'a Path, what: &'static str, len_min: u64) -> Result<Self> {
        let file = within::open(path)?;
        let left = file.metadata().map_err(Error::reading(path))?.len();
        let mut records = Self { path, reader: BufReader::new(file), left, what, count: 0, index: 0 };
        records.count = records.u64()?;
        if records.count > records.left / len_min {
            return Err(refuse(
                path,
                "the header",
                format!("promises {} {what}s, more than its bytes can hold; copy the file again", records.count),
            ));
        }
        Ok(records)
    }

    /// Reads all records.
    fn all<T>(mut self, mut read: impl FnMut(&mut Self) -> Result<T>) -> Result<Vec<T>> {
        let wanted = self.count.saturating_mul(size_of::<T>() as u64);
        SCENE.ask(self.path, self.left, format!("its {} {}s", self.count, self.what), wanted)?;
        let mut all = Vec::with_capacity(self.count as usize);
        for index in 0..self.count {
            self.index = index;
            all.push(read(&mut self)?);
        }
        if self.left > 0 {
            tracing::warn!(
                "{:?} has {} unread bytes after its {} {}s; copy the file again if it should have more",
                self.path,
                self.left,
                self.count,
                self.what
            );
        }
        Ok(all)
    }

    fn refuse(&self, what: impl Into<String>) -> Error {
        refuse(self.path, format!("{} {} of {}", self.what, self.index + 1, self.count), what)
    }

    fn cut_short(&self) -> Error {
        self.refuse("is cut short; copy the file again")
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        if self.left < N as u64 {
            return Err(self.cut_short());
        }
        self.reader.read_exact(&mut bytes).map_err(Error::reading(self.path))?;
        self.left -= N as u64;
        Ok(bytes)
    }

    fn u32(&mut self) -> Result<u32> {
        self.bytes().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64> {
        self.bytes().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64> {
        self.bytes().map(f64::from_le_bytes)
    }

    fn numbers<const N: usize>(&mut self) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.f64()?;
        }
        Ok(numbers)
    }

    /// Reads zero-terminated text.
    fn text(&mut self) -> Result<String> {
        let mut bytes = Vec::new();
        let most = self.left.min(NAME_MAX);
        let read = self.reader.by_ref().take(most).read_until(0, &mut bytes).map_err(Error::reading(self.path))?;
        self.left -= read as u64;
        if bytes.pop() != Some(0) {
            return Err(self.refuse("has a name without a terminator; copy the file again"));
        }
        String::from_utf8(bytes).map_err(|_| self.refuse("has a name that is not UTF-8; rename the image"))
    }

    /// Skips a count and that many records of `len` bytes.
    fn pass(&mut self, len: u64) -> Result<()> {
        let count = self.u64()?;
        let size = count.checked_mul(len).filter(|size| *size <= self.left).ok_or_else(|| self.cut_short())?;
        self.reader.seek_relative(size as i64).map_err(Error::reading(self.path))?;
        self.left -= size;
        Ok(())
    }
}

/// Reads `cameras.bin`: identifiers, with cameras or their faults.
pub(super) fn cameras(path: &Path) -> Result<Vec<(u32, Result<Camera>)>> {
    Records::open(path, "camera", CAMERA_LEN)?.all(|records| {
        let (id, number) = (records.u32()?, records.u32()?);
        let (width, height) = (records.u64()?, records.u64()?);
        let known = KINDS.iter().chain(&UNREAD_KINDS).find(|kind| kind.number == number);
        let model = known.ok_or_else(|| records.refuse(unknown_model(&format!("number {number}"))))?;
        let params = (0..model.params).map(|_| records.f64()).collect::<Result<Vec<f64>>>()?;
        let is_read = KINDS.contains(model);
        let camera = is_read.then_some(Camera { model, width, height, params });
        Ok((id, camera.ok_or_else(|| records.refuse(unknown_model(model.name)))))
    })
}

/// Reads `images.bin` without 2D points.
pub(super) fn images(path: &Path) -> Result<Vec<Image>> {
    Records::open(path, "image", IMAGE_LEN)?.all(|records| {
        let id = records.u32()?;
        let (quat, translation) = (records.numbers()?, records.numbers()?);
        let (camera, name) = (records.u32()?, records.text()?);
        records.pass(PLACE_LEN)?;
        Ok(Image { id, quat, translation, camera, name })
    })
}

/// Reads `points3D.bin` without tracks.
pub(super) fn points(path: &Path) -> Result<Vec<Point>> {
    Records::open(path, "point", POINT_LEN)?.all(|records| {
        let _id = records.u64()?;
        let position = records.numbers()?;
        let color = records.bytes()?;
        let _error = records.f64()?;
        records.pass(TRACK_LEN)?;
        Ok(Point { position, color })
    })
}

/// Reads `points3D.bin` with tracks.
pub(super) fn tracks(path: &Path) -> Result<Vec<Track>> {
    Records::open(path, "point", POINT_LEN)?.all(|records| {
        let _id = records.u64()?;
        let position = records.numbers()?;
        let _color: [u8; 3] = records.bytes()?;
        let error = records.f64()?;
        let count = records.u64()?;
        if count > records.left / TRACK_LEN {
            return Err(records.cut_short());
        }
        let mut image = || records.u32().and_then(|image| records.u32().map(|_place| image));
        let images = (0..count).map(|_| image()).collect::<Result<Vec<u32>>>()?;
        Ok(Track { position, error, images })
    })
}
