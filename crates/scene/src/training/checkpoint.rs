//! Checkpoints of a training: their interval, and the description that identifies the training.

use crate::dataset::pixel_checksum;
use specula_core::{camera::Camera, state::TrainingState};
use specula_io::{
    Result,
    checkpoint::{self, Checkpoint, Facts},
};
use specula_train::{trainer::Settings, view::View};
use std::path::{Path, PathBuf};

/// Checkpoints of a training: their folder, interval and description.
#[derive(Debug)]
pub struct Checkpoints {
    folder: PathBuf,
    /// Steps between checkpoints; 0 for none before the end.
    every: u32,
    facts: Facts,
    /// Iteration of the last checkpoint.
    last: Option<u32>,
    /// True if another rank writes the checkpoints.
    is_of_another_rank: bool,
}

impl Checkpoints {
    /// Checkpoints of a new training in a folder, one every `every` steps; none before the end if
    /// 0.
    pub fn new(folder: &Path, every: u32, facts: Facts) -> Self {
        Self { folder: folder.to_owned(), every, facts, last: None, is_of_another_rank: false }
    }

    /// Checkpoints of a training that is resumed from iteration `last`.
    #[must_use]
    pub fn resumed_at(self, last: u32) -> Self {
        Self { last: Some(last), ..self }
    }

    /// The same checkpoints, written by another rank.
    #[must_use]
    pub fn of_another_rank(self) -> Self {
        Self { is_of_another_rank: true, ..self }
    }

    /// Path of the checkpoint.
    pub fn path(&self) -> PathBuf {
        checkpoint::path_in(&self.folder)
    }

    /// Iteration of the last checkpoint, if there is one.
    pub fn last(&self) -> Option<u32> {
        self.last
    }

    /// Returns whether a checkpoint is due at an iteration.
    pub fn is_due(&self, iteration: u32) -> bool {
        self.every > 0 && iteration.is_multiple_of(self.every) && self.last != Some(iteration)
    }

    /// Records that another rank failed to write the last checkpoint.
    pub(super) fn forget(&mut self) {
        self.last = None;
    }

    /// Writes a checkpoint, unless another rank does; `seconds` is the time of all steps.
    ///
    /// # Errors
    ///
    /// A file that cannot be written.
    pub fn write(&mut self, state: TrainingState<Vec<f32>>, seconds: f64) -> Result<()> {
        let iteration = state.iteration;
        if !self.is_of_another_rank {
            checkpoint::write(&self.folder, &Checkpoint { state, facts: Facts { seconds, ..self.facts.clone() } })?;
        }
        self.last = Some(iteration);
        Ok(())
    }

    /// Reads the last checkpoint.
    ///
    /// # Errors
    ///
    /// A file that is missing, damaged or of another format.
    pub fn read(&self) -> Result<TrainingState<Vec<f32>>> {
        Ok(checkpoint::read(&self.folder)?.state)
    }
}

/// Name, camera and checksum of a picture, which identify it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PictureSum<'a> {
    /// Name in the data set.
    pub(crate) name: &'a str,
    /// Camera of the picture.
    pub(crate) camera: &'a Camera,
    /// CRC-32 of its pixels.
    pub(crate) pixels: u32,
}

/// Description of a training before its first step; `config` is the text of the user's settings.
pub fn describe(settings: &Settings, config: String, views: &[View]) -> Facts {
    let sums = views.iter().map(|view| {
        let View { name, camera, rgba, unclipped, .. } = view;
        PictureSum { name, camera, pixels: pixel_checksum(rgba, unclipped.as_deref()) }
    });
    describe_pictures(settings, config, sums)
}

/// [`describe`] for pictures that are not in memory.
pub(crate) fn describe_pictures<'a>(
    settings: &Settings,
    config: String,
    pictures: impl ExactSizeIterator<Item = PictureSum<'a>>,
) -> Facts {
    Facts {
        program: env!("CARGO_PKG_VERSION").into(),
        iterations: settings.iterations,
        seed: settings.seed,
        config,
        settings: settings_text(settings),
        views: pictures.len(),
        pictures: checksum(pictures),
        ..Facts::default()
    }
}

/// All settings as text.
pub fn settings_text(settings: &Settings) -> String {
    format!("{settings:?}")
}

/// Checksum of the names, cameras and pixels of views, which detects changed pictures.
fn checksum<'a>(pictures: impl Iterator<Item = PictureSum<'a>>) -> String {
    let mut sum = crc32fast::Hasher::new();
    for PictureSum { name, camera, pixels } in pictures {
        // The near plane follows from the cameras' positions.
        let Camera {
            camera_from_world,
            position,
            focal_px,
            principal_px,
            near: _,
            width,
            height,
            light_from_world,
            scissor: _,
            light: number,
        } = *camera;
        let numbers = camera_from_world.to_cols_array().into_iter().chain(position.to_array());
        let light = light_from_world.iter().flat_map(glam::Mat3::to_cols_array);
        sum.update(name.as_bytes());
        [width, height].iter().for_each(|size| sum.update(&size.to_le_bytes()));
        numbers.chain(focal_px).chain(principal_px).chain(light).for_each(|number| sum.update(&number.to_le_bytes()));
        if number > 0 {
            sum.update(&number.to_le_bytes());
        }
        let len = 4 * u64::from(width) * u64::from(height);
        sum.combine(&crc32fast::Hasher::new_with_initial_len(pixels, len));
    }
    format!("{:08x}", sum.finalize())
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::random;
    use specula_cpu::CpuExecutor;
    use specula_train::{
        profile::{by_name, exposure_rate},
        start::Point,
        trainer::Trainer,
    };
    use std::fs;

    const SIZE: u32 = 32;
    const VIEWS: u64 = 5;
    const POINTS: u64 = 150;
    const ITERATIONS: u32 = 24;
    /// Number of interruptions of a training, for each profile.
    const SAVE_COUNT: u64 = 20;

    fn views() -> Vec<View> {
        let view = |k: u64| {
            let turn = k as f32 * 1.1;
            let eye = glam::Vec3::new(3.0 * turn.cos(), 3.0 * turn.sin(), 0.7);
            let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, SIZE, SIZE);
            let camera = Camera { light_from_world: Some(glam::Mat3::from_rotation_z(turn)), ..camera };
            let camera = Camera { light: (k % 2) as u32, ..camera };
            let rgba = (0..u64::from(SIZE * SIZE * 4)).map(|byte| (byte * (k + 3) % 253) as u8).collect();
            View { name: k.to_string(), camera, rgba, unclipped: None, normals: None }
        };
        (0..VIEWS).map(view).collect()
    }

    fn points() -> Vec<Point> {
        let coordinate = |axis: u64, k: u64| random::uniform(1, axis, k) - 0.5;
        (0..POINTS)
            .map(|k| Point { position: [0, 1, 2].map(|axis| coordinate(axis, k)), color: [0.5, 0.4, 0.3] })
            .collect()
    }

    fn settings(name: &str) -> Settings {
        let mut profile = by_name(name, ITERATIONS).expect("a profile of that name");
        profile.densification.every = 5;
        profile.exposure = (name == "specula").then(|| exposure_rate(ITERATIONS));
        if let Some(light) = &mut profile.light {
            light.resolution = profile.scheme.resolution_min().max(16);
        }
        Settings { profile, iterations: ITERATIONS, seed: 3, background: [1.0; 3], random_points: 0 }
    }

    fn train(trainer: &mut Trainer<CpuExecutor>, until: u32) {
        while trainer.iteration() < until {
            trainer.step().expect("the CPU trains");
        }
    }

    /// The bytes of the checkpoint that a training would write now.
    fn bytes(trainer: &mut Trainer<CpuExecutor>, settings: &Settings) -> Vec<u8> {
        let folder = tempfile::tempdir().expect("a writable folder");
        let mut checkpoints = Checkpoints::new(folder.path(), 1, describe(settings, String::new(), &views()));
        checkpoints.write(trainer.snapshot().expect("the CPU gives back"), 0.0).expect("a writable folder");
        fs::read(checkpoints.path()).expect("it was written")
    }

    /// A training resumed from the bytes of a checkpoint.
    fn resumed(bytes: &[u8], settings: &Settings) -> Trainer<CpuExecutor> {
        let folder = tempfile::tempdir().expect("a writable folder");
        fs::write(checkpoint::path_in(folder.path()), bytes).expect("a writable folder");
        let saved = checkpoint::read(folder.path()).expect("it was written");
        Trainer::resume(CpuExecutor::new(), settings.clone(), &views(), &saved.state).expect("it is the same")
    }

    #[test]
    fn resumed_trainings_end_with_the_same_bits() {
        for name in ["specula", "paper", "3dgs"] {
            let settings = settings(name);
            let mut whole =
                Trainer::new(CpuExecutor::new(), settings.clone(), &views(), &points()).expect("there are views");
            let mut iterations: Vec<u32> =
                (0..SAVE_COUNT).map(|k| (random::bits(7, 0, k) % u64::from(ITERATIONS)) as u32).collect();
            iterations.sort_unstable();
            let mut saved = Vec::new();
            for iteration in iterations {
                train(&mut whole, iteration);
                saved.push(bytes(&mut whole, &settings));
            }
            train(&mut whole, ITERATIONS);
            assert_ne!(whole.gaussians().count as u64, POINTS, "densification took part in {name}");
            let expected = bytes(&mut whole, &settings);
            for saved in saved {
                let mut resumed_run = resumed(&saved, &settings);
                let iteration = resumed_run.iteration();
                assert!(bytes(&mut resumed_run, &settings) == saved, "{name} at {iteration} is not what was read");
                train(&mut resumed_run, ITERATIONS);
                assert!(bytes(&mut resumed_run, &settings) == expected, "{name} from {iteration} on ends otherwise");
            }
        }
    }

    #[test]
    fn checkpoints_of_other_trainings_are_rejected() {
        let specula = settings("specula");
        let mut trainer =
            Trainer::new(CpuExecutor::new(), specula.clone(), &views(), &points()).expect("there are views");
        train(&mut trainer, 1);
        let learned = trainer.snapshot().expect("the CPU gives back");
        let go_on = |settings: &Settings, views: &[View], snapshot: &TrainingState<Vec<f32>>| {
            let resumed = Trainer::resume(CpuExecutor::new(), settings.clone(), views, snapshot);
            resumed.map(|_| ()).map_err(|error| error.to_string())
        };
        assert_eq!(go_on(&specula, &views(), &learned), Ok(()));
        let mut other_light = specula.clone();
        other_light.profile.light.as_mut().expect("specula has a light").resolution *= 2;
        let mut short = learned.clone();
        short.scene.moments.mean.pop();
        let mut plain = specula.clone();
        plain.profile.exposure = None;
        for (settings, views, snapshot, word) in [
            (&settings("3dgs"), &views()[..], &learned, "attributes"),
            (&other_light, &views(), &learned, "light"),
            (&plain, &views(), &learned, "exposures"),
            (&specula, &views()[..4], &learned, "exposures"),
            (&specula, &views()[..1], &learned, "groups"),
            (&specula, &views(), &short, "moments"),
        ] {
            let sentence = go_on(settings, views, snapshot).expect_err("it is another training");
            assert!(sentence.contains(word), "{word:?} is not in: {sentence}");
        }
    }

    #[test]
    fn pictures_names_and_cameras_identify_a_data_set() {
        let sum_of = |views: &[View]| describe(&settings("3dgs"), String::new(), views).pictures;
        let sum = sum_of(&views());
        assert_eq!(sum, sum_of(&views()));
        let changes: [fn(&mut View); 7] = [
            |view| view.rgba[17] ^= 1,
            |view| view.unclipped = Some(vec![[half::f16::ONE; 3]]),
            |view| view.name.push('x'),
            |view| view.camera.focal_px[0] += 1.0,
            |view| view.camera.width += 1,
            |view| view.camera.light_from_world = None,
            |view| view.camera.light = 1,
        ];
        for change in changes {
            let mut changed = views();
            change(&mut changed[2]);
            assert_ne!(sum, sum_of(&changed), "a change went unnoticed");
        }
        assert_ne!(sum, sum_of(&views()[1..]), "a missing view went unnoticed");
    }
}
