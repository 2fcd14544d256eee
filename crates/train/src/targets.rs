//! Targets of a training on its executor: uploaded at their turns, and kept on a device if all of
//! them fit into memory.

use crate::{
    error::TrainError,
    pictures::{PictureKey, Pictures, Turn},
};
use specula_core::executor::Executor;
use std::collections::{HashMap, HashSet};

/// Uploaded pictures, and their sources.
#[derive(Debug)]
pub(crate) struct Targets<T> {
    pictures: Box<dyn Pictures>,
    uploaded: HashMap<PictureKey, T>,
    /// Whether any of them is halved.
    has_halved: bool,
}

impl<T> Targets<T> {
    pub(crate) fn new(pictures: Box<dyn Pictures>) -> Self {
        Self { pictures, uploaded: HashMap::new(), has_halved: false }
    }

    /// Announces the next turns of pictures that are not uploaded.
    pub(crate) fn expect<'a, E: Executor<Target = T>>(&mut self, turns: impl IntoIterator<Item = &'a Turn>) {
        let is_kept = E::IS_DEVICE && self.pictures.are_kept_by_viewer();
        let mut seen = HashSet::new();
        let is_wanted =
            |turn: &Turn| !is_kept || (!self.uploaded.contains_key(&turn.picture) && seen.insert(turn.picture));
        let wanted: Vec<Turn> = turns.into_iter().copied().filter(is_wanted).collect();
        self.pictures.expect(&wanted);
    }

    /// Uploads the pictures of some turns, and drops others unless all of them are kept.
    ///
    /// # Errors
    ///
    /// [`TrainError::Picture`] or [`TrainError::Executor`]; the call may be repeated.
    pub(crate) fn prepare<E: Executor<Target = T>>(
        &mut self,
        exec: &mut E,
        turns: &[Turn],
    ) -> Result<(), TrainError<E::Error>> {
        let is_kept = E::IS_DEVICE && self.pictures.are_kept_by_viewer();
        let is_due = |picture: &PictureKey| turns.iter().any(|turn| turn.picture == *picture);
        let needs_halved = turns.iter().any(|turn| turn.picture.is_halved);
        if !is_kept {
            self.uploaded.retain(|picture, _| is_due(picture));
        } else if self.has_halved && !needs_halved {
            self.uploaded.retain(|picture, _| !picture.is_halved);
        }
        self.has_halved = needs_halved;
        for turn in turns {
            if self.uploaded.contains_key(&turn.picture) {
                continue;
            }
            let mut target = None;
            self.pictures
                .show(*turn, &mut |view| {
                    target = Some(exec.target(&view.picture()));
                })
                .map_err(TrainError::Picture)?;
            if let Some(target) = target.transpose()? {
                self.uploaded.insert(turn.picture, target);
            }
            if is_kept {
                self.pictures.release(turn.picture);
            }
        }
        Ok(())
    }

    /// Target of a prepared picture.
    pub(crate) fn of(&self, picture: PictureKey) -> &T {
        self.uploaded.get(&picture).expect("the pictures of a step are prepared")
    }
}
