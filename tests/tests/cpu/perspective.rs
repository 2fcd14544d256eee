//! The perspective inside of splats: against rays through Gaussians, computed without any formula
//! of core.

use glam::{DMat3, DQuat, DVec3};
use proptest::prelude::*;
use specula_core::{
    antialias::{BLUR, LowPass},
    bin::footprint,
    camera::Camera,
    cutoffs::ProjectionModel,
    double::Double,
    perspective::{
        Perspective, affine_error, footprint_in_perspective, log2_strength, perspective, ray_scale, scaled_curvature,
    },
    project::{Shape, project},
    real::Real,
    splat::{ROOT_SCALE, Splat},
    vector::vec3,
};
use specula_tests::strategies::same_every_time;

/// `f64`, but for constants of formulas, which are `f32`'s.
const SAME: f64 = 1e-6;
/// `f32` through the same: a few hundred units in the last place, of which the mean's distance from
/// the axis has most.
const SAME_IN_F32: f64 = 2e-4;
/// The published table has two or three digits.
const OF_TABLE: f64 = 0.06;

/// A Gaussian in plain numbers.
#[derive(Clone, Copy, Debug)]
struct Ball {
    mean: DVec3,
    scales: DVec3,
    quat: DQuat,
}

impl Ball {
    fn shape(&self) -> Shape<Double> {
        let of = |v: DVec3| vec3(Double(v.x), Double(v.y), Double(v.z));
        Shape {
            mean: of(self.mean),
            log_scales: of(DVec3::new(self.scales.x.ln(), self.scales.y.ln(), self.scales.z.ln())),
            quat: [self.quat.w, self.quat.x, self.quat.y, self.quat.z].map(Double),
            // As good as one.
            opacity_logit: Double(40.0),
            low_pass: LowPass::Dilated,
            filter: None,
        }
    }

    fn covariance(&self) -> DMat3 {
        let rotation = DMat3::from_quat(self.quat);
        rotation * DMat3::from_diagonal(self.scales * self.scales) * rotation.transpose()
    }
}

/// Looks along +z from the origin, so that the camera's space is the world.
fn straight(focal: [f32; 2]) -> Camera {
    Camera {
        camera_from_world: glam::Mat3::IDENTITY,
        position: glam::Vec3::ZERO,
        focal_px: focal,
        principal_px: [50.0, 40.0],
        light_from_world: None,
        scissor: None,
        light: 0,
        width: 100,
        height: 80,
        near: 0.0,
    }
}

/// Least squared distance from the mean, in standard deviations, of a point of the ray in front of
/// the eye.
fn along_the_ray(ball: &Ball, camera: &Camera, pixel: [f64; 2], blur: f64) -> f64 {
    let axis = |k: usize| (pixel[k] - f64::from(camera.principal_px[k])) / f64::from(camera.focal_px[k]);
    let ray = DVec3::new(axis(0), axis(1), 1.0);
    let wide = |k: usize| (ball.mean.z / f64::from(camera.focal_px[k])).powi(2) * blur;
    let covariance = ball.covariance() + DMat3::from_diagonal(DVec3::new(wide(0), wide(1), 0.0));
    let (ray, mean) = (in_deviations(covariance, ray), in_deviations(covariance, ball.mean));
    let distance = |t: f64| (ray * t - mean).length_squared();
    distance((ray.dot(mean) / ray.length_squared()).max(0.0))
}

/// L⁻¹ v with L Lᵀ = Σ: unlike Σ⁻¹ by its adjugate it keeps the digits of needles, which have
/// lengths of 1 : 1000.
fn in_deviations(covariance: DMat3, v: DVec3) -> DVec3 {
    let [a, b, c] = covariance.to_cols_array_2d();
    let xx = a[0].sqrt();
    let (yx, zx) = (a[1] / xx, a[2] / xx);
    let yy = (b[1] - yx * yx).sqrt();
    let zy = (b[2] - zx * yx) / yy;
    let zz = (c[2] - zx * zx - zy * zy).sqrt();
    let x = v.x / xx;
    let y = (v.y - yx * x) / yy;
    DVec3::new(x, y, (v.z - zx * x - zy * y) / zz)
}

struct Projected<R> {
    splat: Splat<R>,
    perspective: Perspective<R>,
}

fn projected(ball: &Ball, camera: &Camera, projection: ProjectionModel) -> Projected<Double> {
    let (shape, camera) = (ball.shape(), camera.lift(Double(0.0)).for_projection(projection));
    let splat = project(&shape, &camera);
    Projected { perspective: perspective(projection, &shape, &splat, &camera), splat }
}

impl<R: Real> Projected<R> {
    /// Squared distance in standard deviations at a pixel.
    fn distance(&self, pixel: [R; 2]) -> R {
        let delta = [pixel[0] - self.splat.mean2d[0], pixel[1] - self.splat.mean2d[1]];
        let [xx, yx, yy] = self.splat.root_conic;
        let (u, w) = (xx * delta[0], yx * delta[0] + yy * delta[1]);
        let one = xx.constant(1.0);
        let scale = ray_scale(one, self.perspective.slope, delta);
        let squared = (u * u + w * w) * (ROOT_SCALE * ROOT_SCALE);
        let log2 = log2_strength(xx.zero(), squared, scale, scaled_curvature(self.perspective.curvature));
        -log2 / (ROOT_SCALE * ROOT_SCALE)
    }
}

fn ball(scales: core::ops::Range<f64>) -> impl Strategy<Value = Ball> {
    let (low, high) = (scales.start.ln(), scales.end.ln());
    let place = (-4.0..4.0, -4.0..4.0, 0.3..6.0).prop_map(|(x, y, z): (f64, f64, f64)| DVec3::new(x, y, z));
    let scales = prop::array::uniform3((low..high).prop_map(f64::exp)).prop_map(DVec3::from_array);
    let quat = prop::array::uniform4(-1.0..1.0_f64)
        .prop_filter("a quat has a length", |q| q.iter().map(|x| x * x).sum::<f64>() > 1e-3)
        .prop_map(|q| DQuat::from_array(q).normalize());
    (place, scales, quat).prop_map(|(mean, scales, quat)| Ball { mean, scales, quat })
}

fn pixel() -> impl Strategy<Value = [f64; 2]> {
    prop::array::uniform2(-300.0..400.0_f64)
}

proptest! {
    #![proptest_config(same_every_time())]

    #[test]
    fn projection_along_rays_gives_the_largest_response(
        ball in ball(1e-2..10.0), pixel in pixel(), focal in prop::array::uniform2(20.0..300.0_f32)
    ) {
        let camera = straight(focal);
        let own = projected(&ball, &camera, ProjectionModel::Ray).distance(pixel.map(Double)).0;
        let expected = along_the_ray(&ball, &camera, pixel, f64::from(BLUR));
        prop_assert!((own - expected).abs() <= SAME * expected.max(1.0), "{own} and {expected}");
    }

    #[test]
    fn all_projections_of_narrow_gaussians_agree(ball in ball(1e-6..1e-5)) {
        let camera = straight([1e5, 1e5]);
        let at = projected(&ball, &camera, ProjectionModel::Ray).splat.mean2d.map(|x| Double(x.0 + 1.0));
        let [affine, tangent, ray] = [ProjectionModel::Within(1.0), ProjectionModel::Tangent, ProjectionModel::Ray]
            .map(|projection| projected(&ball, &camera, projection).distance(at).0);
        prop_assert!((tangent / affine - 1.0).abs() < 1e-3 && (ray / affine - 1.0).abs() < 1e-3, "{affine} {tangent} {ray}");
    }

    #[test]
    fn the_edge_of_a_footprint_is_where_the_splat_ends(
        ball in ball(1e-3..2.0), turn in 0.0..6.3_f64, reach in 0.5..7.0_f64
    ) {
        let camera = straight([80.0, 80.0]);
        let projected = projected(&ball, &camera, ProjectionModel::Ray);
        let (outline, variance) = footprint_in_perspective(&projected.splat, &projected.perspective, Double(reach));
        prop_assume!(variance[0].0.is_finite());
        let [xx, yx, yy] = outline.root_conic.map(|x| x.0);
        let (u, w) = (reach * turn.cos(), reach * turn.sin());
        let x = u / xx;
        let edge = [x + outline.mean2d[0].0, (w - yx * x) / yy + outline.mean2d[1].0];
        let own = projected.distance(edge.map(Double)).0;
        prop_assert!((own / (reach * reach) - 1.0).abs() < 1e-6, "{own} at the edge of {}", reach * reach);
        prop_assert!((edge[0] - outline.mean2d[0].0).abs() <= variance[0].0.sqrt() * reach * (1.0 + 1e-6));
        prop_assert!((edge[1] - outline.mean2d[1].0).abs() <= variance[1].0.sqrt() * reach * (1.0 + 1e-6));
    }

    #[test]
    fn a_footprint_is_everywhere_only_where_it_is_no_ellipse_that_ends(ball in ball(0.5..30.0), reach in 0.5..7.0_f64) {
        let camera = straight([80.0, 80.0]);
        let projected = projected(&ball, &camera, ProjectionModel::Ray);
        let (_, variance) = footprint_in_perspective(&projected.splat, &projected.perspective, Double(reach));
        prop_assume!(variance[0].0.is_infinite());
        // Far away where rays are longest it is still, or almost, within reach.
        let ([xx, yx, yy], [x, y]) = (projected.splat.root_conic.map(|x| x.0), projected.perspective.slope.map(|x| x.0));
        let second = y / yy;
        let first = (x - yx * second) / xx;
        let (x, y) = (first / xx, (second - yx * first / xx) / yy);
        let far = 1e9 / x.hypot(y);
        let far = projected.distance([x * far, y * far].map(Double)).0.sqrt();
        prop_assert!(far < 1.02 * reach, "{far} of {reach}");
    }

    #[test]
    fn f32_is_close_to_f64(ball in ball(1e-4..30.0), pixel in pixel()) {
        let camera = straight([90.0, 80.0]);
        let shape = ball.shape();
        let narrow = |v: specula_core::vector::Vec3<Double>| vec3(v.x.0 as f32, v.y.0 as f32, v.z.0 as f32);
        let own = Shape {
            mean: narrow(shape.mean),
            log_scales: narrow(shape.log_scales),
            quat: shape.quat.map(|x| x.0 as f32),
            opacity_logit: 40.0,
            low_pass: LowPass::Dilated,
            filter: None,
        };
        let lifted = camera.lift(0.0_f32).for_projection(ProjectionModel::Ray);
        let splat = project(&own, &lifted);
        let own = Projected { perspective: perspective(ProjectionModel::Ray, &own, &splat, &lifted), splat };
        let strength = |distance: f64| (-0.5 * distance).exp();
        let own = strength(own.distance(pixel.map(|x| x as f32)).into());
        let exact = strength(projected(&ball, &camera, ProjectionModel::Ray).distance(pixel.map(Double)).0);
        prop_assert!((own - exact).abs() < SAME_IN_F32, "{own} and {exact}");
    }

    #[test]
    fn turning_the_camera_changes_only_affine_projections(
        ball in ball(0.2..0.4), turn in prop::array::uniform2(-0.6..0.6_f64)
    ) {
        let ball = Ball { mean: ball.mean * DVec3::new(0.1, 0.1, 0.5) + DVec3::Z, ..ball };
        // Of many pixels, so that the low-pass is too narrow to be projected.
        let camera = straight([1e5, 1e5]);
        let turn = DQuat::from_rotation_y(turn[0]) * DQuat::from_rotation_x(turn[1]);
        let turned = Ball { mean: turn * ball.mean, quat: turn * ball.quat, ..ball };
        prop_assume!(turned.mean.z > 0.3);
        let ray = ball.mean + DVec3::new(0.1, -0.15, 0.05);
        let pixel = |ray: DVec3| {
            [50.0 + 1e5 * ray.x / ray.z, 40.0 + 1e5 * ray.y / ray.z].map(Double)
        };
        for projection in [ProjectionModel::Tangent, ProjectionModel::Ray] {
            let before = projected(&ball, &camera, projection).distance(pixel(ray)).0;
            let after = projected(&turned, &camera, projection).distance(pixel(turn * ray)).0;
            prop_assert!((before / after - 1.0).abs() < 1e-4, "{projection:?}: {before} and {after}");
        }
    }
}

/// Largest difference of alphas from exact ones over a footprint, without low-pass.
fn largest_error(ball: &Ball, projection: ProjectionModel) -> f64 {
    let camera = straight([1e6, 1e6]);
    let projected = projected(ball, &camera, projection);
    let [x, y] = projected.splat.mean2d.map(|x| x.0);
    let half = [0, 1].map(|axis| 4.0 * projected.splat.variance[axis].0.sqrt());
    let steps = || (-100..=100).map(|k| f64::from(k) / 100.0);
    let mut largest = 0.0_f64;
    for (across, down) in steps().flat_map(|across| steps().map(move |down| (across, down))) {
        let pixel = [x + across * half[0], y + down * half[1]];
        let strength = |distance: f64| (-0.5 * distance).exp();
        let exact = strength(along_the_ray(ball, &camera, pixel, 0.0));
        largest = largest.max((strength(projected.distance(pixel.map(Double)).0) - exact).abs());
    }
    largest
}

fn at(degrees: f64, scales: DVec3, tilt: f64) -> Ball {
    let turn = DQuat::from_rotation_y(degrees.to_radians());
    Ball { mean: turn * DVec3::Z, scales, quat: turn * DQuat::from_rotation_y(tilt.to_radians()) }
}

#[test]
fn errors_are_those_of_the_published_table() {
    let (round, flat) = (DVec3::splat(1.0), DVec3::new(1.0, 1.0, 1e-4));
    // numerics: shape, angle off the axis, tilt, scale, affine, tangent.
    let rows = [
        (round, 0.0, 0.0, 0.1, 0.011, 0.011),
        (round, 30.0, 0.0, 0.1, 0.076, 0.011),
        (round, 60.0, 0.0, 0.03, 0.061, 0.001),
        (round, 60.0, 0.0, 0.3, 0.542, 0.096),
        (round, 75.0, 0.0, 0.1, 0.399, 0.011),
        (flat, 30.0, 0.0, 0.03, 0.020, 0.0),
        (flat, 60.0, 0.0, 0.1, 0.197, 0.0),
        (flat, 0.0, 60.0, 0.1, 0.100, 0.100),
    ];
    for (shape, degrees, tilt, scale, affine, tangent) in rows {
        let ball = at(degrees, shape * scale, tilt);
        for (projection, expected) in [(ProjectionModel::Within(1e9), affine), (ProjectionModel::Tangent, tangent)] {
            let own = largest_error(&ball, projection);
            let allowed = OF_TABLE * expected + 1e-3;
            assert!((own - expected).abs() < allowed, "{degrees} {tilt} {scale} {projection:?}: {own}, not {expected}");
        }
        assert!(largest_error(&ball, ProjectionModel::Ray) < SAME, "{degrees} {tilt} {scale}");
    }
}

#[test]
fn the_error_of_the_affine_projection_is_predicted() {
    for (degrees, tilt, scale) in [(10.0, 0.0, 0.03), (45.0, 30.0, 0.02), (60.0, 0.0, 0.01), (0.0, 60.0, 0.03)] {
        let ball = at(degrees, DVec3::new(1.0, 0.5, 0.2) * scale, tilt);
        let projected = projected(&ball, &straight([1e6, 1e6]), ProjectionModel::Ray);
        let (foretold, own) = (
            affine_error(&projected.splat, &projected.perspective).0,
            largest_error(&ball, ProjectionModel::Within(1e9)),
        );
        assert!(own < 1.1 * foretold && foretold < 1.6 * own, "{degrees} {tilt} {scale}: {own} of {foretold}");
        let kept = |alpha: f32| {
            let own = self::projected(&ball, &straight([1e6, 1e6]), ProjectionModel::Within(alpha)).perspective;
            (own.slope, own.curvature)
        };
        assert_eq!(kept(0.99 * foretold as f32), (projected.perspective.slope, projected.perspective.curvature));
        assert_eq!(kept(1.01 * foretold as f32), ([Double(0.0); 2], Double(0.0)));
    }
}

#[test]
fn affine_splats_have_the_same_footprint_in_perspective() {
    let ball = at(20.0, DVec3::new(0.1, 0.05, 0.01), 30.0);
    let projected = projected(&ball, &straight([100.0, 100.0]), ProjectionModel::Within(1e9));
    let expected = footprint(&projected.splat);
    let (own, variance) = footprint_in_perspective(&projected.splat, &projected.perspective, expected.reach);
    for k in 0..3 {
        assert!((own.root_conic[k].0 - expected.root_conic[k].0).abs() < SAME);
    }
    assert_eq!(own.mean2d, expected.mean2d);
    assert!((variance[0].0 / projected.splat.variance[0].0 - 1.0).abs() < SAME);
}
