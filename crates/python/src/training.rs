//! Trainings on data sets, which Ctrl-C ends with a checkpoint.

use crate::{
    errors::{Failure, Result},
    scene::{Scene, executor_of},
    threads::pool,
};
use core::{
    fmt,
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};
use pyo3::prelude::*;
use specula_io::{
    checkpoint::{self, Checkpoint, Facts},
    dataset::LoadOptions,
    model_folder::{self, ModelInfo},
};
use specula_scene::{
    ExecutorChoice, OpenedModel, SceneError,
    backdrop::BackgroundColor,
    capture::{Capture, Photograph, Reading},
    dataset::{InitialPoints, cloud_of, has_files},
    training::{Checkpoints, Lock, Observer, Start, Training, model_info},
};
use specula_train::{
    picture_store::PictureStore,
    pictures::PictureSource,
    profile::{self, Profile},
    start::{Point, thinned},
    trainer::Settings,
};
use std::{
    fs,
    path::{Path, PathBuf},
    sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel},
    thread,
};

/// Bytes of decoded pictures in memory; others are decoded when their turn comes.
const PICTURE_MEMORY: u64 = 1 << 32;
/// Time between two looks for Ctrl-C.
const PATIENCE: Duration = Duration::from_millis(50);

/// Request for a training.
struct Wish {
    dataset: PathBuf,
    folder: PathBuf,
    profile: String,
    iterations: u32,
    seed: u64,
    background: Option<[f32; 3]>,
    random_points: Option<u32>,
    downscale: u32,
    holds_out: bool,
    executor: ExecutorChoice,
    checkpoint_every: u32,
    resumes: bool,
    overwrites: bool,
}

/// State of a training after a step: iteration, PSNR, Gaussians.
type Progress = (u32, Option<f64>, usize);

/// Trains a model on a data set.
#[pyfunction]
#[pyo3(signature = (
    dataset, folder, *, profile="specula".to_owned(), iterations=30_000, seed=0, background=None, random_points=None, downscale=1,
    hold_out=false, executor="auto", checkpoint_every=1000, resume=false, overwrite=false, callback=None,
    callback_every=100
))]
pub(crate) fn train(
    py: Python<'_>,
    dataset: PathBuf,
    folder: PathBuf,
    profile: String,
    iterations: u32,
    seed: u64,
    background: Option<[f32; 3]>,
    random_points: Option<u32>,
    downscale: u32,
    hold_out: bool,
    executor: &str,
    checkpoint_every: u32,
    resume: bool,
    overwrite: bool,
    callback: Option<Py<PyAny>>,
    callback_every: u32,
) -> PyResult<Scene> {
    if iterations == 0 || callback_every == 0 || ![1, 2, 4, 8].contains(&downscale) {
        return Err(Failure::input(
            "use at least 1 iteration, callback_every of at least 1, and a downscale of 1, 2, 4 or 8",
        )
        .into());
    }
    let wish = Wish {
        dataset,
        folder,
        profile,
        iterations,
        seed,
        background,
        random_points,
        downscale,
        holds_out: hold_out,
        executor: executor_of(executor)?,
        checkpoint_every,
        resumes: resume,
        overwrites: overwrite,
    };
    let pool = pool(py)?;
    let trained = py.detach(|| {
        let is_interrupted = AtomicBool::new(false);
        let (sender, receiver) = sync_channel(0);
        let follower = Follower { sender, every: callback_every, is_interrupted: &is_interrupted };
        thread::scope(|scope| {
            // Python delivers signals to the calling thread, which therefore only waits.
            let worker = scope.spawn(|| pool.install(|| run(&wish, follower)));
            let mut raised = None;
            loop {
                let heard = receiver.recv_timeout(PATIENCE);
                if raised.is_none() {
                    raised = Python::attach(|py| heard_of(py, heard.as_ref().ok().copied(), callback.as_ref())).err();
                    is_interrupted.store(raised.is_some(), Ordering::Relaxed);
                }
                if heard == Err(RecvTimeoutError::Disconnected) {
                    break;
                }
            }
            let trained = worker.join().map_err(|_| Failure::Named("TrainingError", "the training panicked".into()));
            match (raised, trained?) {
                (Some(error), Ok(_)) => Err(Failure::Python(error)),
                (_, trained) => trained,
            }
        })
    });
    Ok(Scene::new(trained?))
}

/// Calls back after a step; looks for signals in any case.
fn heard_of(py: Python<'_>, progress: Option<Progress>, callback: Option<&Py<PyAny>>) -> PyResult<()> {
    py.check_signals()?;
    match (progress, callback) {
        (Some(progress), Some(callback)) => callback.call1(py, progress).map(drop),
        _ => Ok(()),
    }
}

/// Tells of steps, and of the wish to end.
struct Follower<'a> {
    sender: SyncSender<Progress>,
    every: u32,
    is_interrupted: &'a AtomicBool,
}

/// A training's pictures and points, beside what follows it.
struct Watched<'a> {
    follower: Follower<'a>,
    pictures: &'a PictureStore,
    points: &'a [Point],
}

/// Error of a training.
#[derive(Debug)]
struct TrainingFailure(SceneError);

impl From<SceneError> for TrainingFailure {
    fn from(error: SceneError) -> Self {
        Self(error)
    }
}

impl fmt::Display for TrainingFailure {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(out)
    }
}

impl Observer for Watched<'_> {
    type Error = TrainingFailure;

    fn is_device_failure(error: &TrainingFailure) -> bool {
        error.0.is_device_failure()
    }

    fn origin(&self) -> (&dyn PictureSource, &[Point]) {
        (self.pictures, self.points)
    }

    fn is_interrupted(&self) -> bool {
        self.follower.is_interrupted.load(Ordering::Relaxed)
    }

    fn after_step(&mut self, training: &Training) {
        let iteration = training.iteration();
        if iteration.is_multiple_of(self.follower.every) || training.is_finished() {
            let progress = (iteration, training.psnr(), training.gaussian_count());
            // The caller's thread listens until the training has ended.
            self.follower.sender.send(progress).unwrap_or_default();
        }
    }
}

/// Trains, saves and opens the model.
fn run(wish: &Wish, follower: Follower<'_>) -> Result<OpenedModel> {
    let Wish { folder, iterations, seed, .. } = wish;
    refuse_other_training(wish)?;
    let mut data = read(wish)?;
    let profile = profile_of(wish, &data)?;
    let background = wish.background.unwrap_or(BackgroundColor::default_for(data.has_alpha()).0);
    let settings = Settings { profile, iterations: *iterations, seed: *seed, background, random_points: 0 };
    let facts = data.describe(&settings, String::new());
    let saved = if wish.resumes { Some(read_checkpoint(folder, &facts)?) } else { None };
    let points = match saved {
        Some(_) => Vec::new(),
        None => thinned(data.take_points(points_of(wish), *seed), settings.profile.densification.count_max.max(1)),
    };
    fs::create_dir_all(folder)
        .map_err(|cause| Failure::Named("FileError", format!("{folder:?} cannot be made: {cause}")))?;
    let _lock = Lock::take(folder)?;
    if wish.overwrites {
        model_folder::remove_training(folder)?;
    }
    if saved.is_none() {
        save_inputs(wish, &data, &points)?;
    }
    let pictures = data.take_store();
    let start = saved.as_ref().map_or(Start::Points(&points), |saved| Start::Checkpoint(&saved.state));
    let mut observer = Watched { follower, pictures: &pictures, points: &points };
    let failed = |TrainingFailure(error): TrainingFailure| Failure::from(error);
    let training = Training::new(&wish.executor, settings.clone(), &pictures, &start, &mut observer).map_err(failed)?;
    let checkpoints = Checkpoints::new(folder, wish.checkpoint_every, facts);
    let (checkpoints, seconds) = match &saved {
        Some(saved) => (checkpoints.resumed_at(saved.state.iteration), saved.facts.seconds),
        None => (checkpoints, 0.0),
    };
    let mut training = training.with_checkpoints(checkpoints, seconds);
    let outcome = training.run(&[], &mut observer).map_err(failed)?;
    let scene = training.scene()?;
    if !scene.is_finite() {
        let iteration = outcome.iteration;
        return Err(Failure::Named(
            "TrainingError",
            format!("the training diverged by iteration {iteration}, to numbers that are not finite, and is not saved"),
        ));
    }
    scene.save(folder, outcome.iteration, &info_of(wish, &settings, &data, scene.gaussians.count))?;
    Ok(OpenedModel::open(folder)?)
}

fn refuse_other_training(Wish { dataset, folder, resumes, overwrites, .. }: &Wish) -> Result<()> {
    if dataset.canonicalize().is_ok_and(|data| folder.canonicalize().is_ok_and(|folder| folder == data)) {
        return Err(Failure::input(format!("{folder:?} is the data set itself; name another folder")));
    }
    if has_files(folder) && !model_folder::holds_training(folder) {
        return Err(Failure::input(format!("{folder:?} is another data set; name another folder")));
    }
    if *resumes || *overwrites || !model_folder::holds_training(folder) {
        return Ok(());
    }
    Err(Failure::input(format!(
        "{folder:?} holds a training already; continue it with resume=True, replace it with overwrite=True, or name \
         another folder"
    )))
}

fn points_of(wish: &Wish) -> InitialPoints {
    InitialPoints { random: wish.random_points, background: 0 }
}

fn read(wish: &Wish) -> Result<Capture> {
    let options = LoadOptions { downscale: wish.downscale, with_test: wish.holds_out, ..LoadOptions::default() };
    let reading = Reading {
        folder: &wish.dataset,
        options: &options,
        points: (!wish.resumes).then(|| points_of(wish)),
        seed: wish.seed,
        local: 0,
        budget: &|_| PICTURE_MEMORY,
    };
    let data = Capture::read(&reading, None, |_, _| ())?;
    match data.train.is_empty() {
        true => Err(Failure::input(format!("{:?} has no picture to train on", wish.dataset))),
        false => Ok(data),
    }
}

/// Profile of a training, as the program chooses it for this data set.
fn profile_of(Wish { profile, iterations, .. }: &Wish, data: &Capture) -> Result<Profile> {
    let named = profile::by_name(profile, *iterations)
        .ok_or_else(|| Failure::input(format!("{profile:?} is no profile; use {}", profile::NAMES.join(", "))))?;
    let holds_objects = data.holds_objects();
    let named = if holds_objects { named.for_objects() } else { named };
    Ok(if holds_objects && profile == "specula" { named.relightable() } else { named })
}

/// Reads the checkpoint of a training with the same settings on the same pictures.
fn read_checkpoint(folder: &Path, facts: &Facts) -> Result<Checkpoint> {
    let saved = checkpoint::read(folder)?;
    let earlier = &saved.facts;
    let same = |facts: &Facts| (facts.settings.clone(), facts.views, facts.pictures.clone());
    match same(facts) == same(earlier) {
        true => Ok(saved),
        false => Err(Failure::input(format!(
            "the checkpoint in {folder:?} is of a training with other settings or on other pictures; ask for those, or \
             start again with overwrite=True"
        ))),
    }
}

fn save_inputs(wish: &Wish, data: &Capture, points: &[Point]) -> Result<()> {
    let named = |all: &[Photograph]| all.iter().map(Photograph::named_camera).collect::<Vec<_>>();
    let (train, test) = (named(&data.train), named(&data.test));
    let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let cfg_args = [
        ("source_path", absolute(&wish.dataset).to_string_lossy().into()),
        ("model_path", absolute(&wish.folder).to_string_lossy().into()),
        ("resolution", wish.downscale.into()),
        ("eval", wish.holds_out.into()),
    ];
    Ok(model_folder::save_inputs(&wish.folder, &train, &test, &cloud_of(points), data.origin, &cfg_args)?)
}

fn info_of(wish: &Wish, settings: &Settings, data: &Capture, count: usize) -> ModelInfo {
    let mut info = model_info(settings, [data.train.len(), data.test.len()], data.orientation);
    info.rest.insert("gaussians".into(), count.into());
    let source = std::path::absolute(&wish.dataset).unwrap_or_else(|_| wish.dataset.clone());
    ModelInfo {
        eval: wish.holds_out,
        origin: data.origin,
        downscale: wish.downscale,
        source_path: source.to_string_lossy().into_owned(),
        ..info
    }
}
