//! Anti-aliasing: filters on the screen and in space, and trainings under them.

use specula_core::{
    antialias::{COMPENSATION_MIN, DEVIATION_SHARE, LowPass},
    camera::Camera,
    double::Double,
    executor::Executor,
    metrics::quantize,
    prefilter::PrefilterScheme,
    project::{Shape, project, project_vjp},
    rules::{Channels, RenderRules},
    scene::{Gaussians, Image, LOG_SCALE, Layout, MEAN, OPACITY},
    shade::ShadingRules,
    splat::{Splat, SplatGrad},
    vector::{Vec3, vec3},
};
use specula_cpu::CpuExecutor;
use specula_tests::strategies::random_cloud;
use specula_train::{
    evaluate::render_view,
    profile::by_name,
    start::Point,
    trainer::{Settings, Trainer},
    view::View,
};

/// Roundings of a projection in `f64` through constants of `f32`.
const SAME: f64 = 1e-6;

fn front(width: u32, height: u32) -> Camera {
    Camera::look_at(glam::Vec3::new(0.0, -3.0, 0.0), glam::Vec3::ZERO, glam::Vec3::Z, 0.7, width, height)
}

fn ball(scales: [f64; 3], low_pass: LowPass, filter: Option<f64>) -> Shape<Double> {
    Shape {
        mean: Vec3::splat(Double(0.0)),
        log_scales: vec3(Double(scales[0].ln()), Double(scales[1].ln()), Double(scales[2].ln())),
        quat: [1.0, 0.1, 0.2, 0.3].map(Double),
        opacity_logit: Double(0.4),
        low_pass,
        filter: filter.map(Double),
    }
}

fn splat_of(shape: &Shape<Double>, camera: &Camera) -> Splat<Double> {
    project(shape, &camera.lift(Double(0.0)))
}

/// Opacity times area: the integral of a splat over the screen, but for 2π.
fn integral(splat: &Splat<Double>) -> f64 {
    let [xx, _, yy] = splat.root_conic;
    splat.opacity.0 / (xx.0 * yy.0)
}

#[test]
fn a_compensated_low_pass_keeps_the_integral_of_a_splat() {
    for low_pass in [LowPass::Compensated, LowPass::Mip] {
        for size in [1e-2, 1e-1, 1.0] {
            // The integral in pixels of the sharpest picture, in which no splat is small.
            let shape = ball([size, 0.5 * size, 0.2 * size], low_pass, None);
            let per_pixel = |width: u32| integral(&splat_of(&shape, &front(width, width))) / f64::from(width).powi(2);
            let sharp = per_pixel(1 << 20);
            for width in [16, 64, 256, 1024] {
                let ratio = per_pixel(width) / sharp;
                assert!((ratio - 1.0).abs() < SAME.sqrt(), "{low_pass:?}, {size}: {ratio} at {width} pixels");
            }
            let dilated = ball([size; 3], LowPass::Dilated, None);
            let [small, sharp] = [16, 1 << 20]
                .map(|width| integral(&splat_of(&dilated, &front(width, width))) / f64::from(width).powi(2));
            assert!(size > 0.5 || small > 1.01 * sharp, "without compensation it grows");
        }
    }
}

#[test]
fn a_filter_in_space_is_a_convolution() {
    let (scales, filter) = ([0.2, 0.1, 0.05], 0.15_f64);
    let wider = scales.map(|scale: f64| scale.hypot(filter));
    let (smoothed, wide) = (ball(scales, LowPass::Dilated, Some(filter)), ball(wider, LowPass::Dilated, None));
    let camera = front(64, 64);
    let [ours, expected] = [&smoothed, &wide].map(|shape| splat_of(shape, &camera));
    for (ours, expected) in ours.root_conic.into_iter().zip(expected.root_conic) {
        assert!((ours.0 - expected.0).abs() < SAME * expected.0.abs().max(1.0), "{ours:?} for {expected:?}");
    }
    let share: f64 = scales.iter().zip(wider).map(|(scale, wider)| scale / wider).product();
    assert!((ours.opacity.0 / expected.opacity.0 - share).abs() < SAME, "its integral over space stays");
}

#[test]
fn sampling_intervals_are_depths_over_focal_lengths_of_the_nearest_view_that_sees() {
    let layout = Layout::radiance(1).antialiased();
    let plane = layout.filter_plane().expect("a filter");
    let mut cloud = random_cloud(37, layout, 3);
    cloud.set(0, MEAN, [0.0; 3]);
    // Beside every picture, and behind the first view.
    cloud.set(1, MEAN, [0.0, -30.0, 100.0]);
    let near = front(100, 50);
    let far = Camera { position: near.position * 2.0, focal_px: [90.0, 80.0], ..near };
    CpuExecutor::new().sampling(&mut cloud, &[far, near]).expect("the CPU samples");
    let deviation = |gaussian: usize| cloud.get::<1>(gaussian, plane)[0];
    let of = |interval: f32| DEVIATION_SHARE * interval;
    let focal = near.focal_px[0];
    assert!((deviation(0) / of(3.0 / focal) - 1.0).abs() < 1e-5, "the nearer view counts");
    let distance = |camera: &Camera| (glam::Vec3::new(0.0, -30.0, 100.0) - camera.position).length();
    let turned = (distance(&near) / focal).min(distance(&far) / 90.0);
    assert!((deviation(1) / of(turned) - 1.0).abs() < 1e-5, "where no view sees, the nearest counts");
    let mut plain = random_cloud(37, Layout::radiance(1), 3);
    let before = plain.clone();
    CpuExecutor::new().sampling(&mut plain, &[near]).expect("the CPU samples");
    assert_eq!(plain, before, "what has no filter stays");
}

/// Scales of needles, discs and points, and filters beyond them, of either sign.
const SCALES: [[f32; 3]; 5] =
    [[-40.0; 3], [0.5, -20.0, -20.0], [0.5, 0.5, -30.0], [-9.0, -9.0, -9.0], [40.0, -40.0, 0.0]];
const FILTERS: [f32; 6] = [0.0, 1e-30, 1e-3, 10.0, 1e30, -1.0];

#[test]
fn splats_and_gradients_stay_finite_at_the_edges_of_both_filters() {
    let camera = front(64, 48).lift(0.0_f32);
    for (log_scales, filter) in SCALES.into_iter().flat_map(|scales| FILTERS.map(|filter| (scales, filter))) {
        for (low_pass, logit) in [(LowPass::Mip, 2.0), (LowPass::Compensated, 100.0), (LowPass::Mip, -100.0)] {
            // Edge on: the axis of a disc lies across the view.
            for quat in [[1.0, 0.0, 0.0, 0.0], [0.8, 0.6, 0.0, 0.0]] {
                let [x, y, z] = log_scales;
                let shape = Shape {
                    mean: vec3(0.1, 0.2, -0.1),
                    log_scales: vec3(x, y, z),
                    quat,
                    opacity_logit: logit,
                    low_pass,
                    filter: Some(filter),
                };
                let splat = project(&shape, &camera);
                assert!(splat.opacity.is_finite() && (0.0..=1.0).contains(&splat.opacity), "{shape:?}: {splat:?}");
                assert!(splat.root_conic.iter().all(|x| x.is_finite()), "{shape:?}: {splat:?}");
                let ones = SplatGrad { mean2d: [1.0; 2], root_conic: [1.0; 3], depth: 1.0, opacity: 1.0 };
                let grad = project_vjp(&shape, &camera, &ones);
                let numbers = [&grad.mean.to_array()[..], &grad.log_scales.to_array(), &grad.quat].concat();
                assert!(numbers.iter().all(|x| x.is_finite()), "{shape:?}: {grad:?}");
                assert!(grad.opacity_logit.is_finite(), "{shape:?}: {grad:?}");
            }
        }
    }
}

#[test]
fn a_splat_without_area_is_as_faint_as_can_be_and_has_no_gradient_of_its_size() {
    let shape = ball([1e-9; 3], LowPass::Mip, None);
    let splat = splat_of(&shape, &front(64, 64));
    let own = 1.0 / (1.0 + (-0.4_f64).exp());
    assert!((splat.opacity.0 / own - f64::from(COMPENSATION_MIN).sqrt()).abs() < SAME);
    let grad =
        SplatGrad { mean2d: [Double(0.0); 2], root_conic: [Double(0.0); 3], depth: Double(0.0), opacity: Double(1.0) };
    let grad = project_vjp(&shape, &front(64, 64).lift(Double(0.0)), &grad);
    assert_eq!(grad.log_scales.to_array().map(|x| x.0), [0.0; 3]);
}

/// Pixels of the pictures of a training along an edge.
const SIZE: u32 = 40;
const VIEWS: usize = 12;
const ITERATIONS: u32 = 150;
/// Brightness of a picture at another size, relative to that at the size of the training, is no
/// farther from one than this: a training leaves noise of a few percent, and splats below 1/255 are
/// not drawn at a quarter of the size. Without the filters it doubles there.
const SAME_BRIGHTNESS: f64 = 0.06;

/// A view on a circle around a cloud of dust, whose grains are about a pixel wide.
fn dust(number: usize) -> View {
    let turn = number as f32 * 0.7;
    let eye = glam::Vec3::new(3.0 * turn.cos(), 3.0 * turn.sin(), 1.0);
    let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, SIZE, SIZE);
    let mut cloud = random_cloud(150, Layout::radiance(0), 21);
    for gaussian in 0..cloud.count {
        let scales = cloud.get::<3>(gaussian, LOG_SCALE).map(|scale| 0.3 * scale - 3.3);
        cloud.set(gaussian, LOG_SCALE, scales);
        cloud.set(gaussian, OPACITY, [2.0]);
    }
    let sharp = picture(&cloud, &camera.resized(4 * SIZE, 4 * SIZE));
    // Areas of four by four pixels become one.
    let mean = |plane: usize, pixel: usize| -> f32 {
        let (x, y) = (4 * (pixel % SIZE as usize), 4 * (pixel / SIZE as usize));
        let rows = (y..y + 4).flat_map(|y| (x..x + 4).map(move |x| y * 4 * SIZE as usize + x));
        rows.map(|index| sharp.plane(plane)[index]).sum::<f32>() / 16.0
    };
    let rgba = (0..(SIZE * SIZE) as usize).flat_map(|pixel| {
        let alpha = 1.0 - mean(3, pixel);
        let straight = |c: usize| quantize(mean(c, pixel) / alpha.max(1e-3));
        [straight(0), straight(1), straight(2), quantize(alpha)]
    });
    View { name: number.to_string(), camera, rgba: rgba.collect(), unclipped: None, normals: None }
}

fn picture(cloud: &Gaussians<Vec<f32>>, camera: &Camera) -> Image<Vec<f32>> {
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    render_view(&mut CpuExecutor::new(), cloud, None, camera, &rules).expect("the CPU renders")
}

/// Brightness of views that a training did not see, at a quarter and at four times its size, each
/// relative to that at its size.
fn brightness_at_other_sizes(layout: Layout) -> [f64; 2] {
    let mut profile = by_name("3dgs", ITERATIONS).expect("a profile of that name");
    profile.layout = layout;
    profile.densification.until = 0;
    let settings = Settings { profile, iterations: ITERATIONS, seed: 3, background: [0.0; 3], random_points: 0 };
    let views: Vec<View> = (0..VIEWS).map(dust).collect();
    let cloud = random_cloud(150, Layout::radiance(0), 21);
    let points: Vec<Point> =
        (0..cloud.count).map(|k| Point { position: cloud.get(k, MEAN), color: [0.5; 3] }).collect();
    let mut trainer = Trainer::new(CpuExecutor::new(), settings, &views, &points).expect("there are views");
    while !trainer.is_finished() {
        trainer.step().expect("the CPU trains");
    }
    let cloud = trainer.download().expect("the CPU gives back").gaussians;
    let brightness = |size: u32| {
        let view_brightness = |number: usize| {
            let image = picture(&cloud, &dust(number).camera.resized(size, size));
            let colors = (0..3).flat_map(|c| image.plane(c));
            colors.map(|x| f64::from(*x)).sum::<f64>() / f64::from(size * size)
        };
        (VIEWS..VIEWS + 4).map(view_brightness).sum::<f64>()
    };
    let own = brightness(SIZE);
    [brightness(SIZE / 4) / own, brightness(4 * SIZE) / own]
}

fn keep_brightness(ratios: [f64; 2]) -> bool {
    ratios.iter().all(|ratio| (ratio - 1.0).abs() < SAME_BRIGHTNESS)
}

#[test]
fn an_antialiased_training_keeps_its_brightness_at_other_sizes() {
    let ratios = brightness_at_other_sizes(Layout::radiance(0).antialiased());
    println!("brightness at 1/4 and 4 times the size: {ratios:.3?}");
    assert!(keep_brightness(ratios), "{ratios:?}");
}

#[test]
fn a_training_without_filters_does_not() {
    let ratios = brightness_at_other_sizes(Layout::radiance(0));
    println!("brightness at 1/4 and 4 times the size: {ratios:.3?}");
    assert!(!keep_brightness(ratios), "{ratios:?}");
}
