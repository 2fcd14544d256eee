//! Colours of OpenEXR files by the names of their channels; `image` supports only R, G and B.
//!
//! Layers are prefixes of names, such as `ViewLayer.Combined.R`, or parts of the file. A file
//! with only luminance, `Y`, is grey.

use crate::{
    color_space::Primaries,
    error::{Error, Result},
    input::{Input, Opened},
};
use exr::{
    block::reader::Reader,
    meta::header::Header,
    prelude::{ReadChannels, ReadLayers, ReadSpecificChannel, Text, Vec2, read},
};
use image::{
    ColorType, ImageDecoder, ImageError, ImageFormat, ImageResult,
    error::{DecodingError, ImageFormatHint},
};
use std::{collections::BTreeMap, io::BufReader};

/// Names of layers with the final colours of a renderer.
const SHOWN: [&str; 5] = ["combined", "beauty", "rgba", "rgb", "color"];
/// Maximum number of names in a sentence.
const NAMES_MAX: usize = 8;

/// Decoder of the colours of a file.
pub(crate) struct ExrDecoder<'a> {
    reader: Reader<BufReader<Opened<'a>>>,
    header: Header,
    names: Names,
    /// Notes on parts of the file that are ignored or changed, one sentence each.
    pub(crate) notes: Vec<String>,
}

/// Names of the channels of a layer.
#[derive(Clone, Debug, PartialEq)]
struct Names {
    layer: String,
    /// Red, green and blue; three times luminance.
    color: [Text; 3],
    alpha: Option<Text>,
}

impl<'a> ExrDecoder<'a> {
    /// Reads headers and chooses the channels.
    pub(crate) fn new(input: Input<'a>) -> Result<Self> {
        let path = input.path();
        let image = |cause: String| Error::Image { path: path.to_owned(), cause };
        let reader = exr::block::read(input.open()?, false).map_err(|error| image(error.to_string()))?;
        let layers: Vec<(&Header, Names)> =
            reader.headers().iter().filter(|header| !header.deep).flat_map(layers_of).collect();
        let Some((header, names)) = layers.iter().min_by_key(|(_, names)| rank(names)).cloned() else {
            return Err(image(without_color(reader.headers())));
        };
        if header.channels.list.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
            return Err(image("it has subsampled channels, such as RY and BY; save it as R, G and B".into()));
        }
        let mut notes = Vec::new();
        let others = layers.iter().map(|(_, other)| other.layer.as_str()).filter(|layer| *layer != names.layer);
        let others: Vec<&str> = others.take(NAMES_MAX).collect();
        if !others.is_empty() {
            let red = names.color[0].to_string();
            notes.push(format!(
                "{path:?} is read from its channel {red:?} and the matching ones, without the layers {others:?}"
            ));
        }
        let header = header.clone();
        Ok(Self { reader, header, names, notes })
    }

    /// Primaries that the file names.
    pub(crate) fn primaries(&self) -> Option<Primaries> {
        let found = self.header.shared_attributes.chromaticities?;
        Some([found.red, found.green, found.blue, found.white].map(|Vec2(x, y)| [x, y].map(f64::from)))
    }

    fn channel_count(&self) -> usize {
        3 + usize::from(self.names.alpha.is_some())
    }
}

/// Layers of a part that have colours or luminance.
fn layers_of(header: &Header) -> impl Iterator<Item = (&Header, Names)> {
    let part = header.own_attributes.layer_name.as_ref().map_or(String::new(), Text::to_string);
    let mut layers: BTreeMap<String, BTreeMap<String, Text>> = BTreeMap::new();
    for channel in &header.channels.list {
        let name = channel.name.to_string();
        let (layer, short) = name.rsplit_once('.').unwrap_or(("", &name));
        layers.entry(layer.to_owned()).or_default().insert(short.to_ascii_lowercase(), channel.name.clone());
    }
    layers.into_iter().filter_map(move |(layer, channels)| {
        let named = |known: &[&str]| known.iter().find_map(|name| channels.get(*name)).cloned();
        let is_place = channels.contains_key("x") && channels.contains_key("z");
        let grey =
            || named(&["y", "l", "luminance"]).filter(|_| !is_place).map(|grey| [grey.clone(), grey.clone(), grey]);
        let color = named(&["r", "red"]).zip(named(&["g", "green"])).zip(named(&["b", "blue"]));
        let color = color.map(|((r, g), b)| [r, g, b]).or_else(grey)?;
        let layer = if layer.is_empty() { part.clone() } else { layer };
        Some((header, Names { layer, color, alpha: named(&["a", "alpha"]) }))
    })
}

/// Rank of a layer: colours before grey; channels without a layer, then renderers' final colours,
/// then others.
fn rank(names: &Names) -> (bool, usize) {
    let [red, green, _] = &names.color;
    let name = red.to_string();
    let last = name.rsplit('.').nth(1).unwrap_or("").to_ascii_lowercase();
    let place = SHOWN.iter().position(|shown| *shown == last).unwrap_or(SHOWN.len());
    (red == green, if name.contains('.') { 1 + place } else { 0 })
}

/// Error for a file without a usable layer.
fn without_color(headers: &[Header]) -> String {
    if headers.iter().all(|header| header.deep) {
        return "it is a deep image, with lists of samples for each pixel; flatten it".to_owned();
    }
    let channels = headers.iter().flat_map(|header| &header.channels.list);
    let names: Vec<String> = channels.take(NAMES_MAX).map(|channel| channel.name.to_string()).collect();
    format!("it has the channels {}, but neither R, G and B nor Y", names.join(", "))
}

impl ImageDecoder for ExrDecoder<'_> {
    fn dimensions(&self) -> (u32, u32) {
        let size = self.header.shared_attributes.display_window.size;
        (size.width() as u32, size.height() as u32)
    }

    fn color_type(&self) -> ColorType {
        if self.names.alpha.is_some() { ColorType::Rgba32F } else { ColorType::Rgb32F }
    }

    fn read_image(self, bytes: &mut [u8]) -> ImageResult<()> {
        let window = self.header.shared_attributes.display_window;
        let (size, offset) = (window.size, self.header.own_attributes.layer_position - window.position);
        let width = self.channel_count();
        let empty = move |_: Vec2<usize>| vec![0.0_f32; size.area() * width];
        let set = move |pixels: &mut Vec<f32>, at: Vec2<usize>, color: [f32; 4]| {
            let Vec2(x, y) = at.to_i32() + offset;
            if (0..size.width() as i32).contains(&x) && (0..size.height() as i32).contains(&y) {
                let start = width * (y as usize * size.width() + x as usize);
                pixels[start..start + width].copy_from_slice(&color[..width]);
            }
        };
        let Names { color: [red, green, blue], alpha, .. } = self.names;
        // An unused name stands for a missing alpha channel.
        let alpha = alpha.unwrap_or_else(|| Text::from(" "));
        let channels = read().no_deep_data().largest_resolution_level().specific_channels();
        let pixels = if red == green {
            let channels = channels.required(red).optional(alpha, 1.0);
            let channels = channels.collect_pixels(
                move |size, _| empty(size),
                move |pixels, at, (y, a): (f32, f32)| set(pixels, at, [y, y, y, a]),
            );
            let image = channels.first_valid_layer().all_attributes().from_chunks(self.reader);
            image.map(|image| image.layer_data.channel_data.pixels)
        } else {
            let channels = channels.required(red).required(green).required(blue).optional(alpha, 1.0);
            let channels = channels.collect_pixels(
                move |size, _| empty(size),
                move |pixels, at, (r, g, b, a): (f32, f32, f32, f32)| set(pixels, at, [r, g, b, a]),
            );
            let image = channels.first_valid_layer().all_attributes().from_chunks(self.reader);
            image.map(|image| image.layer_data.channel_data.pixels)
        };
        bytes.copy_from_slice(bytemuck::cast_slice(&pixels.map_err(undecoded)?));
        Ok(())
    }

    fn read_image_boxed(self: Box<Self>, bytes: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(bytes)
    }
}

fn undecoded(error: exr::error::Error) -> ImageError {
    ImageError::Decoding(DecodingError::new(ImageFormatHint::Exact(ImageFormat::OpenExr), error.to_string()))
}
