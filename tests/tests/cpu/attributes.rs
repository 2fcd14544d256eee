//! Values of a Gaussian's channels and losses, and of a light's radiance, from arithmetic that
//! shares no formula with core. Both executors and the plain pipeline compose them in one place,
//! `specula_core::attributes`: comparisons between those three check none of its terms.

use glam::{DVec3, Vec3};
use specula_core::{
    attributes::{AttributeLosses, GaussianShading, LayerChannels, LightSample, StoredGaussian},
    camera::Camera,
    double::Double,
    environment::{number_of, radiance},
    loss::{LossWeights, NormalForm},
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules, channel},
    scene::{
        DIFFUSE, Gaussians, Layout, METALNESS, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY,
        RadianceActivation::{Exponential, Identity},
        TINT,
    },
    shade::{ShadingForm, ShadingRules},
};
use specula_tests::{
    compare::{ROUNDING_F32, assert_all_close, assert_close},
    independent::{
        rays::{Gaussian, RayView},
        surface::{Look, Surface, gaussians, sum_of_harmonics},
    },
    number::vector,
    plain::{attribute_loss, lift_gaussians},
    strategies::random_cloud,
};

/// Light of every Gaussian; no two of its numbers are equal.
const SPECULAR_LIGHT: DVec3 = DVec3::new(0.9, 1.7, 0.4);
const AMBIENT_LIGHT: DVec3 = DVec3::new(0.35, 0.55, 0.75);
const SPLIT_SUM: [f64; 2] = [0.8, 0.15];
const COUNT: usize = 24;

fn camera() -> Camera {
    Camera::look_at(Vec3::new(2.0, -3.0, 1.5), Vec3::new(0.2, 0.0, 0.1), Vec3::Z, 0.7, 64, 48)
}

fn light() -> LightSample<Double> {
    LightSample {
        specular: vector(SPECULAR_LIGHT.to_array()),
        ambient: vector(AMBIENT_LIGHT.to_array()),
        split_sum: SPLIT_SUM.map(Double),
    }
}

fn shading(layout: Layout, form: ShadingForm, channels: Channels) -> GaussianShading {
    let rules = ShadingRules { form, ..ShadingRules::PAPER };
    GaussianShading { layout, rules: RenderRules::full(rules, PrefilterScheme::Exact, channels) }
}

/// Channels of each Gaussian of a cloud, as core composes them.
fn channels_of(shading: &GaussianShading, cloud: &Gaussians<Vec<f32>>) -> Vec<Vec<f64>> {
    let (cloud, camera) = (lift_gaussians::<Double>(cloud), camera().lift(Double(0.0)));
    let channels_of_one = |index: usize| {
        let planes = StoredGaussian { gaussians: &cloud, index };
        let LayerChannels(channels) = if shading.reads_surface() {
            let shaded = shading.shaded(&planes, camera.position);
            shading.surface_channels(&shaded, &shaded.terms(&light()), &camera)
        } else {
            shading.color_channels(&planes, &camera).0
        };
        channels.iter().map(|x| x.0).collect()
    };
    (0..cloud.count).map(channels_of_one).collect()
}

/// Unit vector to the eye, and depth along the optical axis.
fn eye_and_depth(gaussian: &Gaussian) -> (DVec3, f64) {
    let view = RayView::of(&camera());
    let from_eye = gaussian.mean - view.position;
    (-from_eye.normalize(), (view.camera_from_world * from_eye).z)
}

/// Channels of all layers from those that are given; others are zero.
fn layers(given: &[(usize, &[f64])]) -> Vec<f64> {
    let mut layers = vec![0.0; Channels::Layers.count()];
    for (first, numbers) in given {
        layers[*first..first + numbers.len()].copy_from_slice(numbers);
    }
    layers
}

/// Diffuse colour of the authors' code, σ(x − ln 3), from σ(x).
fn shifted(diffuse: DVec3) -> DVec3 {
    diffuse / (3.0 - 2.0 * diffuse)
}

/// Δn of the side that is seen, and whether it is the first.
fn residual_of(surface: &Surface, to_eye: DVec3) -> (DVec3, bool) {
    let is_first = surface.axis.dot(to_eye) >= 0.0;
    (surface.normal_residuals[usize::from(!is_first)], is_first)
}

/// Layers of a shaded Gaussian by the equations of the paper and of the authors' code.
fn layers_of_surface(form: ShadingForm, gaussian: &Gaussian, look: &Look) -> Vec<f64> {
    let (to_eye, depth) = eye_and_depth(gaussian);
    let surface = look.surface().expect("the cloud is shaded");
    let tint = surface.tint;
    let residual = sum_of_harmonics(&surface.residual, -to_eye);
    let reflected = AMBIENT_LIGHT * (1.0 - tint) + SPECULAR_LIGHT * (tint * SPLIT_SUM[0] + SPLIT_SUM[1]);
    let (diffuse, specular, color) = match form {
        ShadingForm::Paper => {
            (surface.diffuse, tint * SPECULAR_LIGHT, look.color(to_eye, &|_: DVec3, _: f64| SPECULAR_LIGHT))
        }
        ShadingForm::Official => {
            let diffuse = shifted(surface.diffuse);
            (diffuse, reflected, diffuse + reflected + residual)
        }
        ShadingForm::Deferred => (surface.diffuse, tint * SPECULAR_LIGHT, surface.diffuse + residual),
        ShadingForm::Physical => unreachable!("clouds here have no physical materials"),
    };
    layers(&[
        (channel::COLOR, &color.to_array()),
        (channel::NORMAL, &surface.normal(to_eye).to_array()),
        (channel::DEPTH, &[depth]),
        (channel::RESIDUAL_SIZE, &[residual_of(surface, to_eye).0.length_squared()]),
        (channel::TINT, &tint.to_array()),
        (channel::ROUGHNESS, &[surface.roughness]),
        (channel::DIFFUSE, &diffuse.to_array()),
        (channel::SPECULAR, &specular.to_array()),
        (channel::RESIDUAL, &residual.to_array()),
        (channel::LIGHT, &SPECULAR_LIGHT.to_array()),
    ])
}

#[test]
fn layers_of_a_shaded_gaussian_are_the_terms_of_its_equation() {
    let cloud = random_cloud(COUNT, Layout::shaded(Some(3)), 31);
    let exact = gaussians(&cloud);
    let firsts = exact.iter().filter(|(gaussian, look)| {
        residual_of(look.surface().expect("the cloud is shaded"), eye_and_depth(gaussian).0).1
    });
    assert!((1..COUNT).contains(&firsts.count()), "both sides of Gaussians are seen");
    for form in [ShadingForm::Paper, ShadingForm::Official, ShadingForm::Deferred] {
        let all = channels_of(&shading(cloud.layout, form, Channels::Layers), &cloud);
        for (actual, (gaussian, look)) in all.iter().zip(&exact) {
            assert_all_close(actual, &layers_of_surface(form, gaussian, look), ROUNDING_F32);
        }
        let surface = channels_of(&shading(cloud.layout, form, Channels::Surface), &cloud);
        for (actual, all) in surface.iter().zip(&all) {
            let (read, rest) = actual.split_at(Channels::Surface.count());
            assert_eq!(read, &all[..read.len()], "{form:?}: fewer channels have the same values");
            assert!(rest.iter().all(|x| *x == 0.0), "{form:?}: layers that nobody asked for are zero: {rest:?}");
        }
    }
}

#[test]
fn a_shaded_gaussian_without_light_has_its_diffuse_and_residual_colour() {
    let cloud = random_cloud(COUNT, Layout::shaded(Some(2)), 32);
    let mut shading = shading(cloud.layout, ShadingForm::Paper, Channels::Color);
    shading.rules.is_lit = false;
    for (actual, (gaussian, look)) in channels_of(&shading, &cloud).iter().zip(gaussians(&cloud)) {
        let (to_eye, depth) = eye_and_depth(&gaussian);
        let color = look.color(to_eye, &|_: DVec3, _: f64| DVec3::ZERO);
        let expected = layers(&[(channel::COLOR, &color.to_array()), (channel::DEPTH, &[depth])]);
        assert_all_close(actual, &expected, ROUNDING_F32);
    }
}

#[test]
fn layers_of_a_plain_gaussian_are_its_harmonics_its_shortest_axis_and_its_depth() {
    let cloud = random_cloud(COUNT, Layout::radiance(3), 33);
    let shading = shading(cloud.layout, ShadingForm::Paper, Channels::Layers);
    for (actual, (gaussian, look)) in channels_of(&shading, &cloud).iter().zip(gaussians(&cloud)) {
        let (to_eye, depth) = eye_and_depth(&gaussian);
        let axes = [0, 1, 2].map(|k| gaussian.axes.col(k));
        let shortest = axes.into_iter().min_by(|a, b| a.length().total_cmp(&b.length())).expect("three axes");
        let normal = shortest.normalize() * shortest.dot(to_eye).signum();
        let color = look.color(to_eye, &|_: DVec3, _: f64| SPECULAR_LIGHT);
        let expected = layers(&[
            (channel::COLOR, &color.to_array()),
            (channel::NORMAL, &normal.to_array()),
            (channel::DEPTH, &[depth]),
        ]);
        assert_all_close(actual, &expected, ROUNDING_F32);
    }
}

fn weights(sparse: f32, residual: f32, metalness: f32) -> LossWeights {
    LossWeights {
        absolute: 0.8,
        squared: 0.3,
        dssim: 0.2,
        normal: 0.1,
        normal_form: NormalForm::Cosine,
        smoothness: 0.6,
        sparse_coverage: 0.4,
        residual_image: 0.5,
        coverage: 0.1,
        sparse,
        residual,
        metalness,
        mean_light: 0.5,
        saturates: false,
    }
}

/// Mean of ln o + ln(1 − o), of |Δn₁|² + |Δn₂|² and of (m − g)² over the Gaussians, each times its
/// weight. Under a light of 0.5, g is smoothstep of the specular share from 0.12 to 0.3, times that
/// of the reflectance from 0.1 to 0.3.
fn loss_on_attributes(cloud: &Gaussians<Vec<f32>>, weights: &LossWeights) -> f64 {
    let loss_of_one = |index: usize| {
        let active = |plane: usize| 1.0 / (1.0 + (-f64::from(cloud.get::<1>(index, plane)[0])).exp());
        let opacity = active(OPACITY);
        let sparse = opacity.ln() + (1.0 - opacity).ln();
        let planes = if cloud.layout.is_shaded() { NORMAL_RESIDUAL_1..NORMAL_RESIDUAL_2 + 3 } else { 0..0 };
        let squares: f64 = planes.map(|plane| f64::from(cloud.get::<1>(index, plane)[0]).powi(2)).sum();
        let apart = cloud.layout.physical_planes().map_or(0.0, |first| {
            let [specular, diffuse] = [TINT, DIFFUSE].map(|plane| (plane..plane + 3).map(active).sum::<f64>() / 3.0);
            let smoothstep = |x: f64, low: f64, high: f64| {
                let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
                3.0 * t.powi(2) - 2.0 * t.powi(3)
            };
            let share = 0.5 * specular / (0.5 * specular + diffuse);
            let suggested = smoothstep(share, 0.12, 0.3) * smoothstep(specular + diffuse / 0.5, 0.1, 0.3);
            active(first + METALNESS) - suggested
        });
        f64::from(weights.sparse) * sparse
            + f64::from(weights.residual) * squares
            + f64::from(weights.metalness) * apart * apart
    };
    (0..cloud.count).map(loss_of_one).sum::<f64>() / cloud.count as f64
}

#[test]
fn losses_on_attributes_are_the_means_of_their_equations() {
    let weighted =
        [(1, [0.25, 0.0, 0.0]), (1, [0.0, 0.75, 0.0]), (3, [0.25, 0.75, 0.5]), (7, [0.0; 3]), (9, [0.0, 0.0, 1.0])];
    for layout in [Layout::shaded(Some(1)), Layout::radiance(1), Layout::shaded(Some(1)).physical()] {
        for (count, [sparse, residual, metalness]) in weighted {
            let (cloud, weights) = (random_cloud(count, layout, 34), weights(sparse, residual, metalness));
            let expected = loss_on_attributes(&cloud, &weights);
            let exact = attribute_loss::<Double>(&lift_gaussians(&cloud), &weights);
            assert_close(exact.0, expected, ROUNDING_F32);

            let losses = AttributeLosses::new(&weights, layout);
            let factors = AttributeLosses::factors(&weights, count);
            let loss_of_one = |index: usize| losses.loss(&StoredGaussian { gaussians: &cloud, index }, factors);
            let rounded: f32 = (0..count).map(loss_of_one).sum();
            assert_close(f64::from(rounded), expected, 10.0 * ROUNDING_F32);
        }
    }
}

/// Relative rounding of the exponential in `f32`: that of its argument in base 2, twice.
const EXPONENTIAL_ROUNDING: f32 = 1e-5;

#[test]
fn radiance_is_the_number_or_its_exponential() {
    for number in [-1.5, 0.0, 0.25, 1e6] {
        assert_eq!(radiance(Identity, number), number);
    }
    for (number, expected) in [
        (0.0_f32, 1.0),
        (1.0, core::f32::consts::E),
        (-1.0, 0.367_879_44),
        (core::f32::consts::LN_2, 2.0),
        (10.0, 22_026.465),
        (-20.0, 2.061_153_6e-9),
    ] {
        let actual = radiance(Exponential, number);
        assert!((actual - expected).abs() <= EXPONENTIAL_ROUNDING * expected, "e^{number} is {expected}, not {actual}");
    }
    assert_eq!(radiance(Exponential, -104.0_f32), 0.0, "the end of the range");
}

#[test]
fn numbers_are_those_of_their_radiance() {
    assert_eq!(number_of(Identity, 0.75), 0.75);
    assert!((number_of(Exponential, core::f32::consts::E) - 1.0).abs() <= EXPONENTIAL_ROUNDING);
}
