//! Radiance's pictures (`.hdr`) of all orientations and both colour spaces; `image` supports one of
//! each.

use crate::{
    color_space::{Primaries, xyz_from_rgb},
    error::{Error, Result},
    input::Input,
    pixels::{Future, ask_for, with_pixels},
};
use glam::DVec3;
use image::{DynamicImage, ImageFormat, codecs::hdr::HdrDecoder};
use std::io::{BufRead, Cursor, Read};

/// Longest header: a thousand times the common length.
const HEADER_MAX: u64 = 1 << 16;
/// Chromaticities of Radiance's red, green, blue and white.
const PRIMARIES: Primaries = [[0.64, 0.33], [0.29, 0.6], [0.15, 0.06], [1.0 / 3.0, 1.0 / 3.0]];
/// Largest difference of chromaticities of Radiance's and of sRGB's primaries.
const SAME: f64 = 0.025;

/// Header of a picture.
#[derive(Debug)]
pub(crate) struct Header {
    /// Number of scan lines, and of pixels of each.
    lines: [u32; 2],
    /// Axes of the lines and of the pixels, each with its sign.
    axes: [String; 2],
    is_xyz: bool,
    /// Pixel factors and other primaries in the header, which are not applied.
    pub(crate) notes: Vec<String>,
}

impl Header {
    /// Reads a header; returns it with the reader of the pixels.
    pub(crate) fn read(input: Input<'_>) -> Result<(Self, impl Read)> {
        let path = input.path();
        let broken = |cause: &str| Error::Image { path: path.to_owned(), cause: cause.to_owned() };
        let mut reader = input.open()?;
        let mut line = || {
            let mut line = Vec::new();
            reader.by_ref().take(HEADER_MAX).read_until(b'\n', &mut line).map_err(Error::reading(path))?;
            Ok::<_, Error>((!line.is_empty()).then(|| String::from_utf8_lossy(&line).trim().to_owned()))
        };
        let (mut len, mut is_xyz, mut notes) = (0, false, Vec::new());
        loop {
            let text = line()?.filter(|_| len < HEADER_MAX).ok_or_else(|| broken("its header does not end"))?;
            len += text.len() as u64 + 1;
            match text.split_once('=').map(|(key, value)| (key.trim(), value.trim())) {
                None if text.is_empty() => break,
                Some(("FORMAT", "32-bit_rle_xyze")) => is_xyz = true,
                Some(("FORMAT", format)) if format != "32-bit_rle_rgbe" => {
                    return Err(broken(&format!("its format {format:?} is not 32-bit_rle_rgbe or 32-bit_rle_xyze")));
                }
                Some((key, value)) if !is_neutral(key, value) => {
                    notes.push(format!(
                        "{path:?} has {key}={value} in its header, which is not applied; --exposure brightens a light"
                    ));
                }
                _ => {}
            }
        }
        let size = line()?.unwrap_or_default();
        let words: Vec<&str> = size.split_ascii_whitespace().collect();
        let number = |text: &str| text.parse().ok();
        let (lines, axes) = match words.as_slice() {
            [of, rows, along, columns, ..] => (number(rows).zip(number(columns)), [*of, *along]),
            _ => (None, [""; 2]),
        };
        let is_known = |axes: [&str; 2]| {
            axes.iter().all(|axis| ["-X", "+X", "-Y", "+Y"].contains(axis)) && axes[0][1..] != axes[1][1..]
        };
        let lines = lines.filter(|_| is_known(axes));
        let (rows, columns) =
            lines.ok_or_else(|| broken(&format!("its size {size:?} is invalid; an example is -Y 512 +X 1024")))?;
        Ok((Self { lines: [rows, columns], axes: axes.map(str::to_owned), is_xyz, notes }, reader))
    }

    /// Width and height, upright.
    pub(crate) fn size(&self) -> [u32; 2] {
        let [lines, pixels] = self.lines;
        if self.is_sideways() { [lines, pixels] } else { [pixels, lines] }
    }

    /// Whether scan lines are columns.
    fn is_sideways(&self) -> bool {
        self.axes[0].ends_with('X')
    }

    /// The picture with its first line at the top and its first column to the left.
    fn upright(&self, image: DynamicImage) -> DynamicImage {
        let has = |axis: &str| self.axes.iter().any(|known| known == axis);
        let image = if self.is_sideways() { image.rotate90().fliph() } else { image };
        let image = if has("-X") { image.fliph() } else { image };
        if has("+Y") { image.flipv() } else { image }
    }
}

/// Decodes a picture as linear red, green and blue.
pub(crate) fn decode(input: Input<'_>, future: Future) -> Result<DynamicImage> {
    let path = input.path();
    let (header, pixels) = Header::read(input)?;
    let [lines, columns] = header.lines;
    let start = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {lines} +X {columns}\n");
    let reader = Cursor::new(start.into_bytes()).chain(pixels);
    let decoder = HdrDecoder::new(reader).map_err(Error::decoding(path))?;
    ask_for(input, &decoder, Some(ImageFormat::Hdr), future)?;
    let image = DynamicImage::from_decoder(decoder).map_err(Error::decoding(path))?;
    let image = header.upright(with_pixels(path, image)?);
    Ok(if header.is_xyz { rgb_from_xyz(image) } else { image })
}

/// True if a line of a header has no effect on colours.
fn is_neutral(key: &str, value: &str) -> bool {
    let numbers = value.split_ascii_whitespace().map(|word| word.parse().unwrap_or(f64::NAN));
    let within = |expected: f64, number: f64, most: f64| (number - expected).abs() <= most;
    match key {
        "EXPOSURE" | "COLORCORR" => numbers.into_iter().all(|number| within(1.0, number, 1e-6)),
        // Zeros stand for none.
        "PRIMARIES" if numbers.clone().all(|number| number == 0.0) => true,
        "PRIMARIES" => numbers.zip(PRIMARIES.as_flattened()).all(|(number, known)| within(*known, number, SAME)),
        _ => true,
    }
}

/// Converts CIE XYZ to Radiance's red, green and blue, mapping white to white.
fn rgb_from_xyz(image: DynamicImage) -> DynamicImage {
    let rgb_from_xyz = xyz_from_rgb(PRIMARIES).inverse();
    let mut image = image.into_rgb32f();
    for pixel in image.pixels_mut() {
        pixel.0 = (rgb_from_xyz * DVec3::from(pixel.0.map(f64::from))).as_vec3().to_array();
    }
    image.into()
}
