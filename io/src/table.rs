//! The vertices of a PLY file as numbers, whatever types and byte order the file has.

use crate::error::{Error, Result};
use core::fmt::Display;
use ply_rs_bw::{
    parser::{Parser, Reader},
    ply::{DefaultElement, ElementDef, Encoding, Header, PropertyType, ScalarType},
};
use specula_core::scene::BLOCK;
use std::{
    fs::File,
    io::{BufRead, BufReader, ErrorKind, Read},
    path::{Path, PathBuf},
};

/// A PLY file whose header has been read and whose vertices come next.
pub(crate) struct Table {
    path: PathBuf,
    encoding: Encoding,
    vertex: ElementDef,
    reader: Reader<BufReader<File>>,
    /// Comment lines of the header, without the word `comment`.
    pub(crate) comments: Vec<String>,
}

/// Where a number stands in a row, and of which type it is.
#[derive(Clone)]
struct Cell {
    scalar: ScalarType,
    offset: usize,
}

/// Columns in blocks, as [`specula_core::scene::Gaussians`] keeps its planes: a block holds [`BLOCK`] rows, column
/// after column.
pub(crate) struct Columns {
    names: Vec<String>,
    count: usize,
    /// The blocks; the last one is padded with zeros.
    pub(crate) values: Vec<f32>,
}

impl Columns {
    /// `N` neighbouring columns of one row.
    pub(crate) fn get<const N: usize>(&self, row: usize, first_column: usize) -> [f32; N] {
        core::array::from_fn(|k| self.values[self.index_of(row, first_column + k)])
    }

    fn index_of(&self, row: usize, column: usize) -> usize {
        (row / BLOCK * self.names.len() + column) * BLOCK + row % BLOCK
    }

    /// Refuses numbers that are NaN or infinite, naming the first vertex that has one.
    fn refuse_non_finite(&self, path: &Path) -> Result<()> {
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
        let file = File::open(path).map_err(Error::reading(path))?;
        let mut reader = Reader::new(BufReader::with_capacity(1 << 20, file));
        let parser = Parser::<DefaultElement>::new();
        let refuse = |cause: &dyn Display| Error::PlyHeader { path: path.to_owned(), cause: first_line(cause) };

        let header = parser.read_header(&mut reader).map_err(|error| refuse(&error))?;
        refuse_compressed(path, &header)?;
        let vertex = vertex_of(path, &header)?.clone();
        for element in header.elements.values().take_while(|element| element.name != vertex.name) {
            parser.read_payload_for_element(&mut reader, element, &header).map_err(|error| refuse(&error))?;
        }
        Ok(Self { path: path.to_owned(), encoding: header.encoding, vertex, reader, comments: header.comments })
    }

    /// How many vertices the header promises.
    pub(crate) fn count(&self) -> usize {
        self.vertex.count
    }

    /// Names of the columns, in the file's order.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.vertex.properties.keys().map(String::as_str)
    }

    /// Whether there is such a column.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.vertex.properties.contains_key(name)
    }

    /// The largest number that an integer column can hold; 1 for columns of fractions.
    pub(crate) fn full_scale(&self, name: &str) -> f32 {
        match self.vertex.properties.get(name).map(|property| &property.data_type) {
            Some(PropertyType::Scalar(ScalarType::UChar)) => f32::from(u8::MAX),
            Some(PropertyType::Scalar(ScalarType::UShort)) => f32::from(u16::MAX),
            _ => 1.0,
        }
    }

    /// Reads the named columns. `layout` is what an error says is expected.
    pub(crate) fn read(mut self, names: &[String], layout: &'static str) -> Result<Columns> {
        if let Some(name) = names.iter().find(|name| !self.has(name)) {
            return Err(Error::MissingProperty { path: self.path, property: name.clone(), layout });
        }
        self.refuse_an_impossible_count()?;
        let len = self.count().next_multiple_of(BLOCK) * names.len();
        let mut columns = Columns { names: names.to_vec(), count: self.count(), values: vec![0.0; len] };
        match self.encoding {
            Encoding::Ascii => self.read_text(&mut columns)?,
            _ => self.read_binary(&mut columns)?,
        }
        columns.refuse_non_finite(&self.path)?;
        Ok(columns)
    }

    /// Keeps a broken header from asking for more memory than the file could ever fill.
    fn refuse_an_impossible_count(&self) -> Result<()> {
        let size = self.reader.get_ref().get_ref().metadata().map_err(Error::reading(&self.path))?.len();
        let bytes_at_least = match self.encoding {
            Encoding::Ascii => 2,
            _ => 1,
        };
        if (self.count() as u64).saturating_mul(bytes_at_least) <= size {
            return Ok(());
        }
        Err(Error::PlyHeader {
            path: self.path.clone(),
            cause: format!("its header promises {} vertices, more than {size} bytes can hold", self.count()),
        })
    }

    fn read_binary(&mut self, columns: &mut Columns) -> Result<()> {
        let (cells, row_size) = self.cells()?;
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

    /// Reads whole rows, or says how many of them there are.
    fn fill(&mut self, rows: &mut [u8], first: usize, row_size: usize) -> Result<()> {
        let mut filled = 0;
        while filled < rows.len() {
            match self.reader.get_mut().read(&mut rows[filled..]) {
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

    /// All columns of a row, and how long a row is.
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

    fn read_text(&mut self, columns: &mut Columns) -> Result<()> {
        let (cells, _) = self.cells()?;
        let places: Vec<usize> = columns.names.iter().map(|name| self.index(name)).collect();
        let mut line = String::new();
        for row in 0..self.count() {
            self.next_line(&mut line, row)?;
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            if words.len() < cells.len() {
                return Err(self.cut_short(row));
            }
            for (k, place) in places.iter().enumerate() {
                let number = self.number(words[*place], row, &columns.names[k])?;
                let index = columns.index_of(row, k);
                columns.values[index] = number;
            }
        }
        Ok(())
    }

    /// The next line that is not blank.
    fn next_line(&mut self, line: &mut String, index: usize) -> Result<()> {
        loop {
            line.clear();
            let size = self.reader.get_mut().read_line(line).map_err(Error::reading(&self.path))?;
            if size == 0 {
                return Err(self.cut_short(index));
            }
            if !line.trim_ascii().is_empty() {
                return Ok(());
            }
        }
    }

    fn number(&self, text: &str, index: usize, property: &str) -> Result<f32> {
        text.parse().map_err(|_| Error::NotANumber {
            path: self.path.clone(),
            index,
            property: property.to_owned(),
            text: text.to_owned(),
        })
    }
}

/// Decodes one column of some rows. The type is chosen outside of the loop, which the compiler then unrolls.
fn decode(rows: &[u8], row_size: usize, cell: &Cell, big_endian: bool, column: &mut [f32]) {
    macro_rules! numbers {
        ($number:ty) => {{
            const SIZE: usize = size_of::<$number>();
            for (number, row) in column.iter_mut().zip(rows.chunks_exact(row_size)) {
                let bytes: [u8; SIZE] = row[cell.offset..cell.offset + SIZE].try_into().expect("SIZE bytes were taken");
                *number =
                    if big_endian { <$number>::from_be_bytes(bytes) } else { <$number>::from_le_bytes(bytes) } as f32;
            }
        }};
    }
    #[expect(trivial_numeric_casts, reason = "one text for all types, f32 among them")]
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

fn size_of_scalar(scalar: &ScalarType) -> usize {
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

fn vertex_of<'a>(path: &Path, header: &'a Header) -> Result<&'a ElementDef> {
    header.elements.get("vertex").ok_or_else(|| Error::NoVertices { path: path.to_owned() })
}

/// PlayCanvas packs position, rotation, scale and colour of a Gaussian into four integers.
fn refuse_compressed(path: &Path, header: &Header) -> Result<()> {
    let is_packed = |element: &ElementDef| element.properties.keys().any(|name| name.starts_with("packed_"));
    if header.elements.values().any(is_packed) {
        return Err(Error::CompressedPly { path: path.to_owned() });
    }
    Ok(())
}

fn first_line(cause: &dyn Display) -> String {
    cause.to_string().lines().next().unwrap_or_default().trim_end_matches('.').to_owned()
}
