//! Pictures of a training, which are there when their turn comes.

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
    /// Number of the visit among all that the training makes, from 1.
    pub visit: u64,
    /// Picture that is visited.
    pub picture: PictureKey,
}

/// Picture that cannot be shown: one sentence.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PictureError(pub String);

/// Pictures of one training, or of one rank of it. They may be decoded when they are wanted.
pub trait Pictures: Debug + Send {
    /// Camera of each picture at full size.
    fn cameras(&self) -> Vec<Camera>;

    /// Takes note of the next turns, in order, instead of those that were expected before.
    fn expect(&mut self, _turns: &[Turn]) {}

    /// Gives `look` a picture.
    ///
    /// # Errors
    ///
    /// A picture that cannot be decoded, or that has changed.
    fn show(&mut self, turn: Turn, look: &mut dyn FnMut(&View)) -> Result<(), PictureError>;

    /// Returns whether an executor with memory of its own may keep all pictures that it is shown:
    /// all of them fit into the memory that is set for them, and no other rank needs them.
    fn are_kept_by_viewer(&self) -> bool;

    /// Frees a picture, which is not shown again.
    fn release(&mut self, picture: PictureKey);
}

/// Source of the pictures of a training, which its ranks may share.
pub trait PictureSource {
    /// Pictures for one training, or for one rank of it.
    fn pictures(&self) -> Box<dyn Pictures>;
}
