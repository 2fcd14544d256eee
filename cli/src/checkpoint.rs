//! A training put aside, and taken up again: what it has learned as a file, and whether it is that of a run.

use crate::failure::Failure;
use specula_core::{camera::Camera, state::TrainingState};
use specula_io::checkpoint::{self, Checkpoint, Facts};
use specula_train::{trainer::Settings, view::View};
use std::path::{Path, PathBuf};

/// Where the checkpoints of a training go, how often, and what they say of it.
#[derive(Debug)]
pub(crate) struct Checkpoints {
    folder: PathBuf,
    /// Steps from one to the next; 0 for none on the way.
    every: u32,
    facts: Facts,
    /// The iteration of the last one.
    last: Option<u32>,
}

impl Checkpoints {
    /// Of a training that begins.
    pub(crate) fn new(folder: &Path, every: u32, facts: Facts) -> Self {
        Self { folder: folder.to_owned(), every, facts, last: None }
    }

    /// Of a training that goes on from its last one.
    pub(crate) fn gone_on(self, last: u32) -> Self {
        Self { last: Some(last), ..self }
    }

    /// Where they are.
    pub(crate) fn place(&self) -> PathBuf {
        checkpoint::place(&self.folder)
    }

    /// The iteration of the last one, if there is one.
    pub(crate) fn last(&self) -> Option<u32> {
        self.last
    }

    /// Whether there should be one after so many steps.
    pub(crate) fn is_due(&self, iteration: u32) -> bool {
        self.every > 0 && iteration.is_multiple_of(self.every) && self.last != Some(iteration)
    }

    /// Writes what was learned.
    pub(crate) fn write(&mut self, state: TrainingState<Vec<f32>>, seconds: f64) -> Result<(), Failure> {
        let iteration = state.iteration;
        checkpoint::write(&self.folder, &Checkpoint { state, facts: Facts { seconds, ..self.facts.clone() } })?;
        self.last = Some(iteration);
        Ok(())
    }

    /// Reads the last one.
    pub(crate) fn read(&self) -> Result<TrainingState<Vec<f32>>, Failure> {
        Ok(checkpoint::read(&self.folder)?.state)
    }
}

/// What is known of a training before its first step.
pub(crate) fn facts_of(settings: &Settings, config: String, views: &[View]) -> Facts {
    Facts {
        program: env!("CARGO_PKG_VERSION").into(),
        iterations: settings.iterations,
        seed: settings.seed,
        config,
        settings: words_of(settings),
        views: views.len(),
        pictures: sum_of(views),
        ..Facts::default()
    }
}

/// Every number of the settings.
pub(crate) fn words_of(settings: &Settings) -> String {
    format!("{settings:?}")
}

/// A sum over names, cameras and pixels of views: it tells pictures that were changed from those that were not.
fn sum_of(views: &[View]) -> String {
    let mut sum = crc32fast::Hasher::new();
    for view in views {
        // How near Gaussians are drawn follows from where the cameras are.
        let Camera { camera_from_world, position, focal_px, principal_px, near: _, width, height } = view.camera;
        let numbers = camera_from_world.to_cols_array().into_iter().chain(position.to_array());
        sum.update(view.name.as_bytes());
        [width, height].iter().for_each(|size| sum.update(&size.to_le_bytes()));
        numbers.chain(focal_px).chain(principal_px).for_each(|number| sum.update(&number.to_le_bytes()));
        sum.update(&view.rgba);
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
    /// Places at which a training is put aside, for each profile.
    const PLACES: u64 = 20;

    fn views() -> Vec<View> {
        let view = |k: u64| {
            let turn = k as f32 * 1.1;
            let eye = glam::Vec3::new(3.0 * turn.cos(), 3.0 * turn.sin(), 0.7);
            let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, SIZE, SIZE);
            let rgba = (0..u64::from(SIZE * SIZE * 4)).map(|byte| (byte * (k + 3) % 253) as u8).collect();
            View { name: k.to_string(), camera, rgba, normals: None }
        };
        (0..VIEWS).map(view).collect()
    }

    fn points() -> Vec<Point> {
        let place = |axis: u64, k: u64| random::uniform(1, axis, k) - 0.5;
        (0..POINTS).map(|k| Point { position: [0, 1, 2].map(|axis| place(axis, k)), color: [0.5, 0.4, 0.3] }).collect()
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
            trainer.step().expect("the processor trains");
        }
    }

    /// The bytes of the checkpoint that a training would write now.
    fn bytes(trainer: &mut Trainer<CpuExecutor>, settings: &Settings) -> Vec<u8> {
        let folder = tempfile::tempdir().expect("there is room");
        let mut checkpoints = Checkpoints::new(folder.path(), 1, facts_of(settings, String::new(), &views()));
        checkpoints.write(trainer.snapshot().expect("the processor gives back"), 0.0).expect("there is room");
        fs::read(checkpoints.place()).expect("it was written")
    }

    /// A training that goes on from these bytes.
    fn gone_on(bytes: &[u8], settings: &Settings) -> Trainer<CpuExecutor> {
        let folder = tempfile::tempdir().expect("there is room");
        fs::write(checkpoint::place(folder.path()), bytes).expect("there is room");
        let saved = checkpoint::read(folder.path()).expect("it was written");
        Trainer::resume(CpuExecutor::new(), settings.clone(), &views(), &saved.state).expect("it is the same")
    }

    #[test]
    fn a_training_ends_with_the_same_bits_wherever_it_was_put_aside() {
        for name in ["specula", "paper", "3dgs"] {
            let settings = settings(name);
            let mut whole =
                Trainer::new(CpuExecutor::new(), settings.clone(), &views(), &points()).expect("there are views");
            let mut places: Vec<u32> =
                (0..PLACES).map(|k| (random::bits(7, 0, k) % u64::from(ITERATIONS)) as u32).collect();
            places.sort_unstable();
            let mut aside = Vec::new();
            for place in places {
                train(&mut whole, place);
                aside.push(bytes(&mut whole, &settings));
            }
            train(&mut whole, ITERATIONS);
            assert_ne!(whole.gaussians().count as u64, POINTS, "densification took part in {name}");
            let expected = bytes(&mut whole, &settings);
            for aside in aside {
                let mut again = gone_on(&aside, &settings);
                let place = again.iteration();
                assert!(bytes(&mut again, &settings) == aside, "{name} at {place} is not what was read");
                train(&mut again, ITERATIONS);
                assert!(bytes(&mut again, &settings) == expected, "{name} from {place} on ends otherwise");
            }
        }
    }

    #[test]
    fn what_was_learned_elsewhere_is_refused() {
        let specula = settings("specula");
        let mut trainer =
            Trainer::new(CpuExecutor::new(), specula.clone(), &views(), &points()).expect("there are views");
        train(&mut trainer, 1);
        let learned = trainer.snapshot().expect("the processor gives back");
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
            (&specula, &views()[..1], &learned, "exposures"),
            (&specula, &views(), &short, "moments"),
        ] {
            let sentence = go_on(settings, views, snapshot).expect_err("it is another training");
            assert!(sentence.contains(word), "{word:?} is not in: {sentence}");
        }
    }

    #[test]
    fn pictures_names_and_cameras_tell_data_sets_apart() {
        let sum = sum_of(&views());
        assert_eq!(sum, sum_of(&views()));
        let changes: [fn(&mut View); 4] = [
            |view| view.rgba[17] ^= 1,
            |view| view.name.push('x'),
            |view| view.camera.focal_px[0] += 1.0,
            |view| view.camera.width += 1,
        ];
        for change in changes {
            let mut changed = views();
            change(&mut changed[2]);
            assert_ne!(sum, sum_of(&changed), "a change went unnoticed");
        }
        assert_ne!(sum, sum_of(&views()[1..]), "a missing view went unnoticed");
    }
}
