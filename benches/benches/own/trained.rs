//! A model that specula has trained.

use specula_core::{
    camera::Camera,
    scene::{Environment, Gaussians},
};
use specula_cpu::morton::sort_in_space;
use specula_io::{
    cameras,
    model_folder::{self, Model},
};
use specula_train::profile::{Profile, by_name};
use std::path::Path;

/// Contents of a model folder. Attributes are used as stored, which is accurate enough for
/// measurements.
#[derive(Debug)]
pub(crate) struct Trained {
    /// The Gaussians, in the order that a training keeps them in.
    pub(crate) cloud: Gaussians<Vec<f32>>,
    /// Their light.
    pub(crate) light: Option<Environment<Vec<f32>>>,
    /// Profile of the training.
    pub(crate) profile: Profile,
    /// All cameras.
    pub(crate) cameras: Vec<Camera>,
}

impl Trained {
    /// Opens a folder.
    pub(crate) fn open(folder: &Path) -> Self {
        let Model { gaussians: mut cloud, light, info, .. } = model_folder::open(folder).expect("a model's folder");
        let cameras = cameras::read(&folder.join("cameras.json")).expect("a model has its cameras");
        sort_in_space(&mut cloud);
        let profile = by_name(&info.expect("specula trained it").profile, 30_000).expect("a profile of that name");
        Self { cloud, light, profile, cameras: cameras.into_iter().map(|(_, camera)| camera).collect() }
    }
}
