//! Reader of Gaussians in binary glTF: of this program's files, and of others' with the Khronos
//! extension.

use super::{Attribute, BIN_CHUNK, FLOAT, JSON_CHUNK, MAGIC, SHADING, SPLATTING, Shading, harmonic};
use crate::{
    Input,
    error::{Error, Result},
    latlong,
};
use core::fmt::Display;
use glam::{DQuat, DVec3};
use serde::Deserialize;
use serde_json::{Map, Value};
use specula_core::{
    activation::logit,
    scene::{Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT, len_of_values},
};
use std::path::Path;

/// Largest number of Gaussians of a file.
const COUNT_MAX: usize = 1 << 25;
/// Smallest scale whose logarithm is taken, in world units.
const SCALE_MIN: f32 = 1e-12;
/// Difference of scales of a node along its axes, relative, up to which they are one.
const UNIFORM: f64 = 1e-3;

/// Contents of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct GlbScene {
    /// Gaussians with harmonics of colours, in the world of the attributes.
    pub gaussians: Gaussians<Vec<f32>>,
    /// Shading attributes, where there are any.
    pub shading: Option<Shading>,
    /// Up direction in the world of the attributes, a unit vector.
    pub up: [f64; 3],
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Document {
    #[serde(default)]
    asset: Asset,
    #[serde(default)]
    nodes: Vec<Node>,
    #[serde(default)]
    meshes: Vec<Mesh>,
    #[serde(default)]
    accessors: Vec<Accessor>,
    #[serde(default)]
    buffer_views: Vec<View>,
}

#[derive(Default, Deserialize)]
struct Asset {
    #[serde(default)]
    generator: String,
}

#[derive(Deserialize)]
struct Node {
    mesh: Option<usize>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
    matrix: Option<[f64; 16]>,
}

#[derive(Deserialize)]
struct Mesh {
    #[serde(default)]
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    #[serde(default)]
    attributes: Map<String, Value>,
    #[serde(default)]
    extensions: Map<String, Value>,
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
    sparse: Option<Value>,
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
}

/// Light of a shading extension.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct LightReference {
    buffer_view: usize,
}

/// Reads the Gaussians of a file.
///
/// # Errors
///
/// [`Error::Glb`] for a file without Gaussians or with faults, [`Error::Read`].
pub fn read(input: Input<'_>) -> Result<GlbScene> {
    let bytes = input.bytes()?;
    let file = Opened::new(input.path(), &bytes)?;
    let primitive = file.primitive()?;
    let gaussians = file.gaussians(primitive)?;
    let shading = file.shading(primitive, gaussians.count)?;
    Ok(GlbScene { up: file.up(shading.is_some())?, gaussians, shading })
}

/// Chunks of a file.
struct Opened<'a> {
    path: &'a Path,
    document: Document,
    binary: &'a [u8],
}

impl<'a> Opened<'a> {
    fn new(path: &'a Path, bytes: &'a [u8]) -> Result<Self> {
        let cut = || broken(path, &"it is no binary glTF 2.0, or cut short");
        let word = |at: usize| Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?));
        let chunk = |at: usize, kind: u32| {
            let len = word(at)? as usize;
            (word(at + 4)? == kind).then(|| bytes.get(at + 8..at.checked_add(8 + len)?)).flatten()
        };
        if word(0) != Some(MAGIC) || word(4) != Some(2) {
            return Err(cut());
        }
        let text = chunk(12, JSON_CHUNK).ok_or_else(cut)?;
        let binary = chunk(20 + text.len(), BIN_CHUNK).ok_or_else(cut)?;
        let document = serde_json::from_slice(text).map_err(|error| broken(path, &error))?;
        Ok(Self { path, document, binary })
    }

    fn broken(&self, cause: &dyn Display) -> Error {
        broken(self.path, cause)
    }

    /// The one list of Gaussians.
    fn primitive(&self) -> Result<&Primitive> {
        let all = self.document.meshes.iter().flat_map(|mesh| &mesh.primitives);
        let mut gaussians = all.filter(|primitive| primitive.extensions.contains_key(SPLATTING));
        match (gaussians.next(), gaussians.next()) {
            (Some(only), None) => Ok(only),
            (None, _) => Err(self.broken(&format_args!("it has no Gaussians with {SPLATTING}"))),
            _ => Err(self.broken(&"it has several lists of Gaussians; join them to one")),
        }
    }

    /// Up direction: +y of glTF as seen from the node's world; for files of this program without a
    /// transform, whose world is that of a data set, +z.
    fn up(&self, is_shaded: bool) -> Result<[f64; 3]> {
        let node = self.document.nodes.iter().find(|node| node.mesh.is_some());
        let Some(Node { rotation, scale, matrix, .. }) = node else { return Ok([0.0, 1.0, 0.0]) };
        if matrix.is_some() {
            return Err(self.broken(&"its node has a matrix; write rotation, translation and scale"));
        }
        let [x, y, z] = scale.unwrap_or([1.0; 3]);
        if (x - y).abs().max((x - z).abs()) > UNIFORM * x.abs() {
            return Err(self.broken(&"its node is scaled differently along its axes; scale the Gaussians"));
        }
        let is_of_data = is_shaded || self.document.asset.generator.starts_with("specula ");
        let rotation = match rotation {
            None if is_of_data => return Ok([0.0, 0.0, 1.0]),
            None => DQuat::IDENTITY,
            Some(rotation) => DQuat::from_array(*rotation),
        };
        let up = rotation.inverse() * DVec3::Y;
        Ok(if up.is_finite() && up != DVec3::ZERO { up.normalize().to_array() } else { [0.0, 1.0, 0.0] })
    }

    fn gaussians(&self, primitive: &Primitive) -> Result<Gaussians<Vec<f32>>> {
        let named = |name: &str| format!("{SPLATTING}:{name}");
        let needed = |name: &str, width: usize, count: Option<usize>| {
            let found = self.attribute(primitive, name, width, count)?;
            found.ok_or_else(|| {
                self.broken(&format_args!("its Gaussians have no {name}; write them without another compression"))
            })
        };
        let means = needed("POSITION", 3, None)?;
        let count = means.len() / 3;
        let rotations = needed(&named("ROTATION"), 4, Some(count))?;
        let scales = needed(&named("SCALE"), 3, Some(count))?;
        let opacities = needed(&named("OPACITY"), 1, Some(count))?;
        let harmonics = self.harmonics(primitive, SPLATTING, "SH", count)?;
        let Some(degree) = degree(harmonics.len()) else {
            return Err(self.broken(&format_args!("it has {} harmonics, of no degree", harmonics.len())));
        };
        let layout = Layout::radiance(degree);
        let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
        for index in 0..count {
            let [x, y, z, w] = of::<4>(&rotations, index);
            gaussians.set(index, MEAN, of::<3>(&means, index));
            gaussians.set(index, LOG_SCALE, of::<3>(&scales, index).map(|scale| scale.max(SCALE_MIN).ln()));
            gaussians.set(index, QUAT, [w, x, y, z]);
            gaussians.set(index, OPACITY, of::<1>(&opacities, index).map(logit));
            for (k, harmonic) in harmonics.iter().enumerate() {
                gaussians.set(index, layout.sh_start() + 3 * k, of::<3>(harmonic, index));
            }
        }
        Ok(gaussians)
    }

    /// Harmonics from the constant one on, as many as there are.
    fn harmonics(&self, primitive: &Primitive, of: &str, prefix: &str, count: usize) -> Result<Vec<Vec<f32>>> {
        let mut all = Vec::new();
        for k in 0..16 {
            match self.attribute(primitive, &format!("{of}:{}", harmonic(prefix, k)), 3, Some(count))? {
                Some(found) => all.push(found),
                None => break,
            }
        }
        Ok(all)
    }

    fn shading(&self, primitive: &Primitive, count: usize) -> Result<Option<Shading>> {
        let extension = primitive.extensions.get(SPLATTING).and_then(|splatting| splatting.get("extensions"));
        let Some(Value::Object(properties)) = extension.and_then(|extensions| extensions.get(SHADING)) else {
            return Ok(None);
        };
        let mut properties = properties.clone();
        let light = properties.remove("light").map(|light| self.light(light)).transpose()?;
        let mut attributes = Vec::new();
        for (name, width) in
            [("NORMAL", 3), ("DIFFUSE", 3), ("TINT", 3), ("ROUGHNESS", 1), ("ALBEDO", 3), ("METALLIC", 1)]
        {
            if let Some(values) = self.attribute(primitive, &format!("{SHADING}:{name}"), width, Some(count))? {
                attributes.push(Attribute { name: name.to_owned(), width, values });
            }
        }
        let residuals = self.harmonics(primitive, SHADING, "RESIDUAL", count)?;
        let residual = |(k, values)| Attribute { name: harmonic("RESIDUAL", k), width: 3, values };
        attributes.extend(residuals.into_iter().enumerate().map(residual));
        Ok(Some(Shading { properties, attributes, light }))
    }

    fn light(&self, light: Value) -> Result<(Vec<f32>, usize)> {
        let LightReference { buffer_view } = serde_json::from_value(light).map_err(|error| self.broken(&error))?;
        let (bytes, _) = self.view(buffer_view).ok_or_else(|| self.broken(&"its light is not there"))?;
        latlong::cube_from(Input::memory("its light", bytes)).map_err(|error| self.broken(&error))
    }

    /// Bytes of a view, and the distance of its elements.
    fn view(&self, index: usize) -> Option<(&'a [u8], Option<usize>)> {
        let View { buffer, byte_offset, byte_length, byte_stride } = self.document.buffer_views.get(index)?;
        let end = byte_offset.checked_add(*byte_length)?;
        (*buffer == 0).then_some((self.binary.get(*byte_offset..end)?, *byte_stride))
    }

    /// Numbers of an attribute; none where the primitive has none of this name.
    fn attribute(
        &self,
        primitive: &Primitive,
        name: &str,
        width: usize,
        count: Option<usize>,
    ) -> Result<Option<Vec<f32>>> {
        let Some(index) = primitive.attributes.get(name) else { return Ok(None) };
        let accessor = index.as_u64().and_then(|index| self.document.accessors.get(usize::try_from(index).ok()?));
        let fits = |accessor: &&Accessor| {
            let kinds = ["SCALAR", "VEC2", "VEC3", "VEC4"];
            let is_counted = accessor.count <= COUNT_MAX && count.is_none_or(|count| accessor.count == count);
            is_counted && accessor.kind == kinds[width - 1] && accessor.sparse.is_none()
        };
        let numbers = accessor.filter(fits).and_then(|accessor| self.numbers(accessor, width));
        let fault = || self.broken(&format_args!("its {name} is cut short, or of a kind that is not read"));
        numbers.map(Some).ok_or_else(fault)
    }

    fn numbers(&self, accessor: &Accessor, width: usize) -> Option<Vec<f32>> {
        let (bytes, stride) = self.view(accessor.buffer_view?)?;
        let bytes = bytes.get(accessor.byte_offset..)?;
        // The numbers of a byte and of a short, as glTF scales them.
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
        // The file bounds the memory: elements do not overlap.
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

/// Components of a Gaussian.
fn of<const N: usize>(values: &[f32], index: usize) -> [f32; N] {
    core::array::from_fn(|k| values[N * index + k])
}

/// Degree of as many harmonics; none where no degree has so many.
pub const fn degree(count: usize) -> Option<u8> {
    match count {
        1 => Some(0),
        4 => Some(1),
        9 => Some(2),
        16 => Some(3),
        _ => None,
    }
}

fn broken(path: &Path, cause: &dyn Display) -> Error {
    Error::Glb { path: path.to_owned(), cause: cause.to_string() }
}

#[cfg(test)]
mod tests {
    use super::super::{Placement, write, write_chunks};
    use super::*;
    use serde_json::json;

    /// Rounding of exp, ln, sigmoid and logit, one after the other.
    const ROUNDING: f32 = 1e-4;

    fn gaussians() -> Gaussians<Vec<f32>> {
        let (count, layout) = (21, Layout::radiance(2));
        let mut all = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
        for index in 0..count {
            for plane in 0..layout.plane_count() {
                all.set(index, plane, [(0.7 * index as f32 + 1.3 * plane as f32).sin()]);
            }
            let quat: [f32; 4] = all.get(index, QUAT);
            let length = quat.iter().map(|x| x * x).sum::<f32>().sqrt();
            all.set(index, QUAT, quat.map(|x| x / length));
        }
        all
    }

    fn shading() -> Shading {
        let attribute = |name: &str, width: usize| Attribute {
            name: name.to_owned(),
            width,
            values: (0..21 * width).map(|k| (k as f32 * 0.37).sin()).collect(),
        };
        let names = [("NORMAL", 3), ("DIFFUSE", 3), ("TINT", 3), ("ROUGHNESS", 1), ("ALBEDO", 3), ("METALLIC", 1)];
        let mut attributes: Vec<Attribute> = names.map(|(name, width)| attribute(name, width)).into();
        attributes.push(attribute("RESIDUAL_DEGREE_0_COEF_0", 3));
        let properties = json!({"form": "deferred"}).as_object().cloned().unwrap();
        Shading { properties, attributes, light: Some(((0..18 * 4).map(|k| k as f32).collect(), 2)) }
    }

    #[test]
    fn what_was_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        let root = core::f64::consts::FRAC_1_SQRT_2;
        let turned = Placement { rotation: [-root, 0.0, 0.0, root], translation: [1.0; 3], scale: 2.0 };
        let given = gaussians();
        for (shading, placement) in [(None, None), (Some(shading()), None), (Some(shading()), Some(turned))] {
            write(&path, &given, shading.as_ref(), placement).unwrap();
            let read = read(Input::file(&path)).unwrap();
            assert_eq!((read.gaussians.count, read.gaussians.layout), (given.count, given.layout));
            for plane in 0..given.layout.plane_count() {
                let apart = given.plane(plane).zip(read.gaussians.plane(plane)).map(|(a, b)| (a - b).abs());
                assert!(apart.fold(0.0, f32::max) <= ROUNDING, "plane {plane}");
            }
            assert_eq!(read.shading, shading);
            // A turn of −90° about x takes +z to +y, and +z is the up axis of data sets.
            assert!((DVec3::from(read.up) - DVec3::Z).length() < 1e-12, "{:?}", read.up);
        }
    }

    /// Bytes of a file of two Gaussians, as other programs store them, with changes of its JSON.
    fn foreign(change: impl FnOnce(&mut Value)) -> Vec<u8> {
        let floats: [f32; 12] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6];
        let mut binary: Vec<u8> = floats.iter().flat_map(|number| number.to_le_bytes()).collect();
        // Quats in shorts, opacities in bytes of which each fourth counts, a constant harmonic.
        binary.extend([0_i16, 0, 0, 32767, 32767, 0, 0, 0].iter().flat_map(|number| number.to_le_bytes()));
        binary.extend([51, 0, 0, 0, 204, 0, 0, 0]);
        let view = |start: usize, len: usize| json!({"buffer": 0, "byteOffset": start, "byteLength": len});
        let accessor = |view: usize, of: u32, kind: &str| json!({"bufferView": view, "componentType": of, "normalized": of != FLOAT, "type": kind, "count": 2});
        let mut views = vec![view(0, 24), view(24, 24), view(48, 16), view(64, 8)];
        views[3]["byteStride"] = 4.into();
        let attributes = json!({
            "POSITION": 0, "KHR_gaussian_splatting:SCALE": 1, "KHR_gaussian_splatting:ROTATION": 2,
            "KHR_gaussian_splatting:OPACITY": 3, "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0": 1,
        });
        let mut json = json!({
            "asset": {"version": "2.0", "generator": "another"}, "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": attributes, "extensions": {SPLATTING: {}}}]}],
            "bufferViews": views,
            "accessors": [accessor(0, FLOAT, "VEC3"), accessor(1, FLOAT, "VEC3"), accessor(2, 5122, "VEC4"),
                accessor(3, 5121, "SCALAR")],
        });
        change(&mut json);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        write_chunks(&path, &json, binary).unwrap();
        std::fs::read(path).unwrap()
    }

    #[test]
    fn files_of_other_programs_are_read() {
        let GlbScene { gaussians, shading, up } = read(Input::memory("a.glb", &foreign(|_| ()))).unwrap();
        assert_eq!((shading, up, gaussians.layout), (None, [0.0, 1.0, 0.0], Layout::radiance(0)));
        assert_eq!(gaussians.get::<3>(1, MEAN), [3.0, 4.0, 5.0]);
        assert_eq!([0, 1].map(|index| gaussians.get::<4>(index, QUAT)), [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]);
        for (index, opacity) in [(0, 0.2_f32), (1, 0.8)] {
            let [found]: [f32; 1] = gaussians.get(index, OPACITY);
            assert!((found - logit(opacity)).abs() <= ROUNDING, "{found}");
        }
    }

    #[test]
    fn faults_end_in_a_sentence() {
        let refused = |bytes: &[u8]| read(Input::memory("a.glb", bytes)).unwrap_err().to_string();
        let right = foreign(|_| ());
        for len in (0..right.len()).step_by(7) {
            assert!(refused(&right[..len]).contains("a.glb"), "{len} bytes");
        }
        let set = |pointer: &'static str, value: Value| {
            foreign(move |json| *json.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer}")) = value)
        };
        let primitive = "/meshes/0/primitives/0";
        assert!(refused(&set("/meshes/0/primitives", json!([]))).contains("no Gaussians"));
        assert!(refused(&set("/meshes/0/primitives/0/attributes", json!({"POSITION": 0}))).contains("no KHR"));
        assert!(refused(&set("/accessors/2/count", json!(3))).contains("ROTATION"));
        assert!(refused(&set("/accessors/0/count", json!(99_999_999_999_u64))).contains("POSITION"));
        assert!(refused(&set("/accessors/0/componentType", json!(5125))).contains("POSITION"));
        assert!(refused(&set("/bufferViews/1/byteOffset", json!(u64::MAX))).contains("SCALE"));
        assert!(refused(&set("/nodes/0", json!({"mesh": 0, "scale": [1, 2, 1]}))).contains("scaled differently"));
        assert!(refused(&set("/nodes/0", json!({"mesh": 0, "matrix": vec![0; 16]}))).contains("matrix"));
        let two = foreign(|json| {
            let one = json.pointer(primitive).cloned().unwrap();
            json["meshes"][0]["primitives"] = json!([one.clone(), one]);
        });
        assert!(refused(&two).contains("several lists"));
    }
}
