//! Pictures of a training, provided at their turns.

use crate::view::View;
use core::fmt::Debug;
use specula_core::camera::Camera;

/// A picture at full or at half size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PictureKey {
    /// Index of the view.
    pub view: usize,
    /// Whether the picture is [halved](View::halved).
    pub is_halved: bool,
}

/// Turn of a picture in a training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Turn {
    /// Number of the visit among all visits of the training, from 1.
    pub visit: u64,
    /// Picture that is visited.
    pub picture: PictureKey,
}

/// Picture that cannot be decoded: one sentence.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PictureError(pub String);

/// Pictures of one training, or of one of its ranks. They may be decoded on demand.
pub trait Pictures: Debug + Send {
    /// Camera of each picture at full size.
    fn cameras(&self) -> Vec<Camera>;

    /// Sets the next turns, in order, replacing the previous ones.
    fn expect(&mut self, _turns: &[Turn]) {}

    /// Calls `look` with a picture.
    ///
    /// # Errors
    ///
    /// A picture that cannot be decoded, or that has changed.
    fn show(&mut self, turn: Turn, look: &mut dyn FnMut(&View)) -> Result<(), PictureError>;

    /// True if an executor with its own memory may keep all pictures: they fit into their memory
    /// budget, and no other rank needs them.
    fn are_kept_by_viewer(&self) -> bool;

    /// Frees a picture that is not used again.
    fn release(&mut self, picture: PictureKey);
}

/// Source of the pictures of a training, possibly shared by its ranks.
pub trait PictureSource {
    /// Pictures for one training, or for one rank of it.
    fn pictures(&self) -> Box<dyn Pictures>;
}
