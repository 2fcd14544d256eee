//! Orders of splats in a pixel on the device: formulas, and pictures against the CPU's.

use core::fmt::Debug;
use specula_core::{
    camera::Camera,
    cutoffs::{
        BlendOrder::{self, Mean, Pixel, Window},
        Cutoffs, WINDOW_MAX,
    },
    double::Double,
    executor::Renderer,
    pack::Storage,
    pipeline::{median_depths, render, render_occluded},
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules},
    scene::{Gaussians, Layout, OPACITY},
    shade::ShadingRules,
};
use specula_cpu::CpuViewer;
use specula_gpu::{
    GpuExecutor,
    stages::{
        blend_in_order::formulas::{AlphaOf, BlendAlpha, DepthAt, IsHidden},
        median_depths::formulas::MedianStep,
        response::formulas::ResponseOf,
    },
};
use specula_oracle::{self as oracle, lift_gaussians};
use specula_tests::{
    compare::{SAME_SPLAT, assert_psnr, psnr},
    device::{executor, executor_in_chunks_of},
    formulas::{assert_every_formula_has_a_case, assert_same, camera, gaussian_rows, uniform_rows},
    strategies::random_cloud,
    stress::{LAYOUT, every_case},
};

/// As for the order of means, but for pixels in which two splats are equally deep up to rounding.
const SAME_FRAME: f64 = 70.0;
/// As [`SAME_FRAME`] in extreme scenes, where more pixels depend on rounding.
const EXTREME_FRAME: f64 = 45.0;
/// Layers of a stack: many more than a pass of the exact order selects. llvmpipe renders 600
/// exactly and is wrong from some thousands on: 5000 are 26.6 dB from the CPU.
const LAYERS: usize = 600;
const ORDERS: [BlendOrder; 5] = [Mean, Window(1), Window(3), Window(WINDOW_MAX), Pixel];

fn viewer() -> Option<GpuExecutor<Storage>> {
    executor().map(|exec| GpuExecutor::viewer(exec.gpu().clone(), Storage::F32))
}

fn picture<E: Renderer>(exec: &mut E, cloud: &Gaussians<Vec<f32>>, camera: &Camera, channels: Channels) -> Vec<f64> {
    picture_behind(exec, cloud, camera, channels, None)
}

/// Picture behind surfaces of another renderer, if there are any.
fn picture_behind<E: Renderer>(
    exec: &mut E,
    cloud: &Gaussians<Vec<f32>>,
    camera: &Camera,
    channels: Channels,
    depths: Option<&[f32]>,
) -> Vec<f64> {
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, channels);
    let uploaded = exec.upload_gaussians(cloud).expect("numbers fit");
    let depths = depths.map(|depths| exec.upload(depths).expect("numbers fit"));
    let frame = match &depths {
        None => render(exec, &uploaded, None, camera, &rules),
        Some(depths) => render_occluded(exec, &uploaded, None, camera, &rules, depths),
    };
    let frame = frame.expect("the executor renders");
    let mut values = vec![0.0; (channels.count() + 1) * (camera.width * camera.height) as usize];
    exec.read_frame(&frame, &mut values).expect("the frame has that size");
    values.iter().map(|x| f64::from(*x)).collect()
}

fn on_cpu(order: BlendOrder) -> CpuViewer {
    CpuViewer::with_cutoffs(Cutoffs::DEFAULT.with_order(order))
}

#[test]
fn every_formula_of_an_order_is_on_the_device_what_it_is_on_the_host() {
    let Some(mut gpu) = executor() else { return };
    let gpu = &mut gpu;
    for layout in [Layout::radiance(3), Layout::shaded(Some(3))] {
        assert_same(gpu, &ResponseOf { layout }, &gaussian_rows(layout));
    }
    let splat = [[0.1, 0.8], [-0.5, 0.5], [0.1, 0.8], [-3.0, 0.0], [-1.0, 1.0], [-1.0, 1.0]];
    assert_same(gpu, &AlphaOf, &uniform_rows(1, &splat));
    assert_same(gpu, &MedianStep, &uniform_rows(5, &[[0.0, 0.99], [0.05, 1.0]]));
    let response = [[-0.02, 0.02], [-0.02, 0.02], [0.0, 0.05], [-0.05, 0.05], [0.0, 0.05], [0.5, 9.0]];
    let rows = uniform_rows(2, &[&response[..], &[[-20.0, 20.0]; 2]].concat());
    assert_same(gpu, &DepthAt, &rows);
    assert_same(gpu, &IsHidden, &uniform_rows(4, &[[0.5, 9.0]; 2]));
    for channels in [3, 8, 12] {
        let mut bounds = vec![[0.0, 0.99]];
        bounds.extend(vec![[-1.0, 1.0]; channels]);
        bounds.extend([[0.05, 1.0]; 2]);
        bounds.extend(vec![[-1.0, 1.0]; channels]);
        assert_same(gpu, &BlendAlpha { channels }, &uniform_rows(3, &bounds));
    }
}

#[test]
fn no_formula_of_an_order_is_left_out() {
    let formulas = [
        include_str!("../../../exec-gpu/src/stages/blend_in_order/formulas.rs"),
        include_str!("../../../exec-gpu/src/stages/median_depths/formulas.rs"),
        include_str!("../../../exec-gpu/src/stages/response/formulas.rs"),
    ];
    assert_every_formula_has_a_case(&formulas, include_str!("order.rs"), 6);
}

#[test]
fn both_executors_render_the_same_pictures_in_every_order() {
    let Some(mut gpu) = viewer() else { return };
    let camera = camera(70, 45);
    for (count, channels) in [(300, Channels::Training), (2000, Channels::Color)] {
        let cloud = random_cloud(count, LAYOUT, 3);
        let by_means = picture(&mut on_cpu(Mean), &cloud, &camera, channels);
        for order in ORDERS {
            gpu.set_order(order);
            let ours = picture(&mut gpu, &cloud, &camera, channels);
            let theirs = picture(&mut on_cpu(order), &cloud, &camera, channels);
            println!("{count}, {order:?}: {:.1} dB", psnr(&ours, &theirs));
            assert_psnr(&ours, &theirs, SAME_FRAME);
            assert!(order != Pixel || psnr(&theirs, &by_means) < 45.0, "orders differ");
        }
    }
}

/// Median depths of an executor.
fn medians<E: Renderer<Error: Debug>>(exec: &mut E, cloud: &Gaussians<Vec<f32>>, camera: &Camera) -> Vec<f32> {
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    let uploaded = exec.upload_gaussians(cloud).expect("numbers fit");
    let array = median_depths(exec, &uploaded, camera, &rules).expect("the executor finds them");
    let mut depths = vec![f32::NAN; (camera.width * camera.height) as usize];
    exec.download(&array, &mut depths).expect("a depth for each pixel");
    depths
}

#[test]
fn both_executors_find_the_same_median_depths() {
    /// Pixels with a transmittance within rounding of one half.
    const ON_EDGE: usize = 3;
    let Some(mut gpu) = viewer() else { return };
    let (camera, cloud) = (camera(70, 45), random_cloud(600, LAYOUT, 7));
    let ours = medians(&mut gpu, &cloud, &camera);
    let theirs = medians(&mut on_cpu(Mean), &cloud, &camera);
    let is_same = |(a, b): &(&f32, &f32)| a == b || (*a - *b).abs() <= SAME_SPLAT as f32 * b.abs();
    let others = ours.iter().zip(&theirs).filter(|pair| !is_same(pair)).count();
    let found = theirs.iter().filter(|depth| depth.is_finite()).count();
    println!("{found} pixels have a median, {others} another one");
    assert!(others <= ON_EDGE, "{others} pixels differ");
    assert!(found > theirs.len() / 10, "few pixels have a median: {found}");
}

#[test]
fn surfaces_hide_the_same_splats_in_every_order() {
    let Some(mut gpu) = viewer() else { return };
    let camera = camera(70, 45);
    let (cloud, width) = (random_cloud(600, LAYOUT, 7), camera.width as usize);
    let slope = |pixel: usize| camera.position.length() + 2.0 * ((pixel % width) as f32 / width as f32 - 0.5);
    let depths: Vec<f32> = (0..width * camera.height as usize).map(slope).collect();
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    for order in ORDERS {
        gpu.set_order(order);
        let cutoffs = Cutoffs::DEFAULT.with_order(order);
        let ours = picture_behind(&mut gpu, &cloud, &camera, Channels::Color, Some(&depths));
        let theirs = picture_behind(&mut on_cpu(order), &cloud, &camera, Channels::Color, Some(&depths));
        let lifted = lift_gaussians::<Double>(&cloud);
        let exact = oracle::render_occluded(&lifted, None, &camera, &rules, Some(&depths), &cutoffs);
        let exact: Vec<f64> = exact.values.iter().map(|x| x.0).collect();
        let open = picture(&mut on_cpu(order), &cloud, &camera, Channels::Color);
        println!("{order:?}: {:.1} dB, {:.1} dB from the oracle", psnr(&ours, &theirs), psnr(&theirs, &exact));
        assert_psnr(&ours, &theirs, SAME_FRAME);
        assert_psnr(&theirs, &exact, SAME_FRAME);
        assert!(psnr(&theirs, &open) < 35.0, "surfaces hide splats");
    }
}

#[test]
fn a_window_of_one_on_the_device_is_the_order_of_means() {
    let Some(mut gpu) = viewer() else { return };
    let (cloud, camera) = (random_cloud(500, LAYOUT, 4), camera(70, 45));
    let mean = picture(&mut gpu, &cloud, &camera, Channels::Training);
    gpu.set_order(Window(1));
    // Another kernel, whose products a driver may fuse in another way.
    assert_psnr(&picture(&mut gpu, &cloud, &camera, Channels::Training), &mean, 100.0);
    gpu.set_order(Mean);
    assert!(picture(&mut gpu, &cloud, &camera, Channels::Training) == mean, "the order can be changed back");
}

#[test]
fn an_order_has_the_same_bits_twice_and_in_chunks() {
    let (Some(mut gpu), Some(divided)) = (viewer(), executor_in_chunks_of(1 << 14)) else { return };
    let mut divided = GpuExecutor::viewer(divided.gpu().clone(), Storage::F32);
    let (cloud, camera) = (random_cloud(900, LAYOUT, 5), camera(70, 45));
    for order in [Window(8), Pixel] {
        gpu.set_order(order);
        divided.set_order(order);
        let first = picture(&mut gpu, &cloud, &camera, Channels::Color);
        assert!(picture(&mut gpu, &cloud, &camera, Channels::Color) == first, "{order:?}: twice");
        assert!(picture(&mut divided, &cloud, &camera, Channels::Color) == first, "{order:?}: in chunks");
    }
}

#[test]
fn extreme_scenes_on_the_device_are_those_of_the_cpu_in_every_order() {
    let Some(mut gpu) = viewer() else { return };
    let layers = ["a wall of opaque layers", "5000 layers of glass"];
    for name in ["needles", "pancakes", "all at one depth", "dust", "no Gaussians"].into_iter().chain(layers) {
        let mut case = every_case().into_iter().find(|case| case.name == name).expect("a case of that name");
        if layers.contains(&name) {
            (LAYERS..case.cloud.count).for_each(|k| case.cloud.set(k, OPACITY, [-30.0]));
        }
        for order in [Window(4), Pixel] {
            gpu.set_order(order);
            let ours = picture(&mut gpu, &case.cloud, &case.camera, Channels::Color);
            let theirs = picture(&mut on_cpu(order), &case.cloud, &case.camera, Channels::Color);
            println!("{name}: {order:?}: {:.1} dB", psnr(&ours, &theirs));
            assert!(ours.iter().all(|x| x.is_finite()), "{name}: {order:?}");
            assert_psnr(&ours, &theirs, EXTREME_FRAME);
        }
    }
}
