//! Scenes packed for web pages: numbers quantised, in an order that compresses.
//!
//! ```text
//! "specula" 2     magic and version
//! u32             length of the header
//! JSON            layout, names, cameras, ranges of quantised numbers
//! streams         numbers of Gaussians, plane by plane; of lights; of the near field
//! ```
//!
//! The numbers of a stream are stored byte plane by byte plane, the highest first: neighbours have
//! similar high bytes, which compress well. Quats have length 1, logits are within ±[`LOGIT_MAX`],
//! the vertices of a near field are stored in the order of their first use by triangles, with
//! octahedral normals, and the reader rebuilds the hierarchy.

mod octahedron;
mod streams;

use crate::{LightSetup, ViewedScene, ViewerError};
use serde::{Deserialize, Serialize};
use specula_core::{
    antialias::LowPass,
    camera::Camera,
    near_field::{NODE_LEN, NearField, TRIANGLE_LEN, VERTEX_BASE, VERTEX_LEN, VERTEX_NORMAL},
    prefilter::RESOLUTION_MAX,
    scene::{
        AMBIENT, Appearance, DIFFUSE, Environment, Gaussians, LOG_SCALE, Layout, MEAN, NORMAL_RESIDUAL_1, OPACITY,
        QUAT, RadianceActivation, len_of_values,
    },
};
use specula_io::{Input, orientation::Orientation};
use specula_mesh::near_field::rearranged;
use specula_scene::{
    Scene, ShadingModel, Surface,
    import::{self, Imported},
    light_file::MapUp,
    number::group_digits,
};
use streams::{Reader, Stream, Writer};

/// First bytes of a packed scene; the last one is the version of the format.
const MAGIC: [u8; 8] = *b"specula\x02";
/// Logits are clamped to ±`LOGIT_MAX`, where the sigmoid is within 6e-6 of 0 or 1.
const LOGIT_MAX: f32 = 12.0;
/// Steps of means in the median size of a Gaussian, and of deviations of filters in their range.
const MEAN_STEPS: f64 = 64.0;
const FILTER_STEPS: f64 = ((1 << 16) - 1) as f64;
/// Steps of log scales, of components of unit quats, of logits, and of ambient transfer.
const SCALE_STEP: f64 = 1.0 / 256.0;
const QUAT_STEP: f64 = 1.0 / 2048.0;
const LOGIT_STEP: f64 = 1.0 / 32.0;
const AMBIENT_STEP: f64 = 1.0 / 256.0;
/// Steps of normal residuals, of constant harmonics, and of others: errors of many of these average
/// out in a pixel.
const RESIDUAL_STEP: f64 = 1.0 / 256.0;
const CONSTANT_STEP: f64 = 1.0 / 256.0;
const HARMONICS_STEP: f64 = 1.0 / 64.0;
/// Steps of a near field: of its vertices, in offsets at which rays start; of octahedral normals,
/// whose range fits a byte; of the rest.
const VERTEX_STEP: f64 = 1.0 / 8.0;
const NORMAL_STEP: f64 = 1.0 / 127.0;
const ATTRIBUTE_STEP: f64 = 1.0 / 64.0;
/// First plane of harmonics of shaded Gaussians.
const SH_START: usize = Layout::shaded(None).sh_start();
/// Largest number of Gaussians.
const GAUSSIANS_MAX: usize = 1 << 25;

/// Precision of the numbers of a packed scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PackPrecision {
    /// Every bit.
    Exact,
    /// Steps below visible differences: a 64th of a Gaussian's size for means, about a percent for
    /// the rest.
    Quantised,
}

/// Light in addition to the scene's.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedLight {
    /// Name of its file.
    pub name: String,
    /// Up direction for reading the file.
    pub up: MapUp,
    /// Radiance as a cube map.
    pub cube: Environment<Vec<f32>>,
}

/// Scene of a web page.
#[derive(Debug)]
pub struct PackedScene {
    /// Scene and its cameras; without photographs.
    pub viewed: ViewedScene,
    /// Lights to choose from; [`SetupEnvironment::Added`](crate::SetupEnvironment::Added) counts
    /// them from 1.
    pub lights: Vec<PackedLight>,
    /// First light.
    pub setup: LightSetup,
    /// Sentence about the scene.
    pub caption: String,
}

#[derive(Serialize, Deserialize)]
struct Header {
    name: String,
    caption: String,
    count: usize,
    layout: PackedLayout,
    /// Comment that names the shading model.
    shading: String,
    background: [f32; 3],
    orientation: Orientation,
    #[serde(default)]
    origin: [f64; 3],
    held_out: usize,
    views: Vec<PackedView>,
    /// Streams of the planes of the Gaussians.
    planes: Vec<Stream>,
    light: Option<LightHeader>,
    lights: Vec<LightHeader>,
    #[serde(default)]
    setup: LightSetup,
    near_field: Option<NearFieldHeader>,
}

#[derive(Serialize, Deserialize)]
struct PackedLayout {
    shaded: bool,
    sh_degree: Option<u8>,
    physical: bool,
    low_pass: String,
    smoothed: bool,
}

#[derive(Serialize, Deserialize)]
struct PackedView {
    name: String,
    size: [u32; 2],
    position: [f32; 3],
    /// Columns of the rotation from world to camera.
    rotation: [f32; 9],
    focal: [f32; 2],
    principal: [f32; 2],
    near: f32,
}

#[derive(Serialize, Deserialize)]
struct LightHeader {
    name: String,
    up: String,
    resolution: usize,
    activation: String,
    stream: Stream,
}

#[derive(Serialize, Deserialize)]
struct NearFieldHeader {
    sizes: [usize; 3],
    offset: f32,
    /// Streams of nodes, of corners of triangles, and of each number of a vertex. Without a stream
    /// of nodes the hierarchy is rebuilt, and a normal has two octahedral numbers.
    nodes: Option<Stream>,
    corners: Stream,
    vertices: Vec<Stream>,
}

impl PackedScene {
    /// Uncompressed bytes of the scene.
    pub fn pack(&self, precision: PackPrecision) -> Vec<u8> {
        let mut writer = Writer::default();
        let ViewedScene { name, scene, views, held_out, origin, orientation, background, .. } = &self.viewed;
        let Scene { gaussians, light, near_field, shading_model, .. } = scene;
        let is_exact = precision == PackPrecision::Exact;
        let planes = pack_gaussians(gaussians, is_exact, &mut writer);
        let light = light.as_ref().map(|cube| pack_light("", MapUp::Scene, cube, is_exact, &mut writer));
        let lights =
            self.lights.iter().map(|light| pack_light(&light.name, light.up, &light.cube, is_exact, &mut writer));
        let lights = lights.collect();
        let near_field = near_field.as_ref().map(|surface| pack_near_field(surface, is_exact, &mut writer));
        let header = Header {
            name: name.clone(),
            caption: self.caption.clone(),
            count: gaussians.count,
            layout: PackedLayout::of(gaussians.layout),
            shading: shading_model.comment(),
            background: *background,
            orientation: *orientation,
            origin: *origin,
            held_out: *held_out,
            views: views.iter().map(|(name, camera)| PackedView::of(name, camera)).collect(),
            planes,
            light,
            lights,
            setup: self.setup.clone(),
            near_field,
        };
        let header = serde_json::to_vec(&header).unwrap_or_default();
        let len = (header.len() as u32).to_le_bytes();
        [MAGIC.as_slice(), &len, &header, &writer.bytes].concat()
    }

    /// Scene of a file: of [`PackedScene::pack`], or of glTF with Gaussians.
    ///
    /// # Errors
    ///
    /// A sentence on the first fault.
    pub fn open(name: &str, bytes: &[u8]) -> Result<Self, ViewerError> {
        let is_gltf = bytes.starts_with(b"glTF") || name.to_ascii_lowercase().ends_with(".gltf");
        if is_gltf { Self::of_glb(name, bytes) } else { Self::unpack(bytes) }
    }

    /// Scene of glTF with Gaussians.
    fn of_glb(name: &str, bytes: &[u8]) -> Result<Self, ViewerError> {
        let Imported { scene, orientation, notes, .. } = import::scene_of_glb(Input::memory(name, bytes))?;
        let kind = match (scene.gaussians.layout.is_physical, scene.gaussians.layout.is_shaded()) {
            (true, _) => "physical materials, relightable",
            (false, true) => "a shading function, relightable",
            (false, false) => "plain Gaussian splatting",
        };
        let notes: String = notes.iter().map(|note| format!(" Note: {note}.")).collect();
        let caption = format!("{} Gaussians of {name}, {kind}.{notes}", group_digits(scene.gaussians.count));
        let viewed = ViewedScene {
            name: name.strip_suffix(".glb").or(name.strip_suffix(".gltf")).unwrap_or(name).to_owned(),
            scene,
            views: Vec::new(),
            held_out: 0,
            origin: [0.0; 3],
            orientation,
            photographs: None,
            background: [0.0; 3],
        };
        Ok(Self { viewed, lights: Vec::new(), setup: LightSetup::default(), caption })
    }

    /// Scene of the bytes of [`PackedScene::pack`].
    ///
    /// # Errors
    ///
    /// A sentence on the first fault.
    pub fn unpack(bytes: &[u8]) -> Result<Self, ViewerError> {
        let (header, streams) = split(bytes).ok_or_else(|| damaged("it is not a scene of specula, or cut short"))?;
        let header: Header = serde_json::from_slice(header).map_err(|error| damaged(&error.to_string()))?;
        let mut reader = Reader { bytes: streams };
        let scene = header.scene(&mut reader)?;
        let lights = header.lights.iter().map(|light| {
            let up = MapUp::try_from(light.up.clone()).map_err(damaged)?;
            Ok(PackedLight { name: light.name.clone(), up, cube: light.cube(&mut reader)? })
        });
        let lights = lights.collect::<Result<Vec<_>, ViewerError>>()?;
        let near_field = header.near_field.as_ref().map(|near_field| near_field.surface(&mut reader)).transpose()?;
        if !reader.bytes.is_empty() {
            return Err(damaged("it is longer than its header says"));
        }
        if !header.orientation.is_valid() {
            return Err(damaged("its orientation is invalid"));
        }
        let views = header.views.iter().map(PackedView::camera).collect::<Result<Vec<_>, _>>()?;
        let viewed = ViewedScene {
            name: header.name,
            scene: Scene { near_field: near_field.map(Surface::shared), ..scene },
            views,
            held_out: header.held_out,
            origin: header.origin,
            orientation: header.orientation,
            photographs: None,
            background: header.background,
        };
        Ok(Self { viewed, lights, setup: header.setup, caption: header.caption })
    }
}

fn split(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let rest = bytes.strip_prefix(&MAGIC)?;
    let (len, rest) = rest.split_first_chunk::<4>()?;
    rest.split_at_checked(u32::from_le_bytes(*len) as usize)
}

fn damaged(cause: &str) -> ViewerError {
    ViewerError::Request(format!("cannot read the packed scene: {cause}; export it again"))
}

impl Header {
    /// Gaussians and light.
    fn scene(&self, reader: &mut Reader<'_>) -> Result<Scene, ViewerError> {
        let layout = self.layout.layout().ok_or_else(|| damaged("its layout is unknown"))?;
        if self.planes.len() != layout.plane_count() || self.count > GAUSSIANS_MAX {
            return Err(damaged("its planes are not those of its layout"));
        }
        let shading_model = ShadingModel::from_comment(&self.shading);
        let shading_model = shading_model.ok_or_else(|| damaged("its shading model is unknown"))?;
        // Each plane takes at least one byte per number, so the file's length bounds the memory.
        if reader.bytes.len() < self.count * layout.plane_count() {
            return Err(damaged("it is cut short"));
        }
        let mut gaussians =
            Gaussians { count: self.count, layout, values: vec![0.0; len_of_values(self.count, layout)] };
        for (plane, stream) in self.planes.iter().enumerate() {
            let numbers = reader.numbers(stream, self.count).ok_or_else(|| damaged("it is cut short"))?;
            for (gaussian, number) in numbers.into_iter().enumerate() {
                gaussians.set(gaussian, plane, [number]);
            }
        }
        let light = self.light.as_ref().map(|light| light.cube(reader)).transpose()?;
        Ok(Scene { gaussians, light, near_field: None, lamps: None, other_lights: Vec::new(), shading_model })
    }
}

/// Step of a plane of Gaussians.
fn step_of(plane: usize, layout: Layout) -> f64 {
    let sh_start = layout.sh_start();
    match plane {
        LOG_SCALE..QUAT => SCALE_STEP,
        QUAT..OPACITY => QUAT_STEP,
        NORMAL_RESIDUAL_1..SH_START if layout.is_shaded() => RESIDUAL_STEP,
        _ if (sh_start..sh_start + 3).contains(&plane) && plane < layout.sh_end() => CONSTANT_STEP,
        _ if (sh_start..layout.sh_end()).contains(&plane) => HARMONICS_STEP,
        _ if layout.physical_planes().is_some_and(|first| plane >= first + AMBIENT) => AMBIENT_STEP,
        _ => LOGIT_STEP,
    }
}

/// True if a plane contains logits.
fn is_logit(plane: usize, layout: Layout) -> bool {
    let is_of_material = |first: usize| (first..first + AMBIENT).contains(&plane);
    let is_of_shading = (DIFFUSE..NORMAL_RESIDUAL_1).contains(&plane) && layout.is_shaded();
    plane == OPACITY || is_of_shading || layout.physical_planes().is_some_and(is_of_material)
}

fn pack_gaussians(gaussians: &Gaussians<Vec<f32>>, is_exact: bool, writer: &mut Writer) -> Vec<Stream> {
    let layout = gaussians.layout;
    if is_exact {
        return (0..layout.plane_count()).map(|plane| writer.exact(gaussians.plane(plane))).collect();
    }
    let mut unit = gaussians.clone();
    for gaussian in 0..gaussians.count {
        let quat: [f32; 4] = gaussians.get(gaussian, QUAT);
        let length = quat.iter().map(|x| x * x).sum::<f32>().sqrt() * if quat[0] < 0.0 { -1.0 } else { 1.0 };
        unit.set(gaussian, QUAT, if length == 0.0 { quat } else { quat.map(|x| x / length) });
        unit.set(gaussian, LOG_SCALE, told_apart(gaussians.get(gaussian, LOG_SCALE)));
    }
    let mean_step = median_size(gaussians) / MEAN_STEPS;
    let pack = |plane: usize| {
        let bound = if is_logit(plane, layout) { LOGIT_MAX } else { f32::MAX };
        let numbers: Vec<f32> = unit.plane(plane).map(|x| x.clamp(-bound, bound)).collect();
        let [least, most] = streams::range(&numbers);
        let step = match plane {
            MEAN..LOG_SCALE => mean_step,
            _ if Some(plane) == layout.filter_plane() => f64::from(most - least) / FILTER_STEPS,
            _ => step_of(plane, layout),
        };
        writer.stepped(&numbers, step, plane < LOG_SCALE)
    };
    (0..layout.plane_count()).map(pack).collect()
}

/// Log scales whose smallest, along the normal, stays the smallest after rounding: it is lowered
/// until it is more than a step below both others.
fn told_apart(mut log_scales: [f32; 3]) -> [f32; 3] {
    const APART: f32 = 1.25 * SCALE_STEP as f32;
    let shorter = |k: usize, other: usize| if log_scales[other] < log_scales[k] { other } else { k };
    let shortest = (1..3).fold(0, shorter);
    let others = (0..3).filter(|k| *k != shortest).map(|k| log_scales[k]).fold(f32::INFINITY, f32::min);
    log_scales[shortest] = log_scales[shortest].min(others - APART);
    log_scales
}

/// Median of the largest scales of Gaussians, in world units; 0 without any.
fn median_size(gaussians: &Gaussians<Vec<f32>>) -> f64 {
    let largest = |index: usize| gaussians.get::<3>(index, LOG_SCALE).into_iter().fold(f32::MIN, f32::max);
    let mut sizes: Vec<f32> = (0..gaussians.count).map(largest).collect();
    let middle = sizes.len() / 2;
    if sizes.is_empty() { 0.0 } else { f64::from(*sizes.select_nth_unstable_by(middle, f32::total_cmp).1).exp() }
}

fn pack_light(name: &str, up: MapUp, cube: &Environment<Vec<f32>>, is_exact: bool, writer: &mut Writer) -> LightHeader {
    let numbers = cube.values.iter().copied();
    // Weights of a network are few.
    let stream = if is_exact || cube.is_network() { writer.exact(numbers) } else { writer.shortened(numbers) };
    let activation = match cube.activation {
        RadianceActivation::Identity => "identity",
        RadianceActivation::Exponential => "exponential",
        RadianceActivation::Network => "network",
    };
    LightHeader {
        name: name.to_owned(),
        up: up.name().to_owned(),
        resolution: cube.resolution,
        activation: activation.to_owned(),
        stream,
    }
}

impl LightHeader {
    fn cube(&self, reader: &mut Reader<'_>) -> Result<Environment<Vec<f32>>, ViewerError> {
        let activation = match self.activation.as_str() {
            "identity" => RadianceActivation::Identity,
            "exponential" => RadianceActivation::Exponential,
            "network" => RadianceActivation::Network,
            _ => return Err(damaged("its light is of an unknown kind")),
        };
        if !self.resolution.is_power_of_two() || self.resolution > RESOLUTION_MAX {
            return Err(damaged("the resolution of its light cannot be filtered"));
        }
        let empty = Environment { resolution: self.resolution, activation, values: Vec::new() };
        let values = reader.numbers(&self.stream, empty.len_of_values()).ok_or_else(|| damaged("it is cut short"))?;
        if !values.iter().all(|number| number.is_finite()) {
            return Err(damaged("its light is not finite"));
        }
        Ok(Environment { values, ..empty })
    }
}

fn pack_near_field(surface: &NearField<Vec<f32>>, is_exact: bool, writer: &mut Writer) -> NearFieldHeader {
    let [triangles, vertices] = [surface.triangles_start(), surface.vertices_start()];
    let nodes = is_exact.then(|| writer.exact(surface.values[..triangles].iter().copied()));
    let mut corners: Vec<f32> = surface.values[triangles..vertices]
        .as_chunks::<TRIANGLE_LEN>()
        .0
        .iter()
        .flat_map(|[a, b, c, _]| [*a, *b, *c])
        .collect();
    let all = surface.values[vertices..].as_chunks::<VERTEX_LEN>().0;
    let order = if is_exact { (0..all.len()).collect() } else { in_order_of_use(&mut corners, all.len()) };
    let corners = writer.whole(&corners);
    let column = |number: usize| order.iter().map(|vertex| all[*vertex][number]).collect::<Vec<f32>>();
    let pack = |writer: &mut Writer, number: usize| match number {
        _ if is_exact => writer.exact(column(number).into_iter()),
        0..VERTEX_NORMAL => writer.stepped(&column(number), f64::from(surface.offset) * VERTEX_STEP, true),
        _ => writer.stepped(&column(number), ATTRIBUTE_STEP, true),
    };
    let vertices = if is_exact {
        (0..VERTEX_LEN).map(|number| pack(writer, number)).collect()
    } else {
        let mut streams: Vec<Stream> = (0..VERTEX_NORMAL).map(|number| pack(writer, number)).collect();
        let normal = |vertex: &usize| octahedron::folded(core::array::from_fn(|k| all[*vertex][VERTEX_NORMAL + k]));
        let normals: Vec<[f32; 2]> = order.iter().map(normal).collect();
        for axis in 0..2 {
            let numbers: Vec<f32> = normals.iter().map(|normal| normal[axis]).collect();
            streams.push(writer.stepped(&numbers, NORMAL_STEP, true));
        }
        streams.extend((VERTEX_BASE..VERTEX_LEN).map(|number| pack(writer, number)));
        streams
    };
    NearFieldHeader { sizes: surface.sizes(), offset: surface.offset, nodes, corners, vertices }
}

/// Numbers vertices in the order of their first use by corners, unused ones last. Returns the
/// former number of each.
fn in_order_of_use(corners: &mut [f32], vertex_count: usize) -> Vec<usize> {
    let mut numbers: Vec<Option<usize>> = vec![None; vertex_count];
    let mut order = Vec::with_capacity(vertex_count);
    for corner in corners {
        let vertex = *corner as usize;
        let number = *numbers[vertex].get_or_insert_with(|| {
            order.push(vertex);
            order.len() - 1
        });
        *corner = number as f32;
    }
    order.extend((0..vertex_count).filter(|vertex| numbers[*vertex].is_none()));
    order
}

impl NearFieldHeader {
    fn surface(&self, reader: &mut Reader<'_>) -> Result<NearField<Vec<f32>>, ViewerError> {
        let short = || damaged("it is cut short");
        let [node_count, triangle_count, vertex_count] = self.sizes;
        let stream_count = if self.nodes.is_some() { VERTEX_LEN } else { VERTEX_LEN - 1 };
        if self.vertices.len() != stream_count || self.sizes.iter().any(|size| *size > GAUSSIANS_MAX) {
            return Err(damaged("its near field has another layout"));
        }
        let nodes = match &self.nodes {
            Some(stream) => Some(reader.numbers(stream, NODE_LEN * node_count).ok_or_else(short)?),
            None => None,
        };
        let corners = reader.numbers(&self.corners, 3 * triangle_count).ok_or_else(short)?;
        let corners = corners.as_chunks::<3>().0.iter().flat_map(|[a, b, c]| [*a, *b, *c, 0.0]);
        let corners: Vec<f32> = corners.collect();
        let columns = self.vertices.iter().map(|stream| reader.numbers(stream, vertex_count).ok_or_else(short));
        let mut columns = columns.collect::<Result<Vec<_>, _>>()?;
        if self.nodes.is_none() {
            let [u, v] = [0, 1].map(|axis| columns[VERTEX_NORMAL + axis].as_slice());
            let normals: Vec<[f32; 3]> = u.iter().zip(v).map(|(u, v)| octahedron::unfolded([*u, *v])).collect();
            let axes = [0, 1, 2].map(|axis| normals.iter().map(|normal| normal[axis]).collect());
            columns.splice(VERTEX_NORMAL..VERTEX_NORMAL + 2, axes);
        }
        let vertices: Vec<f32> =
            (0..vertex_count).flat_map(|vertex| columns.iter().map(move |column| column[vertex])).collect();
        let (sizes, values) = match nodes {
            Some(nodes) => (self.sizes, [nodes, corners, vertices].concat()),
            None => ([0, triangle_count, vertex_count], [corners, vertices].concat()),
        };
        let surface = NearField::of_sizes(sizes, self.offset, values);
        let surface = if self.nodes.is_none() { rearranged(&surface) } else { Some(surface) };
        let surface = surface.ok_or_else(|| damaged("its near field has triangles without vertices"))?;
        surface.check().map_err(|error| damaged(&error.to_string()))?;
        Ok(surface)
    }
}

impl PackedLayout {
    fn of(layout: Layout) -> Self {
        let low_pass = match layout.low_pass {
            LowPass::Dilated => "dilated",
            LowPass::Compensated => "compensated",
            LowPass::Mip => "mip",
        };
        Self {
            shaded: layout.is_shaded(),
            sh_degree: layout.sh_degree,
            physical: layout.is_physical,
            low_pass: low_pass.to_owned(),
            smoothed: layout.is_smoothed,
        }
    }

    fn layout(&self) -> Option<Layout> {
        let low_pass = match self.low_pass.as_str() {
            "dilated" => LowPass::Dilated,
            "compensated" => LowPass::Compensated,
            "mip" => LowPass::Mip,
            _ => return None,
        };
        Some(Layout {
            appearance: if self.shaded { Appearance::Shaded } else { Appearance::Radiance },
            sh_degree: self.sh_degree.filter(|degree| *degree <= 3),
            is_physical: self.physical,
            low_pass,
            is_smoothed: self.smoothed,
        })
    }
}

impl PackedView {
    fn of(name: &str, camera: &Camera) -> Self {
        Self {
            name: name.to_owned(),
            size: [camera.width, camera.height],
            position: camera.position.to_array(),
            rotation: camera.camera_from_world.to_cols_array(),
            focal: camera.focal_px,
            principal: camera.principal_px,
            near: camera.near,
        }
    }

    fn camera(&self) -> Result<(String, Camera), ViewerError> {
        let [width, height] = self.size;
        let numbers = [self.position.as_slice(), &self.rotation, &self.focal, &self.principal, &[self.near]].concat();
        if width == 0 || height == 0 || !numbers.iter().all(|number| number.is_finite()) {
            return Err(damaged("one of its cameras has no size or numbers that are not finite"));
        }
        let camera = Camera {
            camera_from_world: glam::Mat3::from_cols_array(&self.rotation),
            position: self.position.into(),
            focal_px: self.focal,
            principal_px: self.principal,
            light_from_world: None,
            scissor: None,
            light: 0,
            near: self.near,
            width,
            height,
        };
        Ok((self.name.clone(), camera))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SetupEnvironment;
    use glam::Vec3;
    use specula_core::{
        random::uniform,
        scene::{ALBEDO, ROUGHNESS},
    };
    use specula_io::orientation::UpSource;

    /// Largest error of quantised means of Gaussians of about one unit, of log scales, and of unit
    /// quats.
    const NEAR: f32 = 0.02;
    const NEAR_SCALE: f32 = 2e-3;
    const NEAR_QUAT: f32 = 3e-4;
    /// Largest error of a logit, half of a step.
    const NEAR_LOGIT: f32 = 0.0157;
    /// Largest error of a number of a near field's vertex, half of a step.
    const NEAR_VERTEX: f32 = 0.00785;

    fn number(stream: u64, index: usize) -> f32 {
        uniform(5, stream, index as u64) - 0.5
    }

    fn gaussians() -> Gaussians<Vec<f32>> {
        let layout = Layout::shaded(Some(1)).physical().antialiased();
        let count = 37;
        let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
        for index in 0..count {
            for plane in 0..layout.plane_count() {
                gaussians.set(index, plane, [number(plane as u64, index)]);
            }
        }
        gaussians.set(3, ROUGHNESS, [80.0]);
        gaussians
    }

    /// Two triangles in a plane.
    fn surface() -> NearField<Vec<f32>> {
        let triangles = [[0.0, 1.0, 2.0, 0.0], [1.0, 3.0, 2.0, 0.0]];
        let vertex = |index: usize| {
            let [x, y] = [index % 2, index / 2].map(|k| k as f32);
            let others = (6..VERTEX_LEN).map(move |k| 0.5 + number(90 + k as u64, index));
            [x, y, 0.0, 0.0, 0.0, 1.0].into_iter().chain(others)
        };
        let values = triangles.as_flattened().iter().copied().chain((0..4).flat_map(vertex)).collect();
        rearranged(&NearField::of_sizes([0, 2, 4], 0.01, values)).expect("all corners are there")
    }

    fn scene() -> PackedScene {
        let cube = |activation| {
            let values = (0..18 * 8 * 8).map(|index| number(70, index) + 1.0).collect();
            Environment { resolution: 8, activation, values }
        };
        let scene = Scene {
            gaussians: gaussians(),
            light: Some(cube(RadianceActivation::Exponential)),
            near_field: Some(Surface::shared(surface())),
            lamps: None,
            other_lights: Vec::new(),
            shading_model: ShadingModel::DEFERRED,
        };
        let orientation = Orientation {
            up: [0.0, 0.0, 1.0],
            centre: [0.0; 3],
            distance: 4.0,
            up_source: UpSource::Upright,
            cameras: 1,
            rolled: 0,
            error_degrees: None,
        };
        let camera = Camera::look_at(Vec3::X * 4.0, Vec3::ZERO, Vec3::Z, 0.7, 40, 30);
        let viewed = ViewedScene {
            name: "vase".to_owned(),
            scene,
            views: vec![("a view".to_owned(), camera)],
            held_out: 1,
            origin: [1.0, 2.0, 3.0],
            orientation,
            photographs: None,
            background: [0.25, 0.5, 1.0],
        };
        let light = PackedLight { name: "sky.hdr".to_owned(), up: MapUp::Y, cube: cube(RadianceActivation::Identity) };
        let setup = LightSetup { environment: SetupEnvironment::Added(1), turn: 30.0, ..LightSetup::default() };
        PackedScene { viewed, lights: vec![light], setup, caption: "a vase".to_owned() }
    }

    #[test]
    fn an_exact_scene_round_trips() {
        let packed = scene();
        let read = PackedScene::unpack(&packed.pack(PackPrecision::Exact)).unwrap();
        let (a, b) = (&packed.viewed, &read.viewed);
        assert_eq!((&a.name, &a.views, a.held_out), (&b.name, &b.views, b.held_out));
        assert_eq!((a.background, a.orientation, a.origin), (b.background, b.orientation, b.origin));
        let (one, other) = (&a.scene, &b.scene);
        assert_eq!(one.gaussians.layout, other.gaussians.layout);
        let planes = 0..one.gaussians.layout.plane_count();
        assert!(planes.into_iter().all(|plane| one.gaussians.plane(plane).eq(other.gaussians.plane(plane))));
        assert_eq!((&one.light, &one.near_field), (&other.light, &other.near_field));
        assert_eq!(one.shading_model, other.shading_model);
        assert_eq!((&packed.lights, &packed.setup, &packed.caption), (&read.lights, &read.setup, &read.caption));
    }

    #[test]
    fn a_quantised_scene_is_near_and_small() {
        let packed = scene();
        let bytes = packed.pack(PackPrecision::Quantised);
        assert!(bytes.len() < packed.pack(PackPrecision::Exact).len(), "its header is most of it");
        let read = PackedScene::unpack(&bytes).unwrap().viewed.scene;
        let (one, other) = (&packed.viewed.scene.gaussians, &read.gaussians);
        let albedo = one.layout.physical_planes().unwrap() + ALBEDO;
        for (plane, least) in
            [(MEAN, NEAR), (LOG_SCALE, NEAR_SCALE), (OPACITY, NEAR_LOGIT), (DIFFUSE, NEAR_LOGIT), (albedo, NEAR_LOGIT)]
        {
            let apart = one.plane(plane).zip(other.plane(plane)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(apart <= least, "plane {plane}: {apart} apart");
        }
        let [bounded] = other.get::<1>(3, ROUGHNESS);
        assert!((bounded - LOGIT_MAX).abs() <= NEAR_LOGIT, "logits are bounded, and {bounded} is not");
        for index in 0..one.count {
            let [a, b]: [[f32; 4]; 2] = [one.get(index, QUAT), other.get(index, QUAT)];
            let length = a.iter().map(|x| x * x).sum::<f32>().sqrt() * a[0].signum();
            assert!(a.iter().zip(b).all(|(a, b)| (a / length - b).abs() <= NEAR_QUAT), "{a:?} became {b:?}");
        }
        let near_field = read.near_field.unwrap();
        assert_eq!(near_field.sizes(), surface().sizes());
        let [found, expected] = [&near_field, &surface()].map(|surface| {
            let corners = |triangle: usize| {
                let first = surface.triangles_start() + TRIANGLE_LEN * triangle;
                let corners = surface.values[first..first + 3].iter();
                corners.flat_map(|vertex| surface.vertex(*vertex as usize)).collect::<Vec<f32>>()
            };
            // Hierarchies may swap the two triangles.
            let mut triangles = [corners(0), corners(1)];
            triangles.sort_by(|a, b| a[0].total_cmp(&b[0]));
            triangles.concat()
        });
        let apart = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart <= NEAR_VERTEX, "triangles have their vertices, and one is {apart} apart");
    }

    #[test]
    fn a_quantised_gaussian_keeps_its_shortest_axis() {
        let mut packed = scene();
        let gaussians = &mut packed.viewed.scene.gaussians;
        let apart = |index: usize, axis: u64| SCALE_STEP as f32 * number(20 + axis, index);
        for index in 0..gaussians.count {
            let log_scales = if index == 0 { [0.1; 3] } else { [0, 1, 2].map(|axis| 0.1 + apart(index, axis)) };
            gaussians.set(index, LOG_SCALE, log_scales);
        }
        let read = PackedScene::unpack(&packed.pack(PackPrecision::Quantised)).unwrap().viewed.scene.gaussians;
        let gaussians = &packed.viewed.scene.gaussians;
        let shortest = |gaussians: &Gaussians<Vec<f32>>, index: usize| {
            let log_scales: [f32; 3] = gaussians.get(index, LOG_SCALE);
            (0..3).min_by(|a, b| log_scales[*a].total_cmp(&log_scales[*b]))
        };
        for index in 0..gaussians.count {
            assert_eq!(shortest(&read, index), shortest(gaussians, index), "Gaussian {index}");
        }
    }

    #[test]
    fn damaged_scenes_are_errors() {
        let bytes = scene().pack(PackPrecision::Quantised);
        let refused = |bytes: &[u8]| PackedScene::unpack(bytes).unwrap_err().to_string();
        for len in (0..bytes.len()).step_by(61) {
            assert!(refused(&bytes[..len]).contains("export it again"));
        }
        assert!(refused(&[bytes.as_slice(), &[0]].concat()).contains("longer"));
        let header = 12..12 + u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize;
        for (index, step) in header.clone().zip([1, 7, 64, 128].into_iter().cycle()) {
            let mut damaged = bytes.clone();
            damaged[index] ^= step;
            // Some changes only affect names; none may panic.
            let _ = PackedScene::unpack(&damaged);
        }
        let text = String::from_utf8_lossy(&bytes[header]).into_owned();
        let [nodes, triangles, vertices] = surface().sizes();
        let sizes = format!("\"sizes\":[{nodes},{triangles},{vertices}]");
        for (from, to) in [
            (sizes.as_str(), "\"sizes\":[1,2,99999999999]"),
            ("\"count\":37", "\"count\":99999999999"),
            ("\"count\":37", "\"count\":36"),
            ("\"resolution\":8", "\"resolution\":4096"),
            ("\"bits\":", "\"bits\":7"),
            ("\"size\":[40,30]", "\"size\":[0,30]"),
        ] {
            assert!(text.contains(from), "{from} is not in {text}");
            let header = text.replacen(from, to, 1);
            let len = (header.len() as u32).to_le_bytes();
            let rest = &bytes[12 + text.len()..];
            assert!(!refused(&[MAGIC.as_slice(), &len, header.as_bytes(), rest].concat()).is_empty(), "{to}");
        }
    }
}
