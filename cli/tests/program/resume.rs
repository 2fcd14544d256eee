//! Trainings that are interrupted, killed and taken up again, through the program.

use crate::tiny::{Tiny, specula, train, train_by_default};
use assert_cmd::cargo::cargo_bin;
use core::time::Duration;
use serde_json::Value;
use specula_core::random;
use specula_io::{
    checkpoint,
    model_folder::{gaussians_at, light_at, near_field_at},
};
use std::{fs, path::Path, process::Stdio, thread};

/// Steps of a training that is interrupted.
const ITERATIONS: u32 = 120;
/// Iterations of a training by several ranks.
const SHARED: u32 = 40;
/// Words of such trainings; densification takes part.
const WORDS: [&str; 8] =
    ["--random-points", "200", "--light-resolution", "16", "--densification-interval", "10", "--checkpoint-every", "1"];

/// Result of a training: Gaussians, light and near field, if there is one, to the last bit.
fn model_of(folder: &Path, iteration: u32) -> ([Vec<u8>; 2], Option<Vec<u8>>) {
    let whole = [gaussians_at(folder, iteration), light_at(folder, iteration)].map(|path| fs::read(path).unwrap());
    (whole, fs::read(near_field_at(folder, iteration)).ok())
}

fn started(tiny: &Tiny, model: &str, iterations: u32, more: &[&str]) -> assert_cmd::Command {
    let mut command = specula();
    command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path(model)).args(WORDS).args(["--executor", "cpu"]);
    command.args(["--iterations", &iterations.to_string()]).args(more);
    command
}

fn resumed(tiny: &Tiny, model: &str) -> assert_cmd::Command {
    let mut command = specula();
    command.arg("train").arg("-m").arg(tiny.path(model)).arg("--resume");
    command
}

/// Standard error of a command that is refused.
fn refusal(command: &mut assert_cmd::Command) -> String {
    let output = command.assert().code(2).get_output().clone();
    String::from_utf8(output.stderr).unwrap()
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[cfg(unix)]
mod killed {
    use super::*;
    use std::process::{Child, Command};

    /// The training of `WORDS` as a process: from its start, or from its checkpoint where there is
    /// one.
    fn spawned(tiny: &Tiny, model: &str, more: &[&str]) -> Child {
        let mut command = Command::new(cargo_bin!("specula"));
        command.arg("train").arg("-m").arg(tiny.path(model));
        if checkpoint::path_in(&tiny.path(model)).is_file() {
            command.arg("--resume");
        } else {
            let iterations = ITERATIONS.to_string();
            command.arg(tiny.data()).args(WORDS).args(["--executor", "cpu", "--iterations", &iterations]).args(more);
        }
        command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    }

    /// Sends a signal after some time, and waits for the end.
    fn end(mut child: Child, signal: &str, milliseconds: u64) -> Option<i32> {
        thread::sleep(Duration::from_millis(milliseconds));
        Command::new("kill").args([signal, &child.id().to_string()]).stderr(Stdio::null()).status().unwrap();
        child.wait().unwrap().code()
    }

    /// Ends a training again and again, wherever it happens to be; then lets it come to its end.
    fn ends_as_if_nothing_had_happened(signal: &str, codes: &[Option<i32>], more: &[&str]) {
        const TIMES: u64 = 6;
        const LONGEST: u64 = 500;
        let tiny = Tiny::new();
        started(&tiny, "whole", ITERATIONS, more).assert().success();
        let model = tiny.path("model");
        for k in 0..TIMES {
            let code = end(spawned(&tiny, "model", more), signal, random::bits(5, 0, k) % LONGEST);
            assert!(codes.contains(&code), "{signal} ended the program with {code:?}");
            if checkpoint::path_in(&model).is_file() {
                let saved = checkpoint::read(&model).unwrap();
                assert!(saved.state.iteration <= ITERATIONS, "a checkpoint from beyond the end");
            }
        }
        assert!(spawned(&tiny, "model", more).wait().unwrap().success(), "nothing ended the last one");
        assert!(model_of(&model, ITERATIONS) == model_of(&tiny.path("whole"), ITERATIONS), "the models differ");
        let names = fs::read_dir(&model).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let left: Vec<String> = names.filter(|name| name.starts_with('.')).collect();
        assert!(left.is_empty(), "{left:?} stayed behind");
    }

    #[test]
    fn a_folder_belongs_to_one_training_until_that_ends() {
        let tiny = Tiny::new();
        let mut first = Command::new(cargo_bin!("specula"));
        first.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("model")).args(["--executor", "cpu"]);
        let mut first = first.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let lock = tiny.path("model/training.lock");
        let mut wait_until = |has_come: &dyn Fn() -> bool| {
            while !has_come() {
                assert_eq!(first.try_wait().unwrap(), None, "the training ended");
                thread::sleep(Duration::from_millis(5));
            }
        };
        wait_until(&|| fs::read_to_string(&lock).is_ok_and(|text| text.ends_with("}\n")));
        // Two that begin at once would take each other's files away before they are in place.
        let files = ["cameras.json", "input.ply", "config.toml"].map(|name| tiny.path("model").join(name));
        wait_until(&|| files.iter().all(|file| file.exists()));
        let sentence = refusal(&mut train(&tiny, "model"));
        for word in [&format!("process {} on ", first.id()), "another training", "--ignore-lock", "-m"] {
            assert!(sentence.contains(word), "{word:?} is not in: {sentence}");
        }
        let stderr = train(&tiny, "model").arg("--ignore-lock").assert().success().get_output().stderr.clone();
        assert!(String::from_utf8(stderr).unwrap().contains("ignoring its lock"));

        let unfinished = tiny.path("model/point_cloud/.unfinished-x");
        fs::write(&unfinished, "half").unwrap();
        end(first, "-KILL", 0);
        train(&tiny, "model").arg("--overwrite").assert().success();
        assert!(!unfinished.exists() && fs::read(&lock).unwrap().is_empty(), "nothing is left of it");
    }

    #[test]
    fn a_training_that_is_killed_continues_to_the_same_bits() {
        ends_as_if_nothing_had_happened("-KILL", &[None, Some(0)], &[]);
    }

    #[test]
    fn a_training_of_a_network_that_is_killed_continues_to_the_same_bits() {
        ends_as_if_nothing_had_happened("-KILL", &[None, Some(0)], &["--light", "mlp"]);
    }

    #[test]
    fn a_killed_training_of_batches_continues_to_the_same_bits() {
        ends_as_if_nothing_had_happened("-KILL", &[None, Some(0)], &["--views-per-step", "3"]);
    }

    #[test]
    fn a_killed_training_that_reflects_itself_continues_as_if_nothing_had_happened() {
        ends_as_if_nothing_had_happened("-KILL", &[None, Some(0)], &["--reflections", "near"]);
    }

    #[test]
    fn a_training_that_is_interrupted_continues_to_the_same_bits() {
        // Before it watches for signals, one ends it as it ends any program.
        ends_as_if_nothing_had_happened("-INT", &[None, Some(130), Some(0)], &[]);
    }
}

#[test]
fn a_finished_training_continues_for_longer() {
    let tiny = Tiny::new();
    let model = tiny.path("model");
    train(&tiny, "model").args(["--eval", "--test-iterations", "10"]).assert().success();
    assert!(resumed(&tiny, "model").output().unwrap().status.success(), "there is nothing left to do, which is fine");
    let output = resumed(&tiny, "model").args(["--iterations", "40"]).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && stderr.contains("continuing from iteration 30 of 40"), "{stderr}");

    let timeline = json(&model.join("timeline.json"));
    let seconds = ["ours_10", "ours_30", "ours_40"].map(|key| timeline[key]["seconds"].as_f64().unwrap());
    assert!(seconds.is_sorted(), "time increases: {seconds:?}");
    assert_eq!(json(&model.join("specula.json"))["iterations"], 40);
    assert_eq!(checkpoint::read(&model).unwrap().state.iteration, 40);

    // Once more, with the settings of the last run.
    resumed(&tiny, "model").assert().success();
    let fewer = refusal(resumed(&tiny, "model").args(["--iterations", "39"]));
    assert!(fewer.contains("iteration 40") && fewer.contains("--iterations 39"), "{fewer}");
}

#[test]
fn ranks_that_are_threads_write_the_same_model() {
    let tiny = Tiny::new();
    let batch = ["--views-per-step", "3"];
    started(&tiny, "one rank", SHARED, &batch).assert().success();
    let stderr =
        started(&tiny, "shared", SHARED, &batch).args(["--ranks", "3"]).assert().success().get_output().stderr.clone();
    assert!(model_of(&tiny.path("shared"), SHARED) == model_of(&tiny.path("one rank"), SHARED));
    // Memory of two pictures, then of none.
    for (model, memory, ranks) in [("few", "8e-6", "2"), ("none", "0", "1")] {
        started(&tiny, model, SHARED, &batch).args(["--picture-memory", memory, "--ranks", ranks]).assert().success();
        assert!(model_of(&tiny.path(model), SHARED) == model_of(&tiny.path("one rank"), SHARED), "{memory} GiB");
    }
    let stderr = String::from_utf8(stderr).unwrap();
    for rank in 0..3 {
        assert!(stderr.contains(&format!("rank {rank} sent ")), "{stderr}");
    }
    started(&tiny, "single", SHARED, &[]).assert().success();
    let single = model_of(&tiny.path("single"), SHARED);
    assert!(single != model_of(&tiny.path("one rank"), SHARED), "the comparison can fail");
}

#[test]
fn a_model_tells_how_many_views_a_step_fitted() {
    let tiny = Tiny::new();
    train(&tiny, "single").assert().success();
    train(&tiny, "batch").args(["--views-per-step", "3"]).assert().success();
    let views = |model: &str| json(&tiny.path(model).join("specula.json"))["views_per_step"].as_u64();
    assert_eq!((views("single"), views("batch")), (None, Some(3)));
    let settings = fs::read_to_string(tiny.path("batch").join("config.toml")).unwrap();
    assert!(settings.contains("views-per-step = 3"), "{settings}");
}

#[test]
fn only_the_same_training_continues() {
    let tiny = Tiny::new();
    let nothing = refusal(&mut resumed(&tiny, "model"));
    assert!(nothing.contains("there is no folder") && !tiny.path("model").exists(), "{nothing}");

    train_by_default(&tiny, "model").assert().success();
    let before = fs::read(checkpoint::path_in(&tiny.path("model"))).unwrap();
    for (words, expected) in [
        (&["--profile", "paper"][..], "--profile specula, not --profile paper"),
        (&["--seed", "1"], "--seed 0, not --seed 1"),
        (&["--lambda-normal", "0.5"], "no --lambda-normal"),
        (&["--eval"], "--eval"),
        (&["--resolution", "2"], "--resolution"),
        (&["--light-resolution", "32"], "--light-resolution 16"),
        (&["--views-per-step", "2"], "--views-per-step"),
    ] {
        let sentence = refusal(resumed(&tiny, "model").arg("--quiet").args(words));
        assert!(sentence.contains(expected) && sentence.contains("checkpoint.safetensors"), "{sentence}");
        assert_eq!(sentence.lines().count(), 1, "one sentence is expected: {sentence}");
    }
    let picture = tiny.file("train/r_3.png");
    let kept = fs::read(&picture).unwrap();
    fs::copy(tiny.file("train/r_4.png"), &picture).unwrap();
    let sentence = refusal(&mut resumed(&tiny, "model"));
    assert!(sentence.contains("11 pictures") && sentence.contains("differ from them"), "{sentence}");
    fs::write(&picture, kept).unwrap();

    fs::write(checkpoint::path_in(&tiny.path("model")), &before[..before.len() / 2]).unwrap();
    let sentence = refusal(&mut resumed(&tiny, "model"));
    assert!(sentence.contains("checkpoint.safetensors") && sentence.contains("copy the file again"), "{sentence}");
    fs::write(checkpoint::path_in(&tiny.path("model")), &before).unwrap();

    // A data set that was moved is still the same.
    fs::rename(tiny.data(), tiny.path("moved")).unwrap();
    assert!(refusal(&mut resumed(&tiny, "model")).contains("data"), "the old place is named");
    resumed(&tiny, "model").arg(tiny.path("moved")).assert().success();
}

#[test]
fn settings_of_one_training_are_those_of_another() {
    let tiny = Tiny::new();
    train(&tiny, "one").args(["--no-sparse", "--save-iterations", "5"]).assert().success();
    let mut other = specula();
    other.arg("train").arg("-m").arg(tiny.path("other")).arg("--config").arg(tiny.path("one/config.toml"));
    other.assert().success();
    for iteration in [5, 30] {
        let [one, other] = ["one", "other"].map(|model| model_of(&tiny.path(model), iteration));
        assert!(one == other, "the models differ");
    }
}

#[test]
fn another_executor_continues() {
    let report = specula().args(["doctor", "--json"]).output().unwrap();
    let report: Value = serde_json::from_slice(&report.stdout).unwrap();
    if report["adapters"].as_array().unwrap().is_empty() {
        assert!(std::env::var_os("CI").is_none(), "CI needs an adapter");
        eprintln!("NOT TESTED, because there is no adapter");
        return;
    }
    let tiny = Tiny::new();
    train(&tiny, "model").args(["--executor", "cpu"]).assert().success();
    resumed(&tiny, "model").args(["--executor", "gpu", "--iterations", "32"]).assert().success();
    resumed(&tiny, "model").args(["--executor", "cpu", "--iterations", "34"]).assert().success();
    assert!(gaussians_at(&tiny.path("model"), 34).is_file(), "the processor ends what the device went on with");
}

/// The checkpoint with another word in its header, as the length of the header says it.
fn reworded(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let (len, rest) = bytes.split_at(8);
    let (header, tensors) = rest.split_at(u64::from_le_bytes(len.try_into().unwrap()) as usize);
    let text = core::str::from_utf8(header).unwrap();
    let start = text.find(from).unwrap_or_else(|| panic!("{from} is not in {text}")) + from.len();
    let end = start + text[start..].find([',', '}']).unwrap();
    let text = [&text[..start], to, &text[end..]].concat();
    [&(text.len() as u64).to_le_bytes()[..], text.as_bytes(), tensors].concat()
}

#[test]
fn numbers_that_no_training_comes_to_are_refused() {
    let tiny = Tiny::new();
    train(&tiny, "model").assert().success();
    let place = checkpoint::path_in(&tiny.path("model"));
    let before = fs::read(&place).unwrap();
    for (name, number) in [
        ("seconds", "1e20"),
        ("seconds", "-1"),
        ("seconds", "1e999"),
        ("seconds", "null"),
        ("psnr", "1e999"),
        ("nonfinite", "18446744073709551615"),
        ("iteration", "4294967295"),
        ("iteration", "-1"),
        ("iterations", "0"),
        ("iterations", "4294967295"),
        ("views", "18446744073709551615"),
        ("gaussians", "18446744073709551615"),
        ("gaussians", "0"),
        ("sh_degree", "200"),
        ("resolution", "4294967296"),
        ("exposures", "18446744073709551615"),
        ("format", "4294967295"),
    ] {
        // The header is JSON within a text of JSON.
        fs::write(&place, reworded(&before, &format!("\\\"{name}\\\":"), number)).unwrap();
        let sentence = refusal(resumed(&tiny, "model").arg("--quiet"));
        assert!(sentence.contains("checkpoint.safetensors"), "{name} = {number}: {sentence}");
        assert_eq!(sentence.lines().count(), 1, "{name} = {number}: one sentence is expected: {sentence}");
    }
}

#[test]
fn a_checkpoint_with_numbers_that_are_none_is_refused_by_tensor_and_count() {
    let tiny = Tiny::new();
    train(&tiny, "model").assert().success();
    let place = checkpoint::path_in(&tiny.path("model"));
    let before = fs::read(&place).unwrap();
    let data = 8 + u64::from_le_bytes(before[..8].try_into().unwrap()) as usize;
    for (number, count) in [(f32::NAN, 50), (f32::INFINITY, 1)] {
        let mut bytes = before.clone();
        (0..count).for_each(|k| bytes[data + 16 * k..][..4].copy_from_slice(&number.to_le_bytes()));
        fs::write(&place, bytes).unwrap();
        let sentence = refusal(resumed(&tiny, "model").args(["--iterations", "40", "--quiet"]));
        let words = ["\"gaussians\"", &format!("{count} of its"), "checkpoint.safetensors", "start without --resume"];
        words.iter().for_each(|word| assert!(sentence.contains(word), "{word:?} is not in: {sentence}"));
    }
}

/// A checkpoint beyond the limit of file sizes (`ulimit -f`) is an error, and the previous one
/// stays.
#[cfg(target_os = "linux")]
#[test]
fn a_checkpoint_that_is_larger_than_files_may_be_is_told_and_leaves_the_one_before() {
    let tiny = Tiny::new();
    train(&tiny, "model").assert().success();
    let place = checkpoint::path_in(&tiny.path("model"));
    let before = fs::read(&place).unwrap();
    // Shells count in 512 bytes, or in twice as many.
    let blocks = (before.len() / 2048).to_string();
    let mut shell = assert_cmd::Command::new("sh");
    shell.args(["-c", "ulimit -f $0; exec \"$@\"", &blocks]).arg(cargo_bin!("specula"));
    shell.arg("train").arg("-m").arg(tiny.path("model")).args(["--resume", "--iterations", "40"]);
    let sentence = refusal(&mut shell);
    assert!(sentence.contains("checkpoint.safetensors") && sentence.contains("File too large"), "{sentence}");
    assert!(sentence.contains("continues without this checkpoint"), "{sentence}");
    assert!(fs::read(&place).unwrap() == before, "the earlier checkpoint is another");
    let names =
        fs::read_dir(tiny.path("model")).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let left: Vec<String> = names.filter(|name| name.starts_with('.')).collect();
    assert!(left.is_empty(), "{left:?} stayed behind");
}

#[test]
fn a_time_chooses_the_iterations_and_nothing_else() {
    let tiny = Tiny::new();
    started(&tiny, "plain", SHARED, &[]).assert().success();
    let long = ["--minutes", "10000"];
    let output = started(&tiny, "long", SHARED, &long).assert().success().get_output().clone();
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(told.contains("40 iterations, which take fewer than 10000 minutes here"), "{told}");
    assert!(
        model_of(&tiny.path("long"), SHARED) == model_of(&tiny.path("plain"), SHARED),
        "the timed steps leave no trace"
    );
    let config = fs::read_to_string(tiny.path("long/config.toml")).unwrap();
    assert!(config.contains("iterations = 40") && !config.contains("minutes"), "{config}");

    let output = started(&tiny, "short", 400, &["--minutes", "1e-9"]).assert().success().get_output().clone();
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(told.contains("300 iterations, the fewest of --minutes, take longer than"), "{told}");
    assert!(gaussians_at(&tiny.path("short"), 300).is_file(), "schedules end there");
    let refused = refusal(resumed(&tiny, "short").args(["--minutes", "1"]));
    assert!(refused.contains("--minutes") && refused.contains("--resume"), "{refused}");
}
