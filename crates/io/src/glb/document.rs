//! Documents of glTF, binary or text, with their buffers.

use super::{BIN_CHUNK, FLOAT, JSON_CHUNK, MAGIC};
use crate::{
    Input,
    budget::SCENE,
    error::{Error, Result},
    origin,
};
use base64::{Engine, engine::general_purpose::STANDARD};
use core::fmt::Display;
use percent_encoding::percent_decode_str;
use serde::{Deserialize, de::IgnoredAny};
use serde_json::{Map, Value};
use std::{
    borrow::Cow,
    path::{Component, Path, PathBuf},
};

/// Largest number of Gaussians of a file.
const COUNT_MAX: usize = 1 << 25;

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Document {
    pub(super) asset: Asset,
    pub(super) extensions_required: Vec<String>,
    pub(super) scene: usize,
    pub(super) scenes: Vec<Roots>,
    pub(super) nodes: Vec<Node>,
    pub(super) meshes: Vec<Mesh>,
    pub(super) animations: Vec<IgnoredAny>,
    accessors: Vec<Accessor>,
    buffer_views: Vec<View>,
    buffers: Vec<Buffer>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Asset {
    pub(super) generator: String,
}

/// Scene of a document.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Roots {
    pub(super) nodes: Vec<usize>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub(super) mesh: Option<usize>,
    pub(super) children: Vec<usize>,
    pub(super) translation: Option<Box<[f64; 3]>>,
    pub(super) rotation: Option<Box<[f64; 4]>>,
    pub(super) scale: Option<Box<[f64; 3]>>,
    pub(super) matrix: Option<Box<[f64; 16]>>,
    pub(super) extensions: Map<String, Value>,
    extras: Value,
}

impl Node {
    /// Origin of positions that this program notes, else zero.
    pub(super) fn origin(&self) -> [f64; 3] {
        let named = self.extras.get("origin").and_then(|origin| <[f64; 3]>::deserialize(origin).ok());
        named.filter(origin::is_usable).unwrap_or_default()
    }
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Mesh {
    pub(super) primitives: Vec<Primitive>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Primitive {
    pub(super) attributes: Map<String, Value>,
    pub(super) indices: Option<usize>,
    pub(super) extensions: Map<String, Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    #[serde(default)]
    normalized: bool,
    count: usize,
    #[serde(rename = "type")]
    kind: String,
    sparse: Option<IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct View {
    #[serde(default)]
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
    #[serde(default)]
    extensions: Map<String, Value>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Buffer {
    uri: Option<String>,
}

/// Document of a file, and the bytes of its buffers.
pub(super) struct File<'a> {
    pub(super) path: &'a Path,
    pub(super) document: Document,
    buffers: Vec<Cow<'a, [u8]>>,
}

impl<'a> File<'a> {
    /// Document from the bytes of a file, with its external buffers.
    pub(super) fn new(input: Input<'a>, bytes: &'a [u8]) -> Result<Self> {
        let path = input.path();
        let (text, binary) = if bytes.trim_ascii_start().starts_with(b"{") || bytes.starts_with(BYTE_ORDER_MARK) {
            (bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes), &[][..])
        } else {
            chunks(bytes).ok_or_else(|| broken(path, &"it is not glTF 2.0, or cut short"))?
        };
        let document: Document = serde_json::from_slice(text).map_err(|error| broken(path, &error))?;
        let mut file = Self { path, document, buffers: Vec::new() };
        let mut len = 0;
        for (index, buffer) in file.document.buffers.iter().enumerate() {
            let bytes = match &buffer.uri {
                Some(uri) => Cow::Owned(file.resource(uri, input.is_on_disk())?),
                None => Cow::Borrowed(if index == 0 { binary } else { &[] }),
            };
            len += bytes.len() as u64;
            SCENE.ask(path, len, "its buffers", len)?;
            file.buffers.push(bytes);
        }
        if file.buffers.is_empty() {
            file.buffers.push(binary.into());
        }
        Ok(file)
    }

    pub(super) fn broken(&self, cause: &dyn Display) -> Error {
        broken(self.path, cause)
    }

    /// Bytes of a buffer: embedded text, or a file in the folder of the document.
    fn resource(&self, uri: &str, is_on_disk: bool) -> Result<Vec<u8>> {
        if let Some(data) = uri.strip_prefix("data:") {
            let text = data.split_once(";base64,").map(|(_, text)| text);
            let bytes = text.and_then(|text| STANDARD.decode(text).ok());
            return bytes.ok_or_else(|| self.broken(&"one of its buffers is not valid base64"));
        }
        let name = PathBuf::from(percent_decode_str(uri).decode_utf8_lossy().as_ref());
        let is_inside = name.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
        if !is_inside || uri.contains(':') {
            return Err(
                self.broken(&format_args!("its buffer {uri:?} is outside of its folder; move it into the folder"))
            );
        }
        if !is_on_disk {
            return Err(self.broken(&format_args!("its buffer {uri:?} is another file; save it as .glb, in one file")));
        }
        SCENE.read(&self.path.with_file_name("").join(name))
    }

    /// Bytes of a view, and the distance of its elements.
    pub(super) fn view(&self, index: usize) -> Option<(&[u8], Option<usize>)> {
        let View { buffer, byte_offset, byte_length, byte_stride, .. } = self.document.buffer_views.get(index)?;
        let end = byte_offset.checked_add(*byte_length)?;
        Some((self.buffers.get(*buffer)?.get(*byte_offset..end)?, *byte_stride))
    }

    /// Number of elements of an attribute; `None` if the primitive does not have it.
    pub(super) fn count(&self, primitive: &Primitive, name: &str) -> Option<usize> {
        Some(self.accessor(primitive, name)?.count)
    }

    fn accessor(&self, primitive: &Primitive, name: &str) -> Option<&Accessor> {
        let index = primitive.attributes.get(name)?.as_u64()?;
        self.document.accessors.get(usize::try_from(index).ok()?)
    }

    /// Numbers of an attribute; `None` if the primitive does not have it.
    pub(super) fn attribute(
        &self,
        primitive: &Primitive,
        name: &str,
        width: usize,
        count: Option<usize>,
    ) -> Result<Option<Vec<f32>>> {
        if !primitive.attributes.contains_key(name) {
            return Ok(None);
        }
        let accessor = self.accessor(primitive, name);
        let fits = |accessor: &&Accessor| {
            let kinds = ["SCALAR", "VEC2", "VEC3", "VEC4"];
            let is_counted = accessor.count <= COUNT_MAX && count.is_none_or(|count| accessor.count == count);
            is_counted && accessor.kind == kinds[width - 1] && accessor.sparse.is_none()
        };
        let numbers = accessor.filter(fits).and_then(|accessor| self.numbers(accessor, width));
        numbers.map(Some).ok_or_else(|| {
            self.broken(&match accessor.and_then(|accessor| self.unread(accessor)) {
                Some(kind) => format!("its {name} is {kind}, which is not supported; export it without"),
                None => format!("its {name} is cut short, or of an unsupported type"),
            })
        })
    }

    /// Unsupported feature of an accessor.
    fn unread(&self, accessor: &Accessor) -> Option<String> {
        let view = accessor.buffer_view.and_then(|view| self.document.buffer_views.get(view));
        let compressed = view.and_then(|view| view.extensions.keys().next());
        compressed
            .map(|extension| format!("compressed by {extension}"))
            .or_else(|| accessor.sparse.map(|_| "sparse".to_owned()))
    }

    fn numbers(&self, accessor: &Accessor, width: usize) -> Option<Vec<f32>> {
        let view = accessor.buffer_view?;
        if !self.document.buffer_views.get(view)?.extensions.is_empty() {
            return None;
        }
        let (bytes, stride) = self.view(view)?;
        let bytes = bytes.get(accessor.byte_offset..)?;
        // Normalised bytes and shorts, as glTF defines them.
        let scaled = |number: f32, largest: f32| {
            if accessor.normalized { (number / largest).max(-1.0) } else { number }
        };
        let (size, number): (usize, &dyn Fn(&[u8]) -> Option<f32>) = match accessor.component_type {
            5120 => (1, &|bytes| Some(scaled(f32::from(*bytes.first()? as i8), 127.0))),
            5121 => (1, &|bytes| Some(scaled(f32::from(*bytes.first()?), 255.0))),
            5122 => (2, &|bytes| Some(scaled(f32::from(i16::from_le_bytes(*bytes.first_chunk()?)), 32767.0))),
            5123 => (2, &|bytes| Some(scaled(f32::from(u16::from_le_bytes(*bytes.first_chunk()?)), 65535.0))),
            FLOAT => (4, &|bytes| Some(f32::from_le_bytes(*bytes.first_chunk()?))),
            _ => return None,
        };
        let stride = stride.unwrap_or(size * width).max(size * width);
        // Elements do not overlap, so the file's length bounds the memory.
        let needed = stride.checked_mul(accessor.count.checked_sub(1)?)?.checked_add(size * width)?;
        if needed > bytes.len() {
            return None;
        }
        (0..accessor.count)
            .flat_map(|index| (0..width).map(move |k| stride * index + size * k))
            .map(|at| number(&bytes[at..]))
            .collect()
    }
}

const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Text and optional binary chunk of a `.glb`.
fn chunks(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let word = |at: usize| Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?));
    let chunk = |at: usize, kind: u32| {
        let len = word(at)? as usize;
        (word(at + 4)? == kind).then(|| bytes.get(at + 8..at.checked_add(8 + len)?)).flatten()
    };
    if word(0) != Some(MAGIC) || word(4) != Some(2) {
        return None;
    }
    let text = chunk(12, JSON_CHUNK)?;
    let next = 20 + text.len();
    let binary = if bytes.len() == next { &[] } else { chunk(next, BIN_CHUNK)? };
    Some((text, binary))
}

fn broken(path: &Path, cause: &dyn Display) -> Error {
    Error::Glb { path: path.to_owned(), cause: cause.to_string() }
}
