//! Plain Gaussians as binary glTF 2.0 with Khronos's ratified extension `KHR_gaussian_splatting`:
//! activated scales and opacities, quats (x, y, z, w), harmonics of sRGB colours. Readers without
//! the extension show points.
//!
//! Shading attributes follow as `SPECULA_shading` ([`Shading`]), an optional extension of that
//! extension; `docs/shading-extension.md` describes it.

mod document;
mod nodes;
mod read;
pub mod textured;

use crate::{
    error::{Error, Result},
    latlong, origin,
    splat::unit,
    whole_file,
};
use serde_json::{Map, Value, json};
use specula_core::{
    activation::sigmoid,
    scene::{Gaussians, LOG_SCALE, MEAN, OPACITY, QUAT},
    sh::Y0,
};
use std::path::Path;

pub use read::{GlbScene, degree, is_gltf, read};

const SPLATTING: &str = "KHR_gaussian_splatting";
const SHADING: &str = "SPECULA_shading";
/// Colour spaces of the extension.
const SRGB: &str = "srgb_rec709_display";
const LINEAR: &str = "lin_rec709_display";
const FLOAT: u32 = 5126;
const POINTS: u32 = 0;
/// Magic numbers: "glTF"; chunks "JSON" and "BIN\0".
const MAGIC: u32 = 0x4654_6c67;
const JSON_CHUNK: u32 = 0x4e4f_534a;
const BIN_CHUNK: u32 = 0x004e_4942;

/// A scalar or vector attribute of each Gaussian.
#[derive(Clone, Debug, PartialEq)]
pub struct Attribute {
    /// Name, after the extension's.
    pub name: String,
    /// Components per Gaussian: 1, 3 or 4.
    pub width: usize,
    /// Values, Gaussian by Gaussian.
    pub values: Vec<f32>,
}

/// Shading attributes of plain Gaussians.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shading {
    /// Properties: the shading equation and the prefilter of its light.
    pub properties: Map<String, Value>,
    /// Attributes of each Gaussian.
    pub attributes: Vec<Attribute>,
    /// Linear radiance, six faces of resolution² RGB texels (+X −X +Y −Y +Z −Z), and the
    /// resolution; stored as OpenEXR.
    pub light: Option<(Vec<f32>, usize)>,
}

/// Transform of the node: scale, then rotation, then translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Unit quat (x, y, z, w).
    pub rotation: [f64; 4],
    /// Translation in units of the reader's world.
    pub translation: [f64; 3],
    /// Uniform scale.
    pub scale: f64,
}

/// Writes plain Gaussians with optional shading attributes and an optional transform of their node,
/// which names the origin of their positions if that is not zero.
///
/// # Errors
///
/// [`Error::TooLong`] beyond 4 GiB, [`Error::Write`] if the file cannot be written.
pub fn write(
    path: &Path,
    gaussians: &Gaussians<Vec<f32>>,
    shading: Option<&Shading>,
    placement: Option<Placement>,
    origin: [f64; 3],
) -> Result<()> {
    let mut file = File::default();
    let mut attributes = Map::new();
    for Attribute { name, width, values } in plain(gaussians) {
        let accessor = file.add(width, &values, name == "POSITION");
        attributes.insert(name, accessor.into());
    }
    let mut extension = json!({
        "kernel": "ellipse", "colorSpace": SRGB, "projection": "perspective",
        "sortingMethod": "cameraDistance",
    });
    let mut used = vec![SPLATTING];
    if let Some(shading) = shading {
        for Attribute { name, width, values } in &shading.attributes {
            attributes.insert(format!("{SHADING}:{name}"), file.add(*width, values, false).into());
        }
        extension["extensions"] = json!({SHADING: properties(path, shading, &mut file)?});
        used.push(SHADING);
    }
    let primitive = json!({"attributes": attributes, "mode": POINTS, "extensions": {SPLATTING: extension}});
    write_document(path, file, Document { primitive, used, ..Document::default() }, placement, origin)
}

/// Content of a document beside its buffer.
#[derive(Default)]
struct Document<'a> {
    primitive: Value,
    /// Extensions that it uses.
    used: Vec<&'a str>,
    /// Nodes beside that of the primitive.
    nodes: Vec<Value>,
    /// Other properties.
    rest: Map<String, Value>,
}

/// Writes a primitive in a node with an optional transform, and the origin of positions if that is
/// not zero.
fn write_document(
    path: &Path,
    file: File,
    Document { primitive, used, nodes: others, rest }: Document<'_>,
    placement: Option<Placement>,
    origin: [f64; 3],
) -> Result<()> {
    let mut node = json!({"mesh": 0});
    if let Some(Placement { rotation, translation, scale }) = placement {
        node["rotation"] = json!(rotation);
        node["translation"] = json!(translation);
        node["scale"] = json!([scale, scale, scale]);
    }
    if !origin::is_zero(&origin) {
        node["extras"] = json!({"origin": origin});
    }
    let nodes: Vec<Value> = [node].into_iter().chain(others).collect();
    let roots: Vec<usize> = (0..nodes.len()).collect();
    let mut json = json!({
        "asset": {"version": "2.0", "generator": concat!("specula ", env!("CARGO_PKG_VERSION"))},
        "scene": 0, "scenes": [{"nodes": roots}], "nodes": nodes, "meshes": [{"primitives": [primitive]}],
        "accessors": file.accessors, "bufferViews": file.views, "buffers": [{"byteLength": file.bytes.len()}],
    });
    // An empty list is not valid.
    if !used.is_empty() {
        json["extensionsUsed"] = json!(used);
    }
    rest.into_iter().for_each(|(name, value)| json[name] = value);
    write_chunks(path, &json, file.bytes)
}

/// Properties of [`Shading`], with a reference to its light.
fn properties(path: &Path, shading: &Shading, file: &mut File) -> Result<Map<String, Value>> {
    let mut properties = shading.properties.clone();
    if let Some((values, resolution)) = &shading.light {
        let view = file.add_view(&latlong::cube_exr(path, values, *resolution)?);
        let faces = ["+X", "-X", "+Y", "-Y", "+Z", "-Z"];
        let light = json!({"bufferView": view, "mimeType": "image/x-exr", "resolution": resolution, "faces": faces});
        properties.insert("light".into(), light);
    }
    Ok(properties)
}

/// Attributes of the Khronos extension, with colours for readers that show points.
fn plain(gaussians: &Gaussians<Vec<f32>>) -> Vec<Attribute> {
    let all = || 0..gaussians.count;
    let start = gaussians.layout.sh_start();
    let named = |name: &str| format!("{SPLATTING}:{name}");
    let opacity = |gaussian: usize| sigmoid(gaussians.get::<1>(gaussian, OPACITY)[0]);
    let rotation = |gaussian: usize| {
        let [w, x, y, z] = unit(gaussians.get(gaussian, QUAT));
        [x, y, z, w]
    };
    let color = |gaussian: usize| {
        let [r, g, b] = gaussians.get::<3>(gaussian, start).map(|first| (0.5 + Y0 * first).clamp(0.0, 1.0));
        [r, g, b, opacity(gaussian)]
    };
    let mut attributes = vec![
        Attribute::of("POSITION".into(), all().map(|gaussian| gaussians.get::<3>(gaussian, MEAN))),
        Attribute::of("COLOR_0".into(), all().map(color)),
        Attribute::of(named("ROTATION"), all().map(rotation)),
        Attribute::of(named("SCALE"), all().map(|gaussian| gaussians.get::<3>(gaussian, LOG_SCALE).map(f32::exp))),
        Attribute::of(named("OPACITY"), all().map(|gaussian| [opacity(gaussian)])),
    ];
    attributes.extend((0..gaussians.layout.sh_count()).map(|k| {
        let coefficients = all().map(|gaussian| gaussians.get::<3>(gaussian, start + 3 * k));
        Attribute::of(named(&harmonic("SH", k)), coefficients)
    }));
    attributes
}

/// Name of a harmonic: `SH_DEGREE_l_COEF_n`, n counting from 0 in each degree.
pub fn harmonic(prefix: &str, k: usize) -> String {
    let degree = k.isqrt();
    format!("{prefix}_DEGREE_{degree}_COEF_{}", k - degree * degree)
}

impl Attribute {
    /// Collects the components of each Gaussian.
    pub fn of<const N: usize>(name: String, numbers: impl Iterator<Item = [f32; N]>) -> Self {
        Self { name, width: N, values: numbers.flatten().collect() }
    }
}

/// Binary chunk of a file with its views and accessors.
#[derive(Default)]
struct File {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl File {
    /// Appends an array and returns the index of its accessor.
    fn add(&mut self, width: usize, values: &[f32], with_bounds: bool) -> usize {
        let view = self.add_view(bytemuck::cast_slice(values));
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][width - 1];
        let count = values.len() / width;
        let mut accessor = json!({"bufferView": view, "componentType": FLOAT, "type": kind, "count": count});
        if with_bounds {
            let bound = |pick: fn(f32, f32) -> f32, start: f32| -> Vec<f32> {
                (0..width).map(|k| values.iter().skip(k).step_by(width).copied().fold(start, pick)).collect()
            };
            accessor["min"] = json!(bound(f32::min, f32::MAX));
            accessor["max"] = json!(bound(f32::max, f32::MIN));
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Appends bytes and returns the index of their view.
    fn add_view(&mut self, bytes: &[u8]) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}));
        self.views.len() - 1
    }
}

/// Writes the header, JSON padded with spaces, and the binary chunk padded with zeros.
fn write_chunks(path: &Path, json: &Value, binary: Vec<u8>) -> Result<()> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let len = 12 + 8 + text.len() + 8 + binary.len();
    let len = u32::try_from(len).map_err(|_| Error::TooLong { path: path.to_owned(), len })?;
    let word = |word: u32| word.to_le_bytes();
    let header = [word(MAGIC), word(2), word(len), word(text.len() as u32), word(JSON_CHUNK)].concat();
    let between = [word(binary.len() as u32), word(BIN_CHUNK)].concat();
    whole_file::write_bytes(path, &[header, text, between, binary].concat())
}
