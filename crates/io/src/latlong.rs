//! Environment light as files: lat-long maps and cube maps of linear radiance, and conversions
//! between them.

use crate::{
    cube::{Cube, floor_and_rest, mix},
    error::{Error, Result},
    exr_decoder::ExrDecoder,
    input::Input,
    pixels::{Future, decode, refuse_many_attributes},
    planes::{self, NamedPlane},
    radiance, whole_file,
};
use core::f64::consts::PI;
use glam::{DQuat, DVec3};
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Rgb, codecs};
use rayon::prelude::*;
use specula_core::{color::linear_from_srgb, cubemap};
use std::{
    io::{self, Read},
    path::Path,
};

/// First bytes of an OpenEXR file.
const OPENEXR: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
/// Replacement of infinite radiance: the largest half float, which most tools write for it.
const LARGEST_HALF: f32 = 65504.0;
/// Largest power of ten that RGBE can represent.
const LARGEST_RGBE: f32 = 1e38;
/// Samples per pixel of the finer map along each axis of a conversion: a single bright pixel then
/// keeps its energy within 1 % on the way to a cube.
const OVERSAMPLING: f64 = 4.0;
/// Maximum number of samples along an edge of a texel; more would take minutes and change nothing.
const SAMPLES_MAX: usize = 64;

/// Three floats per pixel.
const RADIANCE: Future = Future { converted: 12, later: 12 };

/// A lat-long (equirectangular) map of linear radiance.
#[derive(Clone, Debug, PartialEq)]
pub struct LatLong {
    /// Pixels in a row, 360° of azimuth.
    pub width: usize,
    /// Rows, from the zenith to the nadir.
    pub height: usize,
    /// Red, green, blue of each pixel, rows from the top.
    pub rgb: Vec<f32>,
}

/// Counts of invalid values in a file that were replaced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cleaned {
    /// NaN, replaced by 0.
    pub nan: usize,
    /// Infinity, replaced by 65504 or the file's largest finite number if that is larger.
    pub infinite: usize,
    /// Negative numbers, replaced by 0.
    pub negative: usize,
}

impl Cleaned {
    /// Number of replaced values.
    pub fn total(self) -> usize {
        self.nan + self.infinite + self.negative
    }
}

/// World axis at the upper edge of a lat-long map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum UpAxis {
    /// Blender's convention: +z at the upper edge, +x in the centre, y decreasing to the right.
    /// NeRF Synthetic uses it.
    #[default]
    Z,
    /// Convention of GaussianShader and nvdiffrec: +y at the upper edge, −z in the centre, x
    /// increasing to the right.
    Y,
}

impl UpAxis {
    /// Map coordinates (u, v) in [0, 1] of a direction of any length, from the upper left corner.
    pub fn uv(self, direction: [f64; 3]) -> [f64; 2] {
        let [x, y, z] = DVec3::from(direction).normalize().to_array();
        let (turn, up) = match self {
            Self::Z => (-y.atan2(x), z),
            Self::Y => (x.atan2(-z), y),
        };
        [0.5 + turn / (2.0 * PI), up.clamp(-1.0, 1.0).acos() / PI]
    }

    /// Unit direction at map coordinates (u, v).
    pub fn direction(self, [u, v]: [f64; 2]) -> [f64; 3] {
        let (sin_turn, cos_turn) = ((u - 0.5) * 2.0 * PI).sin_cos();
        let (sin_polar, cos_polar) = (v * PI).sin_cos();
        match self {
            Self::Z => [sin_polar * cos_turn, -sin_polar * sin_turn, cos_polar],
            Self::Y => [sin_polar * sin_turn, cos_polar, -sin_polar * cos_turn],
        }
    }
}

/// Orientation of a lat-long map in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MapOrientation {
    /// A convention of the field, along an axis of the world.
    Axis(UpAxis),
    /// A rotated map.
    Rotated {
        /// Convention in the map's frame.
        map: UpAxis,
        /// Rotation from the map's frame to the world.
        world_from_map: DQuat,
    },
}

impl MapOrientation {
    /// Orientation with a given up direction of any length but 0: [`UpAxis::Z`] under the shortest
    /// rotation from +z. For +z and +y it is the [`UpAxis`].
    pub fn with_up(direction: [f64; 3]) -> Self {
        let above = DVec3::from(direction).normalize();
        match [DVec3::Z, DVec3::Y].map(|axis| axis == above) {
            [true, _] => Self::Axis(UpAxis::Z),
            [_, true] => Self::Axis(UpAxis::Y),
            _ => Self::rotated(UpAxis::Z, DQuat::from_rotation_arc(DVec3::Z, above)),
        }
    }

    /// Orientation of a map whose frame is rotated against the world.
    pub fn rotated(map: UpAxis, world_from_map: DQuat) -> Self {
        Self::Rotated { map, world_from_map }
    }

    /// Map coordinates (u, v) in [0, 1] of a direction of any length, from the upper left corner.
    pub fn uv(self, direction: [f64; 3]) -> [f64; 2] {
        match self {
            Self::Axis(up) => up.uv(direction),
            Self::Rotated { map, world_from_map } => {
                map.uv((world_from_map.inverse() * DVec3::from(direction)).to_array())
            }
        }
    }

    /// Unit direction at map coordinates (u, v).
    pub fn direction(self, uv: [f64; 2]) -> [f64; 3] {
        match self {
            Self::Axis(up) => up.direction(uv),
            Self::Rotated { map, world_from_map } => (world_from_map * DVec3::from(map.direction(uv))).to_array(),
        }
    }
}

impl From<UpAxis> for MapOrientation {
    fn from(up: UpAxis) -> Self {
        Self::Axis(up)
    }
}

impl LatLong {
    /// Pixel at a column modulo the width; rows beyond a pole continue on its other side.
    fn pixel(&self, column: isize, row: isize) -> [f32; 3] {
        let (width, height) = (self.width as isize, self.height as isize);
        let (column, row) = match row {
            _ if row < 0 => (column + width / 2, -1 - row),
            _ if row >= height => (column + width / 2, 2 * height - 1 - row),
            _ => (column, row),
        };
        let start = 3 * (row.clamp(0, height - 1) * width + column.rem_euclid(width)) as usize;
        [self.rgb[start], self.rgb[start + 1], self.rgb[start + 2]]
    }

    /// Bilinear lookup at (u, v); pixel centres are at + ½.
    fn sample(&self, [u, v]: [f64; 2]) -> [f32; 3] {
        let (column, across) = floor_and_rest(u * self.width as f64 - 0.5);
        let (row, down) = floor_and_rest(v * self.height as f64 - 0.5);
        let upper = mix(self.pixel(column, row), self.pixel(column + 1, row), across);
        let lower = mix(self.pixel(column, row + 1), self.pixel(column + 1, row + 1), across);
        mix(upper, lower, down)
    }
}

/// Extensions of files of linear radiance.
pub const RADIANCE_ENDINGS: [&str; 2] = ["hdr", "exr"];

/// Reads a map of any format: `.hdr` and `.exr` as linear values, `.png`, `.jpg` and `.webp`
/// decoded from sRGB.
///
/// # Errors
///
/// An error of [`Error`] for files that cannot be read or decoded, or exceed their memory budget.
pub fn read(path: &Path) -> Result<(LatLong, Cleaned)> {
    read_from(Input::file(path))
}

/// [`read`], of a file or of its contents.
///
/// # Errors
///
/// Those of [`read`].
pub fn read_from(input: Input<'_>) -> Result<(LatLong, Cleaned)> {
    let (width, height, mut rgb) = read_linear(input)?;
    let cleaned = clean(&mut rgb);
    Ok((LatLong { width, height, rgb }, cleaned))
}

/// Returns whether a file has a high-dynamic-range format, Radiance or OpenEXR.
///
/// # Errors
/// [`Error::Read`] if the file cannot be read.
pub fn holds_radiance(input: Input<'_>) -> Result<bool> {
    let start = start_of(input)?;
    Ok(is_radiance(&start) || start.starts_with(&OPENEXR))
}

/// Reads the size of a map, width and height in pixels, from its header.
///
/// # Errors
///
/// [`Error::Read`] or [`Error::Image`] for a file that cannot be read or has a format that [`read`]
/// does not support.
pub fn size(input: Input<'_>) -> Result<[u32; 2]> {
    let path = input.path();
    if is_radiance(&start_of(input)?) {
        return Ok(radiance::Header::read(input)?.0.size());
    }
    let format = ImageReader::new(input.open()?).with_guessed_format().map_err(Error::reading(path))?;
    refuse_many_attributes(input, format.format())?;
    let (width, height) = match format.format() {
        Some(ImageFormat::OpenExr) => ExrDecoder::new(input)?.dimensions(),
        _ => format.into_dimensions().map_err(Error::decoding(path))?,
    };
    Ok([width, height])
}

/// Notes on ignored or changed parts of a file in a high-dynamic-range format.
///
/// # Errors
///
/// Those of [`read`].
pub fn notes(input: Input<'_>) -> Result<Vec<String>> {
    let start = start_of(input)?;
    if is_radiance(&start) {
        return Ok(radiance::Header::read(input)?.0.notes);
    }
    if !start.starts_with(&OPENEXR) {
        return Ok(Vec::new());
    }
    refuse_many_attributes(input, Some(ImageFormat::OpenExr))?;
    Ok(ExrDecoder::new(input)?.notes)
}

/// Writes `.hdr` (RGBE, steps of about 1 %) or `.exr` (lossless).
///
/// # Errors
///
/// [`Error::Ending`] for other extensions, [`Error::Write`] if the file cannot be written.
pub fn write(path: &Path, map: &LatLong) -> Result<()> {
    assert_eq!(map.rgb.len(), 3 * map.width * map.height, "a pixel has three numbers");
    match ending(path).as_deref() {
        Some("hdr") => write_hdr(path, map),
        Some("exr") => write_exr(path, map.width, map.height, &map.rgb),
        _ => Err(Error::Ending { path: path.to_owned(), expected: ".hdr or .exr" }),
    }
}

/// Writes the six faces of a cube map, +X −X +Y −Y +Z −Z from the top, losslessly as OpenEXR.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
pub fn write_cube_exr(path: &Path, values: &[f32], resolution: usize) -> Result<()> {
    assert_eq!(values.len(), 18 * resolution * resolution, "six faces of resolution² texels");
    write_exr(path, resolution, 6 * resolution, values)
}

/// Reads six faces in a column. Returns the values, bit for bit, and the resolution.
///
/// # Errors
///
/// [`Error::NotACube`] for other shapes; the errors of [`read`].
pub fn read_cube_exr(path: &Path) -> Result<(Vec<f32>, usize)> {
    cube_from(Input::file(path))
}

/// Reads six faces in a column, from a file or its contents.
pub(crate) fn cube_from(input: Input<'_>) -> Result<(Vec<f32>, usize)> {
    let (width, height, values) = read_linear(input)?;
    if height != 6 * width {
        return Err(Error::NotACube { path: input.path().to_owned(), width, height });
    }
    Ok((values, width))
}

/// Resamples to a cube map, six faces of resolution² texels. Each texel is the mean radiance over
/// its solid angle, so that small bright lights keep their energy.
pub fn to_cube(map: &LatLong, resolution: usize, orientation: impl Into<MapOrientation>) -> Vec<f32> {
    // At the centre of a face a texel spans 2/resolution radians, a pixel 2π/width.
    let pixels_in_texel = map.width as f64 / (PI * resolution as f64);
    cube_of(map, resolution, orientation.into(), sample_count(pixels_in_texel))
}

/// Resamples to a cube map by one bilinear lookup at each texel's centre, as GaussianShader does.
pub fn to_cube_bilinear(map: &LatLong, resolution: usize, up: UpAxis) -> Vec<f32> {
    cube_of(map, resolution, up.into(), 1)
}

/// Resamples a cube map to a lat-long map. Each pixel is the mean radiance over its solid angle.
pub fn from_cube(
    values: &[f32],
    resolution: usize,
    width: usize,
    height: usize,
    orientation: impl Into<MapOrientation>,
) -> LatLong {
    let orientation = orientation.into();
    let texels_in_pixel = PI * resolution as f64 / width as f64;
    let samples = sample_count(texels_in_pixel);
    let cube = Cube::new(values, resolution);
    let mut rgb = vec![0.0; 3 * width * height];
    rgb.par_chunks_mut(3 * width).enumerate().for_each(|(row, pixels)| {
        for (column, pixel) in pixels.chunks_exact_mut(3).enumerate() {
            pixel.copy_from_slice(&mean_over(samples, |x, y| {
                let v = (row as f64 + y) / height as f64;
                let direction = orientation.direction([(column as f64 + x) / width as f64, v]);
                (cube.sample(direction), (v * PI).sin())
            }));
        }
    });
    LatLong { width, height, rgb }
}

/// Radiance of a cube map along directions of any length but 0, bilinear between texel centres.
pub fn radiance_along(values: &[f32], resolution: usize, directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
    let cube = Cube::new(values, resolution);
    directions.par_iter().map(|direction| cube.sample(*direction)).collect()
}

/// Converts a cube map from a z-up to a y-up world: radiance from (x, y, z) arrives from (x, z,
/// −y), the conversion of Blender's scenes. Texels are permuted, not resampled.
pub fn y_up_from_z_up(values: &[f32], resolution: usize) -> Vec<f32> {
    assert_eq!(values.len(), 18 * resolution * resolution, "six faces of resolution² texels");
    let from = |index: usize| {
        let (face, row, column) =
            (index / resolution / resolution, index / resolution % resolution, index % resolution);
        let [x, y, z] = cubemap::texel_direction(face, column, row, resolution);
        let (face, u, v) = cubemap::face_of([x, -z, y]);
        let [column, row] = [u, v].map(|at| (0.5 * (at + 1.0) * resolution as f64) as usize);
        3 * cubemap::texel_index(face, column, row, resolution)
    };
    let texels = (0..values.len() / 3).map(from);
    texels.flat_map(|start| [values[start], values[start + 1], values[start + 2]]).collect()
}

/// Rotates a cube map about a unit axis, counterclockwise seen against the axis: radiance from d
/// arrives from the rotated d. Bilinear between texels; a rotation by zero changes nothing.
pub fn rotated(values: &[f32], resolution: usize, axis: [f64; 3], radians: f64) -> Vec<f32> {
    if radians == 0.0 {
        return values.to_vec();
    }
    let (cube, back) = (Cube::new(values, resolution), DQuat::from_axis_angle(axis.into(), -radians));
    let mut turned = vec![0.0; values.len()];
    turned.par_chunks_mut(3 * resolution).enumerate().for_each(|(line, row_of_texels)| {
        let (face, row) = (line / resolution, line % resolution);
        for (column, texel) in row_of_texels.chunks_exact_mut(3).enumerate() {
            let direction = DVec3::from(cubemap::texel_direction(face, column, row, resolution));
            texel.copy_from_slice(&cube.sample((back * direction).to_array()));
        }
    });
    turned
}

fn sample_count(pixels_in_texel: f64) -> usize {
    ((OVERSAMPLING * pixels_in_texel).ceil() as usize).clamp(1, SAMPLES_MAX)
}

fn cube_of(map: &LatLong, resolution: usize, orientation: MapOrientation, samples: usize) -> Vec<f32> {
    let mut values = vec![0.0; 18 * resolution * resolution];
    values.par_chunks_mut(3 * resolution).enumerate().for_each(|(line, row_of_texels)| {
        let (face, row) = (line / resolution, line % resolution);
        let on_face = |index: usize, part: f64| 2.0 * (index as f64 + part) / resolution as f64 - 1.0;
        for (column, texel) in row_of_texels.chunks_exact_mut(3).enumerate() {
            texel.copy_from_slice(&mean_over(samples, |x, y| {
                let direction = cubemap::direction(face, on_face(column, x), on_face(row, y));
                (map.sample(orientation.uv(direction)), solid_angle_density(direction))
            }));
        }
    });
    values
}

/// Solid angle per unit of area on a face at distance 1: |d|⁻³.
fn solid_angle_density(direction: [f64; 3]) -> f64 {
    DVec3::from(direction).length_squared().powf(-1.5)
}

/// Weighted mean of a colour over the centres of `samples`² cells of the unit square.
fn mean_over(samples: usize, sample: impl Fn(f64, f64) -> ([f32; 3], f64)) -> [f32; 3] {
    let (mut sum, mut total) = ([0.0; 3], 0.0);
    let centre = |i: usize| (i as f64 + 0.5) / samples as f64;
    for (x, y) in (0..samples * samples).map(|i| (centre(i % samples), centre(i / samples))) {
        let (color, weight) = sample(x, y);
        sum = core::array::from_fn(|k| sum[k] + weight * f64::from(color[k]));
        total += weight;
    }
    sum.map(|channel| (channel / total) as f32)
}

fn read_linear(input: Input<'_>) -> Result<(usize, usize, Vec<f32>)> {
    let image =
        if is_radiance(&start_of(input)?) { radiance::decode(input, RADIANCE)? } else { decode(input, RADIANCE)? };
    let (width, height) = (image.width() as usize, image.height() as usize);
    let is_linear = matches!(image, DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_));
    let mut rgb = floats(image);
    if !is_linear {
        rgb.iter_mut().for_each(|value| *value = linear_from_srgb(*value));
    }
    Ok((width, height, rgb))
}

/// Returns whether a file begins like Radiance's: `#?RADIANCE`, or `#?RGBE` from other tools, which
/// `image` would refuse.
fn is_radiance(start: &[u8]) -> bool {
    start.starts_with(b"#?")
}

/// First bytes of a file, enough to recognise its kind; a shorter file is read in full.
pub(crate) fn start_of(input: Input<'_>) -> Result<Vec<u8>> {
    const ENOUGH: u64 = 32;
    let mut start = Vec::new();
    input.open()?.take(ENOUGH).read_to_end(&mut start).map_err(Error::reading(input.path()))?;
    Ok(start)
}

/// Red, green and blue without the clamp to [0, 1] of `image`'s conversions.
fn floats(image: DynamicImage) -> Vec<f32> {
    match image {
        DynamicImage::ImageRgb32F(image) => image.into_raw(),
        DynamicImage::ImageRgba32F(image) => {
            image.pixels().flat_map(|pixel| [pixel.0[0], pixel.0[1], pixel.0[2]]).collect()
        }
        other => other.into_rgb32f().into_raw(),
    }
}

/// Replaces invalid radiance, and counts the replaced values.
fn clean(values: &mut [f32]) -> Cleaned {
    let largest = values.iter().filter(|value| value.is_finite()).fold(LARGEST_HALF, |most, value| most.max(*value));
    let mut cleaned = Cleaned::default();
    for value in values {
        let (count, replacement) = match *value {
            number if number.is_nan() => (&mut cleaned.nan, 0.0),
            number if number == f32::INFINITY => (&mut cleaned.infinite, largest),
            number if number < 0.0 => (&mut cleaned.negative, 0.0),
            _ => continue,
        };
        *count += 1;
        *value = replacement;
    }
    cleaned
}

fn write_hdr(path: &Path, map: &LatLong) -> Result<()> {
    let pixels: Vec<Rgb<f32>> =
        map.rgb.chunks_exact(3).map(|rgb| Rgb(rounded_up_half([rgb[0], rgb[1], rgb[2]]))).collect();
    whole_file::write(path, |out| {
        codecs::hdr::HdrEncoder::new(out).encode(&pixels, map.width, map.height).map_err(io::Error::other)
    })
}

/// Adds half a step of RGBE, since the encoder truncates, which would darken a map by 0.25 %. NaN
/// and negative values become 0, infinity the largest representable number.
fn rounded_up_half(rgb: [f32; 3]) -> [f32; 3] {
    let rgb = rgb.map(|channel| if channel > 0.0 { channel.min(LARGEST_RGBE) } else { 0.0 });
    let largest = rgb[0].max(rgb[1]).max(rgb[2]);
    if largest < f32::MIN_POSITIVE {
        return [0.0; 3];
    }
    let half_step = 2.0_f64.powi(f64::from(largest).log2().floor() as i32 - 8) as f32;
    rgb.map(|channel| channel + half_step)
}

fn write_exr(path: &Path, width: usize, height: usize, rgb: &[f32]) -> Result<()> {
    planes::write_exr(path, width, height, planes_of(rgb))
}

/// Bytes of [`write_cube_exr`], for embedding in another file.
pub(crate) fn cube_exr(path: &Path, values: &[f32], resolution: usize) -> Result<Vec<u8>> {
    planes::exr(path, resolution, 6 * resolution, planes_of(values))
}

/// Bytes of a map as OpenEXR, for embedding in another file.
pub(crate) fn exr(path: &Path, map: &LatLong) -> Result<Vec<u8>> {
    planes::exr(path, map.width, map.height, planes_of(&map.rgb))
}

/// Red, green and blue, without alpha.
fn planes_of(rgb: &[f32]) -> Vec<NamedPlane> {
    let plane = |k: usize| rgb.iter().skip(k).step_by(3).copied().collect();
    vec![("R", plane(0)), ("G", plane(1)), ("B", plane(2))]
}

pub(crate) fn ending(path: &Path) -> Option<String> {
    Some(path.extension()?.to_str()?.to_ascii_lowercase())
}
