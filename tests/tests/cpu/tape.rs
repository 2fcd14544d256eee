//! Gradients of pictures under any cotangent, against dual numbers through the plain pipeline.

use specula_core::{
    attributes::{AttributePlanes, GaussianShading, LightSample, StoredGaussian},
    camera::{Camera, CameraOf},
    color::Picture,
    double::Double,
    dual::Dual,
    executor::{Executor, OwnLoss, ReadBack, Renderer, TrainingStep},
    loss::LossWeights,
    pipeline::{self, Gradients, Tape, render, render_taped, view_gradient},
    prefilter::{LevelRange, PrefilterScheme},
    project::project,
    random,
    rules::{Channels, RenderRules, channel},
    scene::{AMBIENT, DIFFUSE, Environment, Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT, RadianceActivation},
    shade::ShadingRules,
};
use specula_cpu::{CpuError, CpuExecutor};
use specula_tests::{
    number::{Number, take3, take9},
    plain::{self, Light, Operator, lift_environment, lift_gaussians, look_up, prefilter},
    strategies::{random_cloud, random_environment},
};
use specula_train::own_loss::{HostLoss, HostPicture};

/// Gradients of a small picture in `f32`, by attribute, relative to the largest.
const SAME_GRADIENT: f64 = 1e-4;
const RESOLUTION: usize = 16;
const COUNT: usize = 5;

/// Scene with a light, and a picture of it on the CPU.
struct Scene {
    gaussians: Gaussians<Vec<f32>>,
    environment: Environment<Vec<f32>>,
    camera: Camera,
    rules: RenderRules,
    exec: CpuExecutor,
    tape: Tape<CpuExecutor>,
    /// Cotangent of each plane of the frame.
    cotangent: Vec<f32>,
}

impl Scene {
    fn new(shading: ShadingRules, layout: Layout, seed: u64) -> Self {
        let gaussians = random_cloud(COUNT, layout, seed);
        let environment = random_environment(RESOLUTION, RadianceActivation::Exponential, seed);
        let mut camera = plain::scenes::camera(26, 20);
        camera.principal_px = [11.0, 12.5];
        let rules = RenderRules::full(shading, PrefilterScheme::Exact, Channels::Training);
        let mut exec = CpuExecutor::new();
        let tape = render_taped(&mut exec, &gaussians, Some(&environment), None, &camera, &rules);
        let tape = tape.expect("the CPU renders");
        let planes = tape.frame.len_of_values() / tape.frame.size().iter().product::<usize>();
        let len = tape.frame.len_of_values() / planes;
        // Normals of plain Gaussians have no gradient.
        let is_free = |plane: usize| layout.is_shaded() || plane < channel::NORMAL || plane == channel::DEPTH;
        let draw = |k: usize| 2.0 * random::uniform(seed, 5, k as u64) - 1.0;
        let is_cotangent = |k: usize| k / len == planes - 1 || is_free(k / len);
        let cotangent = (0..planes * len).map(|k| if is_cotangent(k) { draw(k) } else { 0.0 }).collect();
        Self { gaussians, environment, camera, rules, exec, tape, cotangent }
    }

    fn gradients(&mut self) -> Gradients<CpuExecutor> {
        let cotangent = self.exec.upload_frame_grad(&self.tape.frame, &self.cotangent).expect("the planes fit");
        pipeline::render_vjp(&mut self.exec, &self.tape, &self.gaussians, Some(&self.environment), cotangent)
            .expect("the CPU derives")
    }

    /// Slope of the cotangent's product with a frame of dual numbers.
    fn slope(&self, frame: &plain::Frame<Dual>) -> f64 {
        assert_eq!(frame.values.len(), self.cotangent.len(), "frames have the same planes");
        frame.values.iter().zip(&self.cotangent).map(|(number, c)| number.slope * f64::from(*c)).sum()
    }

    fn light(&self, environment: &Environment<Vec<Dual>>) -> Light<Dual> {
        prefilter(environment, &Operator::new(RESOLUTION))
    }

    /// Checks the gradient of each attribute.
    #[track_caller]
    fn assert_gaussians(&mut self, attributes: &[(&str, usize, usize)]) {
        let found = self.gradients().gaussians;
        let light = self.light(&lift_environment(&self.environment));
        let constant: Gaussians<Vec<Dual>> = lift_gaussians(&self.gaussians);
        for (name, first, end) in attributes {
            let places = (0..COUNT).flat_map(|gaussian| (*first..*end).map(move |plane| (gaussian, plane)));
            let [mut expected, mut actual] = [Vec::new(), Vec::new()];
            for (gaussian, plane) in places {
                let index = self.gaussians.index_of(gaussian, plane);
                let mut moved = constant.clone();
                moved.values[index] = Dual::variable(constant.values[index].value);
                let frame = plain::render(&moved, Some(&light), &self.camera, &self.rules);
                expected.push(self.slope(&frame));
                actual.push(f64::from(found.values[index]));
            }
            assert_same(name, &actual, &expected);
        }
    }

    /// Checks the gradient of the light along some directions.
    #[track_caller]
    fn assert_light(&mut self) {
        let found = self.gradients().environment.expect("a light was looked up");
        let gaussians = lift_gaussians(&self.gaussians);
        let [mut expected, mut actual] = [Vec::new(), Vec::new()];
        for direction in 0..4_u64 {
            let along = |k: usize| 2.0 * f64::from(random::uniform(direction, 6, k as u64)) - 1.0;
            let mut environment: Environment<Vec<Dual>> = lift_environment(&self.environment);
            environment.values.iter_mut().enumerate().for_each(|(k, number)| number.slope = along(k));
            let light = self.light(&environment);
            expected.push(self.slope(&plain::render(&gaussians, Some(&light), &self.camera, &self.rules)));
            actual.push(found.iter().enumerate().map(|(k, grad)| f64::from(*grad) * along(k)).sum());
        }
        assert_same("light", &actual, &expected);
    }

    /// Checks the gradient of the camera's pose.
    #[track_caller]
    fn assert_camera(&mut self) {
        let cotangent = self.exec.upload_frame_grad(&self.tape.frame, &self.cotangent).expect("the planes fit");
        let environment = Some(&self.environment);
        let (gradients, found) =
            pipeline::render_and_camera_vjp(&mut self.exec, &self.tape, &self.gaussians, environment, cotangent)
                .expect("the CPU derives");
        assert_eq!(gradients.gaussians, self.gradients().gaussians, "the camera changes no bit of the others");
        let found: Vec<f64> = found.rows().into_iter().flat_map(|row| row.to_array().map(|x| x.0)).collect();
        let light = self.light(&lift_environment(&self.environment));
        let gaussians = lift_gaussians(&self.gaussians);
        let lifted = self.camera.lift(Double(0.0));
        let [x, y, z] = lifted.camera_from_world.rows;
        let pose = [x, y, z, lifted.position].map(|row| row.to_array().map(|x| x.0));
        let slope_along = |index: usize| {
            let mut numbers: Vec<Dual> = pose.as_flattened().iter().map(|x| Dual::of(*x)).collect();
            numbers[index] = Dual::variable(numbers[index].value);
            let (camera_from_world, position) = (take9(&numbers), take3(&numbers[9..]));
            let camera = CameraOf { camera_from_world, position, ..self.camera.lift(numbers[0]) };
            self.slope(&self.seen_by(&gaussians, &light, &camera))
        };
        let expected: Vec<f64> = (0..12).map(slope_along).collect();
        assert_same("rotation", &found[..9], &expected[..9]);
        assert_same("centre", &found[9..], &expected[9..]);
    }

    /// The plain pipeline in a camera of dual numbers, its light looked up by Gaussians.
    fn seen_by(
        &self,
        gaussians: &Gaussians<Vec<Dual>>,
        light: &Light<Dual>,
        camera: &CameraOf<Dual>,
    ) -> plain::Frame<Dual> {
        let shading = GaussianShading { layout: gaussians.layout, rules: self.rules };
        let of = |index: usize| {
            let planes = StoredGaussian { gaussians, index };
            let splat = project(&AttributePlanes::<Dual>::shape(&planes, gaussians.layout), camera);
            let channels = if gaussians.layout.is_shaded() {
                let shaded = shading.shaded(&planes, camera.position);
                let mut sample = LightSample::none(camera.near);
                sample.specular = look_up(light, shaded.surface.reflection_dir, shaded.surface.roughness);
                shading.surface_channels(&shaded, &shaded.terms(&sample), camera)
            } else {
                shading.color_channels(&planes, camera).0
            };
            (splat, channels.0[..self.tape.frame.channel_count()].to_vec())
        };
        let (splats, colors): (Vec<_>, Vec<_>) = (0..gaussians.count).map(of).unzip();
        plain::blend(&splats, &colors, &plain::front_to_back(&splats), &self.camera)
    }
}

/// Checks that numbers differ by a share of the largest.
#[track_caller]
fn assert_same(name: &str, actual: &[f64], expected: &[f64]) {
    let scale = expected.iter().fold(0.0, |scale, x| f64::max(scale, x.abs()));
    assert!(scale > 0.0, "{name} has a gradient");
    let difference = actual.iter().zip(expected).fold(0.0, |worst, (a, e)| f64::max(worst, (a - e).abs() / scale));
    println!("{name}: {difference:.1e} of {scale:.1e}");
    assert!(difference <= SAME_GRADIENT, "{name}: {actual:?} is not {expected:?}, by {difference:e} of {scale}");
}

const SHAPE: [(&str, usize, usize); 4] = [
    ("means", MEAN, LOG_SCALE),
    ("scales", LOG_SCALE, QUAT),
    ("quats", QUAT, OPACITY),
    ("opacities", OPACITY, DIFFUSE),
];

/// Shape, then planes of the material.
fn attributes<'a>(material: &[(&'a str, usize, usize)]) -> Vec<(&'a str, usize, usize)> {
    [&SHAPE, material].concat()
}

#[test]
fn gradients_of_plain_gaussians_are_those_of_their_picture() {
    let layout = Layout::radiance(3);
    let mut scene = Scene::new(ShadingRules::PAPER, layout, 1);
    scene.assert_gaussians(&attributes(&[("harmonics", layout.sh_start(), layout.sh_end())]));
    scene.assert_camera();
}

/// Light is looked up by Gaussians, or by pixels.
#[test]
fn gradients_of_shaded_gaussians_and_their_light_are_those_of_their_picture() {
    let layout = Layout::shaded(Some(1));
    let material = attributes(&[
        ("diffuse", DIFFUSE, DIFFUSE + 3),
        ("tint", DIFFUSE + 3, DIFFUSE + 6),
        ("roughness", DIFFUSE + 6, DIFFUSE + 7),
        ("normals", DIFFUSE + 7, layout.sh_start()),
        ("harmonics", layout.sh_start(), layout.sh_end()),
    ]);
    for (seed, shading) in [(2, ShadingRules::PAPER), (3, ShadingRules::DEFERRED)] {
        let mut scene = Scene::new(shading, layout, seed);
        scene.assert_gaussians(&material);
        scene.assert_light();
    }
    Scene::new(ShadingRules::PAPER, layout, 4).assert_camera();
}

#[test]
fn gradients_of_physical_materials_and_their_light_are_those_of_their_picture() {
    let layout = Layout::shaded(None).physical();
    let first = layout.sh_end();
    let mut scene = Scene::new(ShadingRules::PHYSICAL, layout, 5);
    scene.assert_gaussians(&attributes(&[("albedo and metalness", first, first + AMBIENT)]));
    scene.assert_light();
}

#[test]
fn a_taped_picture_is_that_of_rendering() {
    for shading in [ShadingRules::PAPER, ShadingRules::DEFERRED] {
        let Scene { gaussians, environment, camera, rules, mut exec, tape, .. } =
            Scene::new(shading, Layout::shaded(Some(1)), 6);
        let light =
            exec.prefilter(&environment, PrefilterScheme::Exact, LevelRange::ALL).expect("16 is a power of two");
        let frame = render(&mut exec, &gaussians, Some(&light), &camera, &rules).expect("the CPU renders");
        assert!(frame == tape.frame, "the same bits");
    }
}

/// A step of training is a loss, whose cotangent is pulled back.
#[test]
fn the_gradient_of_a_loss_is_that_of_a_view() {
    for shading in [ShadingRules::PAPER, ShadingRules::DEFERRED] {
        let Scene { gaussians, environment, camera, rules, mut exec, tape, cotangent: drawn } =
            Scene::new(shading, Layout::shaded(Some(1)), 7);
        let [width, height] = tape.frame.size();
        let rgba: Vec<u8> = (0..width * height * 4).map(|k| (255.0 * random::uniform(7, 8, k as u64)) as u8).collect();
        let target = exec.target(&Picture::of_bytes(width, height, &rgba)).expect("the bytes fit");
        let weights = LossWeights { absolute: 0.8, dssim: 0.2, normal: 0.1, ..LossWeights::NONE };
        let background = [0.1, 0.2, 0.3];
        let step = TrainingStep {
            camera: &camera,
            target: &target,
            background,
            exposure: None,
            near_field: None,
            rules: &rules,
            weights: &weights,
            is_observed: false,
            rates: &[],
            environment_rate: 0.0,
            radiance_max: f32::MAX,
            number: 1,
            light_number: 1,
            own_loss: None,
        };
        let (expected, _) =
            view_gradient(&mut exec, &gaussians, Some(&environment), None, &step).expect("the CPU derives");
        let own = HostLoss(|picture: &HostPicture<'_>, grad: &mut [f32]| {
            assert_eq!(picture.view, 5);
            grad.copy_from_slice(&drawn);
        });
        let own_loss = Some(OwnLoss { loss: &own, view: 5 });
        let (replaced, _) =
            view_gradient(&mut exec, &gaussians, Some(&environment), None, &TrainingStep { own_loss, ..step })
                .expect("the CPU derives");
        let found = exec.upload_frame_grad(&tape.frame, &drawn).expect("the planes fit");
        let found =
            pipeline::render_vjp(&mut exec, &tape, &gaussians, Some(&environment), found).expect("the CPU derives");
        let without_losses = replaced.gaussians == found.gaussians;
        assert!(without_losses && replaced.light == found.environment, "a loss of the caller gives any cotangent");
        let cotangent = exec.loss(&tape.frame, &target, &camera, &weights, background).expect("the sizes agree");
        let found =
            pipeline::render_vjp(&mut exec, &tape, &gaussians, Some(&environment), cotangent).expect("the CPU derives");
        assert!(found.gaussians == expected.gaussians, "the same bits of the Gaussians");
        assert!(found.environment == expected.light && found.environment.is_some(), "and of the light");
    }
}

#[test]
fn cameras_of_light_added_pixel_by_pixel_are_refused_by_name() {
    let mut scene = Scene::new(ShadingRules::DEFERRED, Layout::shaded(None), 8);
    let cotangent = scene.exec.upload_frame_grad(&scene.tape.frame, &scene.cotangent).expect("the planes fit");
    let refused = pipeline::render_and_camera_vjp(
        &mut scene.exec,
        &scene.tape,
        &scene.gaussians,
        Some(&scene.environment),
        cotangent,
    );
    let error = refused.expect_err("pixels look light up along the camera's axes");
    assert!(matches!(error, CpuError::Unsupported(_)), "{error}");
}
