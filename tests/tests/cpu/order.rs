//! Orders of splats in a pixel: the formula of their depths, and pictures of the viewer against the
//! plain pipeline and against the independent renderer.

use glam::{DMat3, DVec3, Mat3, Quat, Vec3};
use specula_core::{
    antialias::BLUR,
    camera::Camera,
    cutoffs::{
        BlendOrder::{self, Mean, Pixel, Window},
        Cutoffs, ProjectionModel, WINDOW_MAX,
    },
    double::Double,
    executor::Renderer,
    order::ResponseDepth,
    pipeline::render,
    plan::{Needs, Plan},
    prefilter::{LevelRange, Levels, PrefilterScheme},
    random,
    rules::{Channels, RenderRules},
    scene::{
        DIFFUSE, Environment, Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT, RadianceActivation, len_of_values,
    },
    shade::ShadingRules,
};
use specula_cpu::CpuViewer;
use specula_tests::{
    compare::{assert_psnr, psnr},
    formulas::camera,
    independent::{
        rays::{self, RayView},
        surface,
    },
    plain::{self, lift_gaussians, stress::stress_scenes},
    strategies::{random_cloud, random_environment},
    stress::{LAYOUT, every_case},
};

/// `f32` on lanes against `f64`: rounding is 100 dB, a pixel of which a pair of splats is equally
/// deep in `f32`, or on the other side of a cut, brings a small picture down to some 80 dB.
const SAME_FRAME: f64 = 75.0;
/// Relative tolerance of depths by two formulas in `f64`, whose covariances cancel some digits.
const SAME_DEPTH: f64 = 1e-6;
/// Texels along an edge of the light.
const RESOLUTION: usize = 16;
const ORDERS: [BlendOrder; 5] = [Mean, Window(1), Window(3), Window(16), Pixel];

type Cloud = Gaussians<Vec<f32>>;

fn rules() -> RenderRules {
    RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Training)
}

/// Planes of an unlit picture.
fn picture(cloud: &Cloud, camera: &Camera, cutoffs: Cutoffs) -> Vec<f32> {
    picture_of(cloud, None, camera, &rules(), cutoffs)
}

fn picture_of(
    cloud: &Cloud,
    light: Option<&Environment<Vec<f32>>>,
    camera: &Camera,
    rules: &RenderRules,
    cutoffs: Cutoffs,
) -> Vec<f32> {
    let mut exec = CpuViewer::with_cutoffs(cutoffs);
    let light = light.map(|light| exec.prefilter(light, rules.scheme, rules.levels).expect("it is large enough"));
    let frame = render(&mut exec, cloud, light.as_ref(), camera, rules).expect("the CPU renders");
    let mut values = vec![0.0; frame.len_of_values()];
    exec.read_frame(&frame, &mut values).expect("the frame has that size");
    values
}

fn in_order(order: BlendOrder) -> Cutoffs {
    Cutoffs::DEFAULT.with_order(order)
}

fn exact(cloud: &Cloud, camera: &Camera, cutoffs: &Cutoffs) -> Vec<f64> {
    let frame = plain::render_within(&lift_gaussians::<Double>(cloud), None, camera, &rules(), cutoffs);
    frame.values.iter().map(|x| x.0).collect()
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}

#[track_caller]
fn assert_same_bits(one: &[f32], other: &[f32], what: &str) {
    assert_eq!(one.len(), other.len(), "{what}: pictures of one size");
    let apart = one.iter().zip(other).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
    assert_eq!(apart, 0, "{what}: numbers that differ");
}

/// Colours and transmittance of the independent renderer, each pixel in its exact order.
fn by_rays(cloud: &Cloud, camera: &Camera, order: rays::Order) -> Vec<f64> {
    let gaussians: Vec<_> = surface::gaussians(cloud).into_iter().map(|(gaussian, _)| gaussian).collect();
    let colors: Vec<Vec<f64>> = plain::shade(&lift_gaussians::<Double>(cloud), camera, None, &rules())
        .into_iter()
        .map(|channels| channels.into_iter().map(|x| x.0).collect())
        .collect();
    rays::blend(&gaussians, &colors, &RayView::of(camera), order).values
}

#[test]
fn the_depth_of_a_response_is_the_quotient_of_its_products() {
    let camera = camera(60, 40);
    let cloud = random_cloud(200, Layout::radiance(0), 1);
    let responses = plain::response_depths(&lift_gaussians::<Double>(&cloud), &camera);
    let (turn, gaussians) = (camera.camera_from_world.as_dmat3(), surface::gaussians(&cloud));
    for (k, (gaussian, _)) in gaussians.into_iter().enumerate() {
        let mean = turn * (gaussian.mean - camera.position.as_dvec3());
        let axes = turn * gaussian.axes;
        let widened = camera.focal_px.map(|focal| f64::from(BLUR) * (mean.z / f64::from(focal)).powi(2));
        let covariance = axes * axes.transpose() + DMat3::from_diagonal(DVec3::new(widened[0], widened[1], 0.0));
        let precision = covariance.inverse();
        for pixel in [[3, 5], [30, 20], [55, 39]] {
            let ray = RayView::of(&camera).ray(pixel[1] * 60 + pixel[0]);
            let expected = (ray.dot(precision * mean) / ray.dot(precision * ray)).max(0.0);
            let offset = [0, 1].map(|axis| Double(pixel[axis] as f64 + 0.5) - responses[k].mean2d[axis]);
            let depth = responses[k].at(offset).0;
            assert!((depth - expected).abs() <= SAME_DEPTH * mean.z, "{k}, {pixel:?}: {depth}, not {expected}");
        }
    }
}

#[test]
fn no_response_in_a_tile_is_nearer_than_its_bound() {
    let uniform = |k: u64, stream: u64, low: f32, high: f32| low + (high - low) * random::uniform(3, stream, k);
    let mut closest = f32::INFINITY;
    for k in 0..2000 {
        let size = 10.0_f32.powf(uniform(k, 0, -3.0, 1.0));
        let draw = |stream: u64| size * uniform(k, stream, -1.0, 1.0);
        let response = ResponseDepth {
            mean2d: [0.0; 2],
            slope: [draw(1), draw(2)],
            root: [draw(3).abs(), draw(4), draw(5).abs()],
            depth: uniform(k, 6, 0.01, 100.0),
        };
        let corner = [uniform(k, 7, -40.0, 30.0), uniform(k, 8, -40.0, 30.0)];
        let bounds = corner.map(|first| [first, first + 15.0]);
        let least = response.least(bounds[0], bounds[1]);
        for pixel in 0..256 {
            let depth = response.at([corner[0] + (pixel % 16) as f32, corner[1] + (pixel / 16) as f32]);
            assert!(least <= depth, "{k}: {least} is behind {depth}");
            closest = closest.min(depth - least);
        }
    }
    assert!(closest < 1e-3, "bounds are tight for some: {closest}");
}

#[test]
fn a_viewer_shows_what_the_plain_pipeline_shows_in_every_order() {
    let (cloud, camera) = (random_cloud(300, LAYOUT, 3), camera(50, 37));
    let mean = exact(&cloud, &camera, &in_order(Mean));
    for projection in [ProjectionModel::Affine, ProjectionModel::Ray, ProjectionModel::Within(0.02)] {
        for order in ORDERS {
            let cutoffs = in_order(order).with_projection(projection);
            let exact = exact(&cloud, &camera, &cutoffs);
            assert_psnr(&wide(&picture(&cloud, &camera, cutoffs)), &exact, SAME_FRAME);
            if order == Pixel {
                assert!(psnr(&exact, &mean) < 40.0, "orders differ, so that the comparison can fail");
            }
        }
    }
}

#[test]
fn the_exact_order_is_that_of_an_independent_renderer() {
    // Without scenes in which Gaussians reach behind the near plane: the independent renderer
    // leaves them out ray by ray.
    let cutoffs = Cutoffs::REFERENCE.with_order(Pixel);
    let mut scenes = vec![(random_cloud(300, LAYOUT, 5), camera(48, 32))];
    for name in ["wide faint splats", "needles at all angles"] {
        let scene = stress_scenes(2).into_iter().find(|scene| scene.name == name).expect("a scene of that name");
        let Camera { width, height, focal_px, principal_px, .. } = scene.cameras[0];
        let quarter = Camera {
            width: width / 4,
            height: height / 4,
            focal_px: focal_px.map(|focal| focal / 4.0),
            principal_px: principal_px.map(|center| center / 4.0),
            ..scene.cameras[0]
        };
        scenes.push((scene.cloud, quarter));
    }
    for (cloud, camera) in scenes {
        let truth = by_rays(&cloud, &camera, rays::Order::Response);
        let by_means = by_rays(&cloud, &camera, rays::Order::Mean);
        let own = wide(&picture(&cloud, &camera, cutoffs));
        println!("{:.1} dB; by means {:.1} dB", psnr(&own, &truth), psnr(&by_means, &truth));
        assert_psnr(&own, &truth, SAME_FRAME);
        assert!(psnr(&by_means, &truth) < 60.0, "the order matters");
    }
}

#[test]
fn a_window_of_one_is_the_order_of_means_to_the_last_bit() {
    let camera = camera(70, 45);
    let light = random_environment(RESOLUTION, RadianceActivation::Identity, 4);
    for projection in [ProjectionModel::Affine, ProjectionModel::Ray] {
        for channels in [Channels::Color, Channels::Training, Channels::Layers] {
            let rules = RenderRules::full(ShadingRules::DEFERRED, PrefilterScheme::Exact, channels);
            let cloud = random_cloud(2000, LAYOUT, 6);
            let [mean, window] = [Mean, Window(1)].map(|order| {
                let cutoffs = in_order(order).with_projection(projection);
                picture_of(&cloud, Some(&light), &camera, &rules, cutoffs)
            });
            assert_same_bits(&mean, &window, "a window of one");
        }
    }
}

#[test]
fn a_wider_window_is_closer_to_the_exact_order_and_a_full_one_is_it() {
    let (cloud, camera) = (random_cloud(400, LAYOUT, 7), camera(70, 45));
    let of = |order: BlendOrder| wide(&picture(&cloud, &camera, in_order(order)));
    let exact = of(Pixel);
    let closeness = [1, 4, 16, 64].map(|count| psnr(&of(Window(count)), &exact));
    println!("{closeness:.1?} dB");
    assert!(closeness.is_sorted() && closeness[2] > closeness[0] + 6.0, "{closeness:?}");

    let few = random_cloud(WINDOW_MAX as usize, LAYOUT, 8);
    let [window, exact] = [Window(WINDOW_MAX), Pixel].map(|order| picture(&few, &camera, in_order(order)));
    assert_same_bits(&window, &exact, "a window of all splats");
}

/// Two opaque discs that cross, red and green, seen by a camera that turns in place by this angle.
fn crossing(order: BlendOrder, angle: f32) -> Vec<f64> {
    let layout = Layout::radiance(0);
    let mut cloud = Gaussians { count: 2, layout, values: vec![0.0; len_of_values(2, layout)] };
    for (k, side) in [-1.0_f32, 1.0].into_iter().enumerate() {
        let turn = Quat::from_rotation_y(side * 0.6);
        cloud.set(k, MEAN, [0.05 * side, 0.0, 0.0]);
        cloud.set(k, LOG_SCALE, [0.0, 0.0, -4.0]);
        cloud.set(k, QUAT, [turn.w, turn.x, turn.y, turn.z]);
        cloud.set(k, OPACITY, [3.0]);
        cloud.set(k, DIFFUSE, if k == 0 { [1.5, -1.5, -1.5] } else { [-1.5, 1.5, -1.5] });
    }
    let eye = Vec3::new(0.0, 0.0, -4.0);
    let straight = Camera::look_at(eye, Vec3::ZERO, Vec3::NEG_Y, 0.7, 64, 48);
    // Rolled, so that the line in which they cross meets the centres of pixels one by one.
    let turned = Mat3::from_rotation_z(0.3) * Mat3::from_rotation_y(angle) * straight.camera_from_world;
    wide(&picture(&cloud, &Camera { camera_from_world: turned, ..straight }, in_order(order)))
}

/// Largest mean absolute difference of successive pictures while the camera turns.
fn largest_jump(order: BlendOrder, steps: usize) -> f64 {
    let angle = |k: usize| 0.02 * (k as f32 / steps as f32 - 0.5);
    let pictures: Vec<Vec<f64>> = (0..=steps).map(|k| crossing(order, angle(k))).collect();
    let jump = |pair: &[Vec<f64>]| {
        pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b).abs()).sum::<f64>() / pair[0].len() as f64
    };
    pictures.windows(2).map(jump).fold(0.0, f64::max)
}

#[test]
fn crossing_discs_pop_by_their_means_and_turn_smoothly_in_the_exact_order() {
    let [mean, finer_mean] = [11, 45].map(|steps| largest_jump(Mean, steps));
    let [pixel, finer_pixel] = [11, 45].map(|steps| largest_jump(Pixel, steps));
    println!("by means {mean:.1e}, {finer_mean:.1e}; exactly {pixel:.1e}, {finer_pixel:.1e}");
    assert!(finer_mean > 0.9 * mean, "smaller steps do not make the jump smaller: {mean} and {finer_mean}");
    assert!(finer_pixel < 0.5 * pixel, "the exact order changes in proportion to the step: {pixel}, {finer_pixel}");
    assert!(mean > 5.0 * pixel && finer_mean > 20.0 * finer_pixel, "{mean} and {pixel}, {finer_mean}, {finer_pixel}");
}

#[test]
fn equal_depths_keep_the_order_of_the_gaussians() {
    let camera = camera(40, 30);
    let mut cloud = random_cloud(150, LAYOUT, 9);
    for k in 0..cloud.count {
        // Fifty in each of three places, of different colours and opacities.
        cloud.set(k, LOG_SCALE, [-0.2, -0.6, -1.5]);
        for (plane, len) in [(MEAN, 3), (QUAT, 4)] {
            for entry in plane..plane + len {
                let number = cloud.get::<1>(k % 3, entry);
                cloud.set(k, entry, number);
            }
        }
    }
    let [mean, pixel] = [Mean, Pixel].map(|order| wide(&picture(&cloud, &camera, in_order(order))));
    assert!(psnr(&mean, &pixel) < 60.0, "three places cross");
    for k in 1..3 {
        for other in (k..cloud.count).step_by(3) {
            cloud.set(other, OPACITY, [-30.0]);
        }
    }
    let [mean, pixel] = [Mean, Pixel].map(|order| picture(&cloud, &camera, in_order(order)));
    assert_same_bits(&mean, &pixel, "all in one place");
}

#[test]
fn an_order_has_the_same_bits_on_any_number_of_threads() {
    let (cloud, camera) = (random_cloud(3000, LAYOUT, 10), camera(90, 70));
    for order in ORDERS {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be had");
            pool.install(|| picture(&cloud, &camera, in_order(order)))
        };
        let one = on(1);
        for threads in [2, 5] {
            assert_same_bits(&one, &on(threads), &format!("{order:?} on {threads} threads"));
        }
    }
}

#[test]
fn extreme_scenes_are_finite_and_as_opaque_in_every_order() {
    for case in every_case() {
        let mean = picture(&case.cloud, &case.camera, in_order(Mean));
        let size = (case.camera.width * case.camera.height) as usize;
        for order in [Window(4), Pixel] {
            let own = picture(&case.cloud, &case.camera, in_order(order));
            assert!(own.iter().all(|x| x.is_finite()), "{}: {order:?}", case.name);
            // Transmittance is a product of the same factors, of whose end the order decides.
            let apart = own[own.len() - size..].iter().zip(&mean[mean.len() - size..]).map(|(a, b)| (a - b).abs());
            let largest = apart.fold(0.0, f32::max);
            assert!(largest <= ENDED, "{}: {order:?}: transmittance is {largest} off", case.name);
        }
    }
}

/// Transmittance of a pixel that the next splat would end, at most: a splat of the largest alpha
/// leaves a hundredth of it, which is below 1e-4.
const ENDED: f32 = 0.011;

#[test]
fn extreme_scenes_in_f32_are_those_in_f64_in_the_exact_order() {
    for name in ["needles", "pancakes", "all at one depth", "dust", "a view of 170 degrees", "a picture of one pixel"] {
        let case = every_case().into_iter().find(|case| case.name == name).expect("a case of that name");
        for order in [Window(4), Pixel] {
            let cutoffs = in_order(order);
            let own = wide(&picture(&case.cloud, &case.camera, cutoffs));
            let psnr = psnr(&own, &exact(&case.cloud, &case.camera, &cutoffs));
            println!("{name}: {order:?}: {psnr:.1} dB");
            assert!(psnr > EXTREME_FRAME, "{name}: {order:?}: {psnr} dB");
        }
    }
}

/// As [`SAME_FRAME`], where more pixels depend on rounding: needles in the plane of a pixel's ray.
const EXTREME_FRAME: f64 = 45.0;

#[test]
fn pictures_without_gaussians_or_pixels_are_empty_in_every_order() {
    for order in ORDERS {
        for (width, height, count) in [(48, 32, 0), (1, 1, 60), (0, 32, 60), (48, 0, 60)] {
            let mut camera = camera(48, 32);
            (camera.width, camera.height) = (width, height);
            let values = picture(&random_cloud(count, LAYOUT, 1), &camera, in_order(order));
            assert!(values.iter().all(|x| x.is_finite()), "{order:?}: {width} × {height}, {count} Gaussians");
            assert!(count > 0 || values[values.len() - 48 * 32..].iter().all(|passed| *passed == 1.0));
        }
    }
}

#[test]
fn omissions_change_no_bit_in_any_order() {
    let (mut cloud, camera) = (random_cloud(300, LAYOUT, 11), camera(50, 40));
    for k in 0..cloud.count {
        for entry in LAYOUT.sh_start()..LAYOUT.plane_count() {
            cloud.set(k, entry, [0.0]);
        }
    }
    let light = random_environment(RESOLUTION, RadianceActivation::Identity, 12);
    let full = RenderRules::full(ShadingRules::DEFERRED, PrefilterScheme::Exact, Channels::Color);
    let levels = Levels::new(PrefilterScheme::Exact, RESOLUTION);
    let asked = RenderRules { sh_degree: LAYOUT.sh_degree, levels: LevelRange::ALL, ..full };
    let plan = Plan::new(LAYOUT, &Needs::of(&cloud).under(Some(&light)), Some(&levels), &asked).rules;
    assert!(plan.sh_degree != asked.sh_degree, "harmonics are omitted");
    for order in [Window(5), Pixel] {
        let [all, planned] =
            [asked, plan].map(|rules| picture_of(&cloud, Some(&light), &camera, &rules, in_order(order)));
        assert_same_bits(&all, &planned, &format!("{order:?}"));
    }
}

#[test]
fn a_response_behind_the_eye_counts_as_at_the_eye() {
    let response = ResponseDepth { mean2d: [0.0; 2], slope: [0.1, 0.0], root: [0.01, 0.0, 0.01], depth: 2.0_f32 };
    assert_eq!(response.at([0.0, 0.0]), 2.0);
    assert_eq!([response.at([-10.0, 0.0]), response.at([-1000.0, 3.0])], [0.0, 0.0]);
    assert!(response.at([-9.9, 0.0]) > 0.0, "and it comes there continuously");
}
