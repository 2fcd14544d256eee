//! Reconstructions by COLMAP as evidence: which pictures have cameras, and how well points agree.

use crate::{
    colmap::{self, Model},
    error::Result,
};
use std::{collections::BTreeMap, path::Path};

/// Picture with a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Registered {
    /// Name of the picture, as COLMAP lists it.
    pub name: String,
    /// Position of the camera in the world.
    pub position: [f64; 3],
    /// Direction of view, a unit vector.
    pub forward: [f64; 3],
}

/// Point, and the pictures that see it.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Position in the world.
    pub position: [f64; 3],
    /// Mean reprojection error in pixels.
    pub error: f64,
    /// Indices of the pictures in [`Reconstruction::pictures`].
    pub pictures: Vec<usize>,
}

/// Cameras and tracks of a model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reconstruction {
    /// Pictures with a camera.
    pub pictures: Vec<Registered>,
    /// Points.
    pub tracks: Vec<Track>,
    /// Number of pictures in each other model beside it.
    pub others: Vec<usize>,
}

impl Reconstruction {
    /// Reads the reconstruction of a data set, of several the largest; `None` without one.
    ///
    /// # Errors
    ///
    /// An error of the files.
    pub fn of_dataset(folder: &Path) -> Result<Option<Self>> {
        colmap::find(folder).map(|model| Self::read(&model)).transpose()
    }

    /// Reads the model in a folder; `None` without one.
    ///
    /// # Errors
    ///
    /// An error of the files.
    pub fn of_model(folder: &Path) -> Result<Option<Self>> {
        Model::in_folder(folder).map(|model| Self::read(&model)).transpose()
    }

    fn read(model: &Model) -> Result<Self> {
        let registered = colmap::registered(model)?;
        let places: BTreeMap<u32, usize> = registered.keys().enumerate().map(|(index, id)| (*id, index)).collect();
        let pictures = registered.into_values().map(|(name, pose)| Registered {
            name,
            position: pose.position.to_array(),
            forward: pose.camera_from_world.row(2).to_array(),
        });
        let tracks = colmap::tracks(model)?.into_iter().map(|track| Track {
            position: track.position,
            error: track.error,
            pictures: track.images.iter().filter_map(|id| places.get(id).copied()).collect(),
        });
        let others = colmap::others(model);
        let others = others.iter().map(|other| colmap::registered(other).map(|images| images.len()));
        Ok(Self { pictures: pictures.collect(), tracks: tracks.collect(), others: others.collect::<Result<_>>()? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const IMAGES: &str = "1 1 0 0 0 0 0 4 1 a.jpg\n1 2 7\n5 1 0 0 0 1 0 4 1 b.jpg\n\n";

    #[test]
    fn tracks_name_the_pictures_that_see_a_point() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("sparse/0");
        fs::create_dir_all(&model).unwrap();
        for (name, text) in [
            ("cameras", "1 SIMPLE_PINHOLE 8 6 10 4 3\n"),
            ("images", IMAGES),
            ("points3D", "7 0.5 1 2 9 9 9 0.25 5 0 1 3 99 1\n"),
        ] {
            fs::write(model.join(name).with_extension("txt"), text).unwrap();
        }
        let found = Reconstruction::of_dataset(folder.path()).unwrap().unwrap();
        let [a, b] = &found.pictures[..] else { panic!("{found:?}") };
        assert_eq!((a.name.as_str(), a.position, a.forward), ("a.jpg", [0.0, 0.0, -4.0], [0.0, 0.0, 1.0]));
        assert_eq!((b.name.as_str(), b.position), ("b.jpg", [-1.0, 0.0, -4.0]));
        assert_eq!(found.tracks, [Track { position: [0.5, 1.0, 2.0], error: 0.25, pictures: vec![1, 0] }]);
        assert_eq!(Reconstruction::of_dataset(&model.join("none")).unwrap(), None);
        fs::write(model.join("points3D.txt"), "7 0.5 1 2 9 9 9 0.25 5 0 x 3\n").unwrap();
        let sentence = Reconstruction::of_dataset(folder.path()).unwrap_err().to_string();
        assert!(sentence.contains("points3D.txt") && sentence.contains("line 1"), "{sentence}");
    }
}
