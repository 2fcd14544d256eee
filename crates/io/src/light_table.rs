//! Table of lights: how far the object was turned under its light in each picture.
//!
//! A line has a picture, the name of a group, and the degrees by which the object was turned about
//! the up direction in that group, counterclockwise from above. The picture is named by the end of
//! its path, with or without the extension. Words are separated by spaces or commas; what follows a
//! `#` is a comment.
//!
//! ```text
//! # picture  group   degrees
//! IMG_0001   first         0
//! IMG_0002   first         0
//! IMG_0041   second       90
//! IMG_0042   second       90
//! ```

use crate::{
    budget::LIST,
    error::{Error, Result},
};
use std::{
    collections::{BTreeMap, HashMap},
    path::Path,
};

/// Turns of the object, by picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightTable {
    degrees: HashMap<String, f64>,
}

impl LightTable {
    /// Reads a table.
    ///
    /// # Errors
    ///
    /// [`Error::Place`] for a line of another form, a picture that is named twice, a group with
    /// two angles, or a group of one picture; [`Error::Read`] and [`Error::TooLarge`].
    pub fn read(path: &Path) -> Result<Self> {
        let refuse = |line: usize, what: String| {
            Err(Error::Place { path: path.to_owned(), place: format!("line {}", line + 1), what })
        };
        let text = String::from_utf8_lossy(&LIST.read(path)?).into_owned();
        let (mut degrees, mut groups) = (HashMap::new(), BTreeMap::<String, (usize, f64, usize)>::new());
        for (line, words) in text.lines().enumerate() {
            let words = words.split('#').next().unwrap_or_default();
            let words: Vec<&str> = words.split([' ', '\t', ',']).filter(|word| !word.is_empty()).collect();
            let [picture, group, turn] = match words[..] {
                [] => continue,
                [picture, group, turn] => [picture, group, turn],
                _ => return refuse(line, "has not three words; give picture, group and degrees".into()),
            };
            let Some(turn) = turn.parse::<f64>().ok().filter(|turn| turn.is_finite()) else {
                return refuse(line, format!("has the angle {turn:?}; give the degrees as a number"));
            };
            let (first, angle, count) = groups.entry(group.to_owned()).or_insert((line, turn, 0));
            *count += 1;
            if *angle != turn {
                let what =
                    format!("turns group {group:?} by {turn}°, and line {} by {angle}°; use two groups", *first + 1);
                return refuse(line, what);
            }
            if degrees.insert(stem(picture).to_owned(), turn).is_some() {
                return refuse(line, format!("names {picture:?} again; keep one of the lines"));
            }
        }
        if let Some((group, (line, ..))) = groups.iter().find(|(_, (_, _, count))| *count < 2) {
            return refuse(*line, format!("is all of group {group:?}; a light needs two pictures or more"));
        }
        Ok(Self { degrees })
    }

    /// Degrees by which the object was turned in a picture, with its name in the table: the longest
    /// that its path ends with. `None` for a picture that is not in the table.
    pub fn turn_of(&self, path: &Path) -> Option<(&str, f64)> {
        let path = path.to_string_lossy().replace('\\', "/");
        let whole = stem(&path);
        let mut starts = core::iter::once(0).chain(whole.match_indices('/').map(|(slash, _)| slash + 1));
        let found = starts.find_map(|start| self.degrees.get_key_value(&whole[start..]));
        found.map(|(name, degrees)| (name.as_str(), *degrees))
    }

    /// Names in the table, in their order.
    pub fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.degrees.keys().map(String::as_str).collect();
        names.sort_unstable();
        names
    }
}

/// Name of a picture without the extension of an image and without `./`.
fn stem(name: &str) -> &str {
    const ENDINGS: [&str; 4] = ["png", "jpg", "jpeg", "webp"];
    let name = name.strip_prefix("./").unwrap_or(name);
    match name.rsplit_once('.') {
        Some((stem, ending)) if ENDINGS.contains(&ending.to_ascii_lowercase().as_str()) => stem,
        _ => name,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn read(text: &str) -> core::result::Result<LightTable, String> {
        let folder = tempfile::tempdir().expect("a writable folder");
        let path = folder.path().join("lights.txt");
        fs::write(&path, text).expect("a writable folder");
        LightTable::read(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn tables_name_the_turn_of_each_picture() {
        let table =
            read("# all\na.png one 0\n./b  one 0 # same\n\nrow/c.JPG,two,-90.5\nd,two,-90.5\n").expect("it is one");
        let turn = |path: &str| table.turn_of(Path::new(path));
        assert_eq!(turn("data/images/a.png"), Some(("a", 0.0)));
        assert_eq!(turn("b.jpg"), Some(("b", 0.0)));
        assert_eq!(turn("data/row/c.png"), Some(("row/c", -90.5)));
        assert_eq!([turn("c.png"), turn("data/ad.png"), turn("e")], [None; 3]);
        assert_eq!(table.names(), ["a", "b", "d", "row/c"]);
    }

    #[test]
    fn wrong_tables_are_refused_with_their_line() {
        for (text, parts) in [
            ("a one 0\nb one\n", ["line 2", "three words"]),
            ("a one 0\nb one ?\n", ["line 2", "\"?\""]),
            ("a one inf\n", ["line 1", "number"]),
            ("a one 0\nb one 90\n", ["line 2", "line 1 by 0°"]),
            ("a one 0\na.png one 0\n", ["line 2", "again"]),
            ("a one 0\nb one 0\nc two 5\n", ["line 3", "two pictures"]),
        ] {
            let said = read(text).expect_err("it is wrong");
            assert!(parts.iter().all(|part| said.contains(part)), "{text:?}: {said}");
        }
    }
}
