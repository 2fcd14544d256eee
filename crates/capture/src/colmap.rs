//! COLMAP, as its program or as the Python package pycolmap: steps as command lines, and their
//! progress from their output. Both run without a display and without a GPU.

use crate::{
    error::{Error, Result},
    process::CommandLine,
};
use core::fmt;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Script that runs a step by pycolmap.
pub(crate) const SCRIPT: &str = include_str!("colmap/step.py");

/// COLMAP, found on this machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tool {
    program: PathBuf,
    version: String,
    kind: Kind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// The program, with options named as up to 3.12 (`SiftMatching.use_gpu`) or as later
    /// (`FeatureMatching.use_gpu`).
    Program { is_recent: bool },
    /// Python with the package.
    Python,
}

impl fmt::Display for Tool {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if self.kind == Kind::Python { "pycolmap" } else { "COLMAP" };
        write!(out, "{kind} {} ({})", self.version, self.program.display())
    }
}

impl Tool {
    /// Finds COLMAP: `program`, or else `colmap`, or else `python3` with pycolmap. A program of
    /// version 3 comes last, since version 4 matches several times faster without a GPU.
    ///
    /// # Errors
    ///
    /// There is none, with ways to install it.
    pub fn find(program: Option<&Path>) -> Result<Self> {
        if let Some(program) = program {
            return Self::at(program).ok_or_else(|| {
                Error::Input(format!(
                    "{program:?} is neither the program of COLMAP nor a Python with the package pycolmap"
                ))
            });
        }
        let found = Self::at(Path::new("colmap"));
        if let Some(recent) = found.as_ref().filter(|tool| !tool.version.starts_with('3')) {
            return Ok(recent.clone());
        }
        let python = ["python3", "python"].iter().find_map(|name| Self::of_python(Path::new(name)));
        python.or(found).ok_or_else(|| {
            Error::Input(
                "cameras are estimated by COLMAP, which is not installed: pip install pycolmap, or apt install colmap, or \
                 brew install colmap; name it with --colmap if it is not on the path"
                    .into(),
            )
        })
    }

    /// Version of the tool.
    pub fn version(&self) -> &str {
        &self.version
    }

    fn at(program: &Path) -> Option<Self> {
        Self::of_program(program).or_else(|| Self::of_python(program))
    }

    fn of_program(program: &Path) -> Option<Self> {
        let help = CommandLine::new(program, &["help"]).output()?;
        let version = version_of(&help)?.to_owned();
        let options = CommandLine::new(program, &["feature_extractor", "-h"]).output().unwrap_or_default();
        let kind = Kind::Program { is_recent: options.contains("FeatureExtraction.use_gpu") };
        Some(Self { program: program.to_owned(), version, kind })
    }

    fn of_python(program: &Path) -> Option<Self> {
        let words = ["-c", "import pycolmap; print('pycolmap', pycolmap.__version__)"];
        let said = CommandLine::new(program, &words).output()?;
        let version = said.trim().strip_prefix("pycolmap ")?.to_owned();
        Some(Self { program: program.to_owned(), version, kind: Kind::Python })
    }

    /// Command line of a step on a database; `script` is the place of [`SCRIPT`].
    pub(crate) fn command(&self, database: &Path, script: &Path, step: &Step<'_>) -> CommandLine {
        let text = |path: &Path| path.to_string_lossy().into_owned();
        let database = text(database);
        match self.kind {
            Kind::Python => {
                let (name, options) = match step {
                    Step::Features { images, masks, list, is_shared, camera, quality } => (
                        "features",
                        json!({
                            "database": database, "images": text(images), "masks": masks.map(text), "list": text(list),
                            "shared": is_shared, "camera": camera, "size": quality.size, "features": quality.features,
                            "lens": quality.lens,
                        }),
                    ),
                    Step::MatchAll { block } => ("all", json!({"database": database, "block": block})),
                    Step::MatchPairs { pairs } => ("pairs", json!({"database": database, "pairs": text(pairs)})),
                    Step::Map { images, output, is_relaxed } => (
                        "map",
                        json!({
                            "database": database, "images": text(images), "output": text(output), "relaxed": is_relaxed,
                        }),
                    ),
                };
                CommandLine::new(&self.program, &[&text(script), name, &options.to_string()])
            }
            Kind::Program { is_recent } => {
                let [extraction, matching] = if is_recent {
                    ["FeatureExtraction", "FeatureMatching"]
                } else {
                    ["SiftExtraction", "SiftMatching"]
                };
                let matching_on_cpu = format!("--{matching}.use_gpu");
                let of = |name: &str| CommandLine::new(&self.program, &[name, "--database_path", &database]);
                match step {
                    Step::Features { images, masks, list, is_shared, camera, quality } => {
                        let line = of("feature_extractor").with(&["--image_path", &text(images)]);
                        let line = line.with(&["--image_list_path", &text(list)]);
                        let line = line.with(&["--ImageReader.camera_model", &quality.lens]);
                        let line = line.with(&["--ImageReader.single_camera", if *is_shared { "1" } else { "0" }]);
                        let line = line.with(&[&format!("--{extraction}.use_gpu"), "0"]);
                        let line = line.with(&[&format!("--{extraction}.max_image_size"), &quality.size.to_string()]);
                        let line = line.with(&["--SiftExtraction.max_num_features", &quality.features.to_string()]);
                        let line = match camera {
                            Some(camera) => line.with(&["--ImageReader.existing_camera_id", &camera.to_string()]),
                            None => line,
                        };
                        match masks {
                            Some(masks) => line.with(&["--ImageReader.mask_path", &text(masks)]),
                            None => line,
                        }
                    }
                    Step::MatchAll { block } => {
                        let line = of("exhaustive_matcher").with(&[&matching_on_cpu, "0"]);
                        line.with(&["--ExhaustiveMatching.block_size", &block.to_string()])
                    }
                    Step::MatchPairs { pairs } => {
                        let line = of("matches_importer").with(&[&matching_on_cpu, "0"]);
                        line.with(&["--match_list_path", &text(pairs), "--match_type", "pairs"])
                    }
                    Step::Map { images, output, is_relaxed } => {
                        let line = of("mapper").with(&["--image_path", &text(images), "--output_path", &text(output)]);
                        let line = line.with(&["--Mapper.min_model_size", "3"]);
                        if !is_relaxed {
                            return line;
                        }
                        let line =
                            line.with(&["--Mapper.init_min_tri_angle", "4", "--Mapper.init_min_num_inliers", "50"]);
                        line.with(&["--Mapper.abs_pose_min_num_inliers", "15"])
                    }
                }
            }
        }
    }
}

/// Features of pictures: largest edge in pixels, number, and lens of the cameras.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Quality {
    pub(crate) size: u32,
    pub(crate) features: u32,
    pub(crate) lens: String,
}

/// Step of a reconstruction.
#[derive(Clone, Debug)]
pub(crate) enum Step<'a> {
    /// Features of the listed pictures, which share a camera or have one each. `camera` is the
    /// camera of those that are in the database.
    Features {
        images: &'a Path,
        masks: Option<&'a Path>,
        list: &'a Path,
        is_shared: bool,
        camera: Option<usize>,
        quality: &'a Quality,
    },
    MatchAll {
        block: usize,
    },
    MatchPairs {
        pairs: &'a Path,
    },
    Map {
        images: &'a Path,
        output: &'a Path,
        is_relaxed: bool,
    },
}

/// Version in the help of the program.
fn version_of(help: &str) -> Option<&str> {
    let line = help.lines().find(|line| line.starts_with("COLMAP "))?;
    line.split(' ').nth(1).filter(|word| word.starts_with(|letter: char| letter.is_ascii_digit()))
}

/// News in a line of output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Event {
    /// Number of pictures with features.
    Processed(u64),
    /// A block of pairs begins: row, rows, column and columns.
    Block([u64; 4]),
    /// A picture gets a camera.
    Registered,
    /// A new reconstruction begins.
    Started,
    /// Number of pictures with matches to others.
    Connected(u64),
    /// Features of a picture cannot be computed.
    Failed(String),
}

impl Event {
    /// Reads a line of version 3 or 4.
    pub(crate) fn of(line: &str) -> Option<Self> {
        let numbers = |rest: &str| -> Vec<u64> {
            rest.split(|letter: char| !letter.is_ascii_digit()).filter_map(|word| word.parse().ok()).collect()
        };
        let after = |words: &str| line.split_once(words).map(|(_, rest)| rest);
        if let Some(rest) = after("Processed file [") {
            return numbers(rest).first().copied().map(Self::Processed);
        }
        if let Some(rest) = after("Matching block [").or_else(|| after("Processing block [")) {
            let place = numbers(rest.split(']').next().unwrap_or(rest));
            return match place[..] {
                [row, rows, column, columns] => Some(Self::Block([row, rows, column, columns])),
                [block, blocks] => Some(Self::Block([1, 1, block, blocks])),
                _ => None,
            };
        }
        if after("(connected ").is_some() {
            return after("(connected ").and_then(|rest| numbers(rest).first().copied()).map(Self::Connected);
        }
        if after("Registering initial image pair").or_else(|| after("Initializing with image pair")).is_some() {
            return Some(Self::Started);
        }
        if after("Registering image #").or_else(|| after("Registering frame #")).is_some() {
            return Some(Self::Registered);
        }
        let error = after("ERROR: ").filter(|_| line.trim_start().starts_with("ERROR: "))?;
        Some(Self::Failed(error.trim().to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_and_progress_are_read_from_the_output_of_either_version() {
        assert_eq!(version_of("COLMAP 3.8 -- Structure-from-Motion and Multi-View Stereo\n"), Some("3.8"));
        assert_eq!(version_of("usage: python [option]"), None);
        for (line, event) in [
            ("Processed file [3/77]", Event::Processed(3)),
            ("I2026 11:1 1 feature_extraction.cc:270] Processed file [12/80]", Event::Processed(12)),
            ("Matching block [1/4, 3/4] in 6.261s", Event::Block([1, 4, 3, 4])),
            ("Matching block [2/5] in 6.261s", Event::Block([1, 1, 2, 5])),
            ("I2026 x pairing.cc:214] Processing block [2/3, 1/3]", Event::Block([2, 3, 1, 3])),
            ("Registering image #5 (12)", Event::Registered),
            ("I2026 x incremental_pipeline.cc:620] Registering image #3 (num_reg_frames=2)", Event::Registered),
            ("Initializing with image pair #2 and #5", Event::Started),
            ("Loading images... 23 in 0.000s (connected 20)", Event::Connected(20)),
            ("I2026 x database_cache.cc:268]  8 in 0.000s (connected 8, loaded 8)", Event::Connected(8)),
            ("  ERROR: Failed to read image file format.", Event::Failed("Failed to read image file format.".into())),
        ] {
            assert_eq!(Event::of(line), Some(event), "{line}");
        }
        assert_eq!(Event::of("  => Image sees 76 / 833 points"), None);
    }

    #[test]
    fn options_have_the_names_of_their_version() {
        let tool = |kind| Tool { program: "colmap".into(), version: "3.8".into(), kind };
        let quality = Quality { size: 1600, features: 4096, lens: "SIMPLE_RADIAL".into() };
        let step = Step::Features {
            images: Path::new("d/images"),
            masks: Some(Path::new("d/masks")),
            list: Path::new("d/list.txt"),
            is_shared: true,
            camera: None,
            quality: &quality,
        };
        let text = |kind| tool(kind).command(Path::new("d/db"), Path::new("d/run.py"), &step).text();
        let old = text(Kind::Program { is_recent: false });
        let new = text(Kind::Program { is_recent: true });
        assert!(old.contains("--SiftExtraction.use_gpu 0") && old.contains("--ImageReader.mask_path d/masks"), "{old}");
        assert!(
            new.contains("--FeatureExtraction.use_gpu 0") && new.contains("--FeatureExtraction.max_image_size"),
            "{new}"
        );
        assert!(text(Kind::Python).starts_with("colmap d/run.py features '{"), "{}", text(Kind::Python));
    }
}
