//! Gaussians that lie in several arrays against the same Gaussians in one.

use specula_core::{
    executor::Renderer,
    scene::{Gaussians, LOG_SCALE, Layout, RadianceActivation},
    shade::ShadingRules,
};
use specula_cpu::CpuExecutor;
use specula_gpu::{GpuError, GpuExecutor};
use specula_tests::{
    compare::{assert_psnr, psnr},
    device::{executor, executor_in_chunks_of, executor_with_arrays_of},
    formulas::camera,
    strategies::{random_cloud, random_environment},
    stress::{Case, LAYOUT, results::Results},
};

const COUNT: usize = 1000;
/// Five pieces of parameters, three of the gradients of splats.
const PIECE_BYTES: u64 = (4 * 208 * LAYOUT.plane_count()) as u64;
const PIECES: usize = COUNT.div_ceil(208);

/// WebGPU's limit of an array.
const BINDING_BYTES: u64 = 128 << 20;
/// More than fit into an array of that limit, with harmonics of degree 3.
const MANY: usize = 700_000;
/// Between both executors, as elsewhere, in dB.
const SAME_FRAME: f64 = 70.0;

/// Gaussians so small that most of them are seen, in the first piece and in the last.
fn small_cloud(count: usize, layout: Layout, log_shrink: f32) -> Gaussians<Vec<f32>> {
    let mut cloud = random_cloud(count, layout, 7);
    for gaussian in 0..count {
        let log_scales = cloud.get::<3>(gaussian, LOG_SCALE).map(|x| x - log_shrink);
        cloud.set(gaussian, LOG_SCALE, log_scales);
    }
    cloud
}

fn case() -> Case {
    let light = random_environment(16, RadianceActivation::Exponential, 2);
    Case::new("pieces", camera(70, 45), small_cloud(COUNT, LAYOUT, 1.5)).lit(light)
}

/// The first list in which results differ by a bit.
fn difference(one: &Results, other: &Results) -> Option<&'static str> {
    let lists: [(&str, fn(&Results) -> &Vec<f64>); 3] =
        [("picture", |r| &r.picture), ("gradient", |r| &r.gradient), ("losses", |r| &r.losses)];
    let bits = |list: &Vec<f64>| list.iter().map(|number| number.to_bits()).collect::<Vec<_>>();
    lists.into_iter().find(|(_, of)| bits(of(one)) != bits(of(other))).map(|(name, _)| name)
}

fn piece_count(gpu: &mut GpuExecutor, case: &Case) -> usize {
    gpu.upload_gaussians(&case.cloud).expect("numbers fit").values.chunk_count()
}

#[test]
fn pictures_and_gradients_are_the_same_to_the_last_bit_in_pieces() {
    let (Some(mut whole), Some(mut divided)) = (executor(), executor_in_chunks_of(PIECE_BYTES)) else { return };
    let case = case();
    assert_eq!([&mut whole, &mut divided].map(|gpu| piece_count(gpu, &case)), [1, PIECES]);
    for shading in [ShadingRules::PAPER, ShadingRules::DEFERRED] {
        let results = [&mut whole, &mut divided].map(|gpu| Results::new(gpu, &case, shading));
        assert_eq!(difference(&results[0], &results[1]), None, "{:?}", shading.form);
    }
}

#[test]
fn the_comparison_can_fail() {
    let Some(mut gpu) = executor_in_chunks_of(PIECE_BYTES) else { return };
    let expected = Results::new(&mut gpu, &case(), ShadingRules::PAPER);
    for gaussian in [0, COUNT - 1] {
        let mut case = case();
        let [scale] = case.cloud.get(gaussian, LOG_SCALE);
        case.cloud.set(gaussian, LOG_SCALE, [scale + 0.01]);
        let other = Results::new(&mut gpu, &case, ShadingRules::PAPER);
        assert!(difference(&expected, &other).is_some(), "a scale of Gaussian {gaussian} is another");
    }
    let mut other = expected.clone();
    let number = other.gradient.last_mut().expect("there is a gradient");
    *number = number.next_up();
    assert_eq!(difference(&expected, &other), Some("gradient"));
}

/// Bytes of a splat, of which blending reads any.
const SPLAT_BYTES: usize = 48;

/// Case of a number of Gaussians with the largest number of planes.
fn case_of(count: usize) -> Case {
    Case::new("many planes", camera(30, 20), small_cloud(count, Layout::shaded(Some(3)), 1.5))
}

#[test]
fn as_many_gaussians_are_trained_as_an_array_holds_splats_and_no_more() {
    const MOST: usize = 1000;
    let limited = executor_with_arrays_of((SPLAT_BYTES * MOST) as u64);
    let (Some(mut whole), Some(mut limited)) = (executor(), limited) else { return };
    let case = case_of(MOST);
    assert_eq!([&mut whole, &mut limited].map(|gpu| piece_count(gpu, &case)), [1, 7]);
    let results = [&mut whole, &mut limited].map(|gpu| Results::new(gpu, &case, ShadingRules::DEFERRED));
    assert_eq!(difference(&results[0], &results[1]), None);

    let case = case_of(MOST + 1);
    let cloud = limited.upload_gaussians(&case.cloud).expect("pieces fit");
    let refused = limited.project(&cloud, &case.camera).expect_err("there is a splat too many");
    assert!(matches!(refused, GpuError::TooLarge { what: "splats", .. }), "{refused:?}");
    assert!(refused.to_string().contains("use fewer Gaussians"), "{refused}");
}

/// Distance of two lists, relative to the first.
fn apart<'a>(expected: impl Iterator<Item = &'a f64> + Clone, actual: impl Iterator<Item = &'a f64>) -> f64 {
    let size: f64 = expected.clone().map(|x| x * x).sum();
    let difference: f64 = expected.zip(actual).map(|(x, y)| (x - y).powi(2)).sum();
    assert!(size > 0.0, "there is something to compare with");
    (difference / size).sqrt()
}

#[test]
#[ignore = "takes gigabytes"]
fn a_scene_too_large_for_an_array_is_rendered_and_trained_as_on_the_processor() {
    let Some(mut gpu) = executor_in_chunks_of(BINDING_BYTES) else { return };
    let case = Case::new("many", camera(320, 200), small_cloud(MANY, Layout::radiance(3), 4.0));
    assert_eq!(piece_count(&mut gpu, &case), 2, "one array is not enough");
    let ours = Results::new(&mut gpu, &case, ShadingRules::PAPER);
    let theirs = Results::new(&mut CpuExecutor::new(), &case, ShadingRules::PAPER);
    println!("pictures: {:.1} dB", psnr(&ours.picture, &theirs.picture));
    assert_psnr(&ours.picture, &theirs.picture, SAME_FRAME);
    // Plane after plane: the Gaussians of the second piece lie at the end of each.
    let first_of_second = BINDING_BYTES as usize / 4 / (16 * 59) * 16;
    let is_of_second = |number: &usize| number % MANY >= first_of_second;
    for (name, of_second) in [("first", false), ("second", true)] {
        let of = |list: &'_ [f64]| -> Vec<f64> {
            (0..list.len()).filter(|number| is_of_second(number) == of_second).map(|number| list[number]).collect()
        };
        let apart = apart(of(&theirs.gradient).iter(), of(&ours.gradient).iter());
        println!("gradients of the {name} piece: {apart:.1e} apart");
        assert!(apart < 1e-3, "gradients of the {name} piece are {apart} apart");
    }
}
