//! State of a training: the parameters of a scene, and everything else for a step. The trainer,
//! checkpoints and executors share these types; `A` is the storage of numbers, as in
//! [`crate::scene`].

use crate::scene::{Environment, Gaussians};
#[cfg(feature = "std")]
use {
    crate::{expose::Exposure, near_field::NearField},
    std::vec::Vec,
};

/// Adam's running means, a number for each parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct AdamMoments<A> {
    /// Means of the gradients.
    pub mean: A,
    /// Means of the squared gradients.
    pub square: A,
}

/// A light under optimisation, and Adam's moments of its numbers.
pub type FittedLight<A> = (Environment<A>, AdamMoments<A>);

/// Statistics of each Gaussian since the last densification.
#[derive(Clone, Debug, PartialEq)]
pub struct Statistics<A> {
    /// Sum over the views of the gradient's length at the projected centre, in normalised device
    /// coordinates.
    pub grad_sum: A,
    /// Number of views with the Gaussian in front of the camera, inside or outside of the picture.
    /// Outside no gradient is added, so the edges of a capture, which few views see, are refined
    /// less; INRIA's code counts Gaussians that touch a tile.
    pub view_count: A,
}

/// A scene under optimisation: everything that a step and densification change.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneState<A> {
    /// The Gaussians.
    pub gaussians: Gaussians<A>,
    /// Adam's moments of the Gaussians.
    pub moments: AdamMoments<A>,
    /// Statistics for densification.
    pub statistics: Statistics<A>,
    /// The light and its moments; `None` for plain Gaussian splatting.
    pub light: Option<FittedLight<A>>,
}

/// Exposures of the photographs, in the order of the views, with Adam's moments.
#[cfg(feature = "std")]
#[derive(Clone, Debug, PartialEq)]
pub struct ExposureState {
    /// One affine map of colours for each photograph.
    pub maps: Vec<Exposure<f32>>,
    /// Moments of the maps.
    pub moments: AdamMoments<Vec<Exposure<f32>>>,
}

/// A training between two steps. With its settings and views it determines every later step, on the
/// same kind of executor to the last bit.
#[cfg(feature = "std")]
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingState<A> {
    /// The scene and its moments.
    pub scene: SceneState<A>,
    /// Lights of pictures under others than the first, in the order of
    /// [`Camera::light`](crate::camera::Camera::light) from 1.
    pub other_lights: Vec<FittedLight<A>>,
    /// Near field for reflected rays, if there is one.
    pub near_field: Option<NearField<Vec<f32>>>,
    /// Exposures, if they are learned.
    pub exposures: Option<ExposureState>,
    /// Remaining views of the current pass over all views, the next one last.
    pub order: Vec<u32>,
    /// Steps taken.
    pub iteration: u32,
    /// PSNR of the training pictures in dB, a running mean; none before the first step.
    pub psnr: Option<f64>,
    /// Gradients skipped because they were not finite.
    pub nonfinite: usize,
}
