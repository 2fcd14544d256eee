//! Triangle meshes with textures as binary glTF 2.0.

use super::{Document, File, Placement, write_document};
use crate::{
    error::Result,
    mesh::TexturedMesh,
    picture::{RgbImage, to_png},
};
use glam::{DQuat, DVec3, Vec3};
use serde_json::{Map, Value, json};
use specula_core::lamps::Lamp;
use std::path::Path;

/// Extension of materials whose base colour contains the light.
const UNLIT: &str = "KHR_materials_unlit";
/// Extension of suns and lamps.
const LIGHTS: &str = "KHR_lights_punctual";
const UNSIGNED_INT: u32 = 5125;
const TRIANGLES: u32 = 4;
/// Targets of buffer views: attributes of vertices, indices.
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// Filters and wrapping of a sampler: linear, with levels; clamped.
const LINEAR: u32 = 9729;
const LINEAR_MIPMAP_LINEAR: u32 = 9987;
const CLAMP_TO_EDGE: u32 = 33071;

/// Writes a mesh with an optional transform of its node, which names the origin of positions if
/// that is not zero, and lamps as nodes of `KHR_lights_punctual`, placed by the same transform. A
/// white surface that faces a directional light of intensity π is white, as in readers without a
/// tone curve; sizes of lamps are `extras`, since the extension has points only.
///
/// # Errors
///
/// [`Error::TooLong`](crate::Error::TooLong) beyond 4 GiB, [`Error::Write`](crate::Error::Write) if
/// the file cannot be written.
pub fn write(
    path: &Path,
    mesh: &TexturedMesh,
    lamps: &[Lamp],
    placement: Option<Placement>,
    origin: [f64; 3],
) -> Result<()> {
    let mut file = File::default();
    let mut attributes = Map::new();
    let mut add = |name: &str, width: usize, values: &[f32]| {
        attributes.insert(name.into(), file.add(width, values, name == "POSITION").into());
    };
    add("POSITION", 3, mesh.positions.as_flattened());
    add("NORMAL", 3, mesh.normals.as_flattened());
    add("TEXCOORD_0", 2, mesh.uvs.as_flattened());
    if mesh.normal_map.is_some() {
        add("TANGENT", 4, mesh.tangents.as_flattened());
    }
    file.views.iter_mut().for_each(|view| view["target"] = ARRAY_BUFFER.into());
    let indices = file.add_view(bytemuck::cast_slice(mesh.triangles.as_flattened()));
    file.views[indices]["target"] = ELEMENT_ARRAY_BUFFER.into();
    let count = 3 * mesh.triangles.len();
    file.accessors
        .push(json!({"bufferView": indices, "componentType": UNSIGNED_INT, "type": "SCALAR", "count": count}));
    let indices = file.accessors.len() - 1;

    let mut images = Vec::new();
    let mut texture = |image: &RgbImage, name: &str| {
        let view = file.add_view(&to_png(image));
        images.push(json!({"bufferView": view, "mimeType": "image/png", "name": name}));
        json!({"index": images.len() - 1})
    };
    let mut material = json!({"name": "surface", "pbrMetallicRoughness": {
        "baseColorTexture": texture(&mesh.base_color, "base color"), "metallicFactor": 0, "roughnessFactor": 1,
    }});
    let mut used = Vec::new();
    match &mesh.surface {
        Some(surface) => {
            let physical = &mut material["pbrMetallicRoughness"];
            physical["metallicRoughnessTexture"] = texture(surface, "roughness and metalness");
            physical["metallicFactor"] = 1.into();
        }
        None => {
            material["extensions"] = json!({UNLIT: {}});
            used.push(UNLIT);
        }
    }
    if let Some(normals) = &mesh.normal_map {
        material["normalTexture"] = texture(normals, "normals");
    }
    let textures: Vec<Value> = (0..images.len()).map(|image| json!({"source": image, "sampler": 0})).collect();
    let sampler = json!({
        "magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR, "wrapS": CLAMP_TO_EDGE, "wrapT": CLAMP_TO_EDGE,
    });
    let primitive = json!({"attributes": attributes, "indices": indices, "mode": TRIANGLES, "material": 0});
    let mut rest = Map::new();
    rest.insert("materials".into(), json!([material]));
    rest.insert("textures".into(), textures.into());
    rest.insert("images".into(), images.into());
    rest.insert("samplers".into(), json!([sampler]));
    let (lights, nodes): (Vec<Value>, Vec<Value>) =
        lamps.iter().enumerate().map(|(index, lamp)| light(lamp, index, placement)).unzip();
    // An empty list is not valid.
    if !lights.is_empty() {
        rest.insert("extensions".into(), json!({LIGHTS: {"lights": lights}}));
        used.push(LIGHTS);
    }
    write_document(path, file, Document { primitive, used, nodes, rest }, placement, origin)
}

/// Light of a lamp, and the node that places it.
fn light(lamp: &Lamp, index: usize, placement: Option<Placement>) -> (Value, Value) {
    let still = Placement { rotation: DQuat::IDENTITY.to_array(), translation: [0.0; 3], scale: 1.0 };
    let Placement { rotation, translation, scale } = placement.unwrap_or(still);
    let rotation = DQuat::from_array(rotation);
    let (kind, light, factor, extras, transform) = match *lamp {
        Lamp::Sun { direction, irradiance, diameter } => {
            // It shines along −z of its node.
            let toward = rotation * Vec3::from(direction).as_dvec3().normalize_or(DVec3::Z);
            let turn = DQuat::from_rotation_arc(DVec3::Z, toward).to_array();
            ("directional", irradiance, 1.0, json!({"diameter": diameter}), ("rotation", turn.to_vec()))
        }
        Lamp::Sphere { position, intensity, radius } => {
            let place = rotation * Vec3::from(position).as_dvec3() * scale + DVec3::from(translation);
            let extras = json!({"radius": f64::from(radius) * scale});
            // Irradiance falls with the square of distances, which are scaled.
            ("point", intensity, scale * scale, extras, ("translation", place.to_array().to_vec()))
        }
    };
    let strength = Vec3::from(light).max_element();
    let color = Vec3::from(light) / strength.max(f32::MIN_POSITIVE);
    let intensity = f64::from(strength) * factor;
    let value = json!({"type": kind, "intensity": intensity, "color": color.to_array(), "extras": extras});
    let mut node = json!({"name": format!("{kind} light {}", index + 1), "extensions": {LIGHTS: {"light": index}}});
    node[transform.0] = transform.1.into();
    (value, node)
}
