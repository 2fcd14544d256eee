//! Options and listings that all data-set formats share.

use crate::{color_space::InputSpace, points_ply::PointCloud, shot::Shot};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Options for reading a data set.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadOptions {
    /// Factor by which images are downscaled: 1, 2, 4 or 8. Sizes are rounded.
    pub downscale: u32,
    /// True to hold out the test views; otherwise they are also trained on.
    pub with_test: bool,
    /// Initial point cloud, instead of the data set's.
    pub points: Option<PathBuf>,
    /// Folder of images within the data set; paths in lists override it if it is [`IMAGES`].
    /// Smaller copies in a folder such as `images_4` are used if there are any.
    pub images: String,
    /// N to hold out every Nth photograph by name, from the first, if the data set names no test
    /// views; 0 for none.
    pub test_every: u32,
    /// Origin to which positions are relative, in the world of the data set, such as that of a
    /// model ([`crate::origin`]); by default it follows from the cameras.
    pub origin: Option<[f64; 3]>,
    /// Meaning of the pixels that masks hide.
    pub masks: MaskUse,
    /// Source of the lights of the pictures.
    pub lights: LightSource,
    /// Names of pictures that are left out.
    pub without: Vec<String>,
    /// Colour space of the pictures.
    pub space: InputSpace,
}

/// Source of the lights of the pictures, besides the lists of the data set itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum LightSource {
    /// None: a table in the data set is reported as unused.
    #[default]
    Unknown,
    /// The caller knows them, so that tables are not reported.
    Known,
    /// A table ([`crate::light_table`]).
    Table {
        /// File.
        path: PathBuf,
        /// Name of a light; pictures under other lights are left out.
        only: Option<String>,
    },
}

/// Meaning of the pixels that masks hide.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum MaskUse {
    /// Empty if the masks hide more than half of the training pictures, else unknown.
    #[default]
    Auto,
    /// Unknown: no loss and no measure counts them.
    Ignore,
    /// Empty: masks cut an object out, as alpha does.
    Cut,
}

impl MaskUse {
    /// Meaning by its name.
    pub fn named(name: &str) -> Option<Self> {
        [Self::Auto, Self::Ignore, Self::Cut].into_iter().find(|masks| masks.name() == name)
    }

    /// Name in options and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Ignore => "ignore",
            Self::Cut => "cut",
        }
    }
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self {
            downscale: 1,
            with_test: true,
            points: None,
            images: IMAGES.into(),
            test_every: TEST_EVERY,
            origin: None,
            masks: MaskUse::default(),
            lights: LightSource::default(),
            without: Vec::new(),
            space: InputSpace::default(),
        }
    }
}

impl LoadOptions {
    /// Folder of images that replaces the folders in a list's paths.
    pub(crate) fn other_images(&self) -> Option<&Path> {
        (self.images != IMAGES).then_some(Path::new(&self.images))
    }
}

/// Default folder of images.
pub const IMAGES: &str = "images";
/// Default N for holding out every Nth photograph, as in the literature.
pub const TEST_EVERY: u32 = 8;

/// Listing of a data set before any picture is opened.
#[derive(Debug, Default)]
pub(crate) struct Listing {
    pub(crate) train: Vec<Shot>,
    pub(crate) test: Vec<Shot>,
    /// Pictures that the options leave out.
    pub(crate) left_out: Vec<Shot>,
    pub(crate) points: Option<PointCloud>,
    /// Origin to which positions are relative.
    pub(crate) origin: [f64; 3],
    pub(crate) source: String,
    pub(crate) notes: Vec<String>,
    /// Rule of the held-out views.
    pub(crate) held_out: String,
    /// Files that are read, other than those of the shots.
    pub(crate) used: Vec<PathBuf>,
}

impl Listing {
    /// Leaves pictures out.
    pub(crate) fn leave_out(&mut self, is_unwanted: impl Fn(&Shot) -> bool) {
        for shots in [&mut self.train, &mut self.test] {
            let (unwanted, wanted): (Vec<Shot>, Vec<Shot>) = shots.drain(..).partition(&is_unwanted);
            *shots = wanted;
            self.left_out.extend(unwanted);
        }
    }

    /// Pictures to train on, then those held out.
    pub(crate) fn shots(&self) -> impl Iterator<Item = &Shot> + Clone {
        self.train.iter().chain(&self.test)
    }
}
