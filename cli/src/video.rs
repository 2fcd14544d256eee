//! Videos, encoded by ffmpeg.

use crate::{
    args::{self, ViewOptions},
    failure::Failure,
    output,
};
use core::slice;
use specula_capture::is_installed;
use specula_scene::{
    Layer, backdrop::BackgroundChoice, camera_set::CameraSet, picture_folder::PictureFolder, rendering::frame_ms,
    text::shown,
};
use std::{
    fs, io,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};
use tempfile::TempDir;

/// File extensions of videos.
const ENDINGS: [&str; 8] = ["mp4", "m4v", "mov", "mkv", "avi", "webm", "webp", "gif"];
/// Filter for codecs with half the resolution in colour, which need even sizes.
const EVEN: [&str; 4] = ["-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", "-pix_fmt", "yuv420p"];
/// A GIF has 256 colours: those of all its pictures.
const PALETTE: [&str; 2] = ["-vf", "split[a][b];[a]palettegen[p];[b][p]paletteuse"];
const WEBP: [&str; 6] = ["-c:v", "libwebp_anim", "-quality", "85", "-loop", "0"];

/// Video that -o names, and the folder of its pictures until it is encoded.
#[derive(Debug)]
pub(crate) struct Video {
    path: PathBuf,
    /// Layer of the video.
    layer: Layer,
    pictures: TempDir,
}

impl Video {
    /// Video that `requested` names; `None` for a folder of pictures.
    ///
    /// # Errors
    ///
    /// Several layers, numbers or transparency, which videos do not support; ffmpeg is not
    /// installed; a folder that cannot be written to.
    pub(crate) fn requested(
        requested: Option<&Path>,
        views: &ViewOptions,
        layers: &[Layer],
    ) -> Result<Option<Self>, Failure> {
        let Some(path) = requested else { return Ok(None) };
        let ending = output::ending(path).unwrap_or_default();
        if !ENDINGS.contains(&ending.as_str()) {
            return refuse_other_file(path, &ending).map(|()| None);
        }
        let layer = match layers {
            [layer] if Layer::expanded(layers).len() == 1 => *layer,
            layers if layers == args::DEFAULT_LAYERS => Layer::Rgb,
            _ => {
                return Err(Failure::Input(format!(
                    "{path:?} is a video, which shows one layer; select it with --layers"
                )));
            }
        };
        if views.exr {
            return Err(Failure::Input(format!("{path:?} is a video, which cannot store numbers; omit --exr")));
        }
        if views.background == Some(BackgroundChoice::Transparent) && ending != "webp" {
            return Err(Failure::Input(format!(
                "{path:?} is a video, which cannot be transparent; use .webp for --background transparent"
            )));
        }
        if path.is_dir() {
            return Err(Failure::Input(format!("{path:?} is a folder; use another name with -o")));
        }
        if !is_installed("ffmpeg") {
            let frames = path.with_extension("");
            return Err(Failure::Input(format!(
                "videos are written by ffmpeg, which is not installed; use -o {} for pictures, which ffmpeg -framerate \
                 10 -i {} -pix_fmt yuv420p {} encodes",
                shown(&frames),
                shown(&frames.join("rgb/%05d.png")),
                shown(path)
            )));
        }
        let parent = output::folder_of(path);
        output::make_folder(parent)?;
        let pictures = tempfile::Builder::new().prefix(".specula-").tempdir_in(parent);
        let pictures = pictures.map_err(|source| failure(parent, source))?;
        Ok(Some(Self { path: path.to_owned(), layer, pictures }))
    }

    /// Notes that views of a data set do not form a continuous path.
    pub(crate) fn note_cuts(&self, set: &CameraSet) {
        if set.split.is_some() {
            tracing::warn!(
                "{:?} shows {} views of the data set one after another; add --turntable 120 for a camera that moves",
                self.path,
                set.cameras.len()
            );
        }
    }

    /// Layer of the video, as a list.
    pub(crate) fn layers(&self) -> &[Layer] {
        slice::from_ref(&self.layer)
    }

    /// Folder of the pictures.
    pub(crate) fn pictures(&self) -> &Path {
        self.pictures.path()
    }

    /// Encodes the pictures.
    fn encode(&self, folder: &PictureFolder) -> Result<(), Failure> {
        let ending = output::ending(&self.path).unwrap_or_default();
        let options = match ending.as_str() {
            "webp" => &WEBP[..],
            "gif" => &PALETTE,
            _ => &EVEN,
        };
        let encoded = folder.path.join("video").with_extension(&ending);
        let first = folder.picture(self.layer, 0);
        let frames = fs::read_dir(output::folder_of(&first)).map_or(0, Iterator::count);
        let mut ffmpeg = Command::new("ffmpeg");
        ffmpeg.args(["-y", "-loglevel", "error", "-framerate", &format!("1000/{}", frame_ms(frames)), "-i"]);
        ffmpeg.arg(first.with_file_name("%05d.png")).args(options).arg(&encoded).stdin(Stdio::null());
        let done = ffmpeg.output().map_err(|source| failure(&self.path, source))?;
        if !done.status.success() {
            let said = String::from_utf8_lossy(&done.stderr).trim().replace('\n', "; ");
            return Err(Failure::Input(format!(
                "ffmpeg failed to write {:?}: {said}; use a folder for the pictures, or another extension",
                self.path
            )));
        }
        fs::rename(&encoded, &self.path).map_err(|source| failure(&self.path, source))
    }
}

/// Encodes the video of the pictures, if one is requested, and prints what was written.
///
/// # Errors
///
/// ffmpeg cannot be started or fails.
pub(crate) fn finish(video: Option<&Video>, folder: &PictureFolder) -> Result<(), Failure> {
    let Some(video) = video else {
        let animation = folder.animation();
        if animation.is_file() {
            let animation = shown(&animation);
            tracing::info!("{animation} is animated in browsers; -o turn.mp4 or turn.webp writes a video instead");
        }
        return output::say(&shown(&folder.path));
    };
    video.encode(folder)?;
    output::say(&shown(&video.path))
}

/// Refuses a folder that is named like a file, unless it is there.
fn refuse_other_file(path: &Path, ending: &str) -> Result<(), Failure> {
    // Such as `mp3`, but not `v2`.
    let letters = ending.strip_suffix(|last: char| last.is_ascii_digit()).unwrap_or(ending);
    let is_of_files = (2..=4).contains(&letters.len()) && letters.chars().all(|letter| letter.is_ascii_alphabetic());
    if !is_of_files || path.is_dir() {
        return Ok(());
    }
    Err(Failure::Input(format!(
        "{path:?} does not name a folder or a video ({}); for pictures, name a folder: -o {}",
        ENDINGS.map(|ending| format!(".{ending}")).join(", "),
        shown(&path.with_extension(""))
    )))
}

fn failure(path: &Path, source: io::Error) -> Failure {
    specula_io::Error::Write { path: path.to_owned(), cause: source }.into()
}
