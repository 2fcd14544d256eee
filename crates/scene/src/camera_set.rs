//! Cameras of a rendering: those of a model, those of a file, or a turntable.

use crate::{
    OpenedModel, SceneError,
    orbit::{DEFAULT_COUNT, DEFAULT_SIZE, near_plane, turntable},
    orientation,
};
use glam::Vec3;
use specula_io::cameras::{self, NamedCamera};
use std::path::PathBuf;

/// Views of a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// Training views.
    Train,
    /// Held-out views.
    Test,
    /// All of them.
    All,
}

impl Split {
    /// Lower-case name, of folders and options.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Test => "test",
            Self::All => "all",
        }
    }

    /// Returns whether it includes test views.
    pub fn has_test(self) -> bool {
        self != Self::Train
    }

    /// Returns whether it includes training views.
    pub fn has_train(self) -> bool {
        self != Self::Test
    }
}

/// Keeps the light of cameras still in the scene, as one that replaces that of the training does.
pub fn keep_light_still(cameras: &mut [NamedCamera]) {
    cameras.iter_mut().for_each(|(_, camera)| *camera = camera.under_still_light());
}

/// Requested cameras; by default the test views, else all of the model's cameras, else a turntable.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraChoice {
    /// File of cameras.
    pub file: Option<PathBuf>,
    /// Views of the model.
    pub split: Option<Split>,
    /// Number of cameras of a turntable.
    pub turntable: Option<u32>,
    /// Width and height of pictures in pixels; by default those of the cameras.
    pub size: Option<[u32; 2]>,
    /// Rotates pictures by multiples of 90° so that the scene's up direction points up.
    pub is_upright: bool,
    /// Up direction of the scene, a vector of any length but 0, instead of that of the model.
    pub up: Option<[f64; 3]>,
}

/// Cameras to render.
#[derive(Clone, Debug)]
pub struct CameraSet {
    /// Name of the set, which names the folder of its pictures.
    pub name: &'static str,
    /// Cameras, with near planes proportional to the spread of the model's cameras.
    pub cameras: Vec<NamedCamera>,
    /// Origin of their positions in the world of the model's data set.
    pub origin: [f64; 3],
    /// Split of the data set; none for other cameras.
    pub split: Option<Split>,
    /// Whether the pictures are frames of an animation.
    pub is_turntable: bool,
    /// True if any picture was rotated to be upright.
    pub is_turned: bool,
    /// Requested size, if it differs from that of the views.
    pub other_size: Option<[u32; 2]>,
}

impl CameraSet {
    /// Requested cameras.
    ///
    /// # Errors
    ///
    /// A file of cameras that cannot be read; [`SceneError::NoCameras`],
    /// [`SceneError::UnknownSplit`] or [`SceneError::NoViews`] for a split that the model does not
    /// have.
    pub fn choose(choice: &CameraChoice, opened: &OpenedModel) -> Result<Self, SceneError> {
        let known = opened.cameras()?;
        let mut set = Self::unsized_set(choice, opened, &known)?;
        let near = near_plane(if known.is_empty() { &set.cameras } else { &known });
        set.cameras.iter_mut().for_each(|(_, camera)| camera.near = near);
        if choice.is_upright {
            set.turn_upright(orientation::up(&opened.orientation(choice.up)?));
        }
        if let Some(size @ [width, height]) = choice.size {
            let is_other = set.cameras.iter().any(|(_, camera)| [camera.width, camera.height] != size);
            set.other_size = is_other.then_some(size);
            set.cameras.iter_mut().for_each(|(_, camera)| *camera = camera.framed(width, height));
        }
        Ok(set)
    }

    /// [`keep_light_still`] for these cameras.
    pub fn keep_light_still(&mut self) {
        keep_light_still(&mut self.cameras);
    }

    fn turn_upright(&mut self, up: Vec3) {
        let before = self.cameras.clone();
        self.cameras.iter_mut().for_each(|(_, camera)| *camera = camera.upright(up));
        self.is_turned = self.cameras != before;
    }

    fn unsized_set(choice: &CameraChoice, opened: &OpenedModel, known: &[NamedCamera]) -> Result<Self, SceneError> {
        if let Some(file) = &choice.file {
            let cameras = cameras::read_cameras(file, choice.size.unwrap_or(DEFAULT_SIZE), opened.origin)?;
            return Ok(Self::other("cameras", cameras, opened));
        }
        match choice.turntable {
            None if !known.is_empty() => Self::of_split(choice.split, opened.lit_cameras()?, opened),
            None if choice.split.is_some() => Err(SceneError::NoCameras),
            count => {
                let orientation = opened.orientation(choice.up)?;
                let kept = opened.crop.is_some().then_some(&opened.scene.gaussians);
                let cameras = turntable(&orientation, known, count.unwrap_or(DEFAULT_COUNT), choice.size, kept);
                Ok(Self { is_turntable: true, ..Self::other("turntable", cameras, opened) })
            }
        }
    }

    /// Cameras other than the model's.
    fn other(name: &'static str, cameras: Vec<NamedCamera>, opened: &OpenedModel) -> Self {
        Self {
            name,
            cameras,
            origin: opened.origin,
            split: None,
            is_turntable: false,
            is_turned: false,
            other_size: None,
        }
    }

    /// Split of the model's cameras; test views come first in their list.
    fn of_split(
        requested: Option<Split>,
        mut cameras: Vec<NamedCamera>,
        opened: &OpenedModel,
    ) -> Result<Self, SceneError> {
        let test_count = opened.test_views().map(|count| count.min(cameras.len()));
        let default = if test_count.is_some_and(|count| count > 0) { Split::Test } else { Split::All };
        let split = requested.unwrap_or(default);
        match (split, test_count) {
            (Split::All, _) => {}
            (_, None) => return Err(SceneError::UnknownSplit),
            (Split::Test, Some(count)) => cameras.truncate(count),
            (Split::Train, Some(count)) => drop(cameras.drain(..count)),
        }
        if cameras.is_empty() {
            return Err(SceneError::NoViews(split.name()));
        }
        Ok(Self { split: Some(split), ..Self::other(split.name(), cameras, opened) })
    }
}
