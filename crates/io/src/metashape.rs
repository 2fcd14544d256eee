//! Cameras of Agisoft Metashape: the XML file of File > Export > Export Cameras.
//!
//! Its axes are those of [`crate::dataset`]: x right, y down, z forwards. A camera has a transform
//! to its component or chunk, and that one a transform to the world, in which Metashape exports
//! points. The lens maps slopes (x, y) of rays, after Brown's polynomials in r, to the pixel
//! (w/2 + cx + f x + b1 x + b2 y, h/2 + cy + f y); tangential terms are p1 (r² + 2x²) + 2 p2 x y,
//! the other way round than OpenCV's (Metashape's manual, appendix on camera models).

use crate::{
    budget::LIST,
    colmap::refuse,
    error::{Error, Result},
    lens::{Distortion, Lens},
    listing::{Listing, LoadOptions},
    named::Files,
    photographs::{self, Folders, HeldOut, Posed, some_of},
    shot::{PictureLight, Pose},
    transforms::orthogonal,
};
use glam::{DMat3, DVec3};
use roxmltree::{Document, Node};
use std::{
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

/// Length of the start of a file that tells Metashape's from other XML.
const START: u64 = 512;
/// Skew in pixels that is ignored without a word.
const SKEW: f64 = 1.0;

/// File of cameras at the top of a data set.
pub(crate) fn find(folder: &Path) -> Option<PathBuf> {
    let entries = folder.read_dir().into_iter().flatten().flatten().map(|entry| entry.path());
    let mut files: Vec<PathBuf> = entries.filter(|path| is_cameras(path)).collect();
    files.sort();
    files.into_iter().next()
}

fn is_cameras(path: &Path) -> bool {
    let is_xml = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("xml"));
    let mut start = Vec::new();
    let read = |file: File| file.take(START).read_to_end(&mut start).is_ok();
    is_xml && path.is_file() && File::open(path).is_ok_and(read) && {
        let start = String::from_utf8_lossy(&start);
        start.contains("<document") && start.contains("<chunk")
    }
}

/// Lists a data set with the cameras of a file.
pub(crate) fn list(files: &Files, path: &Path, options: &LoadOptions) -> Result<Listing> {
    let bytes = LIST.read(path)?;
    let broken = |what: String| refuse(path, "the text", format!("is not XML ({what}); export the cameras again"));
    let text = core::str::from_utf8(&bytes).map_err(|error| broken(error.to_string()))?;
    let document = Document::parse(text).map_err(|error| broken(error.to_string()))?;
    let chunks: Vec<Node<'_, '_>> =
        document.root_element().children().filter(|node| node.has_tag_name("chunk")).collect();
    let chunk = *chunks.first().ok_or_else(|| Error::NoFrames { path: path.to_owned() })?;
    let mut notes = Vec::new();
    if chunks.len() > 1 {
        notes.push(format!("{path:?} has {} chunks; only the first is read", chunks.len()));
    }
    let cameras = Cameras { path, chunk };
    let (mut aligned, mut others) = (Vec::new(), Vec::new());
    for camera in cameras.all() {
        let label = camera.attribute("label").unwrap_or_default();
        let is_aligned = child(camera, "transform").is_some() && camera.attribute("enabled") != Some("false");
        if is_aligned { aligned.push((label, camera)) } else { others.push(label) }
    }
    if aligned.is_empty() {
        return Err(refuse(path, "the first chunk", "has no aligned camera; align the photographs, and export again"));
    }
    if !others.is_empty() {
        notes.push(format!(
            "skipped {} cameras that are not aligned or not enabled: {}",
            others.len(),
            some_of(&others)
        ));
    }
    let folders = Folders::of(files, aligned.iter().map(|(label, _)| *label), options);
    let posed = aligned.iter().map(|(label, camera)| cameras.posed(label, *camera, &mut notes));
    let posed = posed.collect::<Result<Vec<Posed>>>()?;
    let mut listing = photographs::list(posed, &folders, &HeldOut::Every(options.test_every), options)?;
    listing.notes.splice(0..0, notes);
    listing.source = format!("Metashape's cameras in {path:?}");
    listing.used.push(path.to_owned());
    Ok(listing)
}

/// Cameras of a chunk.
struct Cameras<'a, 'input> {
    path: &'a Path,
    chunk: Node<'a, 'input>,
}

impl<'a, 'input> Cameras<'a, 'input> {
    fn all(&self) -> impl Iterator<Item = Node<'a, 'input>> + use<'a, 'input> {
        let list = child(self.chunk, "cameras");
        list.into_iter().flat_map(|list| list.descendants().filter(|node| node.has_tag_name("camera")))
    }

    fn posed(&self, label: &str, camera: Node<'a, 'input>, notes: &mut Vec<String>) -> Result<Posed> {
        let refuse = |what: &str| refuse(self.path, format!("camera {label:?}"), what);
        let pose = self
            .pose(camera)
            .ok_or_else(|| refuse("has a transform that is no rotation with a position; export the cameras again"))?;
        let lens = self.lens(camera, notes).map_err(|what| refuse(&what))?;
        Ok(Posed {
            image: PathBuf::from(label),
            mask: None,
            pose,
            light: PictureLight::default(),
            measured_size: Some([lens.width, lens.height]),
            lens: Box::new(move |[width, height]| Ok(lens.resized(width, height))),
        })
    }

    fn pose(&self, camera: Node<'_, '_>) -> Option<Pose> {
        let rows: [f64; 16] = numbers(child(camera, "transform")?)?;
        let row = |k: usize| DVec3::new(rows[4 * k], rows[4 * k + 1], rows[4 * k + 2]);
        let local_from_camera = DMat3::from_cols(row(0), row(1), row(2)).transpose();
        let (turn, scale, shift) = self.world(camera)?;
        let (world_from_camera, _) = orthogonal(turn * local_from_camera)?;
        let position = scale * (turn * DVec3::new(rows[3], rows[7], rows[11])) + shift;
        let pose = Pose { camera_from_world: world_from_camera.transpose(), position };
        (world_from_camera.determinant() > 0.0 && position.is_finite()).then_some(pose)
    }

    /// Rotation, scale and shift from the component of a camera, or else the chunk, to the world.
    fn world(&self, camera: Node<'_, '_>) -> Option<(DMat3, f64, DVec3)> {
        let components = child(self.chunk, "components").into_iter().flat_map(|list| list.children());
        let id = camera.attribute("component_id");
        let mut own = components.filter(|node| id.is_some() && node.attribute("id") == id);
        let transform = own.find_map(|component| child(component, "transform")).or(child(self.chunk, "transform"));
        let Some(transform) = transform else { return Some((DMat3::IDENTITY, 1.0, DVec3::ZERO)) };
        let turn = child(transform, "rotation")
            .map_or(Some(DMat3::IDENTITY), |node| Some(DMat3::from_cols_array(&numbers(node)?).transpose()))?;
        let scale = child(transform, "scale").map_or(Some([1.0]), numbers)?[0];
        let shift = child(transform, "translation").map_or(Some([0.0; 3]), numbers)?;
        Some((turn, scale, DVec3::from(shift)))
    }

    /// Lens of a camera; the error says what is wrong with it.
    fn lens(&self, camera: Node<'_, '_>, notes: &mut Vec<String>) -> core::result::Result<Lens, String> {
        let id = camera.attribute("sensor_id").unwrap_or("0");
        let sensors = child(self.chunk, "sensors").into_iter().flat_map(|list| list.children());
        let sensor = sensors.filter(|node| node.has_tag_name("sensor")).find(|node| node.attribute("id") == Some(id));
        let sensor =
            sensor.ok_or_else(|| format!("has the sensor {id}, which is not listed; export the cameras again"))?;
        let calibrations = || sensor.children().filter(|node| node.has_tag_name("calibration"));
        let calibration =
            calibrations().find(|node| node.attribute("class") == Some("adjusted")).or(calibrations().next());
        let calibration =
            calibration.ok_or("has a sensor without calibration; optimise the cameras, and export again")?;
        let size = child(calibration, "resolution").or(child(sensor, "resolution"));
        let side = |name: &str| size?.attribute(name)?.parse::<u32>().ok().filter(|side| *side > 0);
        let [width, height] = [side("width"), side("height")];
        let (width, height) = width.zip(height).ok_or("has a sensor without a resolution; export the cameras again")?;
        let number = |name: &str| child(calibration, name).and_then(numbers).map_or(0.0, |[number]: [f64; 1]| number);
        let focal = number("f");
        if !(focal > 0.0 && focal.is_finite()) {
            return Err(format!("has a focal length of {focal} pixels; optimise the cameras, and export again"));
        }
        let [k1, k2, k3, k4] = ["k1", "k2", "k3", "k4"].map(number);
        let tangential = [number("p2"), number("p1")];
        if ["p3", "p4"].map(number) != [0.0; 2] {
            return Err("has a lens with p3 or p4; optimise the cameras without them, and export again".into());
        }
        let distortion = match calibration.attribute("type").or(sensor.attribute("type")).unwrap_or("frame") {
            "frame" if k4 != 0.0 => {
                return Err("has a lens with k4; optimise the cameras without it, and export again".into());
            }
            "frame" => Distortion::Polynomial { radial: [k1, k2, k3, 0.0, 0.0, 0.0], tangential },
            "fisheye" | "equidistant_fisheye" => {
                Distortion::Fisheye { radial: [k1, k2, k3, k4], tangential, prism: [0.0; 2] }
            }
            other => {
                return Err(format!(
                    "has a lens of type {other:?}; convert its pictures to pinholes, such as with File > Export > Convert \
                     Images, and export again"
                ));
            }
        };
        let skew = number("b2");
        if skew.abs() > SKEW && notes.iter().all(|note| !note.contains("skew")) {
            notes.push(format!("the skew b2 = {skew} pixels of the lens is ignored"));
        }
        Ok(Lens {
            focal_px: [focal + number("b1"), focal],
            principal_px: [0.5 * f64::from(width) + number("cx"), 0.5 * f64::from(height) + number("cy")],
            width,
            height,
            distortion: distortion.simplified(),
        })
    }
}

fn child<'a, 'input>(node: Node<'a, 'input>, name: &str) -> Option<Node<'a, 'input>> {
    node.children().find(|child| child.has_tag_name(name))
}

/// Numbers of a node's text, if there are as many.
fn numbers<const N: usize>(node: Node<'_, '_>) -> Option<[f64; N]> {
    let numbers = node.text()?.split_ascii_whitespace().map(|word| word.parse().ok());
    numbers.collect::<Option<Vec<f64>>>()?.try_into().ok()
}
