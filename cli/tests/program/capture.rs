//! Captures: bad input without COLMAP, and a small scene with it where it is installed.

use crate::tiny::{Tiny, specula};
use core::time::Duration;
use image::{GrayImage, Luma, Rgb, RgbImage};
use serde_json::Value;
use specula_capture::Tool;
use std::{
    fs,
    path::Path,
    process::{Command, Stdio},
    thread,
    time::Instant,
};

/// Size of the pictures, and focal length in pixels.
const SIZE: [u32; 2] = [400, 300];
const FOCAL: f32 = 360.0;
const PICTURES: u32 = 10;

/// The command fails in one sentence with these words.
fn refuses(arguments: &[&str], words: &[&str], folder: &Path) {
    let output = specula().current_dir(folder).args(arguments).assert().code(2).get_output().clone();
    let said = String::from_utf8(output.stderr).unwrap();
    let last = said.lines().last().unwrap_or_default();
    words.iter().for_each(|word| assert!(last.contains(word), "{word:?} is not in: {said}"));
}

#[test]
fn unusable_inputs_end_in_a_sentence_with_a_remedy() {
    let tiny = Tiny::new();
    let folder = tiny.path("");
    for name in ["heic/1.HEIC", "heic/2.HEIC", "empty/notes.txt", "walk.mp4"] {
        fs::create_dir_all(tiny.path(name).parent().unwrap()).unwrap();
        fs::write(tiny.path(name), "no picture").unwrap();
    }
    refuses(&["capture", "nothing", "-o", "a"], &["nothing", "does not exist"], &folder);
    refuses(&["capture", "heic", "-o", "b"], &["2 pictures", "convert"], &folder);
    refuses(&["capture", "empty", "-o", "c"], &["neither pictures", "video"], &folder);
    refuses(&["capture", "empty", "-o", "d", "--colmap", "no-such-program"], &["neither"], &folder);
    for (name, file) in [("model", "specula.json"), ("other", "transforms.json"), ("photographs", "a.png")] {
        fs::create_dir_all(tiny.path(name)).unwrap();
        fs::write(tiny.path(name).join(file), "{}").unwrap();
    }
    for command in ["capture", "make"] {
        refuses(
            &[command, "scene.ply", "-o", "a"],
            &["is a scene, not photographs", "specula view scene.ply"],
            &folder,
        );
        refuses(&[command, "photographs", "-o", "model"], &["already contains a model"], &folder);
        refuses(&[command, "photographs", "-o", "other"], &["already contains another data set"], &folder);
    }
    assert!(!tiny.path("other/capture").exists() && !tiny.path("model/data").exists(), "nothing is written");
    if !has_colmap() {
        return;
    }
    refuses(&["capture", "walk.mp4", "-o", "e"], &["ffmpeg"], &folder);
    let copies = tiny.path("copies");
    fs::create_dir_all(&copies).unwrap();
    for name in ["a.png", "b.png", "c.png"] {
        RgbImage::new(64, 48).save(copies.join(name)).unwrap();
    }
    refuses(&["capture", "copies", "-o", "f"], &["too few different pictures for cameras, 1", "50 to 150"], &folder);
}

/// Whether COLMAP is installed; says so if it is not.
fn has_colmap() -> bool {
    Tool::find(None).map_err(|error| eprintln!("skipped: {error}")).is_ok()
}

/// Grey level of a texture of blocks of two sizes.
fn texture(x: f32, y: f32, plane: u32) -> u8 {
    let hash = |cell: f32| {
        let [a, b] = [x, y].map(|place| (place / cell).floor() as i32 as u32);
        let mixed = (a.wrapping_mul(0x9e37_79b1) ^ b.wrapping_mul(0x85eb_ca77) ^ plane.wrapping_mul(0xc2b2_ae3d))
            .wrapping_mul(0x27d4_eb2f);
        ((mixed ^ (mixed >> 15)).wrapping_mul(0x1656_67b1) >> 24) as f32
    };
    (0.6 * hash(0.23) + 0.4 * hash(0.07)) as u8
}

/// Photographs of a corner, two textured planes, from an arc.
fn photograph(folder: &Path) {
    fs::create_dir_all(folder).unwrap();
    for index in 0..PICTURES {
        let turn = 0.09 * (index as f32 - 0.5 * PICTURES as f32) + 0.78;
        let eye = [4.0 * turn.cos(), 4.0 * turn.sin(), 0.3 + 0.1 * index as f32];
        let forward = [-turn.cos(), -turn.sin(), -0.05];
        let right = [-turn.sin(), turn.cos(), 0.0];
        let picture = RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| {
            let [u, v] =
                [(x as f32 + 0.5 - 0.5 * SIZE[0] as f32) / FOCAL, (y as f32 + 0.5 - 0.5 * SIZE[1] as f32) / FOCAL];
            let ray: [f32; 3] = core::array::from_fn(|k| forward[k] + u * right[k] - if k == 2 { v } else { 0.0 });
            let to = |axis: usize| -eye[axis] / ray[axis];
            let hit = [0, 1].into_iter().filter(|axis| to(*axis) > 0.0).min_by(|a, b| to(*a).total_cmp(&to(*b)));
            let level = hit.map_or(0, |axis| {
                let at = |k: usize| eye[k] + to(axis) * ray[k];
                texture(at(1 - axis), at(2), axis as u32)
            });
            Rgb([level; 3])
        });
        picture.save(folder.join(format!("{index:02}.png"))).unwrap();
    }
}

#[test]
fn photographs_get_cameras_once_and_a_killed_capture_continues() {
    if !has_colmap() {
        return;
    }
    let tiny = Tiny::new();
    photograph(&tiny.path("photographs"));
    let words = ["capture", "photographs", "-o", "corner"];
    let mut child = Command::new(assert_cmd::cargo::cargo_bin("specula"))
        .current_dir(tiny.path(""))
        .args(words)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let begin = Instant::now();
    while !tiny.path("corner/capture/database-1.db").exists() && begin.elapsed() < Duration::from_secs(60) {
        thread::sleep(Duration::from_millis(20));
    }
    child.kill().unwrap();
    child.wait().unwrap();

    specula().current_dir(tiny.path("")).args(words).assert().success();
    let record = fs::read_to_string(tiny.path("corner/capture.json")).unwrap();
    let facts: Value = serde_json::from_str(&record).unwrap();
    let registered = facts["attempts"][0]["models"][0].as_u64().unwrap();
    assert!(registered + 1 >= u64::from(PICTURES), "{record}");
    assert!(facts["commands"].as_array().unwrap().len() >= 3, "{record}");

    let again = specula().current_dir(tiny.path("")).args(words).assert().success().get_output().clone();
    assert_eq!(fs::read_to_string(tiny.path("corner/capture.json")).unwrap(), record, "something ran again");
    let said = String::from_utf8(again.stderr).unwrap();
    let next = said.lines().last().unwrap_or_default();
    assert!(next.contains("next: specula train corner") && next.ends_with("--relightable --foreground auto"), "{said}");
    // Masks are added to the cameras that are there.
    fs::create_dir_all(tiny.path("silhouettes")).unwrap();
    for index in 0..PICTURES {
        let mask = GrayImage::from_fn(SIZE[0], SIZE[1], |x, _| Luma([if x < SIZE[0] / 2 { 0 } else { 255 }]));
        mask.save(tiny.path("silhouettes").join(format!("{index:02}.png"))).unwrap();
    }
    let masked = [&words[..], &["--masks", "silhouettes"]].concat();
    specula().current_dir(tiny.path("")).args(&masked).assert().success();
    let added: Value = serde_json::from_str(&fs::read_to_string(tiny.path("corner/capture.json")).unwrap()).unwrap();
    assert_eq!(added["masks"], serde_json::json!([PICTURES, 0]));
    assert_eq!([&added["attempts"], &added["commands"]], [&facts["attempts"], &facts["commands"]], "COLMAP ran again");
    assert!(tiny.path("corner/masks/00.png.png").is_file());

    let other = ["capture", "photographs", "-o", "corner", "--best"];
    refuses(&other, &["corner", "a capture with --masks silhouettes; repeat that"], &tiny.path(""));

    let output =
        specula().current_dir(tiny.path("")).args(["info", "corner", "--json"]).assert().success().get_output().clone();
    let info: Value = serde_json::from_slice(&output.stdout).unwrap();
    let kinds: Vec<&str> =
        info["to_improve"].as_array().unwrap().iter().map(|one| one["kind"].as_str().unwrap()).collect();
    assert!(!kinds.contains(&"baseline") && kinds.contains(&"coverage"), "{kinds:?}");
}
