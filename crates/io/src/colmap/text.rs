//! COLMAP's text files: one line per record, two per image; words are separated by spaces, and
//! comments begin with #.

use super::record::{Camera, Image, KINDS, Kind, Point, Track, refuse, unknown_model};
use crate::{
    budget::COLMAP_LINE_MAX,
    error::{Error, Result},
    within,
};
use core::str::FromStr;
use std::{
    fs::File,
    io::{BufRead, BufReader, Read},
    path::Path,
};

/// Byte order mark, which some editors write.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";
/// Longest line of an image: ten numbers and a name.
const IMAGE_LINE_MAX: u64 = 8192;

/// Reader of lines.
struct Lines<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    line: Vec<u8>,
    /// Line number, from 1.
    number: usize,
}

impl<'a> Lines<'a> {
    fn open(path: &'a Path) -> Result<Self> {
        let file = within::open(path)?;
        Ok(Self { path, reader: BufReader::new(file), line: Vec::new(), number: 0 })
    }

    /// Reads the next line; false at the end of the file.
    fn next(&mut self) -> Result<bool> {
        self.line.clear();
        self.number += 1;
        let mut reader = self.reader.by_ref().take(COLMAP_LINE_MAX);
        let read = reader.read_until(b'\n', &mut self.line).map_err(Error::reading(self.path))?;
        if self.number == 1 && self.line.starts_with(BYTE_ORDER_MARK) {
            self.line.drain(..BYTE_ORDER_MARK.len());
        }
        Ok(read > 0)
    }

    /// Reads the next line, at most as long as an image's record; false at the end of the file.
    fn next_short(&mut self) -> Result<bool> {
        self.line.clear();
        self.number += 1;
        let mut start = self.reader.by_ref().take(IMAGE_LINE_MAX);
        let read = start.read_until(b'\n', &mut self.line).map_err(Error::reading(self.path))?;
        if read as u64 == IMAGE_LINE_MAX && !self.line.ends_with(b"\n") {
            self.line.clear();
            self.reader.skip_until(b'\n').map_err(Error::reading(self.path))?;
        }
        Ok(read > 0)
    }

    /// Reads the next line that is neither blank nor a comment; false at the end of the file.
    fn next_record(&mut self) -> Result<bool> {
        while self.next()? {
            if self.line.trim_ascii().first().is_some_and(|first| *first != b'#') {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Words of the current line.
    fn words(&self) -> Result<Words<'_>> {
        let line = core::str::from_utf8(&self.line).map_err(|_| self.refuse("is not UTF-8; copy the file again"))?;
        Ok(Words { lines: self, rest: line.trim() })
    }

    fn refuse(&self, what: impl Into<String>) -> Error {
        refuse(self.path, format!("line {}", self.number), what)
    }
}

/// Remainder of a line.
struct Words<'a> {
    lines: &'a Lines<'a>,
    rest: &'a str,
}

impl<'a> Words<'a> {
    fn word(&mut self, name: &str) -> Result<&'a str> {
        let (word, rest) = self.rest.split_once(|space: char| space.is_ascii_whitespace()).unwrap_or((self.rest, ""));
        self.rest = rest.trim_start();
        if word.is_empty() { Err(self.lines.refuse(format!("has no {name}; write the model again"))) } else { Ok(word) }
    }

    fn number<T: FromStr>(&mut self, name: &str) -> Result<T> {
        let word = self.word(name)?;
        word.parse().map_err(|_| self.lines.refuse(format!("has {word:?} where its {name} should be")))
    }

    /// Number of pixels; some programs write decimals.
    fn size(&mut self, name: &str) -> Result<u64> {
        let size: f64 = self.number(name)?;
        let is_whole = size >= 0.0 && size.fract() == 0.0;
        if is_whole { Ok(size as u64) } else { Err(self.lines.refuse(format!("has {size} pixels for its {name}"))) }
    }

    fn numbers<const N: usize>(&mut self, name: &str) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.number(name)?;
        }
        Ok(numbers)
    }
}

/// Reads `cameras.txt`: identifier, model, width, height, parameters. Cameras without images may be
/// faulty.
pub(super) fn cameras(path: &Path) -> Result<Vec<(u32, Result<Camera>)>> {
    let mut lines = Lines::open(path)?;
    let mut cameras = Vec::new();
    while lines.next_record()? {
        let mut words = lines.words()?;
        let id = words.number("identifier")?;
        cameras.push((id, camera(words)));
    }
    Ok(cameras)
}

fn camera(mut words: Words<'_>) -> Result<Camera> {
    let name = words.word("model")?;
    let (width, height) = (words.size("width")?, words.size("height")?);
    let known = KINDS.iter().find(|kind| kind.name == name);
    let model: &'static Kind = known.ok_or_else(|| words.lines.refuse(unknown_model(name)))?;
    let count = words.rest.split_ascii_whitespace().count();
    if count != model.params {
        let fault = format!("has {count} parameters; {name} has {} parameters: write the model again", model.params);
        return Err(words.lines.refuse(fault));
    }
    let params: Result<Vec<f64>> = (0..model.params).map(|_| words.number("parameter")).collect();
    Ok(Camera { model, width, height, params: params? })
}

/// Reads `images.txt`: identifier, quaternion, translation, camera, name. The line of 2D points
/// below is skipped; some programs omit it.
pub(super) fn images(path: &Path) -> Result<Vec<Image>> {
    let mut lines = Lines::open(path)?;
    let mut images = Vec::new();
    let mut has_image = lines.next_record()?;
    while has_image {
        images.push(image(&lines)?);
        has_image = lines.next_short()? && is_image(&lines) || lines.next_record()?;
    }
    Ok(images)
}

/// Returns whether a line describes an image: a line of 2D points has numbers only, none of which
/// form a unit quaternion.
fn is_image(lines: &Lines<'_>) -> bool {
    image(lines).is_ok_and(|Image { quat, name, .. }| {
        let is_unit = (quat.iter().map(|number| number * number).sum::<f64>() - 1.0).abs() < 0.1;
        is_unit || name.split_ascii_whitespace().any(|word| word.parse::<f64>().is_err())
    })
}

fn image(lines: &Lines<'_>) -> Result<Image> {
    let mut words = lines.words()?;
    let id = words.number("identifier")?;
    let quat = words.numbers("rotation")?;
    let translation = words.numbers("translation")?;
    let camera = words.number("camera")?;
    if words.rest.is_empty() {
        words.word("name")?;
    }
    // Names may have spaces.
    Ok(Image { id, quat, translation, camera, name: words.rest.to_owned() })
}

/// Reads `points3D.txt`: identifier, position, colour; the rest of a line is ignored.
pub(super) fn points(path: &Path) -> Result<Vec<Point>> {
    let mut lines = Lines::open(path)?;
    let mut points = Vec::new();
    while lines.next_record()? {
        points.push(point(&lines)?);
    }
    Ok(points)
}

fn point(lines: &Lines<'_>) -> Result<Point> {
    let mut words = lines.words()?;
    let _id: u64 = words.number("identifier")?;
    let position = words.numbers("position")?;
    let color = [words.number("red")?, words.number("green")?, words.number("blue")?];
    Ok(Point { position, color })
}

/// Reads `points3D.txt` with tracks: after the colour a reprojection error, then pairs of an image
/// and a 2D point.
pub(super) fn tracks(path: &Path) -> Result<Vec<Track>> {
    let mut lines = Lines::open(path)?;
    let mut tracks = Vec::new();
    while lines.next_record()? {
        let Point { position, .. } = point(&lines)?;
        let mut words = lines.words()?;
        (0..7).try_for_each(|_| words.word("colour").map(drop))?;
        let error = words.number("error")?;
        let ids = words.rest.split_ascii_whitespace().step_by(2).map(str::parse);
        let images = ids.collect::<core::result::Result<Vec<u32>, _>>();
        tracks.push(Track { position, error, images: images.map_err(|_| lines.refuse("has an invalid track"))? });
    }
    Ok(tracks)
}
