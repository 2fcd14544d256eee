//! Planes of numbers as OpenEXR, in full precision, for compositing and measuring.

use crate::{
    error::{Error, Result},
    whole_file,
};
use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage};
use std::{
    io::{self, Cursor},
    path::Path,
};

/// A channel's name and numbers, one for each pixel, rows from the top.
pub type NamedPlane = (&'static str, Vec<f32>);

/// Writes named channels of 32-bit floats as an OpenEXR image, compressed without loss.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
///
/// # Panics
///
/// Without channels, or with a channel of another size.
pub fn write_exr(path: &Path, width: usize, height: usize, planes: Vec<NamedPlane>) -> Result<()> {
    whole_file::write_bytes(path, &exr(path, width, height, planes)?)
}

/// Bytes of [`write_exr`], encoded in memory, since the encoder seeks.
pub(crate) fn exr(path: &Path, width: usize, height: usize, planes: Vec<NamedPlane>) -> Result<Vec<u8>> {
    assert!(!planes.is_empty(), "an image has channels");
    assert!(planes.iter().all(|(_, numbers)| numbers.len() == width * height), "channels have a number for each pixel");
    let channel = |(name, numbers): NamedPlane| AnyChannel::new(name, FlatSamples::F32(numbers));
    let channels = AnyChannels::sort(planes.into_iter().map(channel).collect());
    let layer = Layer::new((width, height), LayerAttributes::default(), Encoding::SMALL_LOSSLESS, channels);
    let mut bytes = Cursor::new(Vec::new());
    let written = Image::from_layer(layer).write().to_buffered(&mut bytes);
    written.map_err(|error| Error::Write { path: path.to_owned(), cause: io::Error::other(error) })?;
    Ok(bytes.into_inner())
}
