//! Pictures that are decoded when their turn comes: the same files as from pictures in memory,
//! within a budget, on any number of ranks, and an orderly end where a picture is broken or another
//! one.

use crate::{Around, Files, Origin, STEPS, files_of, run_rank_from};
use core::fmt::Write;
use specula_core::random;
use specula_io::{
    checkpoint,
    dataset::{self, LoadOptions},
};
use specula_scene::{
    SceneError,
    capture::{Capture, Reading},
    dataset::{Dataset, InitialPoints},
    training::describe,
};
use specula_train::{
    exchange::{Exchange, ExchangeError, RANK_TIMEOUT, ThreadExchange, threads},
    picture_store::Held,
    profile::by_name,
    start::random_points,
    trainer::Settings,
    view::View,
};
use std::{
    fs,
    path::{Path, PathBuf},
    thread,
};
use tempfile::TempDir;

/// Pixels along an edge: pictures are halved in the first steps.
const SIZE: u32 = 128;
const VIEWS: u64 = 7;
/// Bytes of a decoded picture.
const PICTURE: u64 = 4 * (SIZE * SIZE) as u64;
const POINTS: InitialPoints = InitialPoints { random: Some(150), background: 0 };

/// A data set of noise in front of nothing.
fn data_set() -> TempDir {
    let folder = tempfile::tempdir().expect("a writable folder");
    let mut frames = String::new();
    for k in 0..VIEWS {
        write_picture(&picture_at(folder.path(), k), k);
        let (sin, cos) = (k as f32 * 0.9).sin_cos();
        let comma = if k > 0 { "," } else { "" };
        let rows = format!(
            "[[{}, 0, {cos}, {}], [{cos}, 0, {sin}, {}], [0, 1, 0, 0], [0, 0, 0, 1]]",
            -sin,
            4.0 * cos,
            4.0 * sin
        );
        write!(frames, "{comma}{{\"file_path\": \"./{k}\", \"transform_matrix\": {rows}}}").expect("it is text");
    }
    let text = format!("{{\"camera_angle_x\": 0.7, \"frames\": [{frames}]}}");
    fs::write(folder.path().join("transforms_train.json"), text).expect("a writable folder");
    folder
}

fn picture_at(folder: &Path, k: u64) -> PathBuf {
    folder.join(format!("{k}.png"))
}

fn write_picture(path: &Path, seed: u64) {
    let pixel = |x: u32, y: u32| {
        let noise = random::bits(seed, u64::from(y), u64::from(x)).to_le_bytes();
        let is_inside = [x, y].iter().all(|place| (SIZE / 8..SIZE - SIZE / 8).contains(place));
        image::Rgba([noise[0], noise[1], noise[2], if is_inside { 255 } else { 0 }])
    };
    image::RgbaImage::from_fn(SIZE, SIZE, pixel).save(path).expect("a writable folder");
}

fn settings() -> Settings {
    let mut profile = by_name("3dgs", STEPS * 4).expect("a profile of that name").for_batches(4);
    profile.coarse_until = 0.4;
    (profile.densification.from, profile.densification.every) = (2, 5);
    Settings { profile, iterations: STEPS, seed: 3, background: [1.0; 3], random_points: 0 }
}

fn read(folder: &Path, budget: u64, exchange: Option<&mut dyn Exchange>) -> Result<Capture, SceneError> {
    let options = LoadOptions::default();
    let reading = Reading { folder, options: &options, points: Some(POINTS), seed: 3, local: 0, budget: &|_| budget };
    Capture::read(&reading, exchange, |_, _| {})
}

/// One rank of a training whose pictures it reads with the others; `meddle` comes between
/// the reading and the training.
fn run_rank(
    mut exchange: ThreadExchange,
    data: &Path,
    budget: u64,
    model: &Path,
    is_resumed: bool,
    meddle: impl Fn(),
) -> Result<Held, SceneError> {
    let mut capture = read(data, budget, Some(&mut exchange))?;
    let points = capture.take_points(POINTS, 3);
    let facts = capture.describe(&settings(), String::new());
    let store = capture.take_store();
    if exchange.rank() == 0 {
        meddle();
    }
    exchange.all_gather(Vec::new()).map_err(SceneError::Ranks)?;
    let origin = Origin { pictures: &store, points: &points, facts };
    run_rank_from(&origin, exchange, &settings(), model, Around::default(), is_resumed)?;
    Ok(store.held())
}

/// Trains on ranks that read a part of the pictures each, as those of MPI do.
fn run_all(
    count: usize,
    data: &Path,
    budget: u64,
    model: &Path,
    is_resumed: bool,
    meddle: impl Fn() + Clone + Send + 'static,
) -> Vec<Result<Held, SceneError>> {
    let ranks = threads(count, RANK_TIMEOUT).into_iter().map(|exchange| {
        let (data, model, meddle) = (data.to_owned(), model.to_owned(), meddle.clone());
        thread::spawn(move || run_rank(exchange, &data, budget, &model, is_resumed, meddle))
    });
    ranks.collect::<Vec<_>>().into_iter().map(|rank| rank.join().expect("no rank panics")).collect()
}

/// Files of a training on pictures in memory.
fn eager(data: &Path) -> Files {
    let model = tempfile::tempdir().expect("a writable folder");
    let views = Dataset::load(data, &LoadOptions::default(), |_, _| {}).expect("it is a data set").train;
    let points = random_points(150, &views, 3);
    let facts = describe(&settings(), String::new(), &views);
    let origin = Origin { pictures: &views, points: &points, facts };
    let alone = threads(1, RANK_TIMEOUT).remove(0);
    run_rank_from(&origin, alone, &settings(), model.path(), Around::default(), false).expect("it trains");
    files_of(model.path())
}

#[test]
fn a_small_budget_and_any_number_of_ranks_have_the_files_of_pictures_in_memory() {
    let data = data_set();
    let expected = eager(data.path());
    // Everything, three pictures, one, and less than one.
    for budget in [u64::MAX, 3 * PICTURE, PICTURE, 0] {
        for count in [1, 2, 3] {
            let model = tempfile::tempdir().expect("a writable folder");
            for held in run_all(count, data.path(), budget, model.path(), false, || {}) {
                let held = held.expect("every rank trains");
                assert!(held.bytes_max <= budget.max(PICTURE), "{held:?} where {budget} bytes are allowed");
                if budget == 0 {
                    assert_eq!(held.pictures_max, 1, "a picture beyond the budget is alone");
                }
                match (budget, count) {
                    (u64::MAX, 1) => assert_eq!(held.decoded, VIEWS as usize, "each is halved once"),
                    (0, 1) => assert!(held.decoded > 60, "{held:?} of 96 turns"),
                    _ => {}
                }
            }
            assert!(files_of(model.path()) == expected, "{count} ranks with {budget} bytes");
        }
    }
}

#[test]
fn ranks_of_one_program_share_the_pictures() {
    let data = data_set();
    let expected = eager(data.path());
    for budget in [u64::MAX, 2 * PICTURE] {
        let mut capture = read(data.path(), budget, None).expect("it is a data set");
        let points = capture.take_points(POINTS, 3);
        let facts = capture.describe(&settings(), String::new());
        let store = capture.take_store();
        let model = tempfile::tempdir().expect("a writable folder");
        thread::scope(|scope| {
            for exchange in threads(3, RANK_TIMEOUT) {
                let (store, points, facts, model) = (&store, &points, facts.clone(), model.path());
                scope.spawn(move || {
                    let origin = Origin { pictures: store, points, facts };
                    run_rank_from(&origin, exchange, &settings(), model, Around::default(), false).expect("it trains");
                });
            }
        });
        assert!(files_of(model.path()) == expected, "{budget} bytes");
        let held = store.held();
        assert!(held.bytes_max <= budget, "{held:?}");
        if budget == u64::MAX {
            assert_eq!(held.decoded, VIEWS as usize, "each is halved once, and decoded at the start");
        }
    }
}

/// Trains on some ranks while a picture is put instead of another after the start; returns the
/// sentence of all ranks. The checkpoint then continues to the files of a whole training.
fn ends_and_continues(count: usize, meddle: fn(&Path)) -> String {
    const VICTIM: u64 = 4;
    let data = data_set();
    let expected = eager(data.path());
    let model = tempfile::tempdir().expect("a writable folder");
    let victim = picture_at(data.path(), VICTIM);
    let change = victim.clone();
    let outcomes = run_all(count, data.path(), 0, model.path(), false, move || meddle(&change));
    let sentences: Vec<String> =
        outcomes.into_iter().map(|outcome| outcome.expect_err("the picture is another").to_string()).collect();
    assert!(sentences.iter().all(|sentence| *sentence == sentences[0]), "{sentences:?}");
    assert!(sentences[0].contains("4.png"), "{}", sentences[0]);
    // A pass of seven views is over within two steps of four.
    let saved = checkpoint::read(model.path()).expect("there is a whole checkpoint");
    assert!(saved.state.iteration < 2, "it is of iteration {}", saved.state.iteration);
    write_picture(&victim, VICTIM);
    for outcome in run_all(3, data.path(), 0, model.path(), true, || {}) {
        outcome.expect("every rank trains");
    }
    assert!(files_of(model.path()) == expected, "it continues to other files");
    sentences[0].clone()
}

#[test]
fn a_picture_that_changed_ends_the_training_and_its_return_continues_it() {
    for count in [1, 2] {
        let sentence = ends_and_continues(count, |path| write_picture(path, 99));
        assert!(sentence.contains("has changed since the program started"), "{sentence}");
    }
}

#[test]
fn a_picture_that_broke_ends_the_training_and_its_return_continues_it() {
    for count in [1, 3] {
        ends_and_continues(count, |path| fs::write(path, "nothing").expect("it is writable"));
        let sentence = ends_and_continues(count, |path| drop(fs::remove_file(path)));
        assert!(sentence.starts_with("cannot read"), "{sentence}");
    }
}

/// Outcomes of ranks that read a data set each.
fn read_all(folders: &[&Path]) -> Vec<Result<Capture, SceneError>> {
    thread::scope(|scope| {
        let read = |(folder, mut exchange): (&Path, ThreadExchange)| {
            let folder = folder.to_owned();
            scope.spawn(move || read(&folder, 0, Some(&mut exchange)))
        };
        let ranks: Vec<_> = folders.iter().copied().zip(threads(folders.len(), RANK_TIMEOUT)).map(read).collect();
        ranks.into_iter().map(|rank| rank.join().expect("no rank panics")).collect()
    })
}

#[test]
fn ranks_learn_the_same_of_all_pictures_as_one_alone() {
    let data = data_set();
    let mut alone = read(data.path(), 0, None).expect("it is a data set");
    let points = alone.take_points(POINTS, 3);
    let views: Vec<View> = Dataset::load(data.path(), &LoadOptions::default(), |_, _| {}).expect("it is one").train;
    assert_eq!(points, random_points(150, &views, 3), "silhouettes tell where points may be");
    assert_eq!(alone.describe(&settings(), String::new()), describe(&settings(), String::new(), &views));
    for capture in read_all(&[data.path(); 3]) {
        let mut capture = capture.expect("every rank reads");
        assert_eq!((&capture.train, &capture.notes), (&alone.train, &alone.notes));
        assert_eq!(capture.summary(), alone.summary());
        assert_eq!(capture.take_points(POINTS, 3), points);
    }
}

#[test]
fn a_broken_picture_is_named_by_all_ranks_at_the_start() {
    let data = data_set();
    for k in [5, 2] {
        fs::write(picture_at(data.path(), k), "nothing").expect("it is writable");
    }
    let expected =
        dataset::load(data.path(), &LoadOptions::default(), |_, _| {}).expect_err("it is broken").to_string();
    assert!(expected.contains("2.png"), "{expected}");
    for outcome in read_all(&[data.path(); 3]) {
        assert_eq!(outcome.expect_err("it is broken").to_string(), expected);
    }
}

#[test]
fn ranks_with_other_lists_of_pictures_are_refused() {
    let [data, other] = [data_set(), data_set()];
    let list = other.path().join("transforms_train.json");
    let text = fs::read_to_string(&list).expect("it is there").replace("./3", "./4");
    fs::write(&list, text).expect("it is writable");
    for outcome in read_all(&[data.path(), other.path()]) {
        let error = outcome.expect_err("the lists differ");
        assert!(matches!(error, SceneError::Ranks(ExchangeError::Different { rank: 1, .. })), "{error}");
    }
}
