//! Models from their folders.

use crate::{
    Scene, SceneError, ShadingModel, Surface,
    camera_set::keep_light_still,
    crop::{Crop, Objects, Support},
    export::{UPRIGHT_COMMENT, up_of_comments},
    foreground::Foreground,
    import::{Imported, scene_of_glb},
    orbit::{self, near_plane, turntable},
    orientation::{of_gaussians, recorded_or_estimated, up, with_up},
};
use glam::Mat3;
use serde_json::Value;
use specula_core::{
    camera::{Camera, near_of},
    region::Ball,
};
use specula_cpu::morton::sort_in_space;
use specula_io::{
    Error, Input, Result,
    cameras::{self, NamedCamera},
    exposure::{self, Exposures},
    glb,
    lint::assumed_up,
    model_folder::{self, Model, ModelInfo},
    orientation::{Orientation, UpSource},
    origin, within,
};
use specula_train::view::{View, extent_of_cameras};
use std::{
    collections::HashMap,
    path::{Path, PathBuf},
};

/// Scene of a trained model, and the facts in its folder.
#[derive(Debug)]
pub struct OpenedModel {
    /// Gaussians, light and shading model.
    pub scene: Scene,
    /// Folder of the model; `None` for a single file.
    pub folder: Option<PathBuf>,
    /// Iteration of the training; `None` for a single file.
    pub iteration: Option<u32>,
    /// Settings of the training; none if another program trained it.
    pub info: Option<ModelInfo>,
    /// Origin of Gaussians and cameras in the world of the data set ([`specula_io::origin`]).
    pub origin: [f64; 3],
    /// True if another light replaced that of the training: a `brdf_mlp.hdr`, the way to relight
    /// with the authors' code, or one that the program set.
    pub is_relit: bool,
    /// Number of the selected light of the training, from 1; `None` for all, each in its pictures.
    pub own_light: Option<usize>,
    /// True if the files name the shading model.
    pub is_read_as_saved: bool,
    /// Notes on parts of the files that are ignored or changed, one sentence each.
    pub notes: Vec<String>,
    /// Region that the scene was cropped to.
    pub crop: Option<Crop>,
    /// Orientation named by the file.
    up_of_file: Option<Orientation>,
}

impl OpenedModel {
    /// Opens the newest iteration of a model's folder, or a PLY or glTF file, with the shading
    /// model that the files name, by default that of the authors' code, which defines the layout.
    ///
    /// # Errors
    ///
    /// A folder without a model, a file that cannot be read, or an unknown shading function.
    pub fn open(path: &Path) -> core::result::Result<Self, SceneError> {
        if glb::is_gltf(path) {
            return Self::of_glb(path);
        }
        let model = model_folder::open(path)?;
        ShadingModel::refuse_unknown(&model)?;
        let shading_model = ShadingModel::of_model(&model);
        Ok(Self::under(path, model, shading_model))
    }

    /// Model that was read from `path`, with a shading model of the caller's choice.
    pub fn under(path: &Path, model: Model, shading_model: ShadingModel) -> Self {
        let folder = folder_of(path, &model);
        let is_read_as_saved = shading_model == ShadingModel::of_model(&model);
        let mut gaussians = model.gaussians;
        shading_model.decode(&mut gaussians);
        sort_in_space(&mut gaussians);
        // Files that were exported upright have y down, the convention of splat viewers.
        let is_y_down = model.comments.iter().any(|comment| comment.ends_with(UPRIGHT_COMMENT));
        // Files of other programs have the axes that viewers assume.
        let is_foreign = model.info.is_none() && !model.comments.iter().any(|comment| comment.contains("specula"));
        let named = is_y_down.then_some([0.0, -1.0, 0.0]).or_else(|| up_of_comments(&model.comments));
        let known = named.map(|up| (up, UpSource::File));
        let known = known.or_else(|| is_foreign.then(|| (assumed_up(path), UpSource::Nothing)));
        let up_of_file = known.map(|(up, up_source)| Orientation { up, up_source, ..of_gaussians(&gaussians) });
        Self {
            scene: Scene {
                gaussians,
                light: model.light,
                other_lights: model.other_lights,
                near_field: model.near_field.map(Surface::shared),
                lamps: None,
                shading_model,
            },
            folder,
            iteration: model.iteration,
            origin: model.info.as_ref().map_or_else(|| origin::of_comments(&model.comments), |info| info.origin),
            info: model.info,
            is_relit: model.is_relit,
            own_light: None,
            is_read_as_saved,
            notes: model.notes,
            crop: None,
            up_of_file,
        }
    }

    /// Opens a glTF file with Gaussians, with the shading model that it names.
    ///
    /// # Errors
    ///
    /// A file that cannot be read, or that [`scene_of_glb`] rejects.
    pub fn of_glb(path: &Path) -> core::result::Result<Self, SceneError> {
        let Imported { mut scene, orientation, origin, notes } = scene_of_glb(Input::file(path))?;
        sort_in_space(&mut scene.gaussians);
        Ok(Self {
            scene,
            folder: None,
            iteration: None,
            info: None,
            origin,
            is_relit: false,
            own_light: None,
            is_read_as_saved: true,
            notes,
            crop: None,
            up_of_file: Some(orientation),
        })
    }

    /// Puts all views under one light of the training, by its number from 1.
    ///
    /// # Errors
    ///
    /// [`SceneError::NoSuchLight`] for a number that the model does not have.
    pub fn select_light(&mut self, number: usize) -> core::result::Result<(), SceneError> {
        let lights = self.scene.light.iter().len() + self.scene.other_lights.len();
        if number == 0 || number > lights {
            return Err(SceneError::NoSuchLight { number, lights });
        }
        self.scene.select_light(number - 1);
        self.own_light = Some(number);
        Ok(())
    }

    /// Name of a light of the training, by its number from 1; `None` for a model of a single light.
    pub fn light_name(&self, number: usize) -> Option<&str> {
        self.info.as_ref()?.light_names().get(number.checked_sub(1)?).copied()
    }

    /// Cameras of the model's folder, test views first, with near planes proportional to their
    /// spread, under a light that stands still; empty if there are none.
    ///
    /// # Errors
    ///
    /// A `cameras.json` that cannot be read.
    pub fn cameras(&self) -> Result<Vec<NamedCamera>> {
        let mut cameras = self.lit_cameras()?;
        keep_light_still(&mut cameras);
        Ok(cameras)
    }

    /// [`OpenedModel::cameras`] under the light of their own pictures, unless another light
    /// replaced that of the training.
    ///
    /// # Errors
    ///
    /// A `cameras.json` that cannot be read, or names a light that the model does not have.
    pub fn lit_cameras(&self) -> Result<Vec<NamedCamera>> {
        let Some(file) = self.folder.as_ref().map(|folder| folder.join("cameras.json")) else { return Ok(Vec::new()) };
        if !within::holds(&file)? {
            return Ok(Vec::new());
        }
        let mut cameras = cameras::read(&file)?;
        let near = near_of(extent_of_cameras(cameras.iter().map(|(_, camera)| camera)));
        let is_still = self.is_relit || self.own_light.is_some();
        for (_, camera) in &mut cameras {
            *camera = Camera { near, ..if is_still { camera.under_still_light() } else { *camera } };
        }
        let lights = 1 + self.scene.other_lights.len();
        match cameras.iter().find(|(_, camera)| camera.light as usize >= lights) {
            None => Ok(cameras),
            Some((name, camera)) => {
                let what = format!(
                    "is under light {}, and the model has {lights}; copy cameras.json and light from one model",
                    camera.light + 1
                );
                Err(Error::Frame { path: file, frame: name.clone(), what })
            }
        }
    }

    /// Gives views of the training's data set the lights of their pictures.
    ///
    /// # Errors
    ///
    /// A `cameras.json` that cannot be read.
    pub fn give_lights(&self, test: &mut [View], train: &mut [View]) -> Result<()> {
        let mut held_out = self.lit_cameras()?;
        let trained = held_out.split_off(self.test_views().map_or(0, |count| count.min(held_out.len())));
        for (views, own, others) in [(test, &held_out, &trained), (train, &trained, &held_out)] {
            let lights: HashMap<&str, (Option<Mat3>, u32)> = others
                .iter()
                .chain(own)
                .map(|(name, camera)| (name.as_str(), (camera.light_from_world, camera.light)))
                .collect();
            for view in views {
                let found = lights.get(view.name.as_str()).copied();
                (view.camera.light_from_world, view.camera.light) = found.unwrap_or_default();
            }
        }
        Ok(())
    }

    /// Cameras of the held-out views; all cameras if none are held out.
    ///
    /// # Errors
    ///
    /// A `cameras.json` that cannot be read.
    pub fn test_cameras(&self) -> Result<Vec<NamedCamera>> {
        let mut cameras = self.cameras()?;
        if let Some(count) = self.test_views().filter(|count| *count > 0) {
            cameras.truncate(count);
        }
        Ok(cameras)
    }

    /// Cameras of the training: all but the held-out views; all cameras if the model does not
    /// record which are held out.
    ///
    /// # Errors
    ///
    /// A `cameras.json` that cannot be read.
    pub fn training_cameras(&self) -> Result<Vec<NamedCamera>> {
        let mut cameras = self.cameras()?;
        let held_out = self.test_views().filter(|count| *count < cameras.len()).unwrap_or(0);
        Ok(cameras.split_off(held_out))
    }

    /// Cameras of the training, else `count` of them on a sphere around the Gaussians.
    ///
    /// # Errors
    ///
    /// A `cameras.json` that cannot be read.
    pub fn surrounding_cameras(&self, count: u32) -> Result<Vec<Camera>> {
        let known = self.training_cameras()?;
        if known.is_empty() {
            return Ok(orbit::sphere(&self.scene.gaussians, count));
        }
        Ok(known.into_iter().map(|(_, camera)| camera).collect())
    }

    /// Cameras of the held-out views, else all cameras, else an orbit around the scene.
    ///
    /// # Errors
    ///
    /// A `cameras.json` that cannot be read.
    pub fn evaluation_cameras(&self) -> Result<Vec<NamedCamera>> {
        let cameras = self.test_cameras()?;
        if !cameras.is_empty() {
            return Ok(cameras);
        }
        let mut cameras = turntable(&self.orientation(None)?, &[], orbit::DEFAULT_COUNT, None, None);
        let near = near_plane(&cameras);
        cameras.iter_mut().for_each(|(_, camera)| camera.near = near);
        Ok(cameras)
    }

    /// Orientation that the model records, else the estimate from its cameras, else that of its
    /// Gaussians; `up`, a vector of any length but 0, replaces the up direction.
    ///
    /// # Errors
    ///
    /// A `cameras.json` that cannot be read.
    pub fn orientation(&self, up: Option<[f64; 3]>) -> Result<Orientation> {
        let known = self.cameras()?;
        let cameras = || known.iter().map(|(_, camera)| camera);
        let found = recorded_or_estimated(self.info.as_ref(), cameras());
        let found = found.or(self.up_of_file).unwrap_or_else(|| of_gaussians(&self.scene.gaussians));
        Ok(up.map_or(found, |up| with_up(found, up, cameras())))
    }

    /// Removes the other parts of the scene ([`Scene::cropped`]). Returns the region as a ball in
    /// the world of the scene; `None` for [`Foreground::All`], which removes nothing. A scene
    /// without a surface, or without a plane in it, keeps the region of [`Crop::Object`], and
    /// `self.crop` says so.
    ///
    /// # Errors
    ///
    /// A `cameras.json` that cannot be read.
    pub fn crop(&mut self, crop: Crop) -> Result<Option<Ball>> {
        let orientation = self.orientation(None)?;
        let region = match crop {
            Crop::Region(region) => region,
            Crop::Object => Foreground::Auto,
        };
        let Some(ball) = region.ball(Some(&orientation), self.origin) else { return Ok(None) };
        let surface = self.scene.near_field.as_deref().filter(|_| crop == Crop::Object);
        let support = surface.and_then(|surface| Support::of(surface, &ball, up(&orientation)));
        let objects = support.map(|support| Objects::on(support, &self.scene.gaussians, &ball));
        if let Some(support) = support {
            let small = (0..self.scene.gaussians.count).filter(|index| support.takes(&self.scene.gaussians, *index));
            self.scene = self.scene.kept(&small.collect::<Vec<_>>());
        }
        let is_theirs = |point| objects.as_ref().is_none_or(|objects| objects.contain(point));
        self.scene = self.scene.cropped(|point| ball.contains(point) && is_theirs(point));
        self.crop = Some(if support.is_some() { crop } else { Crop::Region(region) });
        Ok(Some(ball))
    }

    /// Number of held-out views, which come first among the cameras; `None` if it is not recorded.
    pub fn test_views(&self) -> Option<usize> {
        let count = self.info.as_ref()?.rest.get("test_views")?.as_u64()?;
        usize::try_from(count).ok()
    }

    /// Exposures of the training's photographs, if they were learned.
    ///
    /// # Errors
    ///
    /// An `exposure.json` that cannot be read.
    pub fn exposures(&self) -> Result<Option<Exposures>> {
        self.folder.as_deref().map_or(Ok(None), exposure::read)
    }

    /// Background of the training in sRGB; black if it is not recorded.
    pub fn background(&self) -> [f32; 3] {
        self.info.as_ref().map_or([0.0; 3], background_of)
    }
}

/// Background of a training in sRGB.
fn background_of(info: &ModelInfo) -> [f32; 3] {
    let number = |value: &Value| value.as_f64().map(|number| number as f32);
    let recorded = info.rest.get("background").and_then(Value::as_array);
    let channels: Option<Vec<f32>> = recorded.and_then(|channels| channels.iter().map(number).collect());
    match channels.as_deref() {
        Some([r, g, b]) => [*r, *g, *b],
        _ if info.white_background => [1.0; 3],
        _ => [0.0; 3],
    }
}

/// Folder of the model that contains a PLY file or the folder of an iteration, if there is one.
fn folder_of(path: &Path, model: &Model) -> Option<PathBuf> {
    let file = model_folder::gaussians_in(path);
    if path.is_dir() && file.is_none() {
        return Some(path.to_owned());
    }
    let file = file.unwrap_or_else(|| path.to_owned());
    model.iteration.and_then(|_| Some(file.canonicalize().ok()?.ancestors().nth(3)?.to_owned()))
}
