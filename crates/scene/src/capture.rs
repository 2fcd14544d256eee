//! Data sets for trainings: pictures are decoded when a training or a measurement needs them, and
//! ranks share the facts of all pictures.
//!
//! At the start each rank decodes its share of the pictures once and gathers the facts of all:
//! sizes, alpha, checksums of the pixels. Later decoding verifies the checksum, so that all ranks
//! train on the same pixels.

mod facts;

pub use facts::Photograph;

use crate::{
    SceneError,
    dataset::{InitialPoints, RANDOM_POINTS, pixel_checksum, points_of, summary, view_of},
    following_light::{FollowingLight, LightFollows, light_of_turned_object},
    orientation::{centre, estimate, up},
    training::{PictureSum, describe_pictures},
};
use core::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use facts::{Extracts, Facts};
use glam::Vec3;
use rayon::prelude::*;
use specula_core::camera::{Camera, near_of};
use specula_io::{
    Error, checkpoint,
    dataset::{Album, LoadOptions, PictureLight, note_changes, note_missing_normals},
    light_table::{LightTable, SHARED},
    materials::Materials,
    orientation::Orientation,
};
use specula_train::{
    exchange::{Exchange, ExchangeError},
    picture_store::PictureStore,
    pictures::PictureError,
    start::{Point, points_behind, points_within},
    trainer::Settings,
    view::{View, extent_of_cameras, pixel_bytes},
};
use std::{path::Path, sync::Arc};

/// Data set with pictures that are decoded on demand.
#[derive(Debug)]
pub struct Capture {
    /// Pictures to train on.
    pub train: Vec<Photograph>,
    /// Pictures held out.
    pub test: Vec<Photograph>,
    /// Origin of cameras and points in the data set's world.
    pub origin: [f64; 3],
    /// Orientation estimated from the cameras; none without cameras.
    pub orientation: Option<Orientation>,
    /// Notes on skipped, changed or assumed data, one sentence each.
    pub notes: Vec<String>,
    /// Names of the lights of groups of pictures, by [`Camera::light`]; empty unless they were set.
    pub light_names: Vec<String>,
    /// Names of pictures that the options leave out.
    pub left_out: Vec<String>,
    points: Option<Vec<Point>>,
    album: Arc<Album>,
    extracts: Vec<Extracts>,
    /// Training views that were decoded at the start and fit into memory.
    decoded: Vec<(usize, View)>,
    /// Maximum bytes of decoded pixels.
    budget: u64,
}

/// Settings of a reading.
pub struct Reading<'a> {
    /// Folder of the data set.
    pub folder: &'a Path,
    /// Options of the data set.
    pub options: &'a LoadOptions,
    /// Initial points; `None` if a training is resumed.
    pub points: Option<InitialPoints>,
    /// Seed of these points.
    pub seed: u64,
    /// Number of this rank among those of its machine.
    pub local: usize,
    /// Maximum bytes of decoded pixels, by the number of ranks that share a machine.
    pub budget: &'a dyn Fn(usize) -> u64,
}

impl core::fmt::Debug for Reading<'_> {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(out, "Reading({:?})", self.folder)
    }
}

impl Capture {
    /// Reads a data set on all cores, with the other ranks if there is an `exchange`. Calls
    /// `progress` with the number of decoded images and of all images of this rank, from any
    /// thread.
    ///
    /// # Errors
    ///
    /// [`SceneError::File`], the first in the list's order, on the rank where it occurred, and
    /// [`SceneError::Training`] with its sentence on all others; [`SceneError::Ranks`] if a rank is
    /// gone or lists another data set.
    pub fn read(
        reading: &Reading<'_>,
        mut exchange: Option<&mut dyn Exchange>,
        progress: impl Fn(usize, usize) + Sync,
    ) -> Result<Self, SceneError> {
        let mut album = Album::list(reading.folder, reading.options)?;
        let points = album.points.take().map(|cloud| points_of(&cloud));
        let neighbours = match &mut exchange {
            Some(exchange) => facts::greet(*exchange, &album, reading).map_err(SceneError::Ranks)?,
            None => 1,
        };
        let budget = (reading.budget)(neighbours);
        let (rank, size) = exchange.as_ref().map_or((0, 1), |exchange| (exchange.rank(), exchange.size()));
        let own: Vec<usize> = (rank..album.len()).step_by(size).collect();
        let wanted = facts::Wanted::new(reading, points.as_deref(), album.train_count());
        let (own, decoded) = decode(&album, &own, &wanted, budget, progress);
        let all = match exchange {
            Some(exchange) => facts::gather(exchange, own, album.len())?,
            None => facts::whole(own)?,
        };
        let mut capture = Self::of(album, all, points, budget);
        capture.decoded = decoded;
        if capture.train.iter().all(|photograph| photograph.changes.is_all_unknown()) && !capture.train.is_empty() {
            return Err(SceneError::File(Error::AllMasked));
        }
        Ok(capture)
    }

    fn of(album: Album, all: Vec<Facts>, points: Option<Vec<Point>>, budget: u64) -> Self {
        let mut notes = album.notes.clone();
        let (mut photographs, mut extracts): (Vec<Photograph>, Vec<Extracts>) =
            all.into_iter().enumerate().map(|(index, facts)| facts.named(album.name(index))).unzip();
        note_changes(&photographs.iter().map(|photograph| photograph.changes).collect::<Vec<_>>(), &mut notes);
        let positions: Vec<[f32; 3]> = points.iter().flatten().map(|point| point.position).collect();
        let orientation = estimate(photographs.iter().map(|photograph| &photograph.camera), &positions);
        let is_held_out_alone = album.train_count() == 0;
        let trained = if is_held_out_alone { &photographs[..] } else { &photographs[..album.train_count()] };
        let near = near_of(extent_of_cameras(trained.iter().map(|photograph| &photograph.camera)));
        photographs.iter_mut().for_each(|photograph| photograph.camera.near = near);
        let test = photographs.split_off(album.train_count());
        extracts.truncate(album.train_count());
        note_missing_normals(test.iter().map(|photograph| photograph.has_normals), &mut notes);
        let (origin, left_out, album) = (album.origin, album.left_out.clone(), Arc::new(album));
        let (light_names, decoded) = (Vec::new(), Vec::new());
        let train = photographs;
        Self {
            train,
            test,
            origin,
            orientation,
            notes,
            light_names,
            left_out,
            points,
            album,
            extracts,
            decoded,
            budget,
        }
    }

    /// Returns whether alpha cuts objects out of all training pictures.
    pub fn holds_objects(&self) -> bool {
        !self.train.is_empty() && self.train.iter().all(|photograph| photograph.has_alpha)
    }

    /// Turns the light of each picture with its camera, unless it stands still in the scene.
    pub fn follow(&mut self, follows: LightFollows) {
        let up = self.orientation.as_ref().map_or(Vec3::Z, up);
        let light = self.train.first().and_then(|first| FollowingLight::new(follows, &first.camera, up));
        for Photograph { camera, .. } in self.train.iter_mut().chain(&mut self.test) {
            camera.light_from_world = light.map(|light| light.light_from_world(camera));
        }
    }

    /// Puts each picture under its light in a table, which has all of them
    /// ([`LightSource::Table`](specula_io::dataset::LightSource)).
    ///
    /// # Errors
    ///
    /// [`SceneError::Training`] for a light of fewer than two training pictures.
    pub fn light_by_table(&mut self, table: &LightTable) -> Result<(), SceneError> {
        let up = self.orientation.as_ref().map_or(Vec3::Z, up);
        let light_of = |index| {
            let found = table.light_of(self.album.path(index)).map(|(_, light)| light);
            let degrees = found.and_then(|light| light.degrees);
            PictureLight {
                name: found.map(|light| light.name.clone()),
                from_world: degrees.map(|degrees| light_of_turned_object(up, degrees)),
            }
        };
        self.light_by((0..self.album.len()).map(light_of).collect())
    }

    /// Puts the pictures of each folder under a light of their own, named as the folder.
    ///
    /// # Errors
    ///
    /// [`SceneError::Training`] for a light of fewer than two training pictures.
    pub fn light_by_folder(&mut self) -> Result<(), SceneError> {
        let folder = |index| self.album.path(index).parent().and_then(Path::file_name);
        let name = |index| folder(index).map(|name| name.to_string_lossy().into_owned());
        let lights = (0..self.album.len()).map(|index| PictureLight { name: name(index), from_world: None });
        self.light_by(lights.collect())
    }

    /// Puts each picture under the light that the data set names, if it names any.
    ///
    /// # Errors
    ///
    /// [`SceneError::Training`] for a light of fewer than two training pictures.
    pub fn light_by_list(&mut self) -> Result<(), SceneError> {
        self.light_by((0..self.album.len()).map(|index| self.album.light(index).clone()).collect())
    }

    /// Returns whether the data set names the light of any picture.
    pub fn lists_lights(&self) -> bool {
        (0..self.album.len()).any(|index| *self.album.light(index) != PictureLight::default())
    }

    /// Returns whether the light of any picture is turned.
    pub fn has_turned_lights(&self) -> bool {
        self.train.iter().chain(&self.test).any(|photograph| photograph.camera.light_from_world.is_some())
    }

    /// Puts the pictures under their lights, which are numbered by their first training picture.
    fn light_by(&mut self, lights: Vec<PictureLight>) -> Result<(), SceneError> {
        let name_of = |light: &PictureLight| light.name.clone().unwrap_or_else(|| SHARED.to_owned());
        let mut found: Vec<(String, usize)> = Vec::new();
        for light in &lights[..self.train.len()] {
            let name = name_of(light);
            match found.iter_mut().find(|(known, _)| *known == name) {
                Some((_, count)) => *count += 1,
                None => found.push((name, 1)),
            }
        }
        let number = |light: &PictureLight| found.iter().position(|(name, _)| *name == name_of(light));
        let unknown = lights.iter().find(|light| number(light).is_none()).map(|light| (name_of(light), 0));
        let rare = found.iter().find(|(_, count)| *count < 2 && found.len() > 1).cloned();
        if let Some((name, count)) = unknown.or(rare) {
            let are = if count == 0 { "no training picture is" } else { "only one training picture is" };
            return Err(SceneError::Training(format!(
                "{are} under the light {name:?}; a light needs two or more to train on"
            )));
        }
        for (Photograph { camera, .. }, light) in self.train.iter_mut().chain(&mut self.test).zip(&lights) {
            camera.light_from_world = light.from_world;
            camera.light = number(light).unwrap_or_default() as u32;
        }
        self.light_names = found.into_iter().map(|(name, _)| name).collect();
        Ok(())
    }

    /// Returns whether any training picture shows any of these points, hidden or not.
    pub fn shows_any_of(&self, points: &[Point]) -> bool {
        let shows = |camera: &Camera, point: &Point| {
            let place = camera.camera_from_world * (Vec3::from(point.position) - camera.position);
            let [x, y] = [0, 1].map(|k| camera.focal_px[k] * place[k] / place.z + camera.principal_px[k]);
            place.z > 0.0 && (0.0..camera.width as f32).contains(&x) && (0.0..camera.height as f32).contains(&y)
        };
        self.train.iter().any(|photograph| points.iter().any(|point| shows(&photograph.camera, point)))
    }

    /// Number of pictures with a mask.
    pub fn masks(&self) -> usize {
        self.album.report.masks
    }

    /// Returns whether any training picture is transparent somewhere.
    pub fn has_alpha(&self) -> bool {
        self.train.iter().any(|photograph| photograph.has_alpha)
    }

    /// Source, number of views, their sizes, and number of points on one line.
    pub fn summary(&self) -> String {
        let [train, test] = [&self.train, &self.test].map(|all| all.iter().map(|one| &one.camera).collect::<Vec<_>>());
        summary(&self.album.report.source, &train, &test, self.points.as_ref().map_or(0, Vec::len))
    }

    /// Takes the points out of the data set and appends random points, or draws only random points.
    pub fn take_points(&mut self, points: InitialPoints, seed: u64) -> Vec<Point> {
        let cameras = self.cameras();
        let (silhouettes, samples): (Vec<_>, Vec<_>) = core::mem::take(&mut self.extracts)
            .into_iter()
            .map(|extracts| (extracts.silhouette, extracts.sample))
            .unzip();
        let centre = self.orientation.as_ref().map_or([0.0; 3], |found| centre(found).to_array());
        let random = |count: u32| points_within(count as usize, centre, &cameras, &silhouettes, seed);
        let with_background = |mut known: Vec<Point>| {
            known.extend(points_behind(&known, points.background as usize, &cameras, &samples, seed));
            known
        };
        match (points.random, self.points.take()) {
            (Some(count), _) => random(count),
            (None, Some(known)) if !known.is_empty() => with_background(known),
            (None, _) => random(RANDOM_POINTS),
        }
    }

    /// Cameras of the training pictures.
    fn cameras(&self) -> Vec<Camera> {
        self.train.iter().map(|photograph| photograph.camera).collect()
    }

    /// Cameras of the test views, or else of the training views.
    pub fn evaluation_cameras(&self) -> Vec<Camera> {
        let views = if self.test.is_empty() { &self.train } else { &self.test };
        views.iter().map(|view| view.camera).collect()
    }

    /// Width of the widest training picture in pixels; 0 without any.
    pub fn width_max(&self) -> u32 {
        self.train.iter().map(|photograph| photograph.camera.width).max().unwrap_or(0)
    }

    /// Description of a training on these pictures ([`crate::training::describe`]).
    pub fn describe(&self, settings: &Settings, config: String) -> checkpoint::Facts {
        let sums = self.train.iter().map(|Photograph { name, camera, checksum, .. }| PictureSum {
            name,
            camera,
            pixels: *checksum,
        });
        describe_pictures(settings, config, sums)
    }

    /// Returns whether any view held out has ground-truth materials.
    pub fn has_materials(&self) -> bool {
        (self.train.len()..self.album.len()).any(|index| self.album.has_materials(index))
    }

    /// Views held out, from the first.
    pub const fn held_out(&self) -> HeldOut<'_> {
        HeldOut { capture: self, next: 0 }
    }

    /// Pictures to train on, which ranks of this program may share.
    pub fn take_store(&mut self) -> PictureStore {
        let (album, photographs) = (Arc::clone(&self.album), self.train.clone());
        let open = move |index: usize| match opened(&album, index, &photographs[index]) {
            Ok((view, _)) => Ok(without_truth(view)),
            Err(error) => Err(PictureError(error.to_string())),
        };
        let pixel_bytes = pixel_bytes(self.train.iter().any(|photograph| photograph.changes.is_unclipped));
        let store = PictureStore::new(self.cameras(), pixel_bytes, self.budget, decoder_count(), open);
        core::mem::take(&mut self.decoded).into_iter().for_each(|(index, view)| store.add(index, view));
        store
    }
}

/// Test views, decoded a few at a time on all threads.
#[derive(Debug)]
pub struct HeldOut<'a> {
    capture: &'a Capture,
    next: usize,
}

impl HeldOut<'_> {
    /// Decodes the next views, with their ground-truth materials; none after the last.
    ///
    /// # Errors
    ///
    /// [`SceneError::File`]: a picture that cannot be decoded, or has changed since the start.
    pub fn next_some(&mut self) -> Result<Option<Vec<(View, Materials)>>, SceneError> {
        /// Maximum number of finished views per thread that wait for other threads.
        const EACH: usize = 4;
        let Capture { train, test, album, .. } = self.capture;
        let first = self.next;
        self.next = (first + EACH * rayon::current_num_threads()).min(test.len());
        let open = |index: usize| opened(album, train.len() + index, &test[index]);
        let opened: Vec<_> = (first..self.next).into_par_iter().map(open).collect();
        let opened = opened.into_iter().collect::<Result<Vec<_>, _>>()?;
        Ok((!opened.is_empty()).then_some(opened))
    }
}

/// Number of threads that decode during a training: a share of the training threads.
fn decoder_count() -> usize {
    const TRAINING_THREADS: usize = 4;
    const MOST: usize = 8;
    (rayon::current_num_threads() / TRAINING_THREADS).clamp(1, MOST)
}

/// Decodes a picture again and verifies that it has not changed.
fn opened(album: &Album, index: usize, photograph: &Photograph) -> Result<(View, Materials), Error> {
    let (mut view, _) = album.open(index)?;
    let materials = core::mem::take(&mut view.materials);
    let view = view_of(view);
    let Camera { near, light_from_world, light, .. } = photograph.camera;
    let camera = Camera { near, light_from_world, light, ..view.camera };
    if camera != photograph.camera || pixel_checksum(&view.rgba, view.unclipped.as_deref()) != photograph.checksum {
        return Err(Error::Changed { path: album.path(index).to_owned() });
    }
    Ok((View { camera, ..view }, materials))
}

/// View without ground truth, which trainings do not use.
fn without_truth(view: View) -> View {
    View { normals: None, ..view }
}

/// Outcome of the pictures that a rank decodes at the start: facts in the order of the pictures, or
/// the first error among them.
type Decoded = Result<Vec<Facts>, (usize, Error)>;

/// Decodes some pictures, and keeps training views within the budget.
fn decode(
    album: &Album,
    indices: &[usize],
    wanted: &facts::Wanted,
    budget: u64,
    progress: impl Fn(usize, usize) + Sync,
) -> (Decoded, Vec<(usize, View)>) {
    let (done, held) = (AtomicUsize::new(0), AtomicU64::new(0));
    let open = |index: usize| {
        let opened = album.open(index).map(|(view, changes)| {
            let facts = Facts::of(&view, changes, wanted, index);
            let bytes = changes.pixels * pixel_bytes(changes.is_unclipped);
            let is_kept = index < album.train_count() && held.fetch_add(bytes, Ordering::Relaxed) + bytes <= budget;
            (facts, is_kept.then(|| (index, without_truth(view_of(view)))))
        });
        progress(done.fetch_add(1, Ordering::Relaxed) + 1, indices.len());
        opened.map_err(|error| (index, error))
    };
    let opened: Vec<Result<_, (usize, Error)>> = indices.par_iter().map(|index| open(*index)).collect();
    match opened.into_iter().collect::<Result<Vec<_>, _>>() {
        Ok(opened) => {
            let (facts, views): (Vec<Facts>, Vec<_>) = opened.into_iter().unzip();
            (Ok(facts), views.into_iter().flatten().collect())
        }
        Err(error) => (Err(error), Vec::new()),
    }
}

/// Error for a rank that sent an invalid message.
fn malformed(rank: usize) -> SceneError {
    SceneError::Ranks(ExchangeError::Transport(format!("rank {rank} sent an invalid message about pictures")))
}
