//! Record of a capture, `capture.json`: inputs, decisions, command lines, and finished steps.

use crate::{
    error::{Error, Result},
    frames::Candidate,
};
use serde::{Deserialize, Serialize};
use specula_io::whole_file;
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Name of the record.
pub(crate) const NAME: &str = "capture.json";

/// Inputs and options that a capture depends on.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Request {
    pub(crate) inputs: Vec<PathBuf>,
    pub(crate) frames: Option<usize>,
    pub(crate) masks: Option<PathBuf>,
    pub(crate) mask_with: Option<String>,
    pub(crate) lens: String,
    pub(crate) is_best: bool,
}

/// A video and its frames.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct VideoRecord {
    pub(crate) path: PathBuf,
    pub(crate) candidates: Vec<Candidate>,
    /// Numbers of the selected frames.
    pub(crate) selected: Vec<u64>,
}

/// One reconstruction.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Attempt {
    pub(crate) pictures: usize,
    /// Whether features are only those within masks.
    #[serde(default)]
    pub(crate) is_masked: bool,
    /// Rule of the pairs, and their number.
    pub(crate) matching: String,
    pub(crate) pairs: usize,
    /// Largest edge of pictures, and largest number of features.
    pub(crate) size: u32,
    pub(crate) features: u32,
    /// Number of cameras that are shared, and of pictures with a camera of their own.
    pub(crate) shared_cameras: usize,
    pub(crate) own_cameras: usize,
    /// Pictures with matches to others.
    pub(crate) connected: u64,
    /// Number of pictures of each model, the largest first.
    pub(crate) models: Vec<usize>,
    /// Folder of the largest model.
    pub(crate) largest: Option<PathBuf>,
}

impl Attempt {
    /// Whether the features of this attempt are those of another one, too.
    pub(crate) fn has_features_of(&self, other: &Self) -> bool {
        let key = |attempt: &Self| (attempt.pictures, attempt.size, attempt.features, attempt.is_masked);
        key(self) == key(other)
    }

    /// Number of pictures with a camera in the largest model.
    pub(crate) fn registered(&self) -> usize {
        self.models.first().copied().unwrap_or(0)
    }
}

/// The record.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Record {
    pub(crate) request: Request,
    pub(crate) tool: String,
    pub(crate) videos: Vec<VideoRecord>,
    /// Pictures that are not used, with the reason.
    pub(crate) skipped: Vec<String>,
    /// Pictures with a mask, and masks of no picture.
    pub(crate) masks: Option<[usize; 2]>,
    pub(crate) attempts: Vec<Attempt>,
    /// Attempt whose largest model is in `sparse/0`, from 1.
    pub(crate) used_attempt: Option<usize>,
    /// Command lines, in order.
    pub(crate) commands: Vec<String>,
    /// Finished steps.
    pub(crate) done: Vec<String>,
    #[serde(skip)]
    path: PathBuf,
}

/// Paths without links and detours, where they exist.
pub(crate) fn real(paths: &[PathBuf]) -> Vec<PathBuf> {
    paths.iter().map(|path| path.canonicalize().unwrap_or_else(|_| path.clone())).collect()
}

impl Request {
    fn has_masks(&self) -> bool {
        self.masks.is_some() || self.mask_with.is_some()
    }

    /// Input or option of an earlier request that this one cannot change, with its value there.
    /// Masks and quality may be added. `None` if nothing differs.
    fn difference(&self, before: &Self) -> Option<String> {
        let frames = |frames: Option<usize>| {
            frames.map_or("without --frames".to_owned(), |count| format!("with --frames {count}"))
        };
        if self.inputs != real(&before.inputs) {
            Some(format!("of {:?}", before.inputs))
        } else if self.frames != before.frames {
            Some(frames(before.frames))
        } else if self.lens != before.lens {
            Some(format!("with --lens {}", before.lens))
        } else if before.has_masks() && !self.has_masks() {
            let masks = before.masks.as_ref().map(|folder| format!("--masks {}", folder.display()));
            let masks = masks.or(before.mask_with.as_ref().map(|command| format!("--mask-with '{command}'")));
            masks.map(|option| format!("with {option}"))
        } else {
            None
        }
    }
}

impl Record {
    /// Reads the record of a data set, or begins one: also where another request took no picture
    /// yet. That of a request with other masks, or another quality, keeps them.
    ///
    /// # Errors
    ///
    /// A record of another request, or one that cannot be read.
    pub(crate) fn open(folder: &Path, request: &Request) -> Result<Self> {
        let path = folder.join(NAME);
        if !path.is_file() {
            return Ok(Self { request: request.clone(), path, ..Self::default() });
        }
        let text =
            fs::read_to_string(&path).map_err(|cause| Error::Input(format!("{path:?} cannot be read: {cause}")))?;
        let found: Self = serde_json::from_str(&text).map_err(|cause| {
            Error::Input(format!("{path:?} is no record of a capture ({cause}); use another folder with -o"))
        })?;
        let pictures = fs::read_dir(folder.join("images")).into_iter().flatten().count();
        if found.request != *request && found.done.is_empty() && pictures == 0 {
            return Ok(Self { request: request.clone(), path, ..Self::default() });
        }
        if let Some(difference) = request.difference(&found.request) {
            return Err(Error::Input(format!(
                "{folder:?} has a capture {difference}; repeat that, or use another folder with -o"
            )));
        }
        Ok(Self { path, ..found })
    }

    /// Writes the record.
    pub(crate) fn save(&self) -> Result<()> {
        let text = serde_json::to_string_pretty(self).expect("it has names and numbers") + "\n";
        Ok(whole_file::write_bytes(&self.path, text.as_bytes())?)
    }

    pub(crate) fn is_done(&self, step: &str) -> bool {
        self.done.iter().any(|done| done == step)
    }

    /// Forgets the reconstructions, but not the pictures and masks.
    pub(crate) fn forget_attempts(&mut self) {
        self.attempts.clear();
        self.used_attempt = None;
        self.done.retain(|step| step == "masks");
    }

    /// Records a finished step.
    pub(crate) fn finish(&mut self, step: String) -> Result<()> {
        self.done.push(step);
        self.save()
    }

    /// Records a command line.
    pub(crate) fn ran(&mut self, command: String) {
        if self.commands.last() != Some(&command) {
            self.commands.push(command);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_continues_its_own_request_only() {
        let folder = tempfile::tempdir().unwrap();
        let request = Request { inputs: vec!["walk.mov".into()], ..Request::default() };
        let refused = Request { inputs: vec!["notes.txt".into()], ..Request::default() };
        Record::open(folder.path(), &refused).unwrap().save().unwrap();
        let mut record = Record::open(folder.path(), &request).expect("no picture was taken yet");
        record.finish("frames".into()).unwrap();
        assert!(Record::open(folder.path(), &request).unwrap().is_done("frames"));
        let other = Request { frames: Some(9), ..request.clone() };
        let sentence = Record::open(folder.path(), &other).unwrap_err().to_string();
        assert!(sentence.contains("without --frames") && sentence.contains("-o"), "{sentence}");
        let masked = Request { masks: Some("masks".into()), ..request.clone() };
        let mut record = Record::open(folder.path(), &masked).unwrap();
        assert_eq!(record.request.masks, None, "masks are added to what is there");
        record.request = masked.clone();
        record.save().unwrap();
        let others = Request { masks: Some("others".into()), ..request.clone() };
        assert_eq!(Record::open(folder.path(), &others).unwrap().request, masked);
        assert!(Record::open(folder.path(), &request).is_err(), "masks are not dropped");
        fs::write(folder.path().join(NAME), "{").unwrap();
        assert!(Record::open(folder.path(), &other).unwrap_err().to_string().contains("no record"));
    }
}
