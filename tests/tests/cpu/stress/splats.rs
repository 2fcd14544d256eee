//! Gaussians of extreme shape and place on the screen.

use super::{assert_at_most, worst};
use specula_core::{
    antialias::{BLUR, LowPass},
    bin::footprint,
    blend,
    camera::Camera,
    covariance::{rotation, rotation_vjp},
    cull::{CullReason, CullStats},
    cutoffs::ALPHA_MIN,
    double::Double,
    executor::Renderer,
    prefilter::PrefilterScheme,
    project::{Shape, project, project_vjp},
    random,
    rules::{Channels, RenderRules},
    scene::{Gaussians, LOG_SCALE, MEAN, OPACITY, QUAT},
    shade::ShadingRules,
    splat::{Splat, Splat2d, SplatGrad},
    vector::Mat3,
};
use specula_cpu::CpuExecutor;
use specula_tests::{
    number::{Number, vector},
    plain,
    strategies::random_cloud,
    stress::{Case, LAYOUT, every_case},
};
use specula_train::evaluate::render_view;

type Cloud = Gaussians<Vec<f32>>;

/// Needles of an `f32` have alphas this close to those of `f64`.
const NEEDLE_ALPHA: f64 = 1e-3;
/// Half a dozen roundings, and those of two exponentials.
pub(crate) const DETERMINANT: f64 = 1e-6;
/// The exponent of a needle of 10⁵ px is a difference of products of that size, a rounding of which
/// is 6e-3 px across.
pub(crate) const EXPONENT: f64 = 1e-2;
/// The area of a splat is a sum over pixels of a curve of half a pixel's width: the sampling shows.
const AREA: f64 = 0.03;
/// Shifted by whole pixels, a splat's place is rounded elsewhere: some units in the last place of a
/// coordinate of 64.
const SHIFTED: f64 = 2e-5;
/// Lengths of needles on the screen, in px.
pub(crate) const LENGTHS: [f32; 6] = [1.0, 10.0, 100.0, 1e3, 1e4, 1e5];

pub(crate) fn lens(width: u32, height: u32) -> Camera {
    Camera::look_at(glam::Vec3::new(0.0, 0.0, -4.0), glam::Vec3::ZERO, glam::Vec3::NEG_Y, 0.7, width, height)
}

pub(crate) fn shape<R: Number>(mean: [f32; 3], log_scales: [f32; 3], quat: [f32; 4], logit: f32) -> Shape<R> {
    let wide = |numbers: [f32; 3]| vector(numbers.map(f64::from));
    Shape {
        mean: wide(mean),
        log_scales: wide(log_scales),
        quat: quat.map(|x| R::of(f64::from(x))),
        opacity_logit: R::of(f64::from(logit)),
        low_pass: LowPass::Dilated,
        filter: None,
    }
}

pub(crate) fn splat<R: Number>(shape: &Shape<R>, camera: &Camera) -> Splat<R> {
    project(shape, &camera.lift(R::of(0.0)))
}

/// Needle through the middle of the picture, at 37°, of a length in pixels.
pub(crate) fn needle<R: Number>(length: f32, camera: &Camera) -> Splat<R> {
    let along = (length * 4.0 / camera.focal_px[0]).ln();
    let half = (37.0_f32 / 2.0).to_radians();
    splat(&shape([0.0; 3], [along, -12.0, -12.0], [half.cos(), 0.0, 0.0, half.sin()], 0.0), camera)
}

/// The determinant of the variance on the screen.
pub(crate) fn determinant<R: Number>(splat: &Splat<R>) -> f64 {
    let [xx, _, yy] = splat.root_conic.map(R::value);
    (xx * yy).powi(-2)
}

fn stamp_of<R: Number>(splat: &Splat<R>) -> Splat2d<R> {
    Splat2d::new(splat.mean2d, splat.root_conic, splat.opacity.log2())
}

fn alpha_at<R: Number>(footprint: &Splat2d<R>, pixel: [f64; 2]) -> f64 {
    let [dx, dy] = [0, 1].map(|axis| R::of(pixel[axis]) - footprint.mean2d[axis]);
    blend::alpha(blend::falloff(footprint, dx, dy).log2_strength).value()
}

/// One Gaussian of a colour that needs no light.
fn one(mean: [f32; 3], log_scales: [f32; 3], logit: f32) -> Cloud {
    let mut cloud = random_cloud(1, LAYOUT, 1);
    cloud.set(0, MEAN, mean);
    cloud.set(0, LOG_SCALE, log_scales);
    cloud.set(0, QUAT, [1.0, 0.0, 0.0, 0.0]);
    cloud.set(0, OPACITY, [logit]);
    cloud
}

/// All planes of a picture, the last of which is the transmittance.
fn picture(exec: &mut CpuExecutor, cloud: &Cloud, camera: &Camera) -> Vec<f32> {
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Training);
    render_view(exec, cloud, None, camera, &rules).expect("the CPU renders").values
}

fn passed(picture: &[f32], camera: &Camera) -> Vec<f32> {
    picture[picture.len() - (camera.width * camera.height) as usize..].to_vec()
}

#[test]
fn needles_stay_within_a_thousandth_of_f64_from_a_thousand_cameras() {
    let scales = [10.0_f32, 1e-6, 1e-6].map(f32::ln);
    let off = |seed: u64| {
        let normal = |index: u64| random::normal(seed, 1, index);
        let eye = glam::Vec3::new(normal(0), normal(1), normal(2)).normalize() * 4.0;
        let camera = Camera::look_at(eye, glam::Vec3::ZERO, eye.any_orthonormal_vector(), 0.7, 48, 32);
        let mean = [3, 4, 5].map(|index| 0.3 * normal(index));
        let quat = [6, 7, 8, 9].map(normal);
        let (own, exact) = (
            stamp_of(&splat(&shape::<f32>(mean, scales, quat, 3.0), &camera)),
            stamp_of(&splat(&shape::<Double>(mean, scales, quat, 3.0), &camera)),
        );
        let pixels = (0..12 * 8).map(|k| [4.0 * f64::from(k % 12) + 0.5, 4.0 * f64::from(k / 12) + 0.5]);
        // Rounding decides whether an alpha near the smallest is drawn.
        let apart = |pixel: [f64; 2]| {
            let [own, exact] = [alpha_at(&own, pixel), alpha_at(&exact, pixel)];
            assert!(own <= f64::from(blend::MAX_ALPHA), "an alpha of {own}");
            let is_cut = (own == 0.0) != (exact == 0.0);
            if is_cut { (own.max(exact) - f64::from(ALPHA_MIN)).abs() } else { (own - exact).abs() }
        };
        worst(pixels.map(apart))
    };
    assert_at_most("alpha of needles", worst((0..1000).map(off)), NEEDLE_ALPHA);
}

#[test]
fn a_determinant_keeps_its_digits_up_to_100_000_px() {
    let camera = lens(800, 800);
    let off = |length: &f32| {
        let [own, exact] =
            [determinant(&needle::<f32>(*length, &camera)), determinant(&needle::<Double>(*length, &camera))];
        let least = f64::from(BLUR * BLUR);
        assert!(own >= least * (1.0 - DETERMINANT), "{own} is below the square of the low-pass");
        (own / exact - 1.0).abs()
    };
    assert_at_most("determinant", worst(LENGTHS.iter().map(off)), DETERMINANT);
}

/// A point at one standard deviation along a needle and half a pixel across it.
pub(crate) fn point_beside(length: f32) -> [f32; 2] {
    let (sin, cos) = 37.0_f32.to_radians().sin_cos();
    [length * cos - 0.5 * sin, length * sin + 0.5 * cos]
}

pub(crate) fn exponent<R: Number>(length: f32, camera: &Camera) -> f64 {
    let Splat { mean2d, root_conic, .. } = needle::<R>(length, camera);
    let [dx, dy] = point_beside(length).map(|x| R::of(f64::from(x)));
    let footprint = Splat2d::new(mean2d, root_conic, dx.zero());
    blend::falloff(&footprint, dx, dy).log2_strength.value() * core::f64::consts::LN_2
}

#[test]
fn an_exponent_is_never_positive_and_close_up_to_100_000_px() {
    let camera = lens(800, 800);
    let off = |length: &f32| {
        let [own, exact] = [exponent::<f32>(*length, &camera), exponent::<Double>(*length, &camera)];
        assert!(own <= 0.0, "an exponent of {own}");
        println!("{length} px: {own} and {exact}");
        (own - exact).abs()
    };
    assert_at_most("exponent", worst(LENGTHS.iter().map(off)), EXPONENT);
}

#[test]
fn a_gaussian_through_the_plane_of_the_eye_makes_no_nan_and_no_flash() {
    let (mut exec, mut camera) = (CpuExecutor::new(), lens(48, 32));
    camera.position = glam::Vec3::ZERO;
    for scale in [0.01_f32, 0.1, 1.0, 10.0] {
        for step in -20..=20 {
            let z = 0.05 * step as f32;
            let picture = picture(&mut exec, &one([1.0, 0.2, z], [scale.ln(); 3], 3.0), &camera);
            assert!(picture.iter().all(|x| x.is_finite()), "a scale of {scale} at {z}");
            // Four of its standard deviations lie outside of the view, which is 20° wide to this
            // side.
            let is_beside = scale <= 0.1;
            let is_empty = passed(&picture, &camera).iter().all(|passed| *passed == 1.0);
            assert!(!is_beside || is_empty, "a Gaussian of {scale} beside the view shows at {z}");
        }
    }
}

#[test]
fn depths_are_in_total_order_and_others_are_counted() {
    let depths = [-1.0, -0.0, 0.0, 1e-45, 1e-30, 1e30, 1.0, f32::INFINITY, f32::NAN, 0.5];
    let mut camera = lens(48, 32);
    camera.position = glam::Vec3::ZERO;
    let mut cloud = random_cloud(depths.len(), LAYOUT, 2);
    for (gaussian, depth) in depths.into_iter().enumerate() {
        cloud.set(gaussian, MEAN, [0.0, 0.0, depth]);
        cloud.set(gaussian, OPACITY, [2.0]);
    }
    let mut exec = CpuExecutor::new();
    let splats = exec.project(&cloud, &camera).expect("the CPU projects");
    assert_eq!(exec.depth_order(&splats), [(0.5, 9), (1.0, 6), (1e30, 5)]);
    let cull = CullStats::of(&cloud, Some(&camera));
    let counts = [CullReason::Near, CullReason::NonfiniteMean, CullReason::Drawn].map(|reason| cull.count(reason));
    assert_eq!(counts, [5, 2, 3], "{cull:?}");
}

#[test]
fn a_hundred_thousand_coplanar_gaussians_are_the_same_bits_twice_and_on_one_thread() {
    const COUNT: usize = 100_000;
    let camera = lens(64, 64);
    let mut cloud = random_cloud(COUNT, LAYOUT, 3);
    for k in 0..COUNT {
        let [x, y] = [0, 1].map(|axis| random::uniform(5, axis, k as u64) - 0.5);
        cloud.set(k, MEAN, [x, y, 0.25]);
        cloud.set(k, LOG_SCALE, [-6.0; 3]);
    }
    let render = || picture(&mut CpuExecutor::new(), &cloud, &camera);
    let first = render();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let bits = |picture: &[f32]| picture.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert!(bits(&first) == bits(&render()), "twice");
    assert!(bits(&first) == bits(&pool.install(render)), "on one thread");
    let mut moved = cloud.clone();
    moved.set(0, MEAN, [0.0, 0.0, 0.2]);
    assert!(bits(&first) != bits(&picture(&mut CpuExecutor::new(), &moved, &camera)), "the comparison can fail");
}

#[test]
fn a_subpixel_splat_has_the_area_of_the_low_pass() {
    let camera = lens(33, 33);
    let scale = (0.01 * 4.0 / camera.focal_px[0]).ln();
    let passed = passed(&picture(&mut CpuExecutor::new(), &one([0.0; 3], [scale; 3], 30.0), &camera), &camera);
    let area: f64 = passed.iter().map(|passed| 1.0 - f64::from(*passed)).sum();
    let low_pass = core::f64::consts::TAU * f64::from(BLUR);
    assert_at_most("area of a splat of a hundredth of a pixel", (area / low_pass - 1.0).abs(), AREA);
}

/// The gradient of a shape whose splat has one everywhere.
fn gradient(shape: &Shape<f32>) -> Vec<f32> {
    let grad = SplatGrad { mean2d: [1.0; 2], root_conic: [1.0; 3], depth: 1.0, opacity: 1.0 };
    let grad = project_vjp(shape, &lens(48, 32).lift(0.0_f32), &grad);
    [&grad.mean.to_array()[..], &grad.log_scales.to_array(), &grad.quat, &[grad.opacity_logit]].concat()
}

#[test]
fn gradients_of_vanishing_scales_are_finite() {
    for scale in [1e-5_f32, 1e-10, 1e-20, 1e-30] {
        let flat = shape([0.1, 0.2, 0.3], [scale.ln(); 3], [1.0, 0.2, -0.3, 0.4], 0.0);
        let grad = gradient(&flat);
        assert!(grad.iter().all(|x| x.is_finite()), "{scale}: {grad:?}");
    }
}

#[test]
fn quats_of_any_length_are_rotations_or_the_identity_without_a_gradient() {
    let identity = rotation([1.0_f32, 0.0, 0.0, 0.0]);
    let ones = Mat3::constant(1.0_f32, glam::Mat3::from_cols_array(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]));
    for quat in [[0.0_f32; 4], [1e-30; 4]] {
        assert_eq!(rotation(quat), identity);
        assert_eq!(rotation_vjp(quat, &ones), [0.0; 4]);
    }
    let expected = rotation([0.5_f32; 4]);
    for length in [1e-10_f32, 1e10, 1e30, 3e38] {
        assert_eq!(rotation([length; 4]), expected, "{length}");
        assert!(rotation_vjp([length; 4], &ones).iter().all(|x| x.is_finite()), "{length}");
    }
    let none = gradient(&shape([0.0; 3], [-1.0; 3], [f32::NAN, 0.0, 0.0, 1.0], 0.0));
    assert!(none.iter().all(|x| *x == 0.0), "what is no number has no gradient: {none:?}");
}

#[test]
fn scales_of_every_size_are_drawn_or_have_a_reason() {
    let (mut exec, camera) = (CpuExecutor::new(), lens(48, 32));
    for log_scale in [-100.0, -40.0, 0.0, 20.0, 40.0, 44.0, 88.0, 100.0, 1e30] {
        let cloud = one([0.0; 3], [log_scale; 3], 3.0);
        let picture = picture(&mut exec, &cloud, &camera);
        assert!(picture.iter().all(|x| x.is_finite()), "e^{log_scale}");
        assert_eq!(CullStats::of(&cloud, Some(&camera)).count(CullReason::Drawn), 1, "e^{log_scale} is drawn");
        assert!(passed(&picture, &camera).iter().any(|passed| *passed < 0.7), "e^{log_scale} is seen");
    }
}

#[test]
fn extreme_but_valid_gaussians_stay_visible() {
    let (mut exec, camera) = (CpuExecutor::new(), lens(48, 32));
    let mut bright = one([0.0; 3], [-1.0; 3], 3.0);
    (0..3).for_each(|c| bright.set(0, LAYOUT.sh_start() + c, [1e4 / specula_core::sh::Y0]));
    let shown = picture(&mut exec, &bright, &camera);
    let brightest = shown[..3 * 48 * 32].iter().fold(0.0_f32, |most, x| most.max(*x));
    let expected = 0.9526 * specula_core::color::srgb_from_linear(1e4_f32);
    assert!((brightest / expected - 1.0).abs() < 0.05, "a colour of 10⁴ shows as {brightest}, not {expected}");
    // A million standard deviations of it are not in the picture, and it is all but opaque.
    let wide = one([0.0; 3], [20.0; 3], 16.118);
    let most = passed(&picture(&mut exec, &wide, &camera), &camera).iter().fold(0.0_f32, |most, x| most.max(*x));
    assert!(most <= 1.0 - blend::MAX_ALPHA + 1e-6, "it lets {most} through");
}

#[test]
fn a_splat_does_not_depend_on_where_tiles_begin() {
    let mut exec = CpuExecutor::new();
    let cloud = one([0.05, -0.02, 0.0], [-1.2, -2.0, -1.6], 4.595);
    let (width, height) = (64, 48);
    let at = |exec: &mut CpuExecutor, shift: u32| {
        let mut camera = lens(width + 16, height + 16);
        camera.focal_px = [60.0; 2];
        camera.principal_px = [32.0, 24.0].map(|x| x + shift as f32);
        let shown = passed(&picture(exec, &cloud, &camera), &camera);
        let row = |y: u32| {
            let first = ((y + shift) * camera.width + shift) as usize;
            shown[first..first + width as usize].to_vec()
        };
        (0..height).flat_map(row).collect::<Vec<f32>>()
    };
    let first = at(&mut exec, 0);
    let apart = |shift: u32| {
        let shifted = at(&mut exec, shift);
        worst(first.iter().zip(&shifted).map(|(a, b)| {
            // The rim, where an alpha of 1/255 is cut off, depends on rounding.
            let is_cut = (*a == 1.0) != (*b == 1.0);
            if is_cut { f64::from((a - b).abs() - ALPHA_MIN).abs() } else { f64::from((a - b).abs()) }
        }))
    };
    assert_at_most("a splat on shifted tiles", worst((1..16).map(apart)), SHIFTED);
}

#[test]
fn tiles_cover_the_visible_extent_of_a_splat() {
    let own = splat(&shape::<f32>([0.0; 3], [-1.0; 3], [1.0, 0.0, 0.0, 0.0], 30.0), &lens(64, 64));
    let reach = footprint(&own).reach;
    let at_reach = (-0.5 * reach * reach).exp();
    assert!((at_reach / ALPHA_MIN - 1.0).abs() < 1e-5, "at {reach} standard deviations it is {at_reach}");
    assert!(reach > 3.3, "an opaque splat is seen beyond three standard deviations");
}

/// No Gaussian of the extreme cases is culled without a reason.
#[test]
fn every_gaussian_of_the_hard_scenes_has_a_reason_and_none_is_not_finite_but_where_it_is() {
    for Case { name, cloud, camera, .. } in every_case() {
        let nonfinite = (0..cloud.count)
            .filter(|k| (0..LAYOUT.plane_count()).any(|plane| !cloud.get::<1>(*k, plane)[0].is_finite()))
            .count();
        assert_eq!(CullStats::of(&cloud, Some(&camera)).nonfinite(), nonfinite, "{name}");
    }
}

/// Tolerance of a picture against that of `f64`, relative to a number or to one.
const SAME_PICTURE: f64 = 1e-4;

/// Errors of the picture of a case against that of `f64`, number by number, the largest last.
fn distances(name: &str) -> Vec<f64> {
    let case = every_case().into_iter().find(|case| case.name == name).expect("a case of that name");
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Training);
    let exact = plain::render::<Double>(&plain::lift_gaussians(&case.cloud), None, &case.camera, &rules);
    let own = picture(&mut CpuExecutor::new(), &case.cloud, &case.camera);
    let apart = |(own, exact): (&f32, &Double)| (f64::from(*own) - exact.0).abs() / exact.0.abs().max(1.0);
    let mut distances: Vec<f64> = own.iter().zip(&exact.values).map(apart).collect();
    distances.sort_by(f64::total_cmp);
    distances
}

#[test]
fn gaussians_at_nonfinite_places_are_skipped_in_f64_as_in_f32() {
    let case = every_case().into_iter().find(|case| case.name == "nowhere").expect("a case of that name");
    let cull = CullStats::of(&case.cloud, Some(&case.camera));
    assert!(cull.nonfinite() > 20 && cull.count(CullReason::Drawn) > 10, "some of it is somewhere: {cull:?}");
    let distances = distances(case.name);
    println!("all but one in a hundred: {:.1e}", distances[distances.len() * 99 / 100]);
    assert_at_most("a scene of which much is nowhere", distances[distances.len() - 1], SAME_PICTURE);
}

#[test]
fn a_world_of_a_millionth_is_drawn_as_f64_draws_it() {
    let name = "a world of a millionth";
    let case = every_case().into_iter().find(|case| case.name == name).expect("a case of that name");
    assert!(
        CullStats::of(&case.cloud, Some(&case.camera)).count(CullReason::Drawn) > 50,
        "it is in front of the near plane"
    );
    let distances = distances(name);
    println!("all but one in a hundred: {:.1e}", distances[distances.len() * 99 / 100]);
    assert_at_most("a world of a millionth", distances[distances.len() - 1], SAME_PICTURE);
}
