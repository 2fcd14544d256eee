//! Trainings on several ranks, as threads of one process: the same files as on one, and an orderly
//! end when a rank fails.

mod pictures;

use core::{fmt, time::Duration};
use glam::Vec3;
use specula_core::{camera::Camera, random};
use specula_cpu::CpuExecutor;
use specula_io::{
    checkpoint::{self, Checkpoint, Facts},
    model_folder::{self, ModelInfo},
};
use specula_scene::{
    ExecutorChoice, SceneError,
    training::{Checkpoints, Note, Observer, Start, Training, describe},
};
use specula_train::{
    exchange::{Exchange, ExchangeError, RANK_TIMEOUT, ThreadExchange, threads},
    pictures::PictureSource,
    profile::{NearFieldSchedule, by_name, exposure_rate},
    ranks::StepSizes,
    start::Point,
    trainer::{Settings, Trainer},
    view::View,
};
use std::{
    fs,
    path::{Path, PathBuf},
    thread,
    time::Instant,
};

const SIZE: u32 = 32;
const POINTS: u64 = 150;
const STEPS: u32 = 24;
/// A rank's end reaches all others well within this time, also on a busy machine.
const PROMPT: Duration = Duration::from_secs(30);

fn views() -> Vec<View> {
    let view = |k: u64| {
        let turn = k as f32 * 1.1;
        let eye = Vec3::new(3.0 * turn.cos(), 3.0 * turn.sin(), 0.7);
        let camera = Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.7, SIZE, SIZE);
        let rgba = (0..u64::from(SIZE * SIZE * 4)).map(|byte| (byte * (k + 3) % 253) as u8).collect();
        View { name: k.to_string(), camera, rgba, unclipped: None, normals: None }
    };
    (0..7).map(view).collect()
}

fn points() -> Vec<Point> {
    let coordinate = |axis: u64, k: u64| random::uniform(1, axis, k) - 0.5;
    (0..POINTS).map(|k| Point { position: [0, 1, 2].map(|axis| coordinate(axis, k)), color: [0.5, 0.4, 0.3] }).collect()
}

/// Settings of a training that densifies, resets and has whatever its profile can have.
fn settings(name: &str, batch: u32) -> Settings {
    let mut profile = by_name(name, STEPS * batch).expect("a profile of that name").for_batches(batch);
    if name == "specula" {
        profile = profile.reflecting_itself().relightable();
        profile.near_field = Some(NearFieldSchedule { from: 0.3, every: 0.3, voxels: 16 });
        profile.exposure = Some(exposure_rate(STEPS));
    }
    (profile.densification.from, profile.densification.every) = (2, 5);
    profile.densification.reset_every = 10;
    if let Some(light) = &mut profile.light {
        light.resolution = profile.scheme.resolution_min().max(16);
    }
    Settings { profile, iterations: STEPS, seed: 3, background: [1.0; 3], random_points: 0 }
}

/// Program around a rank, which fails, hesitates or wishes to end before some step.
#[derive(Clone, Copy, Debug, Default)]
struct Around {
    fails_before: Option<u32>,
    sleeps_before: Option<(u32, Duration)>,
    ends_before: Option<u32>,
    iteration: u32,
}

impl Observer for Around {
    type Error = SceneError;

    fn is_device_failure(_: &SceneError) -> bool {
        false
    }
    fn origin(&self) -> (&dyn PictureSource, &[Point]) {
        unreachable!("no device is lost here")
    }
    fn is_interrupted(&self) -> bool {
        self.ends_before == Some(self.iteration + 1)
    }
    fn before_step(&mut self, training: &mut Training) -> Result<(), SceneError> {
        let next = training.iteration() + 1;
        if self.fails_before == Some(next) {
            return Err(SceneError::Training("the rank was killed".into()));
        }
        if let Some((_, time)) = self.sleeps_before.filter(|(step, _)| *step == next) {
            thread::sleep(time);
        }
        Ok(())
    }
    fn after_step(&mut self, training: &Training) {
        self.iteration = training.iteration();
    }
    fn note(&mut self, _: Note<SceneError>) {}
}

/// Pictures and points of a training, with its description.
struct Origin<'a> {
    pictures: &'a dyn PictureSource,
    points: &'a [Point],
    facts: Facts,
}

/// One rank of a training from its points, or from the checkpoint of a folder: trains, and saves
/// the model where it is the first.
fn run_rank(
    exchange: ThreadExchange,
    settings: &Settings,
    folder: &Path,
    around: Around,
    is_resumed: bool,
) -> Result<(), SceneError> {
    let facts = describe(settings, String::new(), &views());
    let origin = Origin { pictures: &views(), points: &points(), facts };
    run_rank_from(&origin, exchange, settings, folder, around, is_resumed)
}

/// [`run_rank`] with other pictures and points.
fn run_rank_from(
    origin: &Origin<'_>,
    exchange: ThreadExchange,
    settings: &Settings,
    folder: &Path,
    mut around: Around,
    is_resumed: bool,
) -> Result<(), SceneError> {
    let is_first = exchange.rank() == 0;
    let saved = if is_resumed { Some(checkpoint::read(folder)?.state) } else { None };
    let start = saved.as_ref().map_or(Start::Points(origin.points), Start::Checkpoint);
    let Origin { pictures, facts, .. } = origin;
    let mut training = Training::new(&ExecutorChoice::Cpu, settings.clone(), *pictures, &start, &mut around)?;
    let checkpoints = Checkpoints::new(folder, 4, facts.clone());
    let checkpoints = if is_first { checkpoints } else { checkpoints.of_another_rank() };
    training = training.with_checkpoints(checkpoints, 0.0);
    around.iteration = training.iteration();
    if exchange.size() > 1 {
        training.join(Box::new(exchange), &facts.pictures)?;
    }
    let outcome = training.run(&[], &mut around)?;
    if is_first && !outcome.is_interrupted {
        training.scene()?.save(folder, outcome.iteration, &ModelInfo::default())?;
    }
    Ok(())
}

/// Runs all ranks; a rank is surrounded as `around` says. Returns the outcome of each.
fn run_all(
    count: usize,
    patience: Duration,
    settings: &Settings,
    folder: &Path,
    around: impl Fn(usize) -> Around,
    is_resumed: bool,
) -> Vec<Result<(), SceneError>> {
    let ranks = threads(count, patience).into_iter().enumerate().map(|(rank, exchange)| {
        let (settings, folder, around) = (settings.clone(), folder.to_owned(), around(rank));
        thread::spawn(move || run_rank(exchange, &settings, &folder, around, is_resumed))
    });
    ranks.collect::<Vec<_>>().into_iter().map(|rank| rank.join().expect("no rank panics")).collect()
}

/// Bytes of a model's files: Gaussians, light, and checkpoint without its time.
#[derive(PartialEq, Eq)]
struct Files([Vec<u8>; 3]);

impl fmt::Debug for Files {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(files) = self;
        write!(out, "files of {:?} bytes", files.each_ref().map(Vec::len))
    }
}

fn files_of(folder: &Path) -> Files {
    let read = |path: PathBuf| fs::read(path).unwrap_or_default();
    let ply = model_folder::gaussians_at(folder, STEPS);
    let light = model_folder::light_at(folder, STEPS);
    let Checkpoint { state, facts } = checkpoint::read(folder).expect("the last step has a checkpoint");
    assert_eq!(state.iteration, STEPS, "the training is finished");
    checkpoint::write(folder, &Checkpoint { state, facts: Facts { seconds: 0.0, ..facts } }).expect("it is writable");
    let files = Files([read(ply), read(light), read(checkpoint::path_in(folder))]);
    assert!(!files.0[0].is_empty() && !files.0[2].is_empty(), "the model was saved");
    files
}

fn train(count: usize, settings: &Settings) -> Files {
    let folder = tempfile::tempdir().expect("a writable folder");
    for outcome in run_all(count, RANK_TIMEOUT, settings, folder.path(), |_| Around::default(), false) {
        outcome.expect("every rank trains");
    }
    files_of(folder.path())
}

/// Files of a training that was continued on some ranks from the checkpoint in a folder.
fn resume(count: usize, settings: &Settings, from: &Path) -> Files {
    let folder = tempfile::tempdir().expect("a writable folder");
    fs::copy(checkpoint::path_in(from), checkpoint::path_in(folder.path())).expect("there is a checkpoint");
    for outcome in run_all(count, RANK_TIMEOUT, settings, folder.path(), |_| Around::default(), true) {
        outcome.expect("every rank trains");
    }
    files_of(folder.path())
}

#[test]
fn any_number_of_ranks_writes_the_same_files() {
    for (name, counts) in [("specula", &[2, 3, 4][..]), ("official", &[3]), ("3dgs", &[2])] {
        let settings = settings(name, 4);
        let alone = train(1, &settings);
        assert_eq!(alone.0[1].is_empty(), name == "3dgs", "all but 3dgs have a light");
        for count in counts {
            assert!(train(*count, &settings) == alone, "{name} differs on {count} ranks");
        }
    }
}

#[test]
fn single_views_and_more_ranks_than_views_have_the_same_files_as_well() {
    for batch in [1, 2] {
        let settings = settings("specula", batch);
        assert!(train(3, &settings) == train(1, &settings), "{batch} views a step differ on 3 ranks");
    }
}

#[test]
fn another_seed_or_batch_gives_other_files() {
    let files = |seed: u64, batch: u32| train(1, &Settings { seed, ..settings("3dgs", batch) });
    assert!(files(3, 4) != files(4, 4) && files(3, 4) != files(3, 2), "the comparison can fail");
}

#[test]
fn an_interrupted_training_continues_on_another_number_of_ranks() {
    let settings = settings("specula", 4);
    let whole = train(1, &settings);
    for (first, then) in [(3, 1), (1, 4), (2, 3)] {
        let folder = tempfile::tempdir().expect("a writable folder");
        // The last rank wishes to end, and all do.
        let around = |rank| Around { ends_before: (rank + 1 == first).then_some(12), ..Around::default() };
        for outcome in run_all(first, RANK_TIMEOUT, &settings, folder.path(), around, false) {
            outcome.expect("they end orderly");
        }
        let saved = checkpoint::read(folder.path()).expect("the end has a checkpoint");
        assert_eq!(saved.state.iteration, 11, "all ended at the same step");
        assert!(resume(then, &settings, folder.path()) == whole, "{first} ranks, then {then}");
    }
}

#[test]
fn a_rank_that_fails_ends_all_others_with_a_sentence_and_the_last_checkpoint_continues() {
    const MOMENTS: u64 = 10;
    let settings = settings("3dgs", 4);
    let whole = train(1, &settings);
    for moment in 0..MOMENTS {
        let draw = |stream: u64, below: u64| random::bits(11, stream, moment) % below;
        // The first checkpoint is of step 4.
        let (victim, step) = (draw(0, 3) as usize, 5 + draw(1, u64::from(STEPS) - 4) as u32);
        let folder = tempfile::tempdir().expect("a writable folder");
        let around = |rank| Around { fails_before: (rank == victim).then_some(step), ..Around::default() };
        let start = Instant::now();
        let outcomes = run_all(3, RANK_TIMEOUT, &settings, folder.path(), around, false);
        assert!(start.elapsed() < PROMPT, "they took {:?} to end", start.elapsed());
        for (rank, outcome) in outcomes.into_iter().enumerate() {
            let sentence = outcome.expect_err("no rank trains on").to_string();
            let expected = if rank == victim { "the rank was killed" } else { "the training ends because rank" };
            assert!(sentence.starts_with(expected), "rank {rank} of the moment {moment}: {sentence}");
        }
        let saved = checkpoint::read(folder.path()).expect("the last checkpoint is whole");
        assert_eq!(saved.state.iteration, (step - 1) / 4 * 4, "it is of the last interval");
        let count = 1 + draw(2, 4) as usize;
        assert!(resume(count, &settings, folder.path()) == whole, "moment {moment} continues on {count} ranks");
    }
}

#[test]
fn a_rank_that_hangs_is_not_waited_for() {
    let settings = settings("3dgs", 2);
    let patience = Duration::from_millis(1500);
    let folder = tempfile::tempdir().expect("a writable folder");
    let sleeps_before = Some((6, 4 * patience));
    let around = |rank| if rank == 1 { Around { sleeps_before, ..Around::default() } } else { Around::default() };
    let outcomes = run_all(2, patience, &settings, folder.path(), around, false);
    let error = outcomes[0].as_ref().expect_err("rank 1 sleeps");
    assert_eq!(error.to_string(), "the training ends because rank 1 has not answered for 1.5 s");
    assert_eq!(checkpoint::read(folder.path()).expect("it is whole").state.iteration, 4);
}

#[test]
fn ranks_send_as_much_as_is_predicted() {
    const GAUSSIANS: usize = POINTS as usize;
    for (name, batch, count) in [("specula", 4, 2), ("specula", 4, 4), ("official", 2, 3), ("3dgs", 1, 2)] {
        let mut settings = settings(name, batch);
        (settings.profile.physical, settings.profile.near_field) = (None, None);
        (settings.profile.densification.every, settings.profile.densification.reset_every) = (STEPS + 1, 0);
        let light = settings.profile.light.map_or(0, |light| 6 * light.resolution * light.resolution * 3);
        let layout = settings.profile.layout;
        let sizes = StepSizes { gaussians: GAUSSIANS, layout, light, views: batch as usize, ranks: count };
        let steps = threads(count, RANK_TIMEOUT).into_iter().enumerate().map(|(rank, exchange)| {
            let settings = settings.clone();
            thread::spawn(move || {
                let mut trainer = Trainer::new(CpuExecutor::new(), settings, &views(), &points()).expect("it starts");
                trainer.join(Box::new(exchange), "").expect("all ranks are there");
                let sent = |trainer: &Trainer<CpuExecutor>| trainer.traffic().expect("it is shared").sent;
                let before = sent(&trainer);
                for _ in 0..3 {
                    trainer.step().expect("the CPU trains");
                }
                assert_eq!(trainer.gaussians().count, GAUSSIANS, "nothing was refined");
                assert_eq!(sent(&trainer) - before, 3 * sizes.sent_by(rank), "rank {rank} of {count}, {name}");
            })
        });
        steps.collect::<Vec<_>>().into_iter().for_each(|rank| rank.join().expect("it sends as much"));
    }
}

#[test]
fn ranks_with_other_settings_are_refused() {
    let ranks = threads(2, RANK_TIMEOUT).into_iter().enumerate().map(|(rank, exchange)| {
        let settings = Settings { seed: rank as u64, ..settings("3dgs", 2) };
        thread::spawn(move || {
            let folder = tempfile::tempdir().expect("a writable folder");
            run_rank(exchange, &settings, folder.path(), Around::default(), false)
        })
    });
    for rank in ranks.collect::<Vec<_>>() {
        let error = rank.join().expect("no rank panics").expect_err("their seeds differ");
        let what = "settings or pictures";
        assert!(matches!(error, SceneError::Ranks(ExchangeError::Different { rank: 1, what: found }) if found == what));
    }
}

#[test]
fn a_full_disk_ends_no_rank() {
    let settings = settings("3dgs", 2);
    let folder = tempfile::tempdir().expect("a writable folder");
    let file = folder.path().join("file");
    fs::write(&file, "mine").expect("a writable folder");
    let outcomes = run_all(2, RANK_TIMEOUT, &settings, &file, |_| Around::default(), false);
    assert!(outcomes[1].is_ok(), "rank 1 trains to the end: {:?}", outcomes[1]);
    let error = outcomes[0].as_ref().expect_err("the model cannot be saved either");
    assert!(matches!(error, SceneError::File(_)), "{error}");
}
