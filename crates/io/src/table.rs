//! Vertices of a PLY file as numbers, of any type and byte order.

use crate::{
    budget::{PLY_HEADER_MAX, PLY_LINE_MAX, SCENE},
    error::{Error, Result},
    input::Input,
    kinds,
    latlong::start_of,
    within,
};
use core::{fmt::Display, str::FromStr};
use ply_rs_bw::{
    parser::{Parser, Reader},
    ply::{DefaultElement, ElementDef, Encoding, Header, PropertyType, ScalarType},
};
use specula_core::scene::BLOCK;
use std::{
    collections::HashSet,
    fs::File,
    io::{BufRead, BufReader, ErrorKind, Read, Seek},
    path::{Path, PathBuf},
};

/// Name of the element that is read.
const VERTEX: &str = "vertex";
/// Name of the element of meshes.
const FACE: &str = "face";

/// A PLY file, read up to its first vertex.
pub(crate) struct Table {
    path: PathBuf,
    encoding: Encoding,
    vertex: ElementDef,
    reader: BufReader<File>,
    /// Length of the file in bytes.
    len: u64,
    /// Comment lines of the header, without the word `comment`.
    pub(crate) comments: Vec<String>,
    /// Whether the vertices belong to faces.
    pub(crate) has_faces: bool,
    /// Whether nothing follows the vertices.
    is_last: bool,
}

/// Type and byte offset of a number in a row.
#[derive(Clone)]
struct Cell {
    scalar: ScalarType,
    offset: usize,
}

/// Columns in blocks, the layout of [`specula_core::scene::Gaussians`]: a block holds [`BLOCK`]
/// rows, column after column.
pub(crate) struct Columns<T = f32> {
    names: Vec<String>,
    count: usize,
    /// Blocks; the last one is padded with zeros.
    pub(crate) values: Vec<T>,
}

/// Number of a column.
pub(crate) trait Number: Copy + Default + FromStr {
    /// The nearest number.
    fn nearest(number: f64) -> Self;
    /// Returns whether it is finite as an `f32`.
    fn is_finite(self) -> bool;
}

impl Number for f32 {
    fn nearest(number: f64) -> Self {
        number as Self
    }
    fn is_finite(self) -> bool {
        self.is_finite()
    }
}

impl Number for f64 {
    fn nearest(number: f64) -> Self {
        number
    }
    fn is_finite(self) -> bool {
        (self as f32).is_finite()
    }
}

impl<T: Number> Columns<T> {
    /// `N` neighbouring columns of one row.
    pub(crate) fn get<const N: usize>(&self, row: usize, first_column: usize) -> [T; N] {
        core::array::from_fn(|k| self.values[self.index_of(row, first_column + k)])
    }

    /// Sets `N` neighbouring columns of one row.
    pub(crate) fn set<const N: usize>(&mut self, row: usize, first_column: usize, numbers: [T; N]) {
        for (k, number) in numbers.into_iter().enumerate() {
            let index = self.index_of(row, first_column + k);
            self.values[index] = number;
        }
    }

    /// Number of rows.
    pub(crate) const fn count(&self) -> usize {
        self.count
    }

    fn index_of(&self, row: usize, column: usize) -> usize {
        (row / BLOCK * self.names.len() + column) * BLOCK + row % BLOCK
    }

    /// Rejects NaN and infinite numbers, naming the first vertex with one.
    pub(crate) fn refuse_non_finite(&self, path: &Path) -> Result<()> {
        if self.values.iter().all(|number| number.is_finite()) {
            return Ok(());
        }
        let places = (0..self.count).flat_map(|row| (0..self.names.len()).map(move |column| (row, column)));
        let mut bad = places.filter(|(row, column)| !self.values[self.index_of(*row, *column)].is_finite());
        let (index, column) = bad.next().expect("padding is finite");
        let property = self.names[column].clone();
        Err(Error::NotFinite { path: path.to_owned(), index, property, count: 1 + bad.count() })
    }
}

impl Table {
    /// Opens a file and reads up to its first vertex.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        if !start_of(Input::file(path))?.starts_with(b"ply") {
            kinds::refuse(Input::file(path))?;
        }
        let file = within::open(path)?;
        let len = file.metadata().map_err(Error::reading(path))?.len();
        let mut reader = BufReader::with_capacity(1 << 20, file);
        let header = read_header(path, &mut reader)?;
        refuse_repeated_names(path, &mut reader)?;
        let vertex = vertex_of(path, &header)?.clone();
        let after = header.elements.values().skip_while(|element| element.name != VERTEX).skip(1);
        let is_last = after.into_iter().all(|element| element.count == 0);
        let has_faces = header.elements.values().any(|element| element.name == FACE && element.count > 0);
        let (path, comments) = (path.to_owned(), header.comments);
        let mut table = Self { path, encoding: header.encoding, vertex, reader, len, comments, has_faces, is_last };
        for element in header.elements.values().take_while(|element| element.name != VERTEX) {
            table.skip(element)?;
        }
        Ok(table)
    }

    /// Skips an element. An element without properties has no bytes, whatever its count.
    fn skip(&mut self, element: &ElementDef) -> Result<()> {
        if element.properties.is_empty() {
            return Ok(());
        }
        if self.encoding == Encoding::Ascii {
            let mut line = String::new();
            return (0..element.count).try_for_each(|row| self.next_line(&mut line, element, row));
        }
        let sizes = element.properties.values().map(|property| match &property.data_type {
            PropertyType::Scalar(scalar) => Some(size_of_scalar(scalar) as u64),
            PropertyType::List(..) => None,
        });
        match sizes.sum::<Option<u64>>() {
            Some(size) => self.skip_bytes(element, size.saturating_mul(element.count as u64)),
            None => self.skip_lists(element),
        }
    }

    /// Skips the numbers and lists of an element one by one.
    fn skip_lists(&mut self, element: &ElementDef) -> Result<()> {
        for _ in 0..element.count {
            for property in element.properties.values() {
                let size = match &property.data_type {
                    PropertyType::Scalar(scalar) => size_of_scalar(scalar) as u64,
                    PropertyType::List(index, item) => {
                        let count = self.list_len(element, index)?;
                        count.saturating_mul(size_of_scalar(item) as u64)
                    }
                };
                self.skip_bytes(element, size)?;
            }
        }
        Ok(())
    }

    /// Length of a list.
    fn list_len(&mut self, element: &ElementDef, index: &ScalarType) -> Result<u64> {
        let mut bytes = [0; size_of::<u64>()];
        let bytes = &mut bytes[..size_of_scalar(index)];
        self.reader.read_exact(bytes).map_err(|_| self.unfilled(element))?;
        if self.encoding == Encoding::BinaryBigEndian {
            bytes.reverse();
        }
        let is_count = match index {
            ScalarType::Float | ScalarType::Double => false,
            ScalarType::Char | ScalarType::Short | ScalarType::Int => bytes.last().is_none_or(|last| *last < 0x80),
            ScalarType::UChar | ScalarType::UShort | ScalarType::UInt => true,
        };
        let len = bytes.iter().rev().fold(0, |len, byte| len << 8 | u64::from(*byte));
        if is_count { Ok(len) } else { Err(self.broken(format!("a list of its {:?} has no length", element.name))) }
    }

    fn skip_bytes(&mut self, element: &ElementDef, size: u64) -> Result<()> {
        // A step within the buffer is checked by the next read; a longer one against the length of
        // the file.
        if size > self.reader.buffer().len() as u64 && size > self.left()? {
            return Err(self.unfilled(element));
        }
        self.reader.seek_relative(size as i64).map_err(Error::reading(&self.path))
    }

    /// Bytes to the end of the file.
    fn left(&mut self) -> Result<u64> {
        let position = self.reader.stream_position().map_err(Error::reading(&self.path))?;
        Ok(self.len.saturating_sub(position))
    }

    fn unfilled(&self, element: &ElementDef) -> Error {
        let (ElementDef { name, count, .. }, len) = (element, self.len);
        self.broken(format!(
            "its header promises {count} of {name:?}, more than its {len} bytes can hold; copy it again"
        ))
    }

    fn broken(&self, cause: String) -> Error {
        Error::PlyHeader { path: self.path.clone(), cause }
    }

    /// Number of vertices in the header.
    pub(crate) fn count(&self) -> usize {
        self.vertex.count
    }

    /// Names of the columns, in the file's order.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.vertex.properties.keys().map(String::as_str)
    }

    /// Returns whether a column exists.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.vertex.properties.contains_key(name)
    }

    /// Largest number of an integer column; 1 for columns of fractions.
    pub(crate) fn full_scale(&self, name: &str) -> f32 {
        match self.vertex.properties.get(name).map(|property| &property.data_type) {
            Some(PropertyType::Scalar(ScalarType::UChar)) => f32::from(u8::MAX),
            Some(PropertyType::Scalar(ScalarType::UShort)) => f32::from(u16::MAX),
            _ => 1.0,
        }
    }

    /// Returns whether a column has 32-bit floating-point numbers.
    pub(crate) fn is_single(&self, name: &str) -> bool {
        let property = self.vertex.properties.get(name);
        property.is_some_and(|property| property.data_type == PropertyType::Scalar(ScalarType::Float))
    }

    /// Reads the named columns, whose numbers must be finite. `layout` is the expected layout for
    /// error messages.
    pub(crate) fn read<T: Number>(self, names: &[String], layout: &'static str) -> Result<Columns<T>> {
        let path = self.path.clone();
        let columns = self.read_any(names, layout)?;
        columns.refuse_non_finite(&path)?;
        Ok(columns)
    }

    /// [`Table::read`] without the check for finite numbers.
    pub(crate) fn read_any<T: Number>(mut self, names: &[String], layout: &'static str) -> Result<Columns<T>> {
        if let Some(name) = names.iter().find(|name| !self.has(name)) {
            return Err(Error::MissingProperty { path: self.path, property: name.clone(), layout });
        }
        let (cells, row_size) = self.cells()?;
        self.refuse_an_impossible_count(row_size, names.len() * size_of::<T>())?;
        let mut columns = Columns { names: names.to_vec(), count: self.count(), values: Vec::new() };
        match self.encoding {
            Encoding::Ascii => self.read_text(&mut columns, cells.len())?,
            _ => self.read_binary(&mut columns, &cells, row_size)?,
        }
        let left = if self.is_last { self.left()? } else { 0 };
        if left > 0 && self.encoding != Encoding::Ascii {
            tracing::warn!("{:?} has {left} unread bytes after its last vertex", self.path);
        }
        Ok(columns)
    }

    /// Checks the count of the header against the length of the file and the memory budget of a
    /// scene.
    fn refuse_an_impossible_count(&mut self, row_size: usize, wanted: usize) -> Result<()> {
        let (count, left, len) = (self.count() as u64, self.left()?, self.len);
        let least = if self.encoding == Encoding::Ascii { 2 } else { 1 };
        if count.saturating_mul(least) > len {
            let cause = format!("its header promises {count} vertices, more than {len} bytes can hold");
            return Err(self.broken(cause));
        }
        if self.encoding != Encoding::Ascii && count.saturating_mul(row_size as u64) > left {
            return Err(self.cut_short((left / row_size as u64) as usize));
        }
        let wanted = count.saturating_mul(wanted as u64);
        let what = format!("its {count} vertices in {} MiB", len >> 20);
        SCENE.ask(&self.path, len, what, wanted)
    }

    fn read_binary<T: Number>(&mut self, columns: &mut Columns<T>, cells: &[Cell], row_size: usize) -> Result<()> {
        columns.values = vec![T::default(); self.count().next_multiple_of(BLOCK) * columns.names.len()];
        let wanted: Vec<Cell> = columns.names.iter().map(|name| cells[self.index(name)].clone()).collect();
        let big_endian = self.encoding == Encoding::BinaryBigEndian;

        let mut rows = vec![0; BLOCK * row_size];
        for (index, block) in columns.values.chunks_exact_mut(BLOCK * wanted.len()).enumerate() {
            let count = BLOCK.min(self.count() - index * BLOCK);
            let rows = &mut rows[..count * row_size];
            self.fill(rows, index * BLOCK, row_size)?;
            for (column, cell) in block.chunks_exact_mut(BLOCK).zip(&wanted) {
                decode(rows, row_size, cell, big_endian, column);
            }
        }
        Ok(())
    }

    /// Reads whole rows; an error for a truncated file has its number of complete rows.
    fn fill(&mut self, rows: &mut [u8], first: usize, row_size: usize) -> Result<()> {
        let mut filled = 0;
        while filled < rows.len() {
            match self.reader.read(&mut rows[filled..]) {
                Ok(0) => return Err(self.cut_short(first + filled / row_size)),
                Ok(more) => filled += more,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(cause) => return Err(Error::Read { path: self.path.clone(), cause }),
            }
        }
        Ok(())
    }

    fn cut_short(&self, found: usize) -> Error {
        Error::CutShort { path: self.path.clone(), found, expected: self.count() }
    }

    fn index(&self, name: &str) -> usize {
        self.vertex.properties.get_index_of(name).expect("the column was looked for before")
    }

    /// Cells of a row, and the length of a row in bytes.
    fn cells(&self) -> Result<(Vec<Cell>, usize)> {
        let mut offset = 0;
        let mut cells = Vec::with_capacity(self.vertex.properties.len());
        for (name, property) in &self.vertex.properties {
            let PropertyType::Scalar(scalar) = property.data_type.clone() else {
                return Err(Error::ListProperty { path: self.path.clone(), property: name.clone() });
            };
            let size = size_of_scalar(&scalar);
            cells.push(Cell { scalar, offset });
            offset += size;
        }
        Ok((cells, offset))
    }

    /// Memory grows block by block with the lines, because the header's count is not reliable.
    fn read_text<T: Number>(&mut self, columns: &mut Columns<T>, words_in_row: usize) -> Result<()> {
        let places: Vec<usize> = columns.names.iter().map(|name| self.index(name)).collect();
        let vertex = self.vertex.clone();
        let mut line = String::new();
        for row in 0..self.count() {
            self.next_line(&mut line, &vertex, row)?;
            let words: Vec<&str> = line.split_ascii_whitespace().take(words_in_row).collect();
            if words.len() < words_in_row {
                return Err(self.cut_short(row));
            }
            if row.is_multiple_of(BLOCK) {
                columns.values.resize(columns.values.len() + BLOCK * places.len(), T::default());
            }
            for (k, place) in places.iter().enumerate() {
                let number = self.number(words[*place], row, &columns.names[k])?;
                let index = columns.index_of(row, k);
                columns.values[index] = number;
            }
        }
        Ok(())
    }

    /// Reads the next line of an element that is not blank.
    fn next_line(&mut self, line: &mut String, element: &ElementDef, row: usize) -> Result<()> {
        loop {
            line.clear();
            let mut reader = self.reader.by_ref().take(PLY_LINE_MAX);
            let size = reader.read_line(line).map_err(Error::reading(&self.path))? as u64;
            if size == 0 {
                let is_vertex = element.name == VERTEX;
                return Err(if is_vertex { self.cut_short(row) } else { self.unfilled(element) });
            }
            if size == PLY_LINE_MAX {
                return Err(self.broken(format!("a line of its {:?} has more than {size} bytes", element.name)));
            }
            if !line.trim_ascii().is_empty() {
                return Ok(());
            }
        }
    }

    fn number<T: FromStr>(&self, text: &str, index: usize, property: &str) -> Result<T> {
        text.parse().map_err(|_| Error::NotANumber {
            path: self.path.clone(),
            index,
            property: property.to_owned(),
            text: text.to_owned(),
        })
    }
}

/// Decodes one column of some rows. The type is matched outside of the loop, which the compiler
/// then unrolls.
fn decode<T: Number>(rows: &[u8], row_size: usize, cell: &Cell, big_endian: bool, column: &mut [T]) {
    macro_rules! numbers {
        ($number:ty) => {{
            const SIZE: usize = size_of::<$number>();
            for (number, row) in column.iter_mut().zip(rows.chunks_exact(row_size)) {
                let bytes: [u8; SIZE] = row[cell.offset..cell.offset + SIZE].try_into().expect("SIZE bytes were taken");
                let stored = if big_endian { <$number>::from_be_bytes(bytes) } else { <$number>::from_le_bytes(bytes) };
                *number = T::nearest(stored.into());
            }
        }};
    }
    match cell.scalar {
        ScalarType::Char => numbers!(i8),
        ScalarType::UChar => numbers!(u8),
        ScalarType::Short => numbers!(i16),
        ScalarType::UShort => numbers!(u16),
        ScalarType::Int => numbers!(i32),
        ScalarType::UInt => numbers!(u32),
        ScalarType::Float => numbers!(f32),
        ScalarType::Double => numbers!(f64),
    }
}

pub(crate) fn size_of_scalar(scalar: &ScalarType) -> usize {
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// Reads the header up to its longest allowed length.
pub(crate) fn read_header(path: &Path, reader: &mut BufReader<File>) -> Result<Header> {
    let mut reader = Reader::new(reader.take(PLY_HEADER_MAX));
    let read = Parser::<DefaultElement>::new().read_header(&mut reader);
    let is_too_long = reader.get_ref().limit() == 0;
    read.map_err(|error| {
        let too_long = || format!("its header has more than {PLY_HEADER_MAX} bytes");
        let cause = if is_too_long { too_long() } else { first_line(&error) };
        Error::PlyHeader { path: path.to_owned(), cause }
    })
}

fn vertex_of<'a>(path: &Path, header: &'a Header) -> Result<&'a ElementDef> {
    header.elements.get(VERTEX).ok_or_else(|| Error::NoVertices { path: path.to_owned() })
}

/// Rejects a header that names a property of an element twice: the parser keeps one of them, so the
/// row length would be wrong.
fn refuse_repeated_names(path: &Path, reader: &mut BufReader<File>) -> Result<()> {
    let len = reader.stream_position().map_err(Error::reading(path))?;
    reader.rewind().map_err(Error::reading(path))?;
    let mut header = vec![0; len as usize];
    reader.read_exact(&mut header).map_err(Error::reading(path))?;
    let (mut element, mut known) = (String::new(), HashSet::new());
    for line in String::from_utf8_lossy(&header).lines() {
        let mut words = line.split_ascii_whitespace();
        let name = match (words.next(), words.next(), words.next_back()) {
            (Some("element"), Some(name), _) => {
                name.clone_into(&mut element);
                element.clone()
            }
            (Some("property"), _, Some(name)) => format!("{element} {name}"),
            _ => continue,
        };
        if !known.insert(name.clone()) {
            let cause = format!("its header names {name:?} twice; remove one of them");
            return Err(Error::PlyHeader { path: path.to_owned(), cause });
        }
    }
    Ok(())
}

fn first_line(cause: &dyn Display) -> String {
    cause.to_string().lines().next().unwrap_or_default().trim_end_matches('.').to_owned()
}
