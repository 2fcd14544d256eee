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
    #[error("cannot read {path:?}: {cause}; check that it is there and that you may read it")]
    Read {
        /// The file.
        path: PathBuf,
        /// Cause given by the operating system.
        cause: io::Error,
    },
    /// The operating system refused to write.
    #[error("cannot write {path:?}: {cause}; make room there, or choose a folder that you may write to")]
    Write {
        /// The file.
        path: PathBuf,
        /// Cause given by the operating system.
        cause: io::Error,
    },
    /// A light is brighter than can be computed with.
    #[error("{path:?} has a radiance of {found:e}, and {RADIANCE_MAX:e} is the most; lower its exposure, or scale it")]
    TooBright {
        /// The file.
        path: PathBuf,
        /// Radiance, with the exposure.
        found: f32,
    },
    /// A pipe, a device or a folder lies where a file is expected.
    #[error("{path:?} is no regular file, but a folder, a pipe or a device; put a file in its place, or remove it")]
    NotAFile {
        /// The path.
        path: PathBuf,
    },
    /// A folder in which files are written or removed is a link.
    #[error(
        "{path:?} is a link, through which nothing is written or removed; put a folder or a file in its place, or \
         remove it"
    )]
    Link {
        /// The link.
        path: PathBuf,
    },
    /// Other programs do not release the lock of a file.
    #[error("other programs change what {path:?} locks, and do not end; wait until they do, and try again")]
    Busy {
        /// The file.
        path: PathBuf,
    },
    /// The extension of a file name is of no format that can be written.
    #[error("cannot tell the format of {path:?} from its name; let it end in {expected}")]
    Ending {
        /// The file.
        path: PathBuf,
        /// Known extensions.
        expected: &'static str,
    },
    /// A file would be longer than its format allows.
    #[error("{path:?} would have {len} bytes, and the format ends at 4 GiB")]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Length of the file in bytes.
        len: usize,
    },
    /// A file needs more memory than the budget of its kind.
    #[error(
        "cannot read {path:?}: {what} would take {} MiB, and {} MiB is the most for {kind}; {remedy}",
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
    #[error(
        "no folder {path:?}; name the folder that holds transforms_train.json, transforms.json or sparse/0, and images"
    )]
    NoFolder {
        /// The folder.
        path: PathBuf,
    },
    /// A folder holds no list of cameras.
    #[error(
        "no transforms_train.json in {path:?}, nor COLMAP's sparse/0/cameras.bin and images.bin (or .txt), nor \
         transforms.json; expected are transforms_train.json and transforms_test.json, as in NeRF Synthetic and Shiny \
         Blender, or a reconstruction by COLMAP beside a folder images, or nerfstudio's transforms.json"
    )]
    NoTransforms {
        /// The folder.
        path: PathBuf,
    },
    /// None of the images of the cameras exists.
    #[error(
        "none of the images that the cameras of {data:?} name is in {path:?}, not even {first:?}{}",
        elsewhere.as_ref().map_or(String::new(), |folder| format!(", which {folder:?} has"))
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
    /// The images of the cameras are of a format that is not read.
    #[error("{path:?} is of a format that is not read; convert the images to PNG or JPEG under their names")]
    UnreadFormat {
        /// The first image.
        path: PathBuf,
    },
    /// An image has another shape than its camera.
    #[error(
        "image {path:?} has {} by {} pixels, but its camera {} by {}, which is another shape; take the images that the \
         cameras were found with, or smaller copies of them", found[0], found[1], expected[0], expected[1]
    )]
    OtherShape {
        /// The image.
        path: PathBuf,
        /// Width and height of the image.
        found: [u32; 2],
        /// Width and height of the camera.
        expected: [u32; 2],
    },
    /// A mask has another shape than its picture.
    #[error(
        "mask {path:?} has {} by {} pixels, but its picture {} by {}, which is another shape; make masks of the \
         pictures as they are", found[0], found[1], expected[0], expected[1]
    )]
    MaskShape {
        /// The mask.
        path: PathBuf,
        /// Width and height of the mask.
        found: [u32; 2],
        /// Width and height of the picture.
        expected: [u32; 2],
    },
    /// A picture is not the one that it was when the program started.
    #[error("{path:?} is not the picture that it was at the start; put back what was there")]
    Changed {
        /// The image.
        path: PathBuf,
    },
    /// Ground truth has another size than its picture.
    #[error(
        "{path:?} has {} by {} pixels, but the picture that it is the truth of {} by {}; render it at that size, or \
         remove it to measure without", found[0], found[1], expected[0], expected[1]
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
    #[error("cannot make the images in {path:?} {downscale} times smaller; use 1, 2, 4 or 8")]
    Downscale {
        /// The data set's folder.
        path: PathBuf,
        /// Requested factor.
        downscale: u32,
    },
    /// A file is not valid JSON, or has other content than expected.
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
    #[error("cannot decode {path:?}: {cause}; save the image again, or leave it out")]
    Image {
        /// The image.
        path: PathBuf,
        /// Message of the decoder.
        cause: String,
    },
    /// Masks hide every training picture.
    #[error(
        "no pixel of any training picture counts: its masks are black throughout, where white counts, or its lens has \
         parameters that no pixel fits"
    )]
    AllMasked,
    /// An image has no pixels.
    #[error("image {path:?} has no pixels; save it again, or leave it out")]
    EmptyImage {
        /// The image.
        path: PathBuf,
    },
    /// The header of a PLY file is invalid.
    #[error("cannot read {path:?} as a PLY file: {cause}")]
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
    /// A file is of a kind that is known and not read.
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
    /// A property holds lists in place of numbers.
    #[error("property \"{property}\" of {path:?} is a list; a number for each vertex is expected")]
    ListProperty {
        /// The file.
        path: PathBuf,
        /// The property.
        property: String,
    },
    /// The number of spherical harmonics belongs to no degree.
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
    #[error("{path:?} is cut short: {found} of {expected} vertices are there; copy or export it again")]
    CutShort {
        /// The file.
        path: PathBuf,
        /// Number of complete vertices.
        found: usize,
        /// Number of vertices in the header.
        expected: usize,
    },
    /// A word in place of a number.
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
    #[error("the checkpoint {path:?} is of format {found}, and this program knows format {known}")]
    CheckpointFormat {
        /// The file.
        path: PathBuf,
        /// Version of the file.
        found: u32,
        /// Version that this program reads.
        known: u32,
    },
    /// The near field of a model is invalid.
    #[error("cannot read the near field {path:?}: {cause}; train again, or remove the file to do without")]
    NearField {
        /// The file.
        path: PathBuf,
        /// Fault.
        cause: String,
    },
    /// A glTF file holds no Gaussians that can be read.
    #[error("cannot read {path:?} as glTF with Gaussians: {cause}")]
    Glb {
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
        "no point_cloud/iteration_{iteration}/point_cloud.ply in {path:?}; name the folder that training wrote to, \
         or a .ply file"
    )]
    NoModel {
        /// The folder.
        path: PathBuf,
        /// Requested iteration, or N.
        iteration: String,
    },
}

impl Error {
    /// True where a file was not written because the disk or a quota is full.
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
                    Some(format) => format!("it is {format}, and PNG, JPEG and WebP are read"),
                    None => other.to_string().trim_end().to_owned(),
                };
                Self::Image { path, cause }
            }
        }
    }
}

/// Message of the parser without the position, which the sentence states already.
fn without_place(error: &serde_json::Error) -> String {
    let text = error.to_string();
    match text.rfind(" at line ") {
        Some(end) => text[..end].to_owned(),
        None => text,
    }
}
