//! Pictures for display: renderings, normals, depths and errors in 8 bits, montages and animations.
//!
//! Planes follow [`specula_core::scene::Image`]: one number per pixel, rows from the top.

use crate::{
    error::{Error, Result},
    latlong::{LatLong, ending},
    whole_file,
};
use colorous::Gradient;
use core::time::Duration;
use font8x8::UnicodeFonts;
use image::{
    ExtendedColorType, Frame, GrayImage, ImageEncoder, ImageFormat, Rgb,
    codecs::{self, gif, png::CompressionType},
    imageops,
};
use specula_core::color::srgb_from_linear;
use std::{
    io::{self, Cursor, Write},
    path::Path,
};

pub use image::{DynamicImage, RgbImage, RgbaImage};

/// Coverage up to which a pixel shows the background.
const COVERED: f32 = 0.5;
/// Colour of pixels without normals.
const NO_NORMAL: [u8; 3] = [128; 3];
/// Colour of pixels without depth.
const NO_DEPTH: [u8; 3] = [0; 3];

/// Gap between the images of a montage in pixels.
const GAP_PX: u32 = 4;
/// Pixels of a dot; a letter has 8 × 8 dots.
const DOT_PX: u32 = 2;
/// Height of a caption in pixels.
const CAPTION_PX: u32 = 8 * DOT_PX + 8;
const PAPER: Rgb<u8> = Rgb([255; 3]);
const INK: Rgb<u8> = Rgb([30; 3]);

/// Byte of a number in [0, 1], rounded to nearest; NaN becomes 0.
pub(crate) fn byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

/// Image of three sRGB planes.
pub fn rgb(width: usize, height: usize, planes: &[f32]) -> RgbImage {
    let size = checked_size(width, height, planes, 3);
    image_of(width, height, |pixel| core::array::from_fn(|channel| byte(planes[channel * size + pixel])))
}

/// Image of three sRGB planes and straight alpha.
pub fn rgba(width: usize, height: usize, planes: &[f32], alpha: &[f32]) -> RgbaImage {
    checked_size(width, height, alpha, 1);
    let opaque = rgb(width, height, planes);
    let bytes = opaque.pixels().zip(alpha).flat_map(|(Rgb([r, g, b]), a)| [*r, *g, *b, byte(*a)]).collect();
    RgbaImage::from_raw(width as u32, height as u32, bytes).expect("four bytes a pixel")
}

/// Normals as colours 0.5 + 0.5 n; grey where coverage is at most one half.
pub fn normals(width: usize, height: usize, planes: &[f32], alpha: &[f32]) -> RgbImage {
    let size = checked_size(width, height, planes, 3);
    checked_size(width, height, alpha, 1);
    let color = |pixel: usize| core::array::from_fn(|channel| byte(0.5 + 0.5 * planes[channel * size + pixel]));
    image_of(width, height, |pixel| if alpha[pixel] > COVERED { color(pixel) } else { NO_NORMAL })
}

/// Depths in Google's Turbo colours, red is near, scaled to the range of pixels with coverage above
/// one half.
pub fn depth(width: usize, height: usize, depths: &[f32], alpha: &[f32]) -> RgbImage {
    checked_size(width, height, depths, 1);
    checked_size(width, height, alpha, 1);
    let is_shown = |pixel: usize| alpha[pixel] > COVERED && depths[pixel].is_finite();
    let shown = || (0..depths.len()).filter(|pixel| is_shown(*pixel)).map(|pixel| depths[pixel]);
    let (near, far) = (shown().fold(f32::INFINITY, f32::min), shown().fold(f32::NEG_INFINITY, f32::max));
    let nearness = |depth: f32| (far - depth) / (far - near).max(f32::MIN_POSITIVE);
    image_of(
        width,
        height,
        |pixel| {
            if is_shown(pixel) { gradient(colorous::TURBO, nearness(depths[pixel])) } else { NO_DEPTH }
        },
    )
}

/// Absolute differences of two images in Inferno colours: black is zero, pale yellow is
/// `full_scale` (in [0, 1]) or more.
pub fn error_map(ours: &RgbImage, truth: &RgbImage, full_scale: f32) -> RgbImage {
    assert_eq!(ours.dimensions(), truth.dimensions(), "images of equal size are compared");
    let difference = |(a, b): (&u8, &u8)| f32::from(a.abs_diff(*b)) / 255.0;
    let pairs: Vec<f32> =
        ours.pixels().zip(truth.pixels()).map(|(a, b)| a.0.iter().zip(&b.0).map(difference).sum()).collect();
    image_of(ours.width() as usize, ours.height() as usize, |pixel| {
        gradient(colorous::INFERNO, pairs[pixel] / 3.0 / full_scale)
    })
}

/// Preview of a lat-long map: radiance in sRGB, clipped at 1.
pub fn tone_map_latlong(map: &LatLong) -> RgbImage {
    image_of(map.width, map.height, |pixel| core::array::from_fn(|k| byte(srgb_from_linear(map.rgb[3 * pixel + k]))))
}

/// Downscales an image to an edge of at most `edge` pixels by averaging; smaller images are
/// unchanged.
pub fn within(image: &RgbImage, edge: u32) -> RgbImage {
    let longer = image.width().max(image.height());
    if longer <= edge {
        return image.clone();
    }
    let scaled = |pixels: u32| ((u64::from(pixels) * u64::from(edge) / u64::from(longer)) as u32).max(1);
    imageops::thumbnail(image, scaled(image.width()), scaled(image.height()))
}

/// Turns an image clockwise by multiples of 90°.
pub fn turned_clockwise(image: RgbImage, turns: usize) -> RgbImage {
    (0..turns % 4).fold(image, |image, _| imageops::rotate90(&image))
}

/// Writes three sRGB planes as PNG, with straight alpha if given.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
pub fn write_rgb(path: &Path, width: usize, height: usize, planes: &[f32], alpha: Option<&[f32]>) -> Result<()> {
    match alpha {
        Some(alpha) => write(path, &rgba(width, height, planes, alpha)),
        None => write(path, &rgb(width, height, planes)),
    }
}

/// Writes a plane as a grey PNG.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
pub fn write_gray(path: &Path, width: usize, height: usize, plane: &[f32]) -> Result<()> {
    checked_size(width, height, plane, 1);
    let bytes = plane.iter().map(|value| byte(*value)).collect();
    let image = GrayImage::from_raw(width as u32, height as u32, bytes).expect("a byte a pixel");
    write_png(path, &image.into())
}

/// Writes [`normals`] as PNG.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
pub fn write_normals(path: &Path, width: usize, height: usize, planes: &[f32], alpha: &[f32]) -> Result<()> {
    write(path, &normals(width, height, planes, alpha))
}

/// Writes [`depth`] as PNG.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
pub fn write_depth(path: &Path, width: usize, height: usize, depths: &[f32], alpha: &[f32]) -> Result<()> {
    write(path, &depth(width, height, depths, alpha))
}

/// Writes an image as PNG.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
pub fn write(path: &Path, image: &(impl Clone + Into<DynamicImage>)) -> Result<()> {
    write_png(path, &image.clone().into())
}

/// Encodes an image as PNG, for speed rather than size.
pub fn to_png(image: &RgbImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    let encoder =
        codecs::png::PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, codecs::png::FilterType::Adaptive);
    encode(image, encoder);
    bytes
}

/// Encodes an image as JPEG with `quality` from 1 to 100.
pub fn to_jpeg(image: &RgbImage, quality: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode(image, codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality));
    bytes
}

fn encode(image: &RgbImage, encoder: impl ImageEncoder) {
    let written = encoder.write_image(image.as_raw(), image.width(), image.height(), ExtendedColorType::Rgb8);
    written.expect("memory accepts an image of three bytes a pixel");
}

fn write_png(path: &Path, image: &DynamicImage) -> Result<()> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png).map_err(|error| unwritable(path, error))?;
    whole_file::write_bytes(path, bytes.get_ref())
}

fn unwritable(path: &Path, error: impl core::error::Error + Send + Sync + 'static) -> Error {
    Error::Write { path: path.to_owned(), cause: io::Error::other(error) }
}

fn checked_size(width: usize, height: usize, planes: &[f32], count: usize) -> usize {
    assert_eq!(planes.len(), count * width * height, "{count} planes of {width} by {height} pixels");
    width * height
}

fn image_of(width: usize, height: usize, color: impl Fn(usize) -> [u8; 3]) -> RgbImage {
    let bytes = (0..width * height).flat_map(color).collect();
    RgbImage::from_raw(width as u32, height as u32, bytes).expect("three bytes a pixel")
}

fn gradient(gradient: Gradient, position: f32) -> [u8; 3] {
    gradient.eval_continuous(f64::from(position.clamp(0.0, 1.0))).into_array()
}

/// An image of a montage with its caption.
#[derive(Clone, Debug)]
pub struct Panel {
    /// The image.
    pub image: RgbImage,
    /// Caption; rows without captions reserve no space.
    pub caption: String,
}

impl Panel {
    /// Creates a panel.
    pub fn new(image: RgbImage, caption: impl Into<String>) -> Self {
        Self { image, caption: caption.into() }
    }
}

/// Montage of a row of images without captions.
pub fn side_by_side(images: &[RgbImage]) -> RgbImage {
    montage(&[images.iter().map(|image| Panel::new(image.clone(), "")).collect()])
}

/// Montage of rows of images with captions, from the top.
pub fn montage(rows: &[Vec<Panel>]) -> RgbImage {
    let rows: Vec<RgbImage> = rows.iter().filter(|row| !row.is_empty()).map(|row| row_of(row)).collect();
    let width = rows.iter().map(RgbImage::width).max().unwrap_or(1);
    let height = rows.iter().map(|row| row.height() + GAP_PX).sum::<u32>().saturating_sub(GAP_PX).max(1);
    let mut sheet = RgbImage::from_pixel(width, height, PAPER);
    let mut top = 0;
    for row in rows {
        imageops::replace(&mut sheet, &row, 0, top.into());
        top += row.height() + GAP_PX;
    }
    sheet
}

fn row_of(panels: &[Panel]) -> RgbImage {
    let caption_height = if panels.iter().any(|panel| !panel.caption.is_empty()) { CAPTION_PX } else { 0 };
    let width = panels.iter().map(|panel| panel.image.width() + GAP_PX).sum::<u32>() - GAP_PX;
    let height = caption_height + panels.iter().map(|panel| panel.image.height()).max().unwrap_or(0);
    let mut row = RgbImage::from_pixel(width, height, PAPER);
    let mut left = 0;
    for panel in panels {
        imageops::replace(&mut row, &panel.image, left.into(), caption_height.into());
        write_caption(&mut row, left, panel);
        left += panel.image.width() + GAP_PX;
    }
    row
}

/// Draws the centred caption, truncated to the width of the image.
fn write_caption(row: &mut RgbImage, left: u32, panel: &Panel) {
    let fitting = (panel.image.width() / (8 * DOT_PX)) as usize;
    let letters: Vec<char> = panel.caption.chars().take(fitting).collect();
    let start = left + (panel.image.width() - letters.len() as u32 * 8 * DOT_PX) / 2;
    for (index, letter) in (0..).zip(letters) {
        draw_letter(row, start + index * 8 * DOT_PX, (CAPTION_PX - 8 * DOT_PX) / 2, letter);
    }
}

fn draw_letter(row: &mut RgbImage, left: u32, top: u32, letter: char) {
    let dots = font8x8::BASIC_FONTS.get(letter).or_else(|| font8x8::LATIN_FONTS.get(letter));
    let dots = dots.or_else(|| font8x8::GREEK_FONTS.get(letter)).unwrap_or_default();
    for (x, y) in (0..64).map(|i| (i % 8, i / 8)).filter(|(x, y)| dots[*y as usize] >> x & 1 == 1) {
        for (dx, dy) in (0..DOT_PX * DOT_PX).map(|i| (i % DOT_PX, i / DOT_PX)) {
            row.put_pixel(left + x * DOT_PX + dx, top + y * DOT_PX + dy, INK);
        }
    }
}

/// Writes an endless animation of frames of equal size, each shown for `frame_ms` milliseconds.
///
/// `.png` is an animated PNG in full colour, with alpha if the first frame has it, which every
/// browser plays; `.gif` has 256 colours per frame, and pixels are either opaque
/// or clear.
///
/// # Errors
///
/// [`Error::Ending`] for other extensions, [`Error::Write`] if the file cannot be written.
pub fn write_animation(path: &Path, frames: &[impl Clone + Into<DynamicImage>], frame_ms: u16) -> Result<()> {
    assert!(!frames.is_empty(), "an animation has at least one frame");
    let frames = frames.iter().cloned().map(Into::into);
    let bytes = match ending(path).as_deref() {
        Some("png" | "apng") => animated_png(frames, frame_ms).map_err(|error| unwritable(path, error))?,
        Some("gif") => animated_gif(frames, frame_ms).map_err(|error| unwritable(path, error))?,
        _ => return Err(Error::Ending { path: path.to_owned(), expected: ".png (exact colours) or .gif" }),
    };
    whole_file::write_bytes(path, &bytes)
}

fn animated_png(
    frames: impl ExactSizeIterator<Item = DynamicImage>,
    frame_ms: u16,
) -> core::result::Result<Vec<u8>, png::EncodingError> {
    let count = frames.len() as u32;
    let mut frames = frames.peekable();
    let first = frames.peek().expect("an animation has at least one frame");
    let (size, has_alpha) = ([first.width(), first.height()], first.color().has_alpha());
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, size[0], size[1]);
    encoder.set_color(if has_alpha { png::ColorType::Rgba } else { png::ColorType::Rgb });
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_animated(count, 0)?;
    encoder.set_frame_delay(frame_ms, 1000)?;
    let mut writer = encoder.write_header()?;
    for frame in frames {
        assert_eq!([frame.width(), frame.height()], size, "frames are of equal size");
        let bytes = if has_alpha { frame.into_rgba8().into_raw() } else { frame.into_rgb8().into_raw() };
        writer.write_image_data(&bytes)?;
    }
    writer.finish()?;
    Ok(bytes)
}

fn animated_gif(frames: impl Iterator<Item = DynamicImage>, frame_ms: u16) -> image::ImageResult<Vec<u8>> {
    /// Quality from 1, best, to 30; the encoder's default.
    const SPEED: i32 = 10;
    let mut bytes = Vec::new();
    let mut encoder = gif::GifEncoder::new_with_speed(bytes.by_ref(), SPEED);
    encoder.set_repeat(gif::Repeat::Infinite)?;
    let delay = image::Delay::from_saturating_duration(Duration::from_millis(frame_ms.into()));
    for frame in frames {
        encoder.encode_frame(Frame::from_parts(frame.into_rgba8(), 0, 0, delay))?;
    }
    drop(encoder);
    Ok(bytes)
}
