//! Arguments of `specula capture` and `specula make`.

use super::parse::positive;
use clap::Args;
use std::path::PathBuf;

/// Lens model by default.
pub(crate) const LENS: &str = "SIMPLE_RADIAL";
/// Lens models of COLMAP that are read.
const LENSES: [&str; 8] = [
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "FULL_OPENCV",
    "OPENCV_FISHEYE",
    "THIN_PRISM_FISHEYE",
];

/// Make a data set of a video or of photographs: select frames, estimate cameras, diagnose.
///
/// Frames are selected by sharpness, exposure and view change, with ffmpeg. Cameras are estimated
/// by COLMAP or pycolmap; specula doctor says which is found. DATA receives images, masks,
/// sparse/0 and capture.json, which records decisions and command lines. After Ctrl-C the same
/// command continues.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula capture walk.mov -o data/vase
  specula capture photographs -o data/vase --masks silhouettes
  specula capture walk.mov details -o data/vase --frames 120 --best
  specula capture photographs -o data/vase --mask-with 'rembg p -om {images} {masks}'")]
pub(crate) struct Capture {
    /// Videos, and folders of pictures.
    #[arg(value_name = "INPUT", required = true)]
    pub(crate) inputs: Vec<PathBuf>,
    /// Folder of the data set.
    #[arg(long, short, value_name = "DATA")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) options: CaptureOptions,
}

/// Options of a capture.
#[derive(Args, Clone, Debug)]
pub(crate) struct CaptureOptions {
    /// Frames of each video; by default three a second, 40 to 150.
    #[arg(long, value_name = "N", value_parser = positive::<u32>)]
    pub(crate) frames: Option<u32>,
    /// Folder of masks, named like the pictures: black hides. Cameras are estimated from whole
    /// pictures, unless their surroundings stand still, as around a turntable.
    #[arg(long, value_name = "FOLDER", conflicts_with = "mask_with")]
    pub(crate) masks: Option<PathBuf>,
    /// Command that writes masks of the folder {images} to the folder {masks}.
    #[arg(long, value_name = "COMMAND")]
    pub(crate) mask_with: Option<String>,
    /// Lens model of COLMAP.
    #[arg(long, value_name = "MODEL", default_value = LENS, value_parser = LENSES)]
    pub(crate) lens: String,
    /// More and finer features: slower, for pictures with little texture.
    #[arg(long)]
    pub(crate) best: bool,
    /// Program of COLMAP, or a Python with pycolmap.
    #[arg(long, value_name = "PROGRAM")]
    pub(crate) colmap: Option<PathBuf>,
}
