//! COLMAP's text files: one record on a line, two lines for an image; words are separated by
//! spaces, and comments begin with #.

use super::record::{Camera, Image, KINDS, Kind, Point, refuse, unknown_model};
use crate::{
    budget::COLMAP_LINE_MAX,
    error::{Error, Result},
};
use core::str::FromStr;
use std::{
    fs::File,
    io::{BufRead, BufReader, Read},
    path::Path,
};

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
        let file = File::open(path).map_err(Error::reading(path))?;
        Ok(Self { path, reader: BufReader::new(file), line: Vec::new(), number: 0 })
    }

    /// Reads the next line; false at the end of the file.
    fn next(&mut self) -> Result<bool> {
        self.line.clear();
        self.number += 1;
        let mut reader = self.reader.by_ref().take(COLMAP_LINE_MAX);
        let read = reader.read_until(b'\n', &mut self.line).map_err(Error::reading(self.path))?;
        Ok(read > 0)
    }

    /// Skips the next line.
    fn pass(&mut self) -> Result<()> {
        self.number += 1;
        self.reader.skip_until(b'\n').map_err(Error::reading(self.path)).map(drop)
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

    fn numbers<const N: usize>(&mut self, name: &str) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.number(name)?;
        }
        Ok(numbers)
    }
}

/// Reads `cameras.txt`: identifier, model, width, height, parameters.
pub(super) fn cameras(path: &Path) -> Result<Vec<Camera>> {
    let mut lines = Lines::open(path)?;
    let mut cameras = Vec::new();
    while lines.next_record()? {
        cameras.push(camera(&lines)?);
    }
    Ok(cameras)
}

fn camera(lines: &Lines<'_>) -> Result<Camera> {
    let mut words = lines.words()?;
    let id = words.number("identifier")?;
    let name = words.word("model")?;
    let (width, height) = (words.number("width")?, words.number("height")?);
    let known = KINDS.iter().find(|kind| kind.name == name);
    let model: &'static Kind = known.ok_or_else(|| lines.refuse(unknown_model(name)))?;
    let params: Result<Vec<f64>> = (0..model.params).map(|_| words.number("parameter")).collect();
    Ok(Camera { id, model, width, height, params: params? })
}

/// Reads `images.txt`: identifier, quaternion, translation, camera, name. The line of 2D points
/// below is skipped.
pub(super) fn images(path: &Path) -> Result<Vec<Image>> {
    let mut lines = Lines::open(path)?;
    let mut images = Vec::new();
    while lines.next_record()? {
        images.push(image(&lines)?);
        lines.pass()?;
    }
    Ok(images)
}

fn image(lines: &Lines<'_>) -> Result<Image> {
    let mut words = lines.words()?;
    let _id: u32 = words.number("identifier")?;
    let quat = words.numbers("rotation")?;
    let translation = words.numbers("translation")?;
    let camera = words.number("camera")?;
    if words.rest.is_empty() {
        words.word("name")?;
    }
    // Names may have spaces.
    Ok(Image { quat, translation, camera, name: words.rest.to_owned() })
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
