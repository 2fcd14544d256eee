//! Reader of Gaussians in glTF: files of this program, and of others with the Khronos extension.

use super::{
    Attribute, LINEAR, MAGIC, SHADING, SPLATTING, SRGB, Shading,
    document::{File, Primitive},
    harmonic,
    nodes::Placed,
};
use crate::{
    Input,
    affine::{self, SCALE_MIN},
    budget::SCENE,
    error::{Error, Result},
    gaussian_ply::note_no_rotations,
    latlong::{self, ending, start_of},
};
use core::ptr;
use rayon::prelude::*;
use serde::Deserialize;
use serde_json::{Map, Value};
use specula_core::{
    activation::logit,
    color::srgb_from_linear,
    scene::{Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT, len_of_values},
    sh_fit::{self, Fit, Harmonics},
    sphere::directions,
};
use std::{collections::HashMap, path::Path};

/// Supported values of the extension. The first is the default.
const KNOWN: [(&str, &[&str]); 4] = [
    ("kernel", &["ellipse"]),
    ("colorSpace", &[SRGB, LINEAR]),
    ("projection", &["perspective"]),
    ("sortingMethod", &["cameraDistance"]),
];
/// Extensions that a file may require.
const READ: [&str; 3] = [SPLATTING, SHADING, "KHR_mesh_quantization"];
/// Maximum number of Gaussians that nodes may add by repeating lists.
const REPEATED_MAX: usize = 1 << 20;
/// Largest excess of opacities over the range 0 to 1 that is clamped.
const OPACITY_ROUNDING: f32 = 1e-3;
/// Directions in which linear colours are converted.
const DIRECTION_COUNT: usize = 64;

/// Contents of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct GlbScene {
    /// Gaussians with harmonics: for a single list, in the world of its attributes; for several, or
    /// a stretched one, in the world of the file.
    pub gaussians: Gaussians<Vec<f32>>,
    /// Shading attributes, if there are any.
    pub shading: Option<Shading>,
    /// Up direction in the world of the Gaussians, a unit vector.
    pub up: [f64; 3],
    /// Origin of the Gaussians in the world of their data set, from files of this program.
    pub origin: [f64; 3],
    /// Notes on parts of the file that are ignored or changed, one sentence each.
    pub notes: Vec<String>,
}

/// Light of a shading extension.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct LightReference {
    buffer_view: usize,
}

/// Returns whether a file is glTF, by its contents or its name.
pub fn is_gltf(path: &Path) -> bool {
    let is_named = ending(path).is_some_and(|ending| ["glb", "gltf"].contains(&ending.as_str()));
    let start = if path.is_file() { start_of(Input::file(path)).unwrap_or_default() } else { return false };
    start.starts_with(&MAGIC.to_le_bytes()) || is_named && !start.starts_with(b"ply")
}

/// Reads the Gaussians of a file, binary (`.glb`) or text (`.gltf`) with the buffers beside it.
///
/// # Errors
///
/// [`Error::Glb`] for a file without Gaussians or with faults, [`Error::Read`].
pub fn read(input: Input<'_>) -> Result<GlbScene> {
    let bytes = input.bytes()?;
    let file = File::new(input, &bytes)?;
    if let Some(name) = file.document.extensions_required.iter().find(|name| !READ.contains(&name.as_str())) {
        return Err(file.broken(&format_args!("it requires {name}, which is not supported; export it without")));
    }
    let mut notes = Vec::new();
    let placed = file.placed(&mut notes)?;
    notes.extend(file.left_out(&placed));
    match placed.as_slice() {
        [only] if only.is_similar() => {
            let gaussians = file.gaussians(only.primitive, &mut notes)?;
            let shading = file.shading(only.primitive, gaussians.count)?;
            let is_of_data = shading.is_some() || file.document.asset.generator.starts_with("specula ");
            Ok(GlbScene { up: only.up(is_of_data), origin: only.origin, gaussians, shading, notes })
        }
        several => file.joined(several, notes),
    }
}

impl File<'_> {
    /// Lists of Gaussians in one world.
    fn joined(&self, placed: &[Placed<'_>], mut notes: Vec<String>) -> Result<GlbScene> {
        let count_of = |list: &Placed<'_>| self.count(list.primitive, "POSITION").unwrap_or(0);
        let wanted = placed.iter().map(count_of).fold(0, usize::saturating_add);
        let written: HashMap<_, _> =
            placed.iter().map(|list| (ptr::from_ref(list.primitive), count_of(list))).collect();
        let repeated = written.values().fold(wanted, |wanted, count| wanted.saturating_sub(*count));
        if repeated > REPEATED_MAX {
            return Err(self.broken(&format_args!(
                "its nodes repeat lists, with {repeated} Gaussians beyond those in the file, above the limit of \
                 {REPEATED_MAX}; export fewer nodes"
            )));
        }
        let bytes = wanted.saturating_mul(4 * Layout::radiance(3).plane_count()) as u64;
        SCENE.ask(self.path, bytes, format_args!("its {wanted} Gaussians in {} lists", placed.len()), bytes)?;
        let mut lists = Vec::with_capacity(placed.len());
        for list in placed {
            let mut gaussians = self.gaussians(list.primitive, &mut notes)?;
            let is_exact = affine::map(&mut gaussians, list.world);
            if self.shading_properties(list.primitive).is_some() {
                notes.push(format!(
                    "{:?} has {SHADING} in several or stretched lists; its harmonics are rendered instead",
                    self.path
                ));
            }
            if gaussians.layout.sh_count() > 1 && !is_exact {
                notes.push(format!("{:?} stretches or shears Gaussians; their harmonics are only rotated", self.path));
            }
            lists.push(gaussians);
        }
        notes.sort_unstable();
        notes.dedup();
        Ok(GlbScene { gaussians: concatenated(&lists), shading: None, up: [0.0, 1.0, 0.0], origin: [0.0; 3], notes })
    }

    /// Gaussians of a list, in the world of its attributes.
    fn gaussians(&self, primitive: &Primitive, notes: &mut Vec<String>) -> Result<Gaussians<Vec<f32>>> {
        let extension = &primitive.extensions[SPLATTING];
        self.refuse_unknown(primitive, extension)?;
        let named = |name: &str| format!("{SPLATTING}:{name}");
        let needed = |name: &str, width: usize, count: Option<usize>| {
            self.attribute(primitive, name, width, count)?.ok_or_else(|| self.without(name, extension))
        };
        let means = needed("POSITION", 3, None)?;
        let count = means.len() / 3;
        let rotations = needed(&named("ROTATION"), 4, Some(count))?;
        let unturned = rotations.chunks_exact(4).filter(|quat| quat.iter().all(|number| *number == 0.0)).count();
        notes.extend(note_no_rotations(self.path, unturned));
        let scales = needed(&named("SCALE"), 3, Some(count))?;
        let opacities = needed(&named("OPACITY"), 1, Some(count))?;
        self.refuse_logits(&opacities)?;
        let harmonics = self.harmonics(primitive, SPLATTING, "SH", count)?;
        let Some(degree) = degree(harmonics.len()) else {
            let count = harmonics.len();
            return Err(
                self.broken(&format_args!("it has {count} harmonics; valid are 1, 4, 9 or 16, for degrees 0 to 3"))
            );
        };
        let are_logarithms = scales.iter().any(|scale| *scale < 0.0);
        let log_scale = |scale: f32| if are_logarithms { scale } else { scale.max(SCALE_MIN as f32).ln() };
        let layout = Layout::radiance(degree);
        let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
        fill(&mut gaussians, MEAN, &means, |mean: [f32; 3]| mean);
        fill(&mut gaussians, LOG_SCALE, &scales, |scales: [f32; 3]| scales.map(log_scale));
        fill(&mut gaussians, QUAT, &rotations, |[x, y, z, w]| [w, x, y, z]);
        fill(&mut gaussians, OPACITY, &opacities, |opacity: [f32; 1]| opacity.map(logit));
        for (k, harmonic) in harmonics.iter().enumerate() {
            fill(&mut gaussians, layout.sh_start() + 3 * k, harmonic, |color: [f32; 3]| color);
        }
        let path = self.path;
        if are_logarithms {
            notes.push(format!("{path:?} has negative scales, read as logarithms, as in drafts of {SPLATTING}"));
        }
        if word(extension, "colorSpace") == Some(LINEAR) {
            encode(&mut gaussians);
            notes.push(format!(
                "{path:?} has colours in {LINEAR}; they are encoded as sRGB per Gaussian before blending"
            ));
        }
        notes.extend(self.left_out_of(primitive, extension, harmonics.len()));
        Ok(gaussians)
    }

    /// Rejects a list that needs another way of rendering.
    fn refuse_unknown(&self, primitive: &Primitive, extension: &Value) -> Result<()> {
        for (key, known) in KNOWN {
            let found = extension.get(key).unwrap_or(&Value::Null);
            if !found.is_null() && !found.as_str().is_some_and(|word| known.contains(&word)) {
                let known = known.join(" or ");
                return Err(self.broken(&format_args!("its {key} is {found}; only {known} is supported")));
            }
        }
        if primitive.indices.is_some() {
            return Err(self.broken(&"its Gaussians have indices; export them without"));
        }
        Ok(())
    }

    /// Rejects opacities out of range. Converting them is not safe: no version of the extension has
    /// logits, so they are probably faulty.
    fn refuse_logits(&self, opacities: &[f32]) -> Result<()> {
        let range = -OPACITY_ROUNDING..=1.0 + OPACITY_ROUNDING;
        match opacities.iter().find(|opacity| !opacity.is_nan() && !range.contains(opacity)) {
            None => Ok(()),
            Some(opacity) => {
                Err(self
                    .broken(&format_args!("its opacities are not in 0 to 1 ({opacity}); export activated opacities")))
            }
        }
    }

    /// Error for a list without an attribute.
    fn without(&self, name: &str, extension: &Value) -> Error {
        match self.unknown_extensions(extension).next() {
            Some(other) => {
                self.broken(&format_args!("its Gaussians are in {other}, which is not supported; export them without"))
            }
            None => self.broken(&format_args!("its Gaussians have no {name}; export them without compression")),
        }
    }

    fn unknown_extensions<'v>(&self, extension: &'v Value) -> impl Iterator<Item = &'v String> {
        let extensions = extension.get("extensions").and_then(Value::as_object);
        extensions.into_iter().flat_map(|names| names.keys()).filter(|name| *name != SHADING)
    }

    /// Note on unused properties and attributes of a list.
    fn left_out_of(&self, primitive: &Primitive, extension: &Value, harmonics: usize) -> Option<String> {
        let is_known = |key: &&String| {
            KNOWN.iter().any(|(known, _)| known == key) || ["extensions", "extras"].contains(&key.as_str())
        };
        let properties = extension.as_object().into_iter().flat_map(|properties| properties.keys());
        let properties = properties.filter(|key| !is_known(key)).chain(self.unknown_extensions(extension));
        let used: Vec<String> = (0..harmonics).map(|k| harmonic("SH", k)).collect();
        let is_used =
            |name: &str| ["ROTATION", "SCALE", "OPACITY"].contains(&name) || used.iter().any(|used| used == name);
        let own = |name: &&String| {
            name.strip_prefix(SPLATTING).and_then(|name| name.strip_prefix(':')).is_some_and(|name| !is_used(name))
        };
        let names: Vec<&str> =
            properties.chain(primitive.attributes.keys().filter(own)).map(String::as_str).take(8).collect();
        (!names.is_empty()).then(|| format!("{:?} also has {}: ignored", self.path, names.join(", ")))
    }

    /// Available harmonics, starting with the constant one.
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

    fn shading_properties<'p>(&self, primitive: &'p Primitive) -> Option<&'p Map<String, Value>> {
        primitive.extensions.get(SPLATTING)?.get("extensions")?.get(SHADING)?.as_object()
    }

    fn shading(&self, primitive: &Primitive, count: usize) -> Result<Option<Shading>> {
        let Some(properties) = self.shading_properties(primitive) else { return Ok(None) };
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
        let (bytes, _) = self.view(buffer_view).ok_or_else(|| self.broken(&"its light is missing"))?;
        latlong::cube_from(Input::memory("its light", bytes)).map_err(|error| self.broken(&error))
    }
}

fn word<'v>(extension: &'v Value, key: &str) -> Option<&'v str> {
    extension.get(key)?.as_str()
}

/// Concatenates lists, with the harmonics of the largest degree.
fn concatenated(lists: &[Gaussians<Vec<f32>>]) -> Gaussians<Vec<f32>> {
    let count = lists.iter().map(|list| list.count).sum();
    let layout = Layout::radiance(lists.iter().filter_map(|list| list.layout.sh_degree).max().unwrap_or(0));
    let mut all = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    let mut next = 0;
    for list in lists {
        for index in 0..list.count {
            // Planes of harmonics come last, so a lower degree is a prefix of a higher one.
            (0..list.layout.plane_count()).for_each(|plane| all.set(next, plane, list.get::<1>(index, plane)));
            next += 1;
        }
    }
    all
}

/// Encodes linear colours of harmonics as sRGB: by least squares over the sphere of directions,
/// which is exact for constant colours.
fn encode(gaussians: &mut Gaussians<Vec<f32>>) {
    let (start, count) = (gaussians.layout.sh_start(), gaussians.layout.sh_count());
    let around = directions(DIRECTION_COUNT).map(|direction| sh_fit::harmonics(direction.map(|x| x as f32), count));
    let around: Vec<Harmonics> = around.collect();
    let mut fit = Fit::new(count);
    around.iter().for_each(|harmonics| fit.add_direction(harmonics, 1.0));
    let encoded = |index: usize| {
        let linear: Vec<[f32; 3]> = (0..count).map(|k| gaussians.get(index, start + 3 * k)).collect();
        let mut fit = fit.without_colors(1.0);
        for harmonics in &around {
            let color = |c: usize| 0.5 + linear.iter().zip(harmonics).map(|(l, y)| f64::from(l[c]) * y).sum::<f64>();
            fit.add_color(harmonics, [0, 1, 2].map(|c| srgb_from_linear(color(c).max(0.0) as f32)), 1.0);
        }
        fit.solve()
    };
    let encoded: Vec<_> = (0..gaussians.count).into_par_iter().map(encoded).collect();
    for (index, harmonics) in encoded.into_iter().enumerate() {
        // Numbers that are not finite are kept and rejected later.
        for (k, harmonic) in harmonics.iter().flatten().take(count).enumerate() {
            gaussians.set(index, start + 3 * k, *harmonic);
        }
    }
}

/// Sets planes of all Gaussians.
fn fill<const N: usize>(
    gaussians: &mut Gaussians<Vec<f32>>,
    plane: usize,
    values: &[f32],
    convert: impl Fn([f32; N]) -> [f32; N],
) {
    values.as_chunks().0.iter().enumerate().for_each(|(index, of)| gaussians.set(index, plane, convert(*of)));
}

/// Degree with this number of harmonics; `None` if there is none.
pub const fn degree(count: usize) -> Option<u8> {
    match count {
        1 => Some(0),
        4 => Some(1),
        9 => Some(2),
        16 => Some(3),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::{FLOAT, Placement, write, write_chunks};
    use super::*;
    use glam::DVec3;
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
    fn written_files_are_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        let root = core::f64::consts::FRAC_1_SQRT_2;
        let turned = Placement { rotation: [-root, 0.0, 0.0, root], translation: [1.0; 3], scale: 2.0 };
        let given = gaussians();
        for (shading, placement) in [(None, None), (Some(shading()), None), (Some(shading()), Some(turned))] {
            let origin = [448_123.5, -5_411_068.0, 1e-3];
            write(&path, &given, shading.as_ref(), placement, origin).unwrap();
            let read = read(Input::file(&path)).unwrap();
            assert_eq!(read.origin, origin);
            assert_eq!((read.gaussians.count, read.gaussians.layout), (given.count, given.layout));
            for plane in 0..given.layout.plane_count() {
                let apart = given.plane(plane).zip(read.gaussians.plane(plane)).map(|(a, b)| (a - b).abs());
                assert!(apart.fold(0.0, f32::max) <= ROUNDING, "plane {plane}");
            }
            assert_eq!(read.shading, shading);
            // A rotation by −90° about x maps +z, the up axis of data sets, to +y.
            assert!((DVec3::from(read.up) - DVec3::Z).length() < 1e-12, "{:?}", read.up);
        }
    }

    /// Bytes of a file of two Gaussians, as other programs store them, with changes of its JSON.
    fn foreign(change: impl FnOnce(&mut Value)) -> Vec<u8> {
        let floats: [f32; 12] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6];
        let mut binary: Vec<u8> = floats.iter().flat_map(|number| number.to_le_bytes()).collect();
        // Quats as shorts, opacities as every fourth byte, a constant harmonic.
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
        let GlbScene { gaussians, shading, up, notes, origin } =
            read(Input::memory("a.glb", &foreign(|_| ()))).unwrap();
        assert_eq!((shading, up, gaussians.layout), (None, [0.0, 1.0, 0.0], Layout::radiance(0)));
        assert_eq!((notes, origin), (vec![], [0.0; 3]));
        assert_eq!(gaussians.get::<3>(1, MEAN), [3.0, 4.0, 5.0]);
        assert_eq!([0, 1].map(|index| gaussians.get::<4>(index, QUAT)), [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]);
        for (index, opacity) in [(0, 0.2_f32), (1, 0.8)] {
            let [found]: [f32; 1] = gaussians.get(index, OPACITY);
            assert!((found - logit(opacity)).abs() <= ROUNDING, "{found}");
        }
    }

    #[test]
    fn faulty_files_are_errors() {
        let refused = |bytes: &[u8]| read(Input::memory("a.glb", bytes)).unwrap_err().to_string();
        let right = foreign(|_| ());
        for len in (0..right.len()).step_by(7) {
            assert!(refused(&right[..len]).contains("a.glb"), "{len} bytes");
        }
        let set = |pointer: &'static str, value: Value| {
            foreign(move |json| *json.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer}")) = value)
        };
        assert!(refused(&set("/meshes/0/primitives", json!([]))).contains("no Gaussians"));
        assert!(refused(&set("/meshes/0/primitives/0/attributes", json!({"POSITION": 0}))).contains("no KHR"));
        assert!(refused(&set("/accessors/2/count", json!(3))).contains("ROTATION"));
        assert!(refused(&set("/accessors/0/count", json!(99_999_999_999_u64))).contains("POSITION"));
        assert!(refused(&set("/accessors/0/componentType", json!(5125))).contains("POSITION"));
        assert!(refused(&set("/bufferViews/1/byteOffset", json!(u64::MAX))).contains("SCALE"));
        assert!(refused(&set("/nodes/0", json!({"mesh": 0, "matrix": vec![0; 16]}))).contains("no inverse"));
    }
}
