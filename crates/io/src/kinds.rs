//! Kinds of files that are not readable scenes of Gaussians, with remedies.

use crate::{
    error::{Error, Result},
    input::Input,
    latlong::{ending, start_of},
};
use std::path::Path;

/// Kind of file, recognised by the extension or the first bytes.
struct Kind {
    name: &'static str,
    remedy: &'static str,
    endings: &'static [&'static str],
    starts: &'static [&'static [u8]],
}

/// Remedy for Gaussians in formats of other viewers.
const CONVERT: &str = "open the model or the .ply file that it was made from, or convert it to a plain PLY file of 3D \
                       Gaussian splatting with splat-transform or SuperSplat";
/// Remedy for scenes in place of points.
const OPEN: &str = "open it as a scene; a PLY file is expected here";
/// Remedy for pictures.
const NO_SCENE: &str = "open a model folder, a PLY or a .glb file of Gaussians, and use --env for lights";
/// Remedy for meshes.
const NO_MESH: &str = "open Gaussians, such as those trained on renders of it";
/// Remedy for videos.
const CAPTURE: &str = "estimate the cameras of its frames with `specula capture`, then train";
/// Remedy for points.
const POINTS: &str = "open Gaussians; points can initialise a training (--points, as a PLY file)";

/// File extensions of videos.
const VIDEOS: &[&str] = &["mp4", "mov", "mkv", "webm", "avi", "m4v", "mts", "3gp"];

/// Extensions take precedence over contents, since archives begin alike.
const KINDS: &[Kind] = &[
    Kind { name: "a .spz file of Gaussians", remedy: OPEN, endings: &["spz"], starts: &[b"NGSP"] },
    Kind { name: "a .splat file of Gaussians", remedy: OPEN, endings: &["splat"], starts: &[] },
    Kind { name: "a .ksplat file of Gaussians", remedy: CONVERT, endings: &["ksplat"], starts: &[] },
    Kind { name: "a .sog file of Gaussians", remedy: CONVERT, endings: &["sog"], starts: &[] },
    Kind { name: "an .lcc file of Gaussians", remedy: CONVERT, endings: &["lcc"], starts: &[] },
    Kind {
        name: "a USD stage",
        remedy: "specula writes USD and does not read it: open the model or the PLY file that it was made from",
        endings: &["usd", "usda", "usdc", "usdz"],
        starts: &[b"PXR-USDC", b"#usda"],
    },
    Kind { name: "a glTF file", remedy: OPEN, endings: &["glb", "gltf"], starts: &[b"glTF"] },
    Kind {
        name: "a mesh",
        remedy: NO_MESH,
        endings: &["obj", "stl", "fbx", "off", "dae", "3ds", "blend"],
        starts: &[b"Kaydara FBX", b"BLENDER"],
    },
    Kind {
        name: "a point cloud",
        remedy: POINTS,
        endings: &["las", "laz", "e57", "pcd", "xyz", "pts"],
        starts: &[b"LASF", b"ASTM-E57", b"# .PCD"],
    },
    Kind {
        name: "a checkpoint of a training",
        remedy: "open the folder of the model, or the point_cloud.ply that was saved with it",
        endings: &["safetensors", "pth", "pt", "ckpt"],
        starts: &[],
    },
    Kind {
        name: "a list of cameras or settings",
        remedy: "open the folder of the model that it belongs to",
        endings: &["json", "toml"],
        starts: &[],
    },
    Kind {
        name: "a light or a picture, not a scene",
        remedy: NO_SCENE,
        endings: &["hdr", "exr", "ktx2", "png", "jpg", "jpeg", "webp", "gif", "tif", "tiff"],
        starts: &[b"#?", b"\x76\x2f\x31\x01", b"\xabKTX", b"\x89PNG", b"\xff\xd8\xff", b"RIFF", b"GIF8"],
    },
    Kind { name: "a video", remedy: CAPTURE, endings: VIDEOS, starts: &[] },
    Kind {
        name: "a web page",
        remedy: "open it in a browser, or download the file again if it should be a scene",
        endings: &["html", "htm"],
        starts: &[b"<!DOCTYPE", b"<!doctype", b"<html"],
    },
    Kind {
        name: "a pointer of Git LFS, without the contents",
        remedy: "fetch them with `git lfs pull`",
        endings: &[],
        starts: &[b"version https://git-lfs"],
    },
    Kind {
        name: "an archive",
        remedy: "unpack it first",
        endings: &["zip", "gz", "tar", "7z"],
        starts: &[b"PK\x03\x04", b"\x1f\x8b"],
    },
];

/// Rejects a file of one of these kinds, by its name or contents.
///
/// # Errors
///
/// [`Error::OtherKind`] for one of these kinds, [`Error::Read`].
pub(crate) fn refuse(input: Input<'_>) -> Result<()> {
    let start = start_of(input)?;
    let ending = ending(input.path()).unwrap_or_default();
    let has_ending = |kind: &&Kind| kind.endings.contains(&ending.as_str());
    let has_start = |kind: &&Kind| kind.starts.iter().any(|known| start.starts_with(known));
    let found = KINDS.iter().find(has_ending).or_else(|| KINDS.iter().find(has_start));
    match found {
        Some(Kind { name, remedy, .. }) => Err(other(input.path(), name, remedy)),
        None if start.is_empty() => Err(other(input.path(), "empty", "copy it again")),
        None => Ok(()),
    }
}

/// Returns whether a file is a video, by its name.
pub fn is_video(path: &Path) -> bool {
    ending(path).is_some_and(|ending| VIDEOS.contains(&ending.as_str()))
}

/// Error for a PLY file with vertices that are not Gaussians.
pub(crate) fn points_or_mesh(path: &Path, has_faces: bool) -> Error {
    if has_faces { other(path, "a mesh", NO_MESH) } else { other(path, "a point cloud", POINTS) }
}

fn other(path: &Path, kind: &'static str, remedy: &'static str) -> Error {
    Error::OtherKind { path: path.to_owned(), kind, remedy }
}
