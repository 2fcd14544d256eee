//! Plain Gaussians as `.spz`, Niantic's compressed format: versions 2 to 4 are read, version 3 is
//! written.
//!
//! Versions 2 and 3 are a gzip stream of a header of 16 bytes and one array for each attribute
//! (github.com/nianticlabs/spz, README):
//!
//! | array | numbers |
//! |---|---|
//! | means | 24-bit fixed point, as many bits behind the point as the header says |
//! | opacities | bytes, 255 σ(opacity) |
//! | colours | bytes, 255 (0.15 f_dc + ½) |
//! | scales | bytes, 16 (ln s + 10) |
//! | rotations | 32 bits: index of the largest of (x, y, z, w); the others, 10 bits each, ± √½ |
//! | harmonics | bytes, 128 + 128 f_rest, colours innermost |
//!
//! Version 2 has rotations of three bytes: x, y and z of a quat with w ≥ 0, as 127.5 (q + 1).
//! Version 4 is not compressed as a whole: after a header of 32 bytes, a table has the compressed
//! and the full length of each array, which is a Zstandard frame of its own.
//!
//! Positions are in the scene's own world; the format defines no other.

use crate::{
    budget::{PACKED, SCENE},
    error::{Error, Result},
    gaussian_ply::GaussianFile,
    splat::{byte, unit},
    whole_file,
};
use core::{f32::consts::FRAC_1_SQRT_2, fmt};
use flate2::{Compression, read::GzDecoder, write::GzEncoder};
use ruzstd::decoding::StreamingDecoder;
use specula_core::{
    activation::{logit, sigmoid},
    antialias::LowPass,
    scene::{Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT, len_of_values},
};
use std::{
    borrow::Cow,
    io::{Read, Write},
    path::Path,
};

const MAGIC: u32 = 0x5053_474e;
/// Version that is written.
const VERSION: u32 = 3;
/// Version with rotations of three bytes.
const VERSION_OF_BYTES: u32 = 2;
/// Version whose arrays are compressed one by one.
const VERSION_OF_FRAMES: u32 = 4;
/// Bytes of the header up to version 3, and of the part that later ones share.
const HEADER_LEN: usize = 16;
/// First bytes of a gzip stream.
const GZIP: [u8; 2] = [0x1f, 0x8b];
/// Flag of a training with compensated opacities.
const ANTIALIASED: u8 = 1;
/// Number of arrays.
const ARRAYS: usize = 6;
/// Factor of colours, which leaves headroom beyond the displayable range.
const COLOR_SCALE: f32 = 0.15;
/// Bits of the largest coordinate.
const MEAN_BITS: i32 = 16;
/// Maximum number of fractional bits; more would leave too few integer bits.
const FRACTION_MAX: i32 = 20;
/// Largest magnitude of the three smaller components of a quat.
const QUAT_STEPS: f32 = 511.0;

/// Numbers of a file: the arrays of [`self`], and facts of the header.
struct Packed {
    count: usize,
    layout: Layout,
    fraction_bits: i32,
    /// Bytes of a rotation: 3 or 4.
    quat_len: usize,
    /// Means, opacities, colours, scales, rotations, harmonics.
    arrays: [Vec<u8>; ARRAYS],
}

/// Header of a file of any version.
struct Header {
    version: u32,
    count: usize,
    sh_degree: u8,
    fraction_bits: i32,
    flags: u8,
    /// Number of arrays in version 4.
    arrays: usize,
}

impl Header {
    fn read(bytes: &[u8]) -> core::result::Result<Self, String> {
        let Some((header, _)) = bytes.split_first_chunk::<HEADER_LEN>() else {
            return Err("it is too short for a header".to_owned());
        };
        let word = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
        let [sh_degree, bits, flags, arrays] = [header[12], header[13], header[14], header[15]];
        let (version, count) = (word(4), word(8) as usize);
        if word(0) != MAGIC {
            return Err("its header is not that of the format".to_owned());
        }
        if !(VERSION_OF_BYTES..=VERSION_OF_FRAMES).contains(&version) {
            return Err(format!("it has version {version}; versions 2 to 4 are read, so convert it"));
        }
        if sh_degree > 3 || bits > 24 {
            return Err(format!("its header has harmonics of degree {sh_degree} and {bits} fractional bits"));
        }
        Ok(Self { version, count, sh_degree, fraction_bits: bits.into(), flags, arrays: arrays.into() })
    }

    const fn quat_len(&self) -> usize {
        if self.version == VERSION_OF_BYTES { 3 } else { 4 }
    }

    fn layout(&self) -> Layout {
        let low_pass = if self.flags & ANTIALIASED != 0 { LowPass::Compensated } else { LowPass::Dilated };
        Layout { low_pass, ..Layout::radiance(self.sh_degree) }
    }

    /// Bytes of each array for a Gaussian.
    fn widths(&self) -> [usize; ARRAYS] {
        [9, 1, 3, 3, self.quat_len(), 3 * (self.layout().sh_count() - 1)]
    }
}

/// Reads plain Gaussians.
///
/// # Errors
///
/// [`Error::Splats`] for a file that is damaged or of another version; [`Error::TooLarge`].
pub(crate) fn read(path: &Path) -> Result<GaussianFile> {
    let bytes = SCENE.read(path)?;
    let broken = |cause: String| Error::Splats { path: path.to_owned(), cause };
    // The length of a gzip stream is unknown, so memory follows from the header, which is read
    // first.
    let mut start = Vec::new();
    let is_gzip = bytes.starts_with(&GZIP);
    let stream: Box<dyn Read> = if is_gzip { Box::new(GzDecoder::new(&bytes[..])) } else { Box::new(&bytes[..]) };
    let mut stream = stream;
    stream.by_ref().take(HEADER_LEN as u64).read_to_end(&mut start).map_err(|cause| broken(damaged(&cause)))?;
    let header = Header::read(&start).map_err(broken)?;
    let layout = header.layout();
    let wanted = header.count as u64 * (4 * layout.plane_count() + header.widths().iter().sum::<usize>()) as u64;
    PACKED.ask(path, bytes.len() as u64, format_args!("its {} Gaussians", header.count), wanted)?;
    let arrays = if header.version == VERSION_OF_FRAMES {
        frames(&header, &bytes).map_err(broken)?
    } else {
        let mut arrays: [Vec<u8>; ARRAYS] = Default::default();
        for (array, width) in arrays.iter_mut().zip(header.widths()) {
            filled(&mut stream, array, header.count * width).map_err(broken)?;
        }
        // The end of a gzip stream has the checksum of what was read.
        stream.take(1).read_to_end(&mut Vec::new()).map_err(|cause| broken(damaged(&cause)))?;
        arrays
    };
    let Header { count, fraction_bits, .. } = header;
    let packed = Packed { count, layout, fraction_bits, quat_len: header.quat_len(), arrays };
    Ok(GaussianFile { gaussians: packed.unpacked(), comments: Vec::new(), notes: Vec::new(), are_materials: false })
}

/// Version of a file, and whether it is compressed as a whole.
///
/// # Errors
///
/// Those of [`read`] for headers.
pub(crate) fn version(path: &Path) -> Result<(u32, bool)> {
    let bytes = SCENE.read(path)?;
    let is_gzip = bytes.starts_with(&GZIP);
    let mut start: Cow<'_, [u8]> = Cow::Borrowed(&bytes);
    if is_gzip {
        let mut header = Vec::new();
        // A damaged stream has a short header, which is an error below.
        let _ = GzDecoder::new(&bytes[..]).take(HEADER_LEN as u64).read_to_end(&mut header);
        start = header.into();
    }
    match Header::read(&start) {
        Ok(header) => Ok((header.version, is_gzip)),
        Err(cause) => Err(Error::Splats { path: path.to_owned(), cause }),
    }
}

/// Arrays of version 4.
fn frames(header: &Header, bytes: &[u8]) -> core::result::Result<[Vec<u8>; ARRAYS], String> {
    /// Place of the table's address in the header.
    const TABLE: usize = HEADER_LEN;
    /// Compressed and full length.
    const ENTRY_LEN: usize = 2 * size_of::<u64>();
    let short = || "it is cut short".to_owned();
    let word = |at: usize| -> Option<usize> {
        let bytes = bytes.get(at..)?.first_chunk::<{ size_of::<u64>() }>()?;
        usize::try_from(u64::from_le_bytes(*bytes)).ok()
    };
    let table = bytes.get(TABLE..TABLE + 4).ok_or_else(short)?;
    let table = u32::from_le_bytes([table[0], table[1], table[2], table[3]]) as usize;
    let mut first = table.saturating_add(ENTRY_LEN * header.arrays);
    let mut arrays: [Vec<u8>; ARRAYS] = Default::default();
    for (index, (array, width)) in arrays.iter_mut().zip(header.widths()).enumerate() {
        if width == 0 && index >= header.arrays {
            continue;
        }
        let len = word(table.saturating_add(ENTRY_LEN * index)).ok_or_else(short)?;
        let last = first.checked_add(len).ok_or_else(short)?;
        let frame = bytes.get(first..last).ok_or_else(short)?;
        let mut frame = StreamingDecoder::new(frame).map_err(|cause| damaged(&cause))?;
        filled(&mut frame, array, header.count * width)?;
        first = last;
    }
    Ok(arrays)
}

/// Sentence on a stream that cannot be decompressed.
fn damaged(cause: &impl fmt::Display) -> String {
    format!("it is cut short or damaged ({cause}); copy it again")
}

/// Reads this many bytes.
fn filled(stream: &mut impl Read, array: &mut Vec<u8>, len: usize) -> core::result::Result<(), String> {
    stream.take(len as u64).read_to_end(array).map_err(|cause| damaged(&cause))?;
    if array.len() < len { Err("it is cut short; copy it again".to_owned()) } else { Ok(()) }
}

/// Writes plain Gaussians.
///
/// # Errors
///
/// [`crate::Error::Write`] if the file cannot be written.
pub fn write(path: &Path, gaussians: &Gaussians<Vec<f32>>) -> Result<()> {
    let Packed { count, layout, fraction_bits, arrays, .. } = Packed::of(gaussians);
    let facts = [layout.sh_degree.unwrap_or(0), fraction_bits as u8, 0, 0];
    let header = [MAGIC, VERSION, count as u32, u32::from_le_bytes(facts)];
    whole_file::write(path, |out| {
        let mut out = GzEncoder::new(out, Compression::best());
        header.iter().try_for_each(|word| out.write_all(&word.to_le_bytes()))?;
        arrays.iter().try_for_each(|array| out.write_all(array))?;
        out.finish().map(drop)
    })
}

/// Gaussians after quantisation, as a reader decodes them.
pub fn stored(gaussians: &Gaussians<Vec<f32>>) -> Gaussians<Vec<f32>> {
    Packed::of(gaussians).unpacked()
}

impl Packed {
    fn of(gaussians: &Gaussians<Vec<f32>>) -> Self {
        let fraction_bits = fraction_bits(gaussians);
        let all = || 0..gaussians.count;
        let arrays = [
            all().flat_map(|gaussian| mean_bytes(gaussians, gaussian, fraction_bits)).collect(),
            all().map(|gaussian| opacity_byte(gaussians, gaussian)).collect(),
            all().flat_map(|gaussian| color_bytes(gaussians, gaussian)).collect(),
            all().flat_map(|gaussian| scale_bytes(gaussians, gaussian)).collect(),
            all().flat_map(|gaussian| pack_quat(gaussians.get(gaussian, QUAT)).to_le_bytes()).collect(),
            all().flat_map(|gaussian| rest_bytes(gaussians, gaussian)).collect(),
        ];
        Self { count: gaussians.count, layout: gaussians.layout, fraction_bits, quat_len: 4, arrays }
    }

    fn unpacked(&self) -> Gaussians<Vec<f32>> {
        let Self { count, layout, fraction_bits, quat_len, ref arrays } = *self;
        let [means, opacities, colors, scales, quats, harmonics] = arrays;
        let mut stored = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
        let step = f32::powi(2.0, -fraction_bits);
        let rest = 3 * (layout.sh_count() - 1);
        for gaussian in 0..count {
            let number = |byte: u8| f32::from(byte) / 255.0;
            let three = |bytes: &[u8]| -> [u8; 3] { core::array::from_fn(|k| bytes[3 * gaussian + k]) };
            let mean = |k: usize| {
                let bytes = &means[9 * gaussian + 3 * k..];
                // The sign of 24 bits extends to 32.
                (i32::from_le_bytes([0, bytes[0], bytes[1], bytes[2]]) >> 8) as f32 * step
            };
            stored.set(gaussian, MEAN, [0, 1, 2].map(mean));
            stored.set(gaussian, OPACITY, [logit(number(opacities[gaussian]))]);
            let first = three(colors).map(|byte| (number(byte) - 0.5) / COLOR_SCALE);
            stored.set(gaussian, layout.sh_start(), first);
            stored.set(gaussian, LOG_SCALE, three(scales).map(|byte| f32::from(byte) / 16.0 - 10.0));
            let quat = &quats[quat_len * gaussian..quat_len * (gaussian + 1)];
            let quat = match *quat {
                [a, b, c, d] => unpack_quat(u32::from_le_bytes([a, b, c, d])),
                _ => quat_of_bytes(three(quats)),
            };
            stored.set(gaussian, QUAT, quat);
            for (k, byte) in harmonics[rest * gaussian..rest * (gaussian + 1)].iter().enumerate() {
                stored.set(gaussian, layout.sh_start() + 3 + k, [(f32::from(*byte) - 128.0) / 128.0]);
            }
        }
        stored
    }
}

/// Quat (w, x, y, z) of version 2.
fn quat_of_bytes(bytes: [u8; 3]) -> [f32; 4] {
    let [x, y, z] = bytes.map(|byte| f32::from(byte) / 127.5 - 1.0);
    [(1.0 - x * x - y * y - z * z).max(0.0).sqrt(), x, y, z]
}

/// Number of fractional bits for which the largest coordinate has [`MEAN_BITS`], so that the
/// precision is relative to the scene's size.
fn fraction_bits(gaussians: &Gaussians<Vec<f32>>) -> i32 {
    let means = (MEAN..MEAN + 3).flat_map(|plane| gaussians.plane(plane));
    let largest = means.fold(f32::MIN_POSITIVE, |most, x| most.max(x.abs()));
    (MEAN_BITS - largest.log2().ceil() as i32).clamp(0, FRACTION_MAX)
}

fn mean_bytes(gaussians: &Gaussians<Vec<f32>>, gaussian: usize, bits: i32) -> [u8; 9] {
    let mut bytes = [0; 9];
    for (bytes, x) in bytes.chunks_exact_mut(3).zip(gaussians.get::<3>(gaussian, MEAN)) {
        bytes.copy_from_slice(&((x * f32::powi(2.0, bits)).round() as i32).to_le_bytes()[..3]);
    }
    bytes
}

fn opacity_byte(gaussians: &Gaussians<Vec<f32>>, gaussian: usize) -> u8 {
    byte(255.0 * sigmoid(gaussians.get::<1>(gaussian, OPACITY)[0]))
}

fn color_bytes(gaussians: &Gaussians<Vec<f32>>, gaussian: usize) -> [u8; 3] {
    gaussians.get::<3>(gaussian, gaussians.layout.sh_start()).map(|first| byte(255.0 * (COLOR_SCALE * first + 0.5)))
}

fn scale_bytes(gaussians: &Gaussians<Vec<f32>>, gaussian: usize) -> [u8; 3] {
    gaussians.get::<3>(gaussian, LOG_SCALE).map(|log_scale| byte(16.0 * (log_scale + 10.0)))
}

/// Harmonics above degree 0, coefficient by coefficient.
fn rest_bytes(gaussians: &Gaussians<Vec<f32>>, gaussian: usize) -> Vec<u8> {
    let Layout { sh_degree: Some(_), .. } = gaussians.layout else { return Vec::new() };
    let rest = gaussians.layout.sh_start() + 3..gaussians.layout.sh_end();
    rest.map(|plane| byte(128.0 * gaussians.get::<1>(gaussian, plane)[0] + 128.0)).collect()
}

/// Packs a quat: the index of the largest component in the two highest bits, then the others as
/// sign and magnitude.
fn pack_quat(quat: [f32; 4]) -> u32 {
    let [w, x, y, z] = unit(quat);
    let quat = [x, y, z, w];
    let largest = (0..4).fold(0, |most, k| if quat[k].abs() > quat[most].abs() { k } else { most });
    let others = (0..4).filter(|k| *k != largest);
    others.fold(largest as u32, |bits, k| {
        let is_negative = (quat[k] < 0.0) != (quat[largest] < 0.0);
        let magnitude = (QUAT_STEPS * quat[k].abs() / FRAC_1_SQRT_2).round().min(QUAT_STEPS) as u32;
        bits << 10 | u32::from(is_negative) << 9 | magnitude
    })
}

/// Unpacks a quat (w, x, y, z).
fn unpack_quat(bits: u32) -> [f32; 4] {
    let largest = (bits >> 30) as usize;
    let mut quat = [0.0; 4];
    for (place, k) in (0..4).filter(|k| *k != largest).enumerate() {
        let part = bits >> (10 * (2 - place));
        let magnitude = FRAC_1_SQRT_2 * (part & 0x1ff) as f32 / QUAT_STEPS;
        quat[k] = if part >> 9 & 1 == 1 { -magnitude } else { magnitude };
    }
    quat[largest] = (1.0 - quat.iter().map(|q| q * q).sum::<f32>()).max(0.0).sqrt();
    let [x, y, z, w] = quat;
    [w, x, y, z]
}
