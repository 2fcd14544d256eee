//! What can go wrong with a file, in sentences for whoever owns it.

use std::{io, path::PathBuf};

/// The result of reading or writing.
pub type Result<T> = core::result::Result<T, Error>;

/// Why a file could not be read or written: the file, the place in it, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system did not give the file.
    #[error("cannot read {path:?}: {cause}; check that it is there and that you may read it")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        cause: io::Error,
    },
    /// The operating system did not take the file.
    #[error("cannot write {path:?}: {cause}; make room there, or choose a folder that you may write to")]
    Write {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        cause: io::Error,
    },
    /// The ending of a file's name says nothing that can be written.
    #[error("cannot tell the format of {path:?} from its name; let it end in {expected}")]
    Ending {
        /// The file.
        path: PathBuf,
        /// Endings that are known.
        expected: &'static str,
    },
    /// More bytes than the format can count.
    #[error("{path:?} would have {len} bytes, and the format ends at 4 GiB")]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Its bytes.
        len: usize,
    },
    /// A file for which more memory would be needed than its kind may take.
    #[error(
        "cannot read {path:?}: {what} would take {} MiB, and {} MiB is the most for {kind}; {remedy}",
        wanted.div_ceil(1 << 20), most >> 20
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The part of it that is too large.
        what: String,
        /// Bytes that it would take.
        wanted: u64,
        /// The kind of file.
        kind: &'static str,
        /// Bytes that such a file may take.
        most: u64,
        /// Advice.
        remedy: &'static str,
    },
    /// The folder of a data set is not there.
    #[error(
        "no folder {path:?}; name the folder that holds transforms_train.json, transforms.json or sparse/0, and images"
    )]
    NoFolder {
        /// The folder.
        path: PathBuf,
    },
    /// The folder is there, but no list of cameras in it.
    #[error(
        "no transforms_train.json in {path:?}, nor COLMAP's sparse/0/cameras.bin and images.bin (or .txt), nor \
         transforms.json; expected are transforms_train.json and transforms_test.json, as in NeRF Synthetic and Shiny \
         Blender, or a reconstruction by COLMAP beside a folder images, or nerfstudio's transforms.json"
    )]
    NoTransforms {
        /// The folder.
        path: PathBuf,
    },
    /// Cameras, but not one of their images.
    #[error("none of the images that the cameras of {data:?} name is in {path:?}, not even {first:?}")]
    NoImages {
        /// The folder of the data set.
        data: PathBuf,
        /// Where they were looked for.
        path: PathBuf,
        /// The first.
        first: PathBuf,
    },
    /// An image that its camera cannot have taken.
    #[error(
        "image {path:?} has {} by {} pixels, but its camera {} by {}, which is another shape; take the images that the \
         cameras were found with, or smaller copies of them", found[0], found[1], expected[0], expected[1]
    )]
    OtherShape {
        /// The image.
        path: PathBuf,
        /// Its width and height.
        found: [u32; 2],
        /// Those of its camera.
        expected: [u32; 2],
    },
    /// Something wrong at a place of a file.
    #[error("{place} of {path:?} {what}")]
    Place {
        /// The file.
        path: PathBuf,
        /// The place: a line, or a record.
        place: String,
        /// What is wrong with it, and the remedy.
        what: String,
    },
    /// A list of cameras without a camera.
    #[error("no frames in {path:?}; list at least one camera with its image")]
    NoFrames {
        /// The list.
        path: PathBuf,
    },
    /// Images cannot be made zero times smaller.
    #[error("cannot make the images in {path:?} {downscale} times smaller; use 1, 2, 4 or 8")]
    Downscale {
        /// The data set's folder.
        path: PathBuf,
        /// What was asked for.
        downscale: u32,
    },
    /// A file that should be JSON is not, or says something else than expected.
    #[error("cannot understand {path:?}, line {line}, column {column}: {cause}")]
    Json {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What the parser said.
        cause: String,
    },
    /// A camera that cannot be.
    #[error("frame {frame:?} of {path:?} {what}")]
    Frame {
        /// The list of cameras.
        path: PathBuf,
        /// The frame's name in it.
        frame: String,
        /// What is wrong with it, and the remedy.
        what: String,
    },
    /// An image that a camera names is not there.
    #[error("no image {path:?}, which frame {frame:?} of {transforms:?} names; png, jpg, jpeg and webp were tried")]
    MissingImage {
        /// The image, as far as its name is known.
        path: PathBuf,
        /// The frame's name.
        frame: String,
        /// The list of cameras.
        transforms: PathBuf,
    },
    /// A file that should be an image is not.
    #[error("cannot decode {path:?}: {cause}; save the image again, or remove its frame")]
    Image {
        /// The image.
        path: PathBuf,
        /// What the decoder said.
        cause: String,
    },
    /// An image without pixels.
    #[error("image {path:?} has no pixels; save it again, or remove its frame")]
    EmptyImage {
        /// The image.
        path: PathBuf,
    },
    /// The first lines of a PLY file make no sense.
    #[error("cannot read {path:?} as a PLY file: {cause}")]
    PlyHeader {
        /// The file.
        path: PathBuf,
        /// What the parser said.
        cause: String,
    },
    /// A PLY file with no points in it.
    #[error("no vertex element in {path:?}; a point cloud is expected, with one vertex for each point")]
    NoVertices {
        /// The file.
        path: PathBuf,
    },
    /// PlayCanvas's packed layout.
    #[error(
        "{path:?} is a compressed PLY of PlayCanvas; convert it to the plain layout of 3D Gaussian splatting first, \
         with splat-transform or SuperSplat"
    )]
    CompressedPly {
        /// The file.
        path: PathBuf,
    },
    /// A column is not there.
    #[error("no property \"{property}\" in {path:?}; {layout} is expected")]
    MissingProperty {
        /// The file.
        path: PathBuf,
        /// The property.
        property: String,
        /// The layout that needs it.
        layout: &'static str,
    },
    /// A column that holds lists where numbers are expected.
    #[error("property \"{property}\" of {path:?} is a list; a number for each vertex is expected")]
    ListProperty {
        /// The file.
        path: PathBuf,
        /// The property.
        property: String,
    },
    /// Spherical harmonics of no degree.
    #[error("{count} properties f_rest_* in {path:?}; {layout} has {allowed}")]
    HarmonicsCount {
        /// The file.
        path: PathBuf,
        /// How many there are.
        count: usize,
        /// The layout.
        layout: &'static str,
        /// Counts that make sense.
        allowed: &'static str,
    },
    /// The file ends too early.
    #[error("{path:?} is cut short: {found} of {expected} vertices are there; copy or export it again")]
    CutShort {
        /// The file.
        path: PathBuf,
        /// Whole vertices.
        found: usize,
        /// Vertices that the header promises.
        expected: usize,
    },
    /// A word where a number is expected.
    #[error("\"{text}\" is not a number, at vertex {index} of {path:?}, property \"{property}\"")]
    NotANumber {
        /// The file.
        path: PathBuf,
        /// The vertex, from 0.
        index: usize,
        /// The property.
        property: String,
        /// The word.
        text: String,
    },
    /// Numbers that are NaN or infinite.
    #[error(
        "{count} numbers in {path:?} are NaN or infinite, the first at vertex {index}, property \"{property}\"; \
         remove those vertices, or take an earlier iteration"
    )]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// The first such vertex, from 0.
        index: usize,
        /// Its first such property.
        property: String,
        /// How many such numbers there are.
        count: usize,
    },
    /// An image that is not six faces in a column.
    #[error("{path:?} has {width} by {height} pixels; six square faces in a column are expected")]
    NotACube {
        /// The file.
        path: PathBuf,
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// No training was put aside in a folder.
    #[error("no checkpoint.safetensors in {path:?}")]
    NoCheckpoint {
        /// The folder.
        path: PathBuf,
    },
    /// A checkpoint that says or holds something else than it should.
    #[error("cannot read {place} of the checkpoint {path:?}: {cause}")]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// The header, or a tensor.
        place: String,
        /// What is wrong with it.
        cause: String,
    },
    /// A checkpoint of another version of the format.
    #[error("the checkpoint {path:?} is of format {found}, and this program knows format {known}")]
    CheckpointFormat {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u32,
        /// The format that is known.
        known: u32,
    },
    /// No trained model in a folder.
    #[error(
        "no point_cloud/iteration_{iteration}/point_cloud.ply in {path:?}; name the folder that training wrote to, \
         or a .ply file"
    )]
    NoModel {
        /// The folder.
        path: PathBuf,
        /// The iteration that was asked for, or N.
        iteration: String,
    },
}

impl Error {
    /// A closure for `map_err` that knows the file that was read.
    pub(crate) fn reading(path: impl Into<PathBuf>) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        move |cause| Self::Read { path, cause }
    }

    /// A closure for `map_err` that knows the JSON file.
    pub(crate) fn json(path: impl Into<PathBuf>) -> impl FnOnce(serde_json::Error) -> Self {
        let path = path.into();
        move |error| Self::Json { path, line: error.line(), column: error.column(), cause: without_place(&error) }
    }

    /// A closure for `map_err` that knows the image.
    pub(crate) fn decoding(path: impl Into<PathBuf>) -> impl FnOnce(image::ImageError) -> Self {
        let path = path.into();
        move |error| match error {
            image::ImageError::IoError(cause) if cause.kind() == io::ErrorKind::NotFound => Self::Read { path, cause },
            image::ImageError::Limits(_) => {
                Self::Image { path, cause: "its header promises more pixels than its bytes can hold".into() }
            }
            other => Self::Image { path, cause: other.to_string() },
        }
    }
}

/// What the parser said, without the place that the sentence names already.
fn without_place(error: &serde_json::Error) -> String {
    let text = error.to_string();
    match text.rfind(" at line ") {
        Some(end) => text[..end].to_owned(),
        None => text,
    }
}
