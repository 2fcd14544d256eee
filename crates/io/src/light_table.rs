//! Table of lights: under which light each picture was taken, and how far the object was turned.
//!
//! A line of two words has a picture and the name of its light. A line of three words has a
//! picture, the name of a group, and the degrees by which the object was turned about the up
//! direction in that group, counterclockwise from above; all such groups share one light. With a
//! fourth word, the name of a light, only groups that name it do. Pictures under the light `-` are
//! left out. A picture is named by the end of its path, with or without the extension. Words are
//! separated by spaces or commas; what follows a `#` is a comment.
//!
//! ```text
//! # picture  group   degrees            # picture  light
//! IMG_0001   first         0            IMG_0001   noon
//! IMG_0002   first         0            IMG_0002   noon
//! IMG_0041   second       90            IMG_0041   evening
//! IMG_0042   second       90            IMG_0042   evening
//! ```

use crate::{
    budget::LIST,
    error::{Error, Result},
    listing::Listing,
};
use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    path::Path,
};

/// Name of the light of groups that name none.
pub const SHARED: &str = "shared";

/// Light of pictures that are left out.
const LEFT_OUT: &str = "-";

/// Pictures that an error lists.
const LISTED_MAX: usize = 12;

/// First words of a first line that names the columns.
const HEADINGS: [&str; 5] = ["picture", "image", "file", "filename", "name"];

/// Light of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct TableLight {
    /// Name of the light.
    pub name: String,
    /// Degrees by which the object was turned under it; `None` if the table has none.
    pub degrees: Option<f64>,
}

/// Lights by picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightTable {
    lights: HashMap<String, TableLight>,
}

/// A group of pictures: its first line, its light, and the number of its pictures.
struct Group {
    line: usize,
    light: TableLight,
    count: usize,
}

impl LightTable {
    /// Reads a table.
    ///
    /// # Errors
    ///
    /// [`Error::Place`] for a line of another form, a picture that is named twice, a group with
    /// two angles or lights, or a group of one picture; [`Error::Read`] and [`Error::TooLarge`].
    pub fn read(path: &Path) -> Result<Self> {
        let refuse = |line: usize, what: String| {
            Err(Error::Place { path: path.to_owned(), place: format!("line {}", line + 1), what })
        };
        let text = String::from_utf8_lossy(&LIST.read(path)?).into_owned();
        let (mut lights, mut groups) = (HashMap::new(), BTreeMap::<String, Group>::new());
        for (line, words) in text.lines().enumerate() {
            let words = words.split('#').next().unwrap_or_default();
            let words: Vec<&str> = words.split([' ', '\t', ',']).filter(|word| !word.is_empty()).collect();
            let (picture, group, turn, name) = match words[..] {
                [] => continue,
                [heading, ..] if line == 0 && HEADINGS.contains(&heading.to_lowercase().as_str()) => continue,
                [picture, light] => (picture, light, None, light),
                [picture, group, turn] => (picture, group, Some(turn), SHARED),
                [picture, group, turn, light] => (picture, group, Some(turn), light),
                _ => {
                    let what = "does not have two to four words; give picture and light, or picture, group and degrees";
                    return refuse(line, what.into());
                }
            };
            let degrees = turn.map(|turn| turn.parse::<f64>().ok().filter(|turn| turn.is_finite()));
            if degrees == Some(None) {
                let turn = turn.unwrap_or_default();
                return refuse(line, format!("has the angle {turn:?}; give the degrees as a number"));
            }
            let light = TableLight { name: name.to_owned(), degrees: degrees.flatten() };
            let first = Group { line, light: light.clone(), count: 0 };
            let found = groups.entry(group.to_owned()).or_insert(first);
            found.count += 1;
            if found.light != light {
                let (own, other, first) = (described(&light), described(&found.light), found.line + 1);
                return refuse(line, format!("puts group {group:?} {own}, and line {first} {other}; use two groups"));
            }
            if lights.insert(stem(picture).to_owned(), light).is_some() {
                return refuse(line, format!("names {picture:?} again; keep one of the lines"));
            }
        }
        let is_rare = |found: &Group| found.count < 2 && found.light.name != LEFT_OUT;
        if let Some((group, found)) = groups.iter().find(|(_, found)| is_rare(found)) {
            return refuse(found.line, format!("is all of group {group:?}; a light needs two pictures or more"));
        }
        Ok(Self { lights })
    }

    /// Light of a picture, with its name in the table: the longest that its path ends with. `None`
    /// for a picture that is not in the table.
    pub fn light_of(&self, path: &Path) -> Option<(&str, &TableLight)> {
        let path = path.to_string_lossy().replace('\\', "/");
        let whole = stem(&path);
        let mut starts = core::iter::once(0).chain(whole.match_indices('/').map(|(slash, _)| slash + 1));
        let found = starts.find_map(|start| self.lights.get_key_value(&whole[start..]));
        found.map(|(name, light)| (name.as_str(), light))
    }

    /// Leaves pictures of a listing out: those under the light `-`, or those that are not under
    /// `only`.
    ///
    /// # Errors
    ///
    /// [`Error::Lightless`] for pictures that are not in the table, [`Error::NoLight`] if no
    /// picture is left.
    pub(crate) fn select(&self, path: &Path, only: Option<&str>, listing: &mut Listing) -> Result<()> {
        let mut unused: BTreeSet<&str> = self.lights.keys().map(String::as_str).collect();
        let mut lacking = Vec::new();
        for shot in listing.shots() {
            match self.light_of(&shot.image) {
                Some((name, _)) => _ = unused.remove(name),
                None => lacking.push(format!("{:?}", shot.name)),
            }
        }
        if !lacking.is_empty() {
            let others = if lacking.len() > LISTED_MAX { ", …" } else { "" };
            let names = lacking[..lacking.len().min(LISTED_MAX)].join(", ") + others;
            return Err(Error::Lightless { path: path.to_owned(), count: lacking.len(), names });
        }
        if let Some(first) = unused.first() {
            listing.notes.push(format!("{} lines of {path:?} name no picture, such as {first:?}", unused.len()));
        }
        listing.leave_out(|shot| {
            let light = self.light_of(&shot.image).map_or(LEFT_OUT, |(_, light)| &light.name);
            only.map_or(light == LEFT_OUT, |name| light != name)
        });
        if listing.shots().next().is_none() {
            let names: BTreeSet<&str> = self.lights.values().map(|light| light.name.as_str()).collect();
            let lights = names.iter().map(|name| format!("{name:?}")).collect::<Vec<_>>().join(", ");
            return Err(Error::NoLight { path: path.to_owned(), name: only.unwrap_or(LEFT_OUT).into(), lights });
        }
        if !listing.left_out.is_empty() && only.is_none() {
            listing.notes.push(format!("{path:?} leaves {} pictures out", listing.left_out.len()));
        }
        Ok(())
    }
}

/// Light of a group for a message.
fn described(TableLight { name, degrees }: &TableLight) -> String {
    let turn = degrees.map_or(String::new(), |degrees| format!(" by {degrees}°"));
    format!("under {name:?}{turn}")
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
        let table = read("Picture,light\na.png one 0\n./b  one 0 # same\n\nrow/c.JPG,two,-90.5\nd,two,-90.5\n")
            .expect("it is one");
        let turn = |path: &str| table.light_of(Path::new(path)).map(|(name, light)| (name, light.degrees.unwrap()));
        assert_eq!(turn("data/images/a.png"), Some(("a", 0.0)));
        assert_eq!(turn("b.jpg"), Some(("b", 0.0)));
        assert_eq!(turn("data/row/c.png"), Some(("row/c", -90.5)));
        assert_eq!([turn("c.png"), turn("data/ad.png"), turn("e")], [None; 3]);
    }

    #[test]
    fn groups_have_a_light_of_their_own_or_share_one() {
        let table = read("a noon\nb noon\nc turned 90 noon\nd turned 90 noon\ne evening\nf evening\ng x 5\nh x 5\n");
        let table = table.expect("it is one");
        let light = |name: &str| table.light_of(Path::new(name)).map(|(_, light)| (light.name.as_str(), light.degrees));
        assert_eq!(light("b.png"), Some(("noon", None)));
        assert_eq!(light("c"), Some(("noon", Some(90.0))));
        assert_eq!([light("f"), light("g")], [Some(("evening", None)), Some((SHARED, Some(5.0)))]);
    }

    #[test]
    fn wrong_tables_are_refused_with_their_line() {
        for (text, parts) in [
            ("a one 0\nb one\n", ["line 2", "two groups"]),
            ("a\n", ["line 1", "two to four words"]),
            ("a one 0\nb one ?\n", ["line 2", "\"?\""]),
            ("a one inf\n", ["line 1", "number"]),
            ("a one 0\nb one 90\n", ["line 2", "line 1 under \"shared\" by 0°"]),
            ("a one 0\na.png one 0\n", ["line 2", "again"]),
            ("a one 0\nb one 0\nc two 5\n", ["line 3", "two pictures"]),
        ] {
            let said = read(text).expect_err("it is wrong");
            assert!(parts.iter().all(|part| said.contains(part)), "{text:?}: {said}");
        }
    }
}
