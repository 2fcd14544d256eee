//! Errors of reading and writing, one sentence each.

use crate::{budget::RADIANCE_MAX, named::unread_format};
use std::{io, path::PathBuf};

/// Result of reading or writing.
pub type Result<T> = core::result::Result<T, Error>;

/// Error of a file: one sentence with its path, the place in it, the fault and, where there is one,
/// a remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused to read.
    #[error("cannot read {path:?}: {cause}; check that it exists and is readable")]
    Read {
        /// The file.
        path: PathBuf,
        /// Cause given by the operating system.
        cause: io::Error,
    },
    /// The operating system refused to write.
    #[error("cannot write {path:?}: {cause}; {}", remedy_of(cause))]
    Write {
        /// The file.
        path: PathBuf,
        /// Cause given by the operating system.
        cause: io::Error,
    },
    /// A light is too bright.
    #[error(
        "{path:?} has a radiance of {found:e}, above the maximum {RADIANCE_MAX:e}; lower its exposure, or scale it"
    )]
    TooBright {
        /// The file.
        path: PathBuf,
        /// Radiance, with the exposure.
        found: f32,
    },
    /// A pipe, a device or a folder instead of a file.
    #[error("{path:?} is not a regular file, but a folder, a pipe or a device; replace it by a file, or remove it")]
    NotAFile {
        /// The path.
        path: PathBuf,
    },
    /// A folder in which files are written or removed is a link.
    #[error(
        "{path:?} is a link, and nothing is written or removed through links; replace it by a folder or a file, or \
         remove it"
    )]
    Link {
        /// The link.
        path: PathBuf,
    },
    /// Other programs do not release the lock of a file.
    #[error("other programs hold the lock {path:?}; wait until they end, and try again")]
    Busy {
        /// The file.
        path: PathBuf,
    },
    /// The extension of a file name does not name a format that can be written.
    #[error("{path:?} has no known extension; use {expected}")]
    Ending {
        /// The file.
        path: PathBuf,
        /// Known extensions.
        expected: &'static str,
    },
    /// A file would be longer than its format allows.
    #[error("{path:?} would have {len} bytes; the format is limited to 4 GiB")]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Length of the file in bytes.
        len: usize,
    },
    /// A file needs more memory than the budget of its kind.
    #[error(
        "cannot read {path:?}: {what} would take {} MiB, above the limit of {} MiB for {kind}; {remedy}",
        wanted.div_ceil(1 << 20), most >> 20
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Part of the file that is too large.
        what: String,
        /// Bytes that the part would take.
        wanted: u64,
        /// Kind of the file.
        kind: &'static str,
        /// Budget in bytes.
        most: u64,
        /// Remedy.
        remedy: &'static str,
    },
    /// The system does not grant the memory that a file needs.
    #[error("cannot read {path:?}: {what} takes {} MiB, more than the system grants; free some, or {remedy}", wanted.div_ceil(1 << 20))]
    OutOfMemory {
        /// The file.
        path: PathBuf,
        /// Part of the file that is too large.
        what: String,
        /// Bytes that the part takes.
        wanted: u64,
        /// Remedy.
        remedy: &'static str,
    },
    /// The folder of a data set does not exist.
    #[error("no folder {path:?}; give the folder with transforms_train.json, transforms.json or sparse/0, and images")]
    NoFolder {
        /// The folder.
        path: PathBuf,
    },
    /// A folder has no list of cameras.
    #[error(
        "no transforms_train.json in {path:?}, nor COLMAP's sparse/0/cameras.bin and images.bin (or .txt), nor \
         transforms.json, nor Metashape's cameras.xml; expected are transforms_train.json and transforms_test.json, as in \
         NeRF Synthetic and Shiny Blender, or a reconstruction by COLMAP next to a folder images, or nerfstudio's \
         transforms.json, or the cameras that Metashape exports as XML"
    )]
    NoTransforms {
        /// The folder.
        path: PathBuf,
    },
    /// None of the images of the cameras exists.
    #[error(
        "{path:?} has none of the images that the cameras of {data:?} name, such as {first:?}{}",
        elsewhere.as_ref().map_or(String::new(), |folder| format!(", which is in {folder:?}"))
    )]
    NoImages {
        /// The folder of the data set.
        data: PathBuf,
        /// Folder that was searched.
        path: PathBuf,
        /// Name of the first image.
        first: PathBuf,
        /// Folder within the data set that has an image of this name.
        elsewhere: Option<PathBuf>,
    },
    /// The images of the cameras have an unsupported format.
    #[error("{path:?} has an unsupported format; convert the images to PNG or JPEG with the same names")]
    UnreadFormat {
        /// The first image.
        path: PathBuf,
    },
    /// An image and its camera differ in aspect ratio.
    #[error(
        "image {path:?} has {} by {} pixels, but its camera {} by {}: aspect ratios differ; use the images that the \
         cameras were estimated from, or smaller copies of them", found[0], found[1], expected[0], expected[1]
    )]
    OtherShape {
        /// The image.
        path: PathBuf,
        /// Width and height of the image.
        found: [u32; 2],
        /// Width and height of the camera.
        expected: [u32; 2],
    },
    /// A mask and its picture differ in aspect ratio.
    #[error(
        "mask {path:?} has {} by {} pixels, but its picture {} by {}: aspect ratios differ; make masks from the \
         pictures", found[0], found[1], expected[0], expected[1]
    )]
    MaskShape {
        /// The mask.
        path: PathBuf,
        /// Width and height of the mask.
        found: [u32; 2],
        /// Width and height of the picture.
        expected: [u32; 2],
    },
    /// A picture has changed since the program started.
    #[error("{path:?} has changed since the program started; restore the original picture")]
    Changed {
        /// The image.
        path: PathBuf,
    },
    /// Ground truth has another size than its picture.
    #[error(
        "{path:?} has {} by {} pixels, but its picture {} by {}; render the ground truth at that size, or remove it to \
         skip its measures", found[0], found[1], expected[0], expected[1]
    )]
    TruthSize {
        /// The file.
        path: PathBuf,
        /// Width and height of the file.
        found: [u32; 2],
        /// Width and height of the picture.
        expected: [u32; 2],
    },
    /// A line or record of a file is invalid.
    #[error("{place} of {path:?} {what}")]
    Place {
        /// The file.
        path: PathBuf,
        /// Line or record.
        place: String,
        /// Fault and remedy.
        what: String,
    },
    /// A list of cameras is empty.
    #[error("no frames in {path:?}; list at least one camera with its image")]
    NoFrames {
        /// The list.
        path: PathBuf,
    },
    /// Images cannot be downscaled by this factor.
    #[error("cannot downscale the images in {path:?} by {downscale}; use 1, 2, 4 or 8")]
    Downscale {
        /// The data set's folder.
        path: PathBuf,
        /// Requested factor.
        downscale: u32,
    },
    /// A file is not valid JSON, or has unexpected content.
    #[error("cannot understand {path:?}, line {line}, column {column}: {cause}")]
    Json {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// Message of the parser.
        cause: String,
    },
    /// A camera is invalid.
    #[error("frame {frame:?} of {path:?} {what}")]
    Frame {
        /// The list of cameras.
        path: PathBuf,
        /// Name of the frame.
        frame: String,
        /// Fault and remedy.
        what: String,
    },
    /// A file cannot be decoded as an image.
    #[error("cannot decode {path:?}: {cause}; save the image again, or remove it")]
    Image {
        /// The image.
        path: PathBuf,
        /// Message of the decoder.
        cause: String,
    },
    /// Masks hide every training picture.
    #[error(
        "all pixels of the training pictures are masked: the masks are black (white counts), or the lens parameters \
         are wrong"
    )]
    AllMasked,
    /// A table of lights lacks pictures.
    #[error(
        "{path:?} does not name {count} of the pictures: {names}; add a line for each; the light - leaves a picture out"
    )]
    Lightless {
        /// The table.
        path: PathBuf,
        /// Number of the pictures.
        count: usize,
        /// Names of the first of them.
        names: String,
    },
    /// No picture is under a light of a table.
    #[error("no picture is under the light {name:?} of {path:?}; its lights are {lights}")]
    NoLight {
        /// The table.
        path: PathBuf,
        /// Name of the light.
        name: String,
        /// Names of its lights.
        lights: String,
    },
    /// An image has no pixels.
    #[error("image {path:?} has no pixels; save it again, or remove it")]
    EmptyImage {
        /// The image.
        path: PathBuf,
    },
    /// The header of a PLY file is invalid.
    #[error("cannot read {path:?} as a PLY file: {cause}; open a model folder, or a .ply, .glb, .spz or .splat file")]
    PlyHeader {
        /// The file.
        path: PathBuf,
        /// Message of the parser.
        cause: String,
    },
    /// A PLY file has no vertex element.
    #[error("no vertex element in {path:?}; a point cloud is expected, with one vertex for each point")]
    NoVertices {
        /// The file.
        path: PathBuf,
    },
    /// A file is of a known but unsupported kind.
    #[error("{path:?} is {kind}; {remedy}")]
    OtherKind {
        /// The file.
        path: PathBuf,
        /// Name of the kind.
        kind: &'static str,
        /// Remedy.
        remedy: &'static str,
    },
    /// A property is missing.
    #[error("no property \"{property}\" in {path:?}; {layout} is expected")]
    MissingProperty {
        /// The file.
        path: PathBuf,
        /// The property.
        property: String,
        /// Layout that requires the property.
        layout: &'static str,
    },
    /// A property contains lists instead of numbers.
    #[error("property \"{property}\" of {path:?} is a list; a number for each vertex is expected")]
    ListProperty {
        /// The file.
        path: PathBuf,
        /// The property.
        property: String,
    },
    /// The number of spherical harmonics matches no degree.
    #[error("{count} properties f_rest_* in {path:?}; {layout} has {allowed}")]
    HarmonicsCount {
        /// The file.
        path: PathBuf,
        /// Number of properties.
        count: usize,
        /// The layout.
        layout: &'static str,
        /// Valid numbers.
        allowed: &'static str,
    },
    /// A file ends too early.
    #[error("{path:?} is cut short: it has {found} of {expected} vertices; copy or export it again")]
    CutShort {
        /// The file.
        path: PathBuf,
        /// Number of complete vertices.
        found: usize,
        /// Number of vertices in the header.
        expected: usize,
    },
    /// A word instead of a number.
    #[error("\"{text}\" is not a number, at vertex {index} of {path:?}, property \"{property}\"")]
    NotANumber {
        /// The file.
        path: PathBuf,
        /// Index of the vertex, from 0.
        index: usize,
        /// The property.
        property: String,
        /// The word.
        text: String,
    },
    /// Numbers are NaN or infinite.
    #[error(
        "{count} numbers in {path:?} are NaN or infinite, the first at vertex {index}, property \"{property}\"; \
         remove those vertices, or write the file again"
    )]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// Index of the first such vertex, from 0.
        index: usize,
        /// First such property of that vertex.
        property: String,
        /// Number of such numbers.
        count: usize,
    },
    /// An image is not six faces in a column.
    #[error("{path:?} has {width} by {height} pixels; six square faces in a column are expected")]
    NotACube {
        /// The file.
        path: PathBuf,
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// A folder has no checkpoint.
    #[error("no checkpoint.safetensors in {path:?}")]
    NoCheckpoint {
        /// The folder.
        path: PathBuf,
    },
    /// Content of a checkpoint is invalid.
    #[error("cannot read {place} of the checkpoint {path:?}: {cause}")]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// Header or tensor.
        place: String,
        /// Fault.
        cause: String,
    },
    /// A checkpoint has another version of the format.
    #[error("the checkpoint {path:?} has format {found}, but this program reads format {known}")]
    CheckpointFormat {
        /// The file.
        path: PathBuf,
        /// Version of the file.
        found: u32,
        /// Version that this program reads.
        known: u32,
    },
    /// The near field of a model is invalid.
    #[error("cannot read the near field {path:?}: {cause}; train again, or remove the file to render without it")]
    NearField {
        /// The file.
        path: PathBuf,
        /// Fault.
        cause: String,
    },
    /// A glTF file has no readable Gaussians.
    #[error("cannot read {path:?} as glTF with Gaussians: {cause}")]
    Glb {
        /// The file.
        path: PathBuf,
        /// Fault.
        cause: String,
    },
    /// A `.spz`, `.splat` or compressed PLY file is invalid.
    #[error("cannot read the Gaussians of {path:?}: {cause}")]
    Splats {
        /// The file.
        path: PathBuf,
        /// Fault.
        cause: String,
    },
    /// The network of a light is invalid.
    #[error("cannot read the light's network {path:?}: {cause}")]
    LightNetwork {
        /// The file.
        path: PathBuf,
        /// Fault.
        cause: String,
    },
    /// A folder has no trained model.
    #[error(
        "no point_cloud/iteration_{iteration}/point_cloud.ply in {path:?}; give the folder of a training, or a .ply \
         file"
    )]
    NoModel {
        /// The folder.
        path: PathBuf,
        /// Requested iteration, or N.
        iteration: String,
    },
}

/// Remedy where the operating system refused to write.
fn remedy_of(cause: &io::Error) -> &'static str {
    match cause.kind() {
        io::ErrorKind::AlreadyExists | io::ErrorKind::NotADirectory => {
            "a file is in the place of a folder; use another name"
        }
        _ => "free some space, or use a writable folder",
    }
}

impl Error {
    /// True if a file was not written because the disk or a quota is full.
    pub fn is_full_disk(&self) -> bool {
        use io::ErrorKind::{QuotaExceeded, StorageFull};
        matches!(self, Self::Write { cause, .. } if matches!(cause.kind(), StorageFull | QuotaExceeded))
    }

    /// Closure for `map_err` that adds the path of a file that was read.
    pub(crate) fn reading(path: impl Into<PathBuf>) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        move |cause| Self::Read { path, cause }
    }

    /// Closure for `map_err` that adds the path of a JSON file.
    pub(crate) fn json(path: impl Into<PathBuf>) -> impl FnOnce(serde_json::Error) -> Self {
        let path = path.into();
        move |error| Self::Json { path, line: error.line(), column: error.column(), cause: without_place(&error) }
    }

    /// Closure for `map_err` that adds the path of an image.
    pub(crate) fn decoding(path: impl Into<PathBuf>) -> impl FnOnce(image::ImageError) -> Self {
        let path = path.into();
        move |error| match error {
            image::ImageError::IoError(cause) if cause.kind() == io::ErrorKind::NotFound => Self::Read { path, cause },
            image::ImageError::Limits(_) => {
                Self::Image { path, cause: "its header promises more pixels than its bytes can hold".into() }
            }
            other => {
                let cause = match unread_format(&path) {
                    Some(format) => format!("it is {format}; supported are PNG, JPEG and WebP"),
                    None => other.to_string().trim_end().to_owned(),
                };
                Self::Image { path, cause }
            }
        }
    }
}

/// Message of the parser without the position, which the error states.
fn without_place(error: &serde_json::Error) -> String {
    let text = error.to_string();
    match text.rfind(" at line ") {
        Some(end) => text[..end].to_owned(),
        None => text,
    }
}
