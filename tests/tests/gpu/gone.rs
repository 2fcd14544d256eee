//! A device that is lost during training: every call returns an error, and nothing panics.

use core::time::Duration;
use specula_core::{camera::Camera, random};
use specula_gpu::{Gpu, GpuError, GpuExecutor};
use specula_tests::device::executor_of_its_own;
use specula_train::{
    profile::by_name,
    start::Point,
    trainer::{Settings, TrainError, Trainer},
    view::View,
};
use std::thread;

const SIZE: u32 = 32;
/// Number of times that a device is lost at some moment, and the longest that it lives.
const TIMES: u64 = 8;
const MILLISECONDS: u64 = 1500;

fn views() -> Vec<View> {
    let view = |k: u64| {
        let turn = k as f32 * 1.3;
        let eye = glam::Vec3::new(3.0 * turn.cos(), 3.0 * turn.sin(), 1.0);
        let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, SIZE, SIZE);
        let rgba = (0..u64::from(SIZE * SIZE * 4)).map(|byte| (byte * (k + 3) % 253) as u8).collect();
        View { name: k.to_string(), camera, rgba, unclipped: None, normals: None }
    };
    (0..4).map(view).collect()
}

fn training(exec: GpuExecutor) -> Result<Trainer<GpuExecutor>, TrainError<GpuError>> {
    let mut profile = by_name("specula", 1_000_000).expect("a profile of that name");
    profile.densification.every = 7;
    profile.densification.from = 0;
    profile.light.as_mut().expect("specula has a light").resolution = 16;
    let settings = Settings { profile, iterations: 1_000_000, seed: 3, background: [1.0; 3], random_points: 0 };
    let place = |axis: u64, k: u64| random::uniform(1, axis, k) - 0.5;
    let points: Vec<Point> =
        (0..200).map(|k| Point { position: [0, 1, 2].map(|axis| place(axis, k)), color: [0.5; 3] }).collect();
    Trainer::new(exec, settings, &views(), &points)
}

fn is_lost<T>(result: Result<T, TrainError<GpuError>>) -> bool {
    matches!(result, Err(TrainError::Executor(GpuError::Lost { .. })))
}

#[test]
fn every_call_says_that_the_device_is_gone() {
    let Some(exec) = executor_of_its_own() else { return };
    let mut trainer = training(exec).expect("the device is there");
    trainer.step().expect("the device trains");
    (trainer.executor().gpu().fuse())();
    for _ in 0..2 {
        assert!(is_lost(trainer.step()), "a step");
        assert!(is_lost(trainer.snapshot()), "a snapshot");
        assert!(is_lost(trainer.download()), "a scene");
        assert!(matches!(trainer.executor().finish(), Err(GpuError::Lost { .. })), "waiting");
    }
    let sentence = trainer.step().expect_err("it is gone").to_string();
    assert!(sentence.contains("the device was lost: it was closed"), "{sentence}");

    let gone = Gpu::new("").expect("there was one before");
    (gone.fuse())();
    assert!(is_lost(training(GpuExecutor::new(gone))), "a start");
}

#[test]
fn a_device_may_go_at_any_moment() {
    for k in 0..TIMES {
        let Some(exec) = executor_of_its_own() else { return };
        let fuse = exec.gpu().fuse();
        let burning = thread::spawn(move || {
            thread::sleep(Duration::from_millis(random::bits(9, 0, k) % MILLISECONDS));
            fuse();
        });
        let ended: Result<(), _> = training(exec).and_then(|mut trainer| {
            loop {
                trainer.step()?;
            }
        });
        let said = format!("{ended:?}");
        assert!(is_lost(ended), "it went away in the middle of a step: {said}");
        burning.join().expect("it only waits");
    }
}
