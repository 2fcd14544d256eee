//! Photographs, masks and normal maps in memory, and downscaling by area averages.

use crate::{
    budget::{PICTURE, PICTURE_NOTES_MAX},
    color_space::{InputSpace, is_linear_png, to_rec_709},
    error::{Error, Result},
    exr_decoder::ExrDecoder,
    input::Input,
    jpeg,
};
use exr::meta::BlockDescription;
use glam::Vec3;
use half::f16;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits, metadata::Orientation};
use specula_core::color::{UNKNOWN, is_unknown, srgb_from_linear};
use std::{
    io::{BufRead, Read, Seek},
    path::Path,
};

/// Memory of a decoded picture after decoding, in bytes per pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Future {
    /// Bytes after conversion, in addition to the decoded ones.
    pub(crate) converted: u64,
    /// Maximum bytes of later stages, after the decoded ones are freed.
    pub(crate) later: u64,
}

/// RGBA; then sums of five numbers for every fourth pixel if the picture is halved.
const PHOTOGRAPH: Future = Future { converted: 4, later: 10 };
/// RGBA in floats, beside the bytes and halves of a linear picture.
const LINEAR: Future = Future { converted: 16, later: 16 + 10 };
/// Grey and alpha, then a flag.
const MASK: Future = Future { converted: 2, later: 3 };
/// RGBA; then a normal and a flag, and sums of four numbers at another size.
const NORMALS: Future = Future { converted: 4, later: 4 + 13 + NORMALS_RESIZED };
/// Bytes per pixel of resampled normals: sums of four numbers, a normal and a flag.
pub(crate) const NORMALS_RESIZED: u64 = 16 + 13;

/// A photograph: sRGB with straight alpha, in 8 bits and, if it was linear, without a limit at
/// white.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green, blue, alpha of each pixel, rows from the top; [`UNKNOWN`] for masked pixels.
    pub rgba: Vec<u8>,
    /// Unclipped red, green and blue of each pixel ([`specula_core::color::Picture`]).
    pub unclipped: Option<Vec<[f16; 3]>>,
}

/// Largest radiance of a picture: the largest number of a half.
const RADIANCE_MAX: f32 = 65504.0;
/// Least alpha of a pixel with a colour.
const ALPHA_MIN: f32 = 1e-4;

/// Relative tolerance of aspect ratios: downscaled sizes are rounded.
const SHAPE_TOLERANCE: f64 = 0.02;

/// Returns whether pictures of two sizes have the same aspect ratio.
pub(crate) fn have_same_shape([width, height]: [u32; 2], [other_width, other_height]: [u32; 2]) -> bool {
    let ratio = f64::from(width) * f64::from(other_height) / (f64::from(height) * f64::from(other_width));
    // A small picture may be off by a pixel.
    let tolerance = SHAPE_TOLERANCE.max(1.0 / f64::from(width.min(height)));
    (ratio - 1.0).abs() <= tolerance
}

/// A decoded photograph.
pub(crate) struct OpenedPixels {
    /// Pixels at full size, or averaged over squares of them.
    pub(crate) pixels: Pixels,
    /// Width and height at full size.
    pub(crate) size: [u32; 2],
    /// EXIF orientation by which the picture was rotated.
    pub(crate) turned: Orientation,
}

impl OpenedPixels {
    /// Resamples the picture to a size as [`Pixels::resized`] does.
    pub(crate) fn resized(self, [width, height]: [u32; 2]) -> Pixels {
        let found = [self.pixels.width, self.pixels.height];
        if found == self.size {
            return if found == [width, height] { self.pixels } else { self.pixels.resized(width, height) };
        }
        // Squares at the right and lower edges may extend beyond the picture.
        let side = f64::from(self.size[0].div_ceil(found[0]));
        self.pixels.averaged(self.size.map(|size| f64::from(size) / side), [width, height])
    }
}

impl Pixels {
    /// Decodes an image of any format and depth, opaque without an alpha channel. EXIF data are
    /// ignored.
    ///
    /// # Errors
    ///
    /// An error of [`crate::Error`] for files that cannot be read or decoded, or exceed their
    /// memory budget.
    pub fn read(path: &Path) -> Result<Self> {
        Ok(Self::of(decode(Input::file(path), PHOTOGRAPH)?))
    }

    /// Picture of 8 bits.
    pub const fn of_bytes(width: u32, height: u32, rgba: Vec<u8>) -> Self {
        Self { width, height, rgba, unclipped: None }
    }

    /// Decodes an image with the orientation of its camera. `fits` returns whether a size has the
    /// camera's aspect ratio, if that is known. Structure from motion uses pictures as stored; a
    /// picture is therefore rotated by its EXIF orientation only if it fits rotated and not as
    /// stored, or if the camera's size is unknown.
    ///
    /// Pictures to be downscaled by `downscale` are decoded at a lower resolution if the format
    /// allows it.
    pub(crate) fn open(
        path: &Path,
        space: InputSpace,
        downscale: u32,
        fits: impl Fn([u32; 2]) -> Option<bool>,
    ) -> Result<OpenedPixels> {
        let smaller = if space.is_linear(false) { None } else { jpeg::decode_smaller(path, downscale) };
        if let Some((image, size)) = smaller {
            return Ok(OpenedPixels { pixels: Self::of(image), size, turned: Orientation::NoTransforms });
        }
        let Decoded { mut image, orientation, is_linear, is_premultiplied } =
            decode_in(Input::file(path), space, |is_linear| if is_linear { LINEAR } else { PHOTOGRAPH })?;
        let size = [image.width(), image.height()];
        let swapped = if swaps_sides(orientation) { [size[1], size[0]] } else { size };
        let turned = match (fits(size), fits(swapped)) {
            (Some(as_stored), Some(turned)) if as_stored || !turned => Orientation::NoTransforms,
            _ => orientation,
        };
        image.apply_orientation(turned);
        let is_float = matches!(image, DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_));
        let pixels =
            if is_float || is_linear { Self::unclipped(image, is_linear, is_premultiplied) } else { Self::of(image) };
        Ok(OpenedPixels { size: [pixels.width, pixels.height], pixels, turned })
    }

    fn of(image: DynamicImage) -> Self {
        let image = image.into_rgba8();
        let (width, height) = image.dimensions();
        let mut rgba = image.into_raw();
        // Black transparent pixels stored in the file must not read as [`UNKNOWN`].
        rgba.chunks_exact_mut(4).filter(|pixel| is_unknown(pixel)).for_each(|pixel| pixel.copy_from_slice(&EMPTY));
        Self::of_bytes(width, height, rgba)
    }

    /// Picture of linear numbers, or of sRGB's, without a limit at white, up to the largest
    /// half. Pixels with NaN are unknown.
    fn unclipped(image: DynamicImage, is_linear: bool, is_premultiplied: bool) -> Self {
        let image = image.into_rgba32f();
        let (width, height) = image.dimensions();
        let mut pixels = Samples::new(width, height, true);
        for pixel in image.as_raw().as_chunks::<4>().0 {
            let [red, green, blue, alpha] = *pixel;
            let alpha = alpha.clamp(0.0, 1.0);
            let scale = if !is_premultiplied {
                1.0
            } else if alpha < ALPHA_MIN {
                0.0
            } else {
                alpha.recip()
            };
            let number = |number: f32| {
                let number = (number * scale).clamp(0.0, RADIANCE_MAX);
                255.0 * if is_linear { srgb_from_linear(number) } else { number }
            };
            let is_known = pixel.iter().all(|number| !number.is_nan());
            pixels.push(is_known.then(|| [number(red), number(green), number(blue), alpha * 255.0]));
        }
        pixels.done()
    }

    /// Red, green, blue and alpha of a pixel, 255 for white and opaque; `None` if it is unknown.
    fn at(&self, x: usize, y: usize) -> Option<[f32; 4]> {
        let index = y * self.width as usize + x;
        let bytes = &self.rgba[4 * index..][..4];
        let mut pixel = [0, 1, 2, 3].map(|k| f32::from(bytes[k]));
        if let Some(colors) = &self.unclipped {
            pixel[..3].copy_from_slice(&colors[index].map(|number| 255.0 * f32::from(number)));
        }
        (!is_unknown(bytes)).then_some(pixel)
    }

    /// Averages colours over the area of each new pixel, weighted by alpha so that invisible pixels
    /// do not bleed into edges, in sRGB as stored. Unknown pixels have no weight; a new pixel is
    /// unknown if they cover more than half of it.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        self.averaged([self.width, self.height].map(f64::from), [width, height])
    }

    /// Averages a picture whose right and lower edges lie at `from`, in pixels.
    fn averaged(&self, from: [f64; 2], [width, height]: [u32; 2]) -> Self {
        let average =
            |x: usize, y: usize| self.at(x, y).map_or([0.0, 0.0, 0.0, 0.0, 1.0], |pixel| with_zero(premultiply(pixel)));
        let averages = area_average(average, from, [width, height]);
        self.resampled(width, height, averages.into_iter().map(straighten))
    }

    /// Picture of other pixels, with colours of the same kind; `None` for unknown pixels.
    pub(crate) fn resampled(&self, width: u32, height: u32, pixels: impl Iterator<Item = Option<[f32; 4]>>) -> Self {
        let mut samples = Samples::new(width, height, self.unclipped.is_some());
        pixels.for_each(|pixel| samples.push(pixel));
        samples.done()
    }

    /// Colour at a position in pixels from the upper left corner, 255 for white and opaque:
    /// bilinear between the four nearest pixels, weighted by alpha, and `None` outside of the
    /// picture or next to an unknown pixel.
    pub(crate) fn between(&self, [x, y]: [f64; 2]) -> Option<[f32; 4]> {
        let [width, height] = [self.width, self.height].map(f64::from);
        // The comparison is also false for NaN.
        if !(x >= 0.0 && y >= 0.0 && x <= width && y <= height) {
            return None;
        }
        let [x, y] = [(x - 0.5).clamp(0.0, width - 1.0), (y - 0.5).clamp(0.0, height - 1.0)];
        let (left, top) = (x as usize, y as usize);
        let (right, below) = ((left + 1).min(self.width as usize - 1), (top + 1).min(self.height as usize - 1));
        let (across, down) = ((x - left as f64) as f32, (y - top as f64) as f32);
        let corners = [
            (left, top, (1.0 - across) * (1.0 - down)),
            (right, top, across * (1.0 - down)),
            (left, below, (1.0 - across) * down),
            (right, below, across * down),
        ];
        let mut sum = [0.0; 5];
        for (x, y, weight) in corners.into_iter().filter(|(_, _, weight)| *weight > 0.0) {
            let color = premultiply(self.at(x, y)?);
            (0..4).for_each(|k| sum[k] += weight * color[k]);
        }
        straighten(sum)
    }

    /// Number of unknown pixels.
    pub(crate) fn unknown_count(&self) -> usize {
        self.rgba.chunks_exact(4).filter(|pixel| is_unknown(pixel)).count()
    }
}

/// Pixels of a picture, one after the other.
struct Samples(Pixels);

impl Samples {
    fn new(width: u32, height: u32, is_unclipped: bool) -> Self {
        let count = width as usize * height as usize;
        let unclipped = is_unclipped.then(|| Vec::with_capacity(count));
        Self(Pixels { width, height, rgba: Vec::with_capacity(4 * count), unclipped })
    }

    /// Adds a pixel, 255 for white and opaque; `None` for an unknown one.
    fn push(&mut self, pixel: Option<[f32; 4]>) {
        // Conversions saturate, and rounding of transparent pixels must not read as unknown.
        let bytes = pixel.map_or(UNKNOWN, |pixel| pixel.map(|number| (number + 0.5) as u8));
        self.0.rgba.extend(if pixel.is_some() && is_unknown(&bytes) { EMPTY } else { bytes });
        if let Some(colors) = &mut self.0.unclipped {
            let color = |k: usize| f16::from_f32(pixel.map_or(0.0, |pixel| pixel[k] / 255.0));
            colors.push([color(0), color(1), color(2)]);
        }
    }

    fn done(self) -> Pixels {
        self.0
    }
}

fn premultiply([red, green, blue, alpha]: [f32; 4]) -> [f32; 4] {
    let alpha = alpha / 255.0;
    [red * alpha, green * alpha, blue * alpha, alpha]
}

fn with_zero([red, green, blue, alpha]: [f32; 4]) -> [f32; 5] {
    [red, green, blue, alpha, 0.0]
}

/// Converts a mean of premultiplied colours and alphas, with the share of unknown area, to straight
/// alpha; `None` if most of the area is unknown.
fn straighten([red, green, blue, alpha, unknown]: [f32; 5]) -> Option<[f32; 4]> {
    let scale = if alpha > 0.0 { alpha.recip() } else { 0.0 };
    (unknown <= 0.5).then(|| [red * scale, green * scale, blue * scale, alpha / (1.0 - unknown) * 255.0])
}

/// Empty pixel.
pub(crate) const EMPTY: [u8; 4] = [0; 4];

/// Mask of the valid pixels of a photograph.
pub(crate) struct Mask {
    width: u32,
    height: u32,
    counts: Vec<bool>,
}

impl Mask {
    /// Decodes a mask: white opaque pixels are valid, black or transparent ones are not; the
    /// threshold is one half.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        Ok(Self::of(decode(Input::file(path), MASK)?))
    }

    /// Decodes the mask of a photograph of this size that was rotated by an orientation. A mask
    /// that matches only the stored, unrotated photograph is rotated as well.
    ///
    /// # Errors
    ///
    /// [`Error::MaskShape`] for a mask with neither aspect ratio, and those of the file.
    pub(crate) fn for_photograph(path: &Path, size: [u32; 2], turned: Orientation) -> Result<Self> {
        let mut image = decode(Input::file(path), MASK)?;
        let found = [image.width(), image.height()];
        if !have_same_shape(found, size) {
            if !(swaps_sides(turned) && have_same_shape([found[1], found[0]], size)) {
                return Err(Error::MaskShape { path: path.to_owned(), found, expected: size });
            }
            image.apply_orientation(turned);
        }
        Ok(Self::of(image))
    }

    fn of(image: DynamicImage) -> Self {
        const HALF: u32 = 128 * 255;
        let image = image.into_luma_alpha8();
        let (width, height) = image.dimensions();
        let counts = image.as_raw().chunks_exact(2).map(|pixel| u32::from(pixel[0]) * u32::from(pixel[1]) >= HALF);
        Self { width, height, counts: counts.collect() }
    }

    /// Share of the pixels that the mask hides.
    pub(crate) fn hidden_share(&self) -> f64 {
        self.counts.iter().filter(|counts| !**counts).count() as f64 / self.counts.len() as f64
    }

    /// Replaces masked pixels of a picture by `hidden`. A mask of another size is stretched.
    pub(crate) fn applied(&self, mut picture: Pixels, hidden: [u8; 4]) -> Pixels {
        let counts = self.stretched([picture.width, picture.height]);
        for (pixel, _) in picture.rgba.chunks_exact_mut(4).zip(counts).filter(|(_, counts)| !counts) {
            pixel.copy_from_slice(&hidden);
        }
        picture
    }

    /// Removes normals of masked pixels. A mask of another size is stretched.
    pub(crate) fn applied_to_normals(&self, mut normals: Normals) -> Normals {
        let counts = self.stretched([normals.width, normals.height]);
        let pixels = normals.values.iter_mut().zip(&mut normals.mask);
        for ((value, mask), _) in pixels.zip(counts).filter(|(_, counts)| !counts) {
            (*value, *mask) = ([0.0; 3], false);
        }
        normals
    }

    /// Validity of each pixel of a picture of this size, rows from the top.
    fn stretched(&self, size: [u32; 2]) -> impl Iterator<Item = bool> + '_ {
        let [width, height] = size.map(|size| size as usize);
        let column = move |x: usize| x * self.width as usize / width;
        let row = move |y: usize| y * self.height as usize / height * self.width as usize;
        (0..width * height).map(move |index| self.counts[row(index / width) + column(index % width)])
    }
}

/// Ground-truth normals of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct Normals {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Unit normals in world space; zero if there is none.
    pub values: Vec<[f32; 3]>,
    /// True if the pixel has a normal.
    pub mask: Vec<bool>,
}

impl Normals {
    /// Decodes a normal map: n = 2 RGB / 255 − 1, normalised, where alpha is at least one half.
    ///
    /// # Errors
    ///
    /// An error of [`crate::Error`] for files that cannot be read or decoded, or exceed their
    /// memory budget.
    pub fn read(path: &Path) -> Result<Self> {
        let image = decode(Input::file(path), NORMALS)?.into_rgba8();
        let (width, height) = image.dimensions();
        let sums = image.as_raw().chunks_exact(4).map(|pixel| {
            let normal = Vec3::new(pixel[0].into(), pixel[1].into(), pixel[2].into()) * (2.0 / 255.0) - Vec3::ONE;
            if pixel[3] >= 128 { normal.normalize_or_zero().extend(1.0).to_array() } else { [0.0; 4] }
        });
        Ok(Self::from_sums(sums, width, height))
    }

    /// Averages directions over the area of each new pixel, where at least half of that area has
    /// normals.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let weighted = |x: usize, y: usize| {
            let pixel = y * self.width as usize + x;
            let [x, y, z] = self.values[pixel];
            [x, y, z, f32::from(u8::from(self.mask[pixel]))]
        };
        let sums = area_average(weighted, [self.width, self.height].map(f64::from), [width, height]);
        Self::from_sums(sums.into_iter(), width, height)
    }

    /// Normalises sums of normals, given with the share of area that has normals.
    fn from_sums(sums: impl Iterator<Item = [f32; 4]>, width: u32, height: u32) -> Self {
        let unit = |[x, y, z, share]: [f32; 4]| {
            if share >= 0.5 { Vec3::new(x, y, z).normalize_or_zero() } else { Vec3::ZERO }
        };
        let values: Vec<[f32; 3]> = sums.map(|sum| unit(sum).to_array()).collect();
        let mask = values.iter().map(|normal| *normal != [0.0; 3]).collect();
        Self { width, height, values, mask }
    }
}

/// A decoded image, with what its file says of it.
struct Decoded {
    image: DynamicImage,
    /// EXIF orientation.
    orientation: Orientation,
    /// Whether numbers are linear, in Rec. 709's primaries.
    is_linear: bool,
    /// Whether colours are multiplied by alpha.
    is_premultiplied: bool,
}

/// Decodes an image by its content, or else by its extension.
pub(crate) fn decode(input: Input<'_>, future: Future) -> Result<DynamicImage> {
    decode_in(input, InputSpace::Auto, |_| future).map(|decoded| decoded.image)
}

/// Decodes an image in a colour space. `future` is given whether its numbers are linear.
fn decode_in(input: Input<'_>, space: InputSpace, future: impl FnOnce(bool) -> Future) -> Result<Decoded> {
    let path = input.path();
    let mut reader = ImageReader::new(input.open()?);
    if let Ok(format) = ImageFormat::from_path(path) {
        reader.set_format(format);
    }
    let mut reader = reader.with_guessed_format().map_err(Error::reading(path))?;
    let format = reader.format();
    refuse_many_attributes(input, format)?;
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(PICTURE_NOTES_MAX);
    reader.limits(limits.clone());
    let (mut primaries, mut says_linear) = (None, false);
    let mut decoder: Box<dyn ImageDecoder + '_> = match format {
        Some(ImageFormat::OpenExr) => {
            let decoder = ExrDecoder::new(input)?;
            (primaries, says_linear) = (decoder.primaries(), true);
            Box::new(decoder)
        }
        _ => Box::new(reader.into_decoder().map_err(Error::decoding(path))?),
    };
    limits.max_alloc = Some(PICTURE.of(input.len()?));
    says_linear |= format == Some(ImageFormat::Png) && is_linear_png(input)?;
    let is_linear = space.is_linear(says_linear);
    let taken = ask_for(input, &decoder, format, future(is_linear))?;
    limits.reserve(taken).map_err(Error::decoding(path))?;
    decoder.set_limits(limits).map_err(Error::decoding(path))?;
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let image = DynamicImage::from_decoder(decoder).map_err(Error::decoding(path))?;
    let image = with_pixels(path, image)?;
    let image = if is_linear { to_rec_709(image, space.primaries(primaries)) } else { image };
    Ok(Decoded { image, orientation, is_linear, is_premultiplied: format == Some(ImageFormat::OpenExr) })
}

/// Checks the memory of decoding, conversion and downscaling against the budget. Returns the
/// decoded bytes.
pub(crate) fn ask_for(
    input: Input<'_>,
    decoder: &impl ImageDecoder,
    format: Option<ImageFormat>,
    future: Future,
) -> Result<u64> {
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    let stored = u64::from(decoder.color_type().bytes_per_pixel());
    // Rotation holds two copies.
    let beside = working_bytes(format, stored).max(future.converted).max(stored);
    let most = (stored + beside).max(future.later);
    let blocks = if format == Some(ImageFormat::OpenExr) { blocks_of(input)? } else { 0 };
    let wanted = pixels.saturating_mul(most).saturating_add(blocks);
    PICTURE.ask(input.path(), input.len()?, format!("a picture of {width} by {height} pixels"), wanted)?;
    if format == Some(ImageFormat::Jpeg) {
        jpeg::refuse_broken_scans(input)?;
    }
    Ok(decoder.total_bytes())
}

/// Working memory of a decoder in bytes per pixel, in addition to its output.
fn working_bytes(format: Option<ImageFormat>, stored: u64) -> u64 {
    match format {
        // Coefficients of four channels.
        Some(ImageFormat::Jpeg) => 8,
        // The frame and the canvas below it.
        Some(ImageFormat::WebP | ImageFormat::Gif) => 8,
        // A second copy.
        Some(ImageFormat::OpenExr) => stored,
        _ => 0,
    }
}

/// Memory of the blocks of an OpenEXR file that are decoded at once, and of all block offsets.
/// Blocks may be far larger than the picture. Invalid headers are left to the decoder.
fn blocks_of(input: Input<'_>) -> Result<u64> {
    /// Compressed and decompressed, on two threads.
    const AT_ONCE: u64 = 4;
    /// Bytes of an offset, in the file and sorted.
    const PLACE: u64 = 16;
    let headers =
        exr::meta::MetaData::read_from_buffered(input.open()?, false).map(|file| file.headers).unwrap_or_default();
    let mut most = 0;
    for header in &headers {
        let size = header.layer_size;
        let bytes = (size.area() as u64).saturating_mul(header.channels.bytes_per_pixel as u64);
        PICTURE.ask(input.path(), input.len()?, format!("a layer of {} by {} pixels", size.0, size.1), bytes)?;
        let places = (header.chunk_count as u64).saturating_mul(PLACE);
        most = most.max(bytes_of_block(header).saturating_mul(AT_ONCE).saturating_add(places));
    }
    Ok(most)
}

/// Rejects an OpenEXR file with more attributes than any program writes: each takes hundreds of
/// bytes of memory, several times. Truncated headers are left to the decoder.
pub(crate) fn refuse_many_attributes(input: Input<'_>, format: Option<ImageFormat>) -> Result<()> {
    const MOST: usize = 4096;
    if format != Some(ImageFormat::OpenExr) {
        return Ok(());
    }
    match attributes(&mut input.open()?, MOST) {
        Ok(count) if count > MOST => {
            Err(Error::Image { path: input.path().to_owned(), cause: format!("it has more than {MOST} attributes") })
        }
        _ => Ok(()),
    }
}

/// Number of attributes in all headers of an OpenEXR file. Counting ends beyond `most`.
fn attributes(reader: &mut (impl BufRead + Seek), most: usize) -> std::io::Result<usize> {
    const MULTIPLE_PARTS: u32 = 1 << 12;
    let mut start = [0; 8];
    reader.read_exact(&mut start)?;
    let [.., a, b, c, d] = start;
    let has_parts = u32::from_le_bytes([a, b, c, d]) & MULTIPLE_PARTS != 0;
    let (mut count, mut is_header_empty) = (0, true);
    while count <= most {
        // An attribute is a name, a type, a length and a value. An empty name ends a header, an
        // empty header the list.
        if skip_text(reader)? == 0 {
            if is_header_empty || !has_parts {
                break;
            }
            is_header_empty = true;
            continue;
        }
        (count, is_header_empty) = (count + 1, false);
        skip_text(reader)?;
        let mut len = [0; 4];
        reader.read_exact(&mut len)?;
        reader.seek_relative(i32::from_le_bytes(len).max(0).into())?;
    }
    Ok(count)
}

/// Skips a zero-terminated text and returns its length.
fn skip_text(reader: &mut impl BufRead) -> std::io::Result<usize> {
    let mut text = Vec::new();
    reader.take(256).read_until(0, &mut text)?;
    Ok(text.strip_suffix(&[0]).map_or(text.len(), <[u8]>::len))
}

fn bytes_of_block(header: &exr::meta::header::Header) -> u64 {
    let pixels = match header.blocks {
        BlockDescription::Tiles(tiles) => tiles.tile_size.0 as u64 * tiles.tile_size.1 as u64,
        BlockDescription::ScanLines => header.compression.scan_lines_per_block() as u64 * header.layer_size.0 as u64,
    };
    pixels.saturating_mul(header.channels.bytes_per_pixel as u64)
}

fn swaps_sides(orientation: Orientation) -> bool {
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    matches!(orientation, Rotate90 | Rotate270 | Rotate90FlipH | Rotate270FlipH)
}

pub(crate) fn with_pixels(path: &Path, image: DynamicImage) -> Result<DynamicImage> {
    if image.width() == 0 || image.height() == 0 {
        return Err(Error::EmptyImage { path: path.to_owned() });
    }
    Ok(image)
}

/// Averages over the area of each new pixel, by columns, then rows, one row at a time, so that no
/// buffer of the old size is needed.
fn area_average<const N: usize>(
    pixel: impl Fn(usize, usize) -> [f32; N],
    [width, height]: [f64; 2],
    to: [u32; 2],
) -> Vec<[f32; N]> {
    let [new_width, new_height] = to.map(|size| size as usize);
    let columns = spans(width, new_width);
    let mut averages = vec![[0.0; N]; new_width * new_height];
    for (sums, rows) in averages.chunks_exact_mut(new_width).zip(spans(height, new_height)) {
        for (y, share) in (rows.first..).zip(&rows.shares) {
            for (sum, span) in sums.iter_mut().zip(&columns) {
                let narrow = span.sum(|x| pixel(x, y));
                *sum = core::array::from_fn(|k| sum[k] + share * narrow[k]);
            }
        }
    }
    averages
}

/// Old pixels that overlap a new one along one axis, with weights that sum to one.
struct Span {
    first: usize,
    shares: Vec<f32>,
}

impl Span {
    fn sum<const N: usize>(&self, pixel: impl Fn(usize) -> [f32; N]) -> [f32; N] {
        let mut sum = [0.0; N];
        for (offset, share) in self.shares.iter().enumerate() {
            let pixel = pixel(self.first + offset);
            sum = core::array::from_fn(|k| sum[k] + share * pixel[k]);
        }
        sum
    }
}

fn spans(from: f64, to: usize) -> Vec<Span> {
    let ratio = from / to as f64;
    let span = |i: usize| {
        let (start, end) = (i as f64 * ratio, ((i + 1) as f64 * ratio).min(from));
        let (first, last) = (start as usize, end.ceil() as usize);
        let overlap = |pixel: usize| (end.min((pixel + 1) as f64) - start.max(pixel as f64)).max(0.0);
        Span { first, shares: (first..last).map(|pixel| (overlap(pixel) / (end - start)) as f32).collect() }
    };
    (0..to).map(span).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixels(width: u32, height: u32, rgba: &[[u8; 4]]) -> Pixels {
        Pixels::of_bytes(width, height, rgba.concat())
    }

    #[test]
    fn attributes_of_all_headers_are_counted_until_there_are_too_many() {
        let header = |count: usize| [b"name\0type\0\x01\0\0\0x".repeat(count), vec![0]].concat();
        let file = |flags: u32, headers: &[Vec<u8>]| {
            let start = [0x76, 0x2f, 0x31, 0x01].into_iter().chain(flags.to_le_bytes());
            start.chain(headers.concat()).collect::<Vec<u8>>()
        };
        let count = |bytes: Vec<u8>| attributes(&mut std::io::Cursor::new(bytes), 10).ok();
        assert_eq!(count(file(2, &[header(7), header(3)])), Some(7), "one header, then offsets");
        assert_eq!(count(file(2 | 1 << 12, &[header(4), header(3), header(0)])), Some(7), "two parts");
        assert_eq!(count(file(2, &[header(100)])), Some(11), "counting stops at the limit");
        assert_eq!(count(file(2, &[header(3)])[..20].to_vec()), None, "a header that ends too soon");
    }

    #[test]
    fn invisible_pixels_do_not_bleed() {
        let edge = pixels(2, 1, &[[200, 100, 50, 255], [0, 255, 0, 0]]);
        assert_eq!(edge.resized(1, 1).rgba, [200, 100, 50, 128]);
    }

    #[test]
    fn a_constant_image_stays_constant_at_any_size() {
        let constant = pixels(7, 5, &[[10, 20, 30, 200]; 35]);
        assert_eq!(constant.resized(3, 2), pixels(3, 2, &[[10, 20, 30, 200]; 6]));
    }

    #[test]
    fn unknown_pixels_have_no_weight() {
        let row = pixels(4, 1, &[[200, 100, 50, 255], UNKNOWN, [90, 80, 70, 128], [90, 80, 70, 128]]);
        assert_eq!(row.resized(2, 1).rgba, [[200, 100, 50, 255], [90, 80, 70, 128]].concat());
        let row = pixels(3, 1, &[UNKNOWN, [9; 4], UNKNOWN]);
        assert_eq!(row.resized(1, 1).rgba, UNKNOWN);
        assert_eq!((row.between([1.5, 0.5]), row.between([1.2, 0.5])), (Some([9.0; 4]), None));
        assert_eq!((row.between([-0.1, 0.5]), row.between([f64::NAN, 0.5])), (None, None));
    }

    #[test]
    fn each_new_pixel_is_the_mean_of_its_block() {
        let rgba: Vec<[u8; 4]> = (0..16).map(|i| [10 * i, 0, 0, 255]).collect();
        let half = pixels(4, 4, &rgba).resized(2, 2);
        let red: Vec<u8> = half.rgba.chunks(4).map(|pixel| pixel[0]).collect();
        assert_eq!(red, [25, 45, 105, 125]);
    }

    #[test]
    fn fractional_borders_share_their_pixel() {
        let row = pixels(3, 1, &[[0, 0, 0, 255], [90, 0, 0, 255], [240, 0, 0, 255]]);
        let shrunk = row.resized(2, 1);
        assert_eq!([shrunk.rgba[0], shrunk.rgba[4]], [30, 190]);
    }

    #[test]
    fn known_normals_are_averaged() {
        let normals = Normals {
            width: 2,
            height: 2,
            values: vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0; 3], [0.0; 3]],
            mask: vec![true, true, false, false],
        };
        let shrunk = normals.resized(1, 1);
        assert!(shrunk.mask[0], "half of the area has normals");
        assert!((Vec3::from(shrunk.values[0]) - Vec3::new(0.5, 0.5, 0.0).normalize()).length() < 1e-6);
    }
}
