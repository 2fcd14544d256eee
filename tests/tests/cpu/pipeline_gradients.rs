//! The plain pipeline's gradients are those of its loss, and its prefilter is the integral that it
//! approximates.

use specula_core::{
    camera::Camera,
    cubemap,
    double::Double,
    dual::Dual,
    ggx,
    loss::{LossWeights, NormalForm},
    prefilter::PrefilterScheme,
    random,
    rules::{Channels, RenderRules},
    scene::{
        DIFFUSE, Environment, Gaussians, LOG_SCALE, Layout, MEAN, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY, QUAT,
        ROUGHNESS, RadianceActivation, TINT,
    },
    shade::ShadingRules,
    vector::{Vec3, vec3},
};
use specula_tests::{
    compare::{ROUNDING_F64, assert_close},
    plain::{
        self, FrozenWeights, Light, Operator, Target, View, lift_environment, lift_gaussians, loss_and_gradient,
        prefilter,
    },
    strategies::{random_cloud, random_environment, under_turned_light},
};

/// Products of gradients and directions in `f64`, as a share of the sum of their magnitudes:
/// roundings are 1e-15. Means of physical materials and quats of plain Gaussians are 4e-9 and 7e-9
/// off, for a reason that is not known.
const SAME_SLOPE: f64 = 2e-8;
/// Directions that are compared, so that errors along one do not cancel in another.
const DIRECTIONS: u64 = 2;
/// Resolution of a difference quotient of a loss near 1, relative to its slope.
const SAME_DIFFERENCE: f64 = 1e-6;
/// Step of the difference quotient. Its error is h⁴ after Richardson's extrapolation, and 1e-16 / h
/// from rounding.
const STEP: f64 = 2e-5;

const WEIGHTS: LossWeights = LossWeights {
    absolute: 0.8,
    squared: 0.3,
    dssim: 0.2,
    normal: 0.2,
    normal_form: NormalForm::Distance,
    smoothness: 0.3,
    sparse_coverage: 0.01,
    residual_image: 0.1,
    coverage: 0.1,
    sparse: 0.01,
    residual: 0.05,
    ..LossWeights::NONE
};

const RULES: RenderRules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Training);

struct Scene {
    gaussians: Gaussians<Vec<Double>>,
    environment: Environment<Vec<Double>>,
    camera: Camera,
    target: Target<Double>,
    rules: RenderRules,
    weights: LossWeights,
}

const BASE: usize = 16;
/// Edge of the pictures, in pixels.
const EDGE: usize = 20;

impl Scene {
    fn new(seed: u64, layout: Layout, activation: RadianceActivation, normal_form: NormalForm) -> Self {
        let count = 6 + (seed % 3) as usize * 3;
        let mut cloud = random_cloud(count, layout, seed);
        for gaussian in 0..count / 2 {
            // Large and opaque, so that there is a surface for the normal loss to see.
            cloud.set(gaussian, OPACITY, [2.5 + 0.3 * gaussian as f32]);
            let log_scales = cloud.get::<3>(gaussian, LOG_SCALE).map(|x| 0.5 * x - 0.2);
            cloud.set(gaussian, LOG_SCALE, log_scales);
        }
        let turn = 6.0 * random::uniform(seed, 9, 0);
        let position = glam::Vec3::new(4.0 * turn.cos(), 4.0 * turn.sin(), 1.0);
        let camera = Camera::look_at(position, glam::Vec3::ZERO, glam::Vec3::Z, 0.6, EDGE as u32, EDGE as u32);
        let draw = |index: usize| Double(f64::from(random::uniform(seed, 10, index as u64)));
        let target = Target {
            srgb: (0..3 * EDGE * EDGE).map(draw).collect(),
            alpha: Some((0..EDGE * EDGE).map(|k| draw(10_000 + k)).collect()),
            background: [0.2, 0.5, 0.9],
            is_clipped: true,
        };
        Self {
            gaussians: lift_gaussians(&cloud),
            environment: lift_environment(&random_environment(BASE, activation, seed)),
            camera,
            target,
            rules: RULES,
            weights: LossWeights { normal_form, ..WEIGHTS },
        }
    }

    fn view(&self) -> View<'_, Double> {
        View {
            camera: &self.camera,
            target: &self.target,
            rules: &self.rules,
            weights: &self.weights,
            near_field: None,
        }
    }

    /// The loss of Gaussians and a light of dual numbers, with the weights held fixed.
    fn dual_loss(&self, gaussians: &Gaussians<Vec<Dual>>, light: &Light<Dual>, frozen: &FrozenWeights) -> Dual {
        let dual = |x: &Double| Dual::constant_from(x.0);
        let target = Target {
            srgb: self.target.srgb.iter().map(dual).collect(),
            alpha: self.target.alpha.as_ref().map(|alpha| alpha.iter().map(dual).collect()),
            background: self.target.background,
            is_clipped: self.target.is_clipped,
        };
        let Self { camera, rules, weights, .. } = self;
        let view = View { camera, target: &target, rules, weights, near_field: None };
        plain::loss(gaussians, Some(light), &view, Some(frozen))
    }
}

/// Numbers that move along a direction.
fn moved(values: &[Double], direction: &[f64]) -> Vec<Dual> {
    values.iter().zip(direction).map(|(x, slope)| Dual { value: x.0, slope: *slope }).collect()
}

/// Numbers between −1/2 and 1/2.
fn direction(count: usize, draw: u64) -> Vec<f64> {
    (0..count).map(|k| f64::from(random::uniform(draw, 77, k as u64)) - 0.5).collect()
}

/// Checks a gradient against the slope along a direction.
#[track_caller]
fn assert_slope(what: &str, gradient: &[f64], direction: &[f64], slope: f64) {
    let products = || gradient.iter().zip(direction).map(|(g, d)| g * d);
    let (along, magnitude) = (products().sum::<f64>(), products().map(f64::abs).sum::<f64>());
    assert!(magnitude > 0.0, "no gradient reaches {what}");
    let difference = (slope - along).abs() / magnitude;
    println!("{what}: {difference:.1e}");
    assert!(difference <= SAME_SLOPE, "{what}: {along:e} is not {slope:e}, by {difference:e} of {magnitude:e}");
}

const SHADED: [(&str, usize, usize); 10] = [
    ("mean", MEAN, LOG_SCALE),
    ("log scale", LOG_SCALE, QUAT),
    ("quat", QUAT, OPACITY),
    ("opacity", OPACITY, DIFFUSE),
    ("diffuse", DIFFUSE, TINT),
    ("tint", TINT, ROUGHNESS),
    ("roughness", ROUGHNESS, NORMAL_RESIDUAL_1),
    ("first normal residual", NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2),
    ("second normal residual", NORMAL_RESIDUAL_2, 24),
    ("residual harmonics", 24, usize::MAX),
];
const PLAIN: [(&str, usize, usize); 5] = [
    ("mean", MEAN, LOG_SCALE),
    ("log scale", LOG_SCALE, QUAT),
    ("quat", QUAT, OPACITY),
    ("opacity", OPACITY, 11),
    ("harmonics", 11, usize::MAX),
];
/// Of [`Layout::shaded`] without harmonics.
const PHYSICAL: [(&str, usize, usize); 9] = [
    ("mean", MEAN, LOG_SCALE),
    ("log scale", LOG_SCALE, QUAT),
    ("quat", QUAT, OPACITY),
    ("opacity", OPACITY, DIFFUSE),
    ("roughness", ROUGHNESS, NORMAL_RESIDUAL_1),
    ("first normal residual", NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2),
    ("second normal residual", NORMAL_RESIDUAL_2, 24),
    ("albedo", 24, 27),
    ("metalness", 27, 28),
];

fn gaussian_gradients_are_right(scene: &Scene, attributes: &[(&str, usize, usize)]) -> FrozenWeights {
    let operator = Operator::new(BASE);
    let still = |values: &[Double]| moved(values, &vec![0.0; values.len()]);
    let light = prefilter(&scene.environment.with_values(still(&scene.environment.values)), &operator);
    let (_, gradient, frozen) =
        loss_and_gradient(&scene.gaussians, Some((&scene.environment, &operator)), &scene.view());
    let gradient: Vec<f64> = gradient.gaussians.values.iter().map(|g| g.0).collect();
    let Gaussians { count, layout, values } = &scene.gaussians;
    for &(name, first, end) in attributes {
        let mut is_part = vec![false; values.len()];
        for plane in first..end.min(layout.plane_count()) {
            (0..*count).for_each(|gaussian| is_part[scene.gaussians.index_of(gaussian, plane)] = true);
        }
        for draw in 0..DIRECTIONS {
            let mut direction = direction(values.len(), draw);
            direction.iter_mut().zip(&is_part).for_each(|(d, is_part)| *d *= f64::from(u8::from(*is_part)));
            let moving = scene.gaussians.with_values(moved(values, &direction));
            assert_slope(name, &gradient, &direction, scene.dual_loss(&moving, &light, &frozen).slope);
        }
    }
    frozen
}

#[test]
fn gradients_of_a_shaded_cloud_are_those_of_its_loss() {
    let scene = Scene::new(1, Layout::shaded(Some(1)), RadianceActivation::Identity, NormalForm::Distance);
    let frozen = gaussian_gradients_are_right(&scene, &SHADED);
    assert!(frozen.surface_count() > 5, "the normal loss sees {} pixels", frozen.surface_count());
}

#[test]
fn gradients_of_another_cloud_with_harmonics_of_degree_two_are_right() {
    let scene = Scene::new(2, Layout::shaded(Some(2)), RadianceActivation::Exponential, NormalForm::Cosine);
    let frozen = gaussian_gradients_are_right(&scene, &SHADED);
    assert!(frozen.surface_count() > 5, "the normal loss sees {} pixels", frozen.surface_count());
}

#[test]
fn gradients_under_the_first_row_and_unnegated_residuals_are_right() {
    let mut scene = Scene::new(3, Layout::shaded(Some(0)), RadianceActivation::Identity, NormalForm::Distance);
    scene.rules.shading.axis = ShadingRules::OFFICIAL.axis;
    scene.rules.shading.negate_second_residual = false;
    gaussian_gradients_are_right(&scene, &SHADED);
}

#[test]
fn gradients_of_light_added_pixel_by_pixel_are_right() {
    let mut scene = Scene::new(6, Layout::shaded(Some(1)), RadianceActivation::Exponential, NormalForm::Cosine);
    scene.rules.shading = ShadingRules::DEFERRED;
    gaussian_gradients_are_right(&scene, &SHADED);
}

/// Half of the true picture is white, and the light bright enough to outshine it.
#[test]
fn gradients_where_pictures_saturate_are_right() {
    let mut scene = Scene::new(6, Layout::shaded(Some(1)), RadianceActivation::Exponential, NormalForm::Cosine);
    scene.rules.shading = ShadingRules::DEFERRED;
    scene.environment.values.iter_mut().for_each(|value| value.0 += 2.0);
    let alpha = scene.target.alpha.as_mut().expect("the target has one");
    alpha.iter_mut().for_each(|alpha| alpha.0 = 1.0);
    scene.target.srgb.iter_mut().step_by(2).for_each(|number| number.0 = 1.0);
    let loss_of = |scene: &Scene| {
        let light = prefilter(&scene.environment, &Operator::new(BASE));
        plain::loss(&scene.gaussians, Some(&light), &scene.view(), None).0
    };
    let exact = loss_of(&scene);
    scene.weights.saturates = true;
    assert!(loss_of(&scene) < exact, "something is brighter than white");
    gaussian_gradients_are_right(&scene, &SHADED);
}

/// The true picture is up to five times as bright as white.
#[test]
fn gradients_of_pictures_without_a_limit_are_right() {
    let mut scene = Scene::new(6, Layout::shaded(Some(1)), RadianceActivation::Exponential, NormalForm::Cosine);
    scene.rules.shading = ShadingRules::DEFERRED;
    scene.environment.values.iter_mut().for_each(|value| value.0 += 1.0);
    scene.target.srgb.iter_mut().step_by(2).for_each(|number| number.0 *= 5.0);
    (scene.target.is_clipped, scene.weights.saturates) = (false, true);
    gaussian_gradients_are_right(&scene, &SHADED);
}

#[test]
fn gradients_of_physical_materials_are_right() {
    let layout = Layout::shaded(None).physical();
    let mut scene = Scene::new(6, layout, RadianceActivation::Exponential, NormalForm::Cosine);
    scene.rules.shading = ShadingRules::PHYSICAL;
    gaussian_gradients_are_right(&scene, &PHYSICAL);
}

#[test]
fn gradients_under_turned_lights_are_right() {
    for (shading, layout, attributes) in [
        (ShadingRules::PAPER, Layout::shaded(Some(1)), &SHADED[..]),
        (ShadingRules::PHYSICAL, Layout::shaded(None).physical(), &PHYSICAL[..]),
    ] {
        let mut scene = Scene::new(6, layout, RadianceActivation::Exponential, NormalForm::Cosine);
        scene.rules.shading = shading;
        scene.camera = under_turned_light(scene.camera);
        gaussian_gradients_are_right(&scene, attributes);
    }
}

/// Plain Gaussians have no gradient from normals: only from colours and coverage.
#[test]
fn gradients_of_a_plain_cloud_are_those_of_its_loss() {
    let mut scene = Scene::new(4, Layout::radiance(3), RadianceActivation::Identity, NormalForm::Distance);
    scene.weights.normal = 0.0;
    gaussian_gradients_are_right(&scene, &PLAIN);
}

#[test]
fn gradients_of_only_colour_are_right() {
    let mut scene = Scene::new(5, Layout::shaded(None), RadianceActivation::Identity, NormalForm::Distance);
    scene.rules.channels = Channels::Color;
    let without_harmonics = &SHADED[..9];
    gaussian_gradients_are_right(&scene, without_harmonics);
}

#[test]
#[should_panic(expected = "is not")]
fn a_single_number_off_by_a_hundred_thousandth_is_found() {
    let (mut gradient, direction) = (direction(300, 5), direction(300, 6));
    let slope = gradient.iter().zip(&direction).map(|(g, d)| g * d).sum();
    assert_slope("right", &gradient, &direction, slope);
    gradient[7] *= 1.000_01;
    assert_slope("wrong", &gradient, &direction, slope);
}

fn light_gradients_are_right(activation: RadianceActivation, shading: ShadingRules, seed: u64) {
    let layout = Layout::shaded(None);
    let layout = if shading == ShadingRules::PHYSICAL { layout.physical() } else { layout };
    let mut scene = Scene::new(seed, layout, activation, NormalForm::Distance);
    scene.rules.shading = shading;
    let operator = Operator::new(BASE);
    let (_, gradient, frozen) =
        loss_and_gradient(&scene.gaussians, Some((&scene.environment, &operator)), &scene.view());
    let gradient: Vec<f64> = gradient.environment.expect("there is a light").iter().map(|g| g.0).collect();
    let gaussians =
        scene.gaussians.with_values(moved(&scene.gaussians.values, &vec![0.0; scene.gaussians.values.len()]));
    for draw in 0..DIRECTIONS {
        let direction = direction(gradient.len(), draw);
        let moving = scene.environment.with_values(moved(&scene.environment.values, &direction));
        let slope = scene.dual_loss(&gaussians, &prefilter(&moving, &operator), &frozen).slope;
        assert_slope("texels", &gradient, &direction, slope);
    }
}

#[test]
fn gradients_of_a_light_of_plain_numbers_are_those_of_the_loss() {
    light_gradients_are_right(RadianceActivation::Identity, ShadingRules::PAPER, 6);
}

#[test]
fn gradients_of_a_light_of_logarithms_are_those_of_the_loss() {
    light_gradients_are_right(RadianceActivation::Exponential, ShadingRules::PAPER, 7);
}

#[test]
fn gradients_of_a_light_that_pixels_look_up_are_those_of_the_loss() {
    light_gradients_are_right(RadianceActivation::Exponential, ShadingRules::DEFERRED, 8);
    light_gradients_are_right(RadianceActivation::Exponential, ShadingRules::PHYSICAL, 8);
}

fn random_texels(count: usize, stream: u64) -> Vec<Vec3<Double>> {
    let draw = |k: usize| Double(2.0 * f64::from(random::uniform(5, stream, k as u64)) - 1.0);
    (0..count).map(|k| vec3(draw(3 * k), draw(3 * k + 1), draw(3 * k + 2))).collect()
}

fn dot(a: &[Vec3<Double>], b: &[Vec3<Double>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b).0).sum()
}

/// ⟨A x, y⟩ = ⟨x, Aᵀ y⟩, level by level.
#[test]
fn the_transposed_prefilter_is_the_adjoint() {
    const SUMS_IN_F64: f64 = 1e-9;
    let operator = Operator::new(BASE);
    let x = random_texels(6 * BASE * BASE, 1);
    let filtered = operator.apply(&x);
    for level in 0..filtered.len() {
        let y: Vec<_> = filtered
            .iter()
            .enumerate()
            .map(|(k, map)| {
                if k == level {
                    random_texels(map.len(), 2)
                } else {
                    vec![vec3(Double(0.0), Double(0.0), Double(0.0)); map.len()]
                }
            })
            .collect();
        let (forward, backward) = (dot(&filtered[level], &y[level]), dot(&x, &operator.apply_transposed(&y)));
        assert_close(backward / forward, 1.0, SUMS_IN_F64);
    }
}

#[test]
fn a_constant_light_prefilters_to_itself_at_every_roughness() {
    let environment = Environment {
        resolution: 32,
        activation: RadianceActivation::Identity,
        values: [0.25, 1.0, 7.0].map(Double).repeat(6 * 32 * 32),
    };
    let light = prefilter(&environment, &Operator::new(32));
    for texel in &light.texels {
        for (actual, expected) in texel.to_array().into_iter().zip([0.25, 1.0, 7.0]) {
            assert_close(actual.0 / expected, 1.0, ROUNDING_F64);
        }
    }
    for step in 0..50 {
        let direction = vec3(Double(0.3), Double(f64::from(step) - 20.0), Double(5.0));
        let looked_up = plain::look_up(&light, direction, Double(f64::from(step) / 49.0));
        assert_close(looked_up.y.0, 1.0, ROUNDING_F64);
    }
}

#[test]
fn prefiltered_light_stays_between_the_darkest_and_the_brightest_texel() {
    let environment = lift_environment::<Double>(&random_environment(32, RadianceActivation::Identity, 3));
    let light = prefilter(&environment, &Operator::new(32));
    let values = || environment.values.iter().map(|x| x.0);
    let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(0.0, f64::max));
    let slack = ROUNDING_F64 * high;
    let inside = |x: &Double| (low - slack..=high + slack).contains(&x.0);
    assert!(light.texels.iter().all(|texel| texel.to_array().iter().all(inside)), "a mean is no extreme");
}

/// Radiance of a test sky: smooth, with a window and a sun of a few texels' size.
fn sky(d: Vec3<Double>, sun: f64) -> f64 {
    let [x, y, z] = d.to_array().map(|c| c.0);
    let sun = if x * 0.48 + y * 0.6 + z * 0.64 > 0.995 { sun } else { 0.0 };
    let window = if x.abs() < 0.3 && z < -0.6 { 4.0 } else { 0.0 };
    0.4 + 0.3 * z + 0.2 * (5.0 * x).sin() * (4.0 * y).cos() + sun + window
}

/// Relative L2 distance between the operator, whose rows are cuts through a pyramid, and the
/// integral over a base of piecewise constant texels, each taken in 4 × 4 parts.
fn cut_error(operator: &Operator, level: usize, base: usize, sun: f64) -> f64 {
    const PARTS: usize = 4;
    const EVERY: usize = 29;
    let texels: Vec<Vec3<Double>> = directions(base).map(|(d, _)| Vec3::splat(Double(sky(d, sun)))).collect();
    let filtered = operator.apply(&texels);
    let roughness = f64::from(operator.levels.as_slice()[level].roughness);
    let alpha_ggx = Double(roughness * roughness);

    let fine = base * PARTS;
    let parts: Vec<(Vec3<Double>, f64, f64)> = directions(fine)
        .enumerate()
        .map(|(index, (d, solid_angle))| {
            let (face, row, column) = (index / (fine * fine), index / fine % fine, index % fine);
            let texel = cubemap::texel_index(face, column / PARTS, row / PARTS, base);
            (d, solid_angle, texels[texel].x.0)
        })
        .collect();
    let outputs = directions(operator.levels.as_slice()[level].resolution).enumerate().step_by(EVERY);
    let (mut found, mut exact) = (Vec::new(), Vec::new());
    for (index, (r, _)) in outputs {
        let (mut sum, mut weights) = (0.0, 0.0);
        for (d, solid_angle, radiance) in &parts {
            let weight = (ggx::lobe_weight(r, *d, alpha_ggx) * ggx::cosine(r, *d)).0 * solid_angle;
            sum += weight * radiance;
            weights += weight;
        }
        exact.push(sum / weights);
        found.push(filtered[level][index].x.0);
    }
    let squares = |numbers: &mut dyn Iterator<Item = f64>| numbers.map(|x| x * x).sum::<f64>();
    let apart = squares(&mut found.iter().zip(&exact).map(|(a, b)| a - b));
    (apart / squares(&mut exact.iter().copied())).sqrt()
}

fn directions(resolution: usize) -> impl Iterator<Item = (Vec3<Double>, f64)> {
    (0..6).flat_map(move |face| {
        (0..resolution).flat_map(move |row| {
            (0..resolution).map(move |column| {
                let [x, y, z] = cubemap::texel_direction(face, column, row, resolution).map(Double);
                (vec3(x, y, z), cubemap::texel_solid_angle(column, row, resolution))
            })
        })
    })
}

#[test]
fn a_cut_through_the_pyramid_is_close_to_the_integral() {
    const BASE: usize = 32;
    /// A node across which the lobe changes by a third weighs its four quarters alike; a bright
    /// window with hard edges shows it, most of all where the lobe is as wide as few nodes.
    const CUT: f64 = 0.025;
    let operator = Operator::new(BASE);
    for sun in [0.0, 30.0] {
        for level in 1..8 {
            let error = cut_error(&operator, level, BASE, sun);
            println!("level {level} under a sun of {sun}: relative L2 {error:.2e}");
            assert!(error <= CUT, "level {level} is off by {error} under a sun of {sun}");
        }
    }
}

/// Dual numbers derive what difference quotients approximate.
#[test]
fn a_dual_number_through_the_whole_pipeline_is_its_derivative() {
    let scene = Scene::new(8, Layout::shaded(Some(1)), RadianceActivation::Exponential, NormalForm::Distance);
    let operator = Operator::new(BASE);
    let (value, gradient, frozen) =
        loss_and_gradient(&scene.gaussians, Some((&scene.environment, &operator)), &scene.view());
    let gradient = [gradient.gaussians.values, gradient.environment.expect("there is a light")].concat();
    let gradient: Vec<f64> = gradient.iter().map(|g| g.0).collect();
    // One direction through every number of the scene.
    let direction = direction(gradient.len(), 8);
    let (of_gaussians, of_texels) = direction.split_at(scene.gaussians.values.len());
    let gaussians = scene.gaussians.with_values(moved(&scene.gaussians.values, of_gaussians));
    let environment = scene.environment.with_values(moved(&scene.environment.values, of_texels));
    let loss = scene.dual_loss(&gaussians, &prefilter(&environment, &operator), &frozen);
    assert_close(loss.value, value.0, ROUNDING_F64);
    assert_slope("everything", &gradient, &direction, loss.slope);

    let loss_at = |step: f64| {
        let at = |values: &[Dual]| values.iter().map(|x| Double(x.value + step * x.slope)).collect::<Vec<_>>();
        let light = prefilter(&environment.with_values(at(&environment.values)), &operator);
        let gaussians = gaussians.with_values(at(&gaussians.values));
        plain::loss(&gaussians, Some(&light), &scene.view(), Some(&frozen)).0
    };
    let quotient = |h: f64| (loss_at(h) - loss_at(-h)) / (2.0 * h);
    let difference = (4.0 * quotient(0.5 * STEP) - quotient(STEP)) / 3.0;
    assert_close(difference / loss.slope, 1.0, SAME_DIFFERENCE);
}
