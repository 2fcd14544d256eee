//! Files to core's types and back: data sets, Gaussians and points as PLY, light, pictures, model
//! folders.
//!
//! Data is validated here, once, and can be trusted afterwards. An [`Error`] is one sentence with
//! the file, the place in it and, if there is one, a remedy. Files are written under a temporary
//! name and renamed, so that a file is complete or unchanged.
//!
//! * [`dataset`]: photographs with cameras ([`cameras`], [`lens`], [`pixels`])
//! * [`reconstruction`]: cameras and points of COLMAP, as evidence of their quality; [`masks`]:
//!   masks of pictures by their names
//! * [`origin`]: origin of a scene in the world of its data set
//! * [`orientation`]: up direction, centre and viewing distance as a model records them
//! * [`gaussian_ply`], [`points_ply`]: Gaussians and points
//! * [`latlong`]: light as `.hdr` and `.exr`, conversion to and from cube maps; [`ktx`]: cube maps
//!   for other programs
//! * [`splat`], [`spz`], [`glb`], [`usd`]: Gaussians for other programs, and from them, except USD;
//!   [`mesh`]: surfaces; [`lint`]: faults of such files, and their effects
//! * [`picture`]: PNGs, comparisons, animations; [`planes`]: numbers of pictures as OpenEXR
//! * [`model_folder`]: the output of a training, in the field's layout
//! * [`exposure`]: exposures of the training photographs
//! * [`checkpoint`]: the state of an interrupted training
//! * [`budget`]: memory budgets of files, limits of picture sizes
//! * [`within`]: untrusted folders: nothing is written or removed through their links
//!
//! ```
//! use specula_core::scene::{Gaussians, Layout, MEAN, len_of_values};
//! use specula_io::gaussian_ply;
//!
//! let layout = Layout::radiance(3);
//! let mut gaussians = Gaussians { count: 1, layout, values: vec![0.0; len_of_values(1, layout)] };
//! gaussians.set(0, MEAN, [1.0, 2.0, 3.0]);
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("scene.ply");
//! gaussian_ply::write(&path, &gaussians, &[])?;
//! assert_eq!(gaussian_ply::read(&path)?.gaussians.get::<3>(0, MEAN), [1.0, 2.0, 3.0]);
//!
//! let missing = folder.path().join("nothing.ply");
//! let refusal = gaussian_ply::read(&missing).err().expect("it is not there");
//! assert!(refusal.to_string().contains("nothing.ply"));
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```

mod affine;
mod blender;
pub mod budget;
pub mod cameras;
pub mod checkpoint;
mod colmap;
mod color_space;
mod compressed_ply;
mod cube;
pub mod dataset;
mod doubts;
mod error;
pub mod exposure;
mod exr_decoder;
mod gaussian_file;
pub mod gaussian_ply;
pub mod glb;
mod input;
mod jpeg;
mod json;
mod kinds;
pub mod ktx;
pub mod latlong;
mod left_out;
pub mod lens;
pub mod light_table;
pub mod lint;
mod listing;
pub mod masks;
pub mod materials;
pub mod mesh;
mod metashape;
pub mod model_folder;
mod named;
mod near_field;
mod nerfstudio;
mod network;
pub mod orientation;
pub mod origin;
mod photographs;
pub mod picture;
pub mod pixels;
pub mod planes;
pub mod points_ply;
mod radiance;
pub mod reconstruction;
mod shot;
pub mod splat;
pub mod spz;
mod table;
mod transforms;
pub mod usd;
pub mod whole_file;
pub mod within;

pub use error::{Error, Result};
pub use input::Input;
pub use shot::{IMAGE_ENDINGS, RAW_ENDINGS};

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
