//! The losses of the GPU executor against core, against the plain pipeline in `f64`, and against
//! the CPU executor.

use core::ops::Range;
use half::f16;
use specula_core::{
    camera::Camera,
    color::{Picture, UNKNOWN},
    double::Double,
    executor::{Executor, ReadBack, Renderer},
    expose::{Exposure, IDENTITY, expose, expose_vjp},
    loss::{LossReport, LossWeights, NormalForm, White},
    pipeline::render,
    prefilter::{LevelRange, PrefilterScheme},
    rules::{Channels, RenderRules, channel},
    scene::{
        DIFFUSE, Environment, Gaussians, Image, LOG_SCALE, Layout, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY, QUAT,
        ROUGHNESS, RadianceActivation, TINT,
    },
    shade::ShadingRules,
    vector::vec3,
};
use specula_cpu::CpuExecutor;
use specula_gpu::{
    GpuError, GpuExecutor,
    stages::{
        expose::formulas::Expose,
        expose_vjp::formulas::ExposeVjp,
        loss::formulas::{
            Bending, BendingVjp, BlurredNormal, ColorLoss, ComparedColors, CoverageLoss, DepthGrad, Evenness, Gloss,
            MomentsDown, NormalLoss, NormalWeight, Structure, StructureGrad, UnclippedScale, UnitNormal, UnitNormalVjp,
            Windows, WithBackground,
        },
    },
};
use specula_tests::{
    compare::{LEAST_SMOOTHNESS, relative_difference},
    device::executor,
    formulas::{ROWS, assert_every_formula_has_a_case, assert_same, camera, numbers_of, side_by_side, uniform_rows},
    plain::{self, FrozenWeights, frame_loss, frame_loss_vjp, freeze_weights, lift},
    strategies::{random_cloud, random_environment},
};

const FORMS: [NormalForm; 3] = [NormalForm::Distance, NormalForm::CosineDetached, NormalForm::Cosine];

#[test]
fn every_formula_of_the_losses_is_on_the_device_what_it_is_on_the_host() {
    let Some(mut gpu) = executor() else { return };
    let gpu = &mut gpu;
    let byte = [0.0, 255.0];
    let (share, unit) = ([0.1, 1.0], [0.0, 1.0]);
    let bright = [[0.0, 2.0], unit, [254.0, 255.0], [254.0, 255.0], unit];
    for white in [White::Exact, White::Saturated, White::Unclipped] {
        assert_same(gpu, &ComparedColors { white }, &uniform_rows(1, &[unit, unit, byte, byte, unit]));
        assert_same(gpu, &ComparedColors { white }, &uniform_rows(16, &bright));
        let pairs = uniform_rows(10, &[unit, unit, [-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0]]);
        assert_same(gpu, &StructureGrad { white }, &pairs);
        let whites = uniform_rows(17, &[[1.0, 1.0], [0.99, 1.0], [-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0]]);
        assert_same(gpu, &StructureGrad { white }, &whites);
    }
    let unclipped = [[0.0, 2.0], unit, [0.0, 1500.0], byte, unit];
    assert_same(gpu, &ComparedColors { white: White::Unclipped }, &uniform_rows(21, &unclipped));
    assert_same(gpu, &UnclippedScale, &uniform_rows(22, &[[0.0, 1500.0], byte, unit]));
    assert_same(gpu, &ColorLoss, &uniform_rows(2, &[unit, unit, share, share]));
    assert_same(gpu, &WithBackground, &uniform_rows(3, &[unit, [-1.0, 1.0], [-1.0, 1.0]]));
    assert_same(gpu, &CoverageLoss, &uniform_rows(4, &[[0.05, 0.95], byte, share, share, share]));
    assert_same(gpu, &MomentsDown, &uniform_rows(5, &[unit; 36]));
    assert_same(gpu, &Windows::<3> { name: "means_down", count: 8 }, &uniform_rows(6, &[[-1.0, 1.0]; 54]));
    assert_same(gpu, &Windows::<3> { name: "means_across", count: 4 }, &uniform_rows(7, &[[-1.0, 1.0]; 42]));
    assert_same(gpu, &Windows::<4> { name: "means_across", count: 4 }, &uniform_rows(8, &[unit; 56]));
    let means = uniform_rows(9, &[[0.1, 0.5], [0.1, 0.5], [0.6, 0.8], [0.2, 0.3], share]);
    assert_same(gpu, &Structure, &means);
    assert_same(gpu, &NormalWeight, &uniform_rows(11, &[[0.0, 0.6]; 5]));
    let signed = [-1.0, 1.0];
    assert_same(gpu, &UnitNormal, &uniform_rows(18, &[signed, signed, signed, unit]));
    assert_same(gpu, &UnitNormalVjp, &uniform_rows(19, &[signed, signed, signed, unit, signed, signed, signed]));
    assert_same(gpu, &BlurredNormal, &uniform_rows(20, &[signed; 3]));
    let place = [[0.0, 70.0], [0.0, 45.0]];
    let seen = |rows: Vec<f32>| side_by_side(&rows, &numbers_of(&camera(70, 45)).repeat(ROWS));
    assert_same(gpu, &Evenness, &seen(uniform_rows(21, &[&[signed; 15][..], &place].concat())));
    assert_same(gpu, &Gloss, &uniform_rows(24, &[&[unit; 6][..], &[[0.0, 0.6], [0.0, 0.4]]].concat()));
    assert_same(gpu, &Bending, &seen(uniform_rows(22, &[&[signed; 9][..], &place, &[unit]].concat())));
    assert_same(gpu, &BendingVjp, &seen(uniform_rows(23, &[&[signed; 9][..], &place, &[unit, share]].concat())));
    assert_same(gpu, &DepthGrad, &uniform_rows(12, &[[1.0, 4.0], [0.1, 0.9], [-1.0, 1.0]]));
    let mut bounds = vec![[-1.0, 1.0]; 12];
    bounds.extend([unit; 4]);
    assert_same(gpu, &Expose, &uniform_rows(14, &bounds));
    bounds.extend([[-1.0, 1.0]; 3]);
    assert_same(gpu, &ExposeVjp, &uniform_rows(15, &bounds));
    let mut bounds = vec![[0.0, 70.0], [0.0, 45.0], [0.5, 1.0]];
    bounds.extend([[-1.0, 1.0]; 3]);
    bounds.extend([[0.0, 0.5]; 4]);
    bounds.extend([[1.0, 4.0]; 4]);
    bounds.push(share);
    let rows = side_by_side(&uniform_rows(13, &bounds), &numbers_of(&camera(70, 45)).repeat(ROWS));
    for form in FORMS {
        assert_same(gpu, &NormalLoss { form }, &rows);
    }
}

#[test]
fn no_formula_of_the_losses_is_left_out() {
    let formulas = [
        include_str!("../../../exec-gpu/src/stages/expose/formulas.rs"),
        include_str!("../../../exec-gpu/src/stages/expose_vjp/formulas.rs"),
        include_str!("../../../exec-gpu/src/stages/loss/formulas.rs"),
    ];
    assert_every_formula_has_a_case(&formulas, include_str!("loss.rs"), 20);
}

/// Numbers of a picture in `f32` on a device against the same in `f64`: roundings of a few hundred
/// operations, and SSIM's differences of mean squares, whose roundings 1/C₂ = 1100 makes larger.
const SAME_GRADIENT: f64 = 1e-4;
/// Both executors blend in their own order before they compare.
const AS_THE_CPU_COMPARES: f64 = 1e-3;
/// Means over a picture, in which roundings of single pixels cancel; those of SSIM all lean to one
/// side where a picture is flat.
const SAME_REPORT: f64 = 4e-6;
/// Means over two pictures that were blended in different orders.
const AS_THE_CPU_REPORTS: f64 = 5e-6;

/// Scene under test and its target.
struct Scene {
    cloud: Gaussians<Vec<f32>>,
    environment: Environment<Vec<f32>>,
    camera: Camera,
    rules: RenderRules,
    rgba: Vec<u8>,
    unclipped: Option<Vec<[f16; 3]>>,
    background: [f32; 3],
    weights: LossWeights,
}

fn weights(normal_form: NormalForm) -> LossWeights {
    LossWeights {
        absolute: 0.5,
        squared: 0.3,
        dssim: 0.2,
        normal: 0.1,
        normal_form,
        smoothness: 0.2,
        sparse_coverage: 0.01,
        residual_image: 0.05,
        coverage: 0.1,
        sparse: 1e-3,
        residual: 1e-2,
        ..LossWeights::NONE
    }
}

/// Bytes without any order, an ellipse before nothing, and waves that nothing shines through, some
/// of them overexposed.
#[derive(Clone, Copy, Debug)]
enum Truth {
    Noise,
    Ellipse,
    Waves,
    /// Waves with white crests.
    Overexposed,
    /// The same, and the radiance of the crests.
    Unclipped,
}

impl Truth {
    fn rgba(self, [width, height]: [u32; 2]) -> Vec<u8> {
        (0..width * height).flat_map(|pixel| self.pixel(pixel % width, pixel / width, [width, height])).collect()
    }
    fn unclipped(self, [width, height]: [u32; 2]) -> Option<Vec<[f16; 3]>> {
        let color = |k: u32| [0.7, 0.9, 1.1].map(|speed: f32| f16::from_f32(2.5 + 2.5 * (speed * k as f32).sin()));
        matches!(self, Self::Unclipped).then(|| (0..width * height).map(color).collect())
    }
    fn pixel(self, x: u32, y: u32, [width, height]: [u32; 2]) -> [u8; 4] {
        let [right, down] = [(x, width), (y, height)].map(|(at, size)| 2.0 * (at as f32 + 0.5) / size as f32 - 1.0);
        let wave = |speed: f32| (127.0 + 100.0 * (speed * (right + 0.4 * down)).sin()) as u8;
        match self {
            Self::Noise => [0, 1, 2, 3].map(|c| ((4 * (y * width + x) + c) * 37 % 251) as u8),
            Self::Ellipse if right * right + down * down > 0.15 => [13, 17, 19, 0],
            Self::Ellipse => [wave(5.0), wave(7.0), wave(9.0), 230],
            Self::Waves => [wave(5.0), wave(7.0), wave(9.0), 255],
            Self::Overexposed | Self::Unclipped => {
                [wave(5.0), wave(7.0), wave(9.0), 191].map(|byte| byte.saturating_add(64))
            }
        }
    }
}

impl Scene {
    fn new(count: usize, layout: Layout, rules: RenderRules, size: [u32; 2], truth: Truth, seed: u64) -> Self {
        let (activation, resolution) = match rules.scheme {
            PrefilterScheme::Exact => (RadianceActivation::Exponential, 16),
            PrefilterScheme::Official => (RadianceActivation::Identity, 64),
        };
        let mut weights = weights(FORMS[seed as usize % 3]);
        let mut environment = random_environment(resolution, activation, seed);
        if matches!(truth, Truth::Overexposed | Truth::Unclipped) {
            weights.saturates = true;
            environment.values.iter_mut().for_each(|number| *number += 2.0);
        }
        Self {
            cloud: random_cloud(count, layout, seed),
            environment,
            camera: camera(size[0], size[1]),
            rules,
            rgba: truth.rgba(size),
            unclipped: truth.unclipped(size),
            background: [0.1, 0.23, 0.3],
            weights,
        }
    }
    /// A mirror of flat Gaussians, whose normals differ by a degree.
    fn mirror(truth: Truth, seed: u64) -> Self {
        let mut scene = Self::new(80, shaded(), training(ShadingRules::DEFERRED), [70, 45], truth, seed);
        for k in 0..scene.cloud.count {
            let (sin, cos) = (k as f32).sin_cos();
            scene.cloud.set(k, LOG_SCALE, [-1.2, -4.5, -1.2]);
            scene.cloud.set(k, QUAT, [1.0, 0.01 * sin, 0.0, 0.01 * cos]);
            scene.cloud.set(k, OPACITY, [2.0]);
            scene.cloud.set(k, DIFFUSE, [-3.0; 3]);
            scene.cloud.set(k, TINT, [1.0; 3]);
            scene.cloud.set(k, ROUGHNESS, [-3.0]);
            scene.cloud.set(k, NORMAL_RESIDUAL_1, [0.0; 3]);
            scene.cloud.set(k, NORMAL_RESIDUAL_2, [0.0; 3]);
        }
        scene
    }
    fn channels(&self) -> usize {
        self.rules.blended(self.cloud.layout).count()
    }
    fn size(&self) -> [usize; 2] {
        [self.camera.width as usize, self.camera.height as usize]
    }
    fn pixel_count(&self) -> usize {
        self.size()[0] * self.size()[1]
    }
    fn frame<E: Renderer>(&self, exec: &mut E) -> E::Frame {
        self.frame_under(exec, self.cloud.layout.is_shaded())
    }
    /// The picture, with or without its light.
    fn frame_under<E: Renderer>(&self, exec: &mut E, is_lit: bool) -> E::Frame {
        let Gaussians { count, layout, values } = &self.cloud;
        let cloud = Gaussians { count: *count, layout: *layout, values: exec.upload(values).expect("numbers fit") };
        let Environment { resolution, activation, values } = &self.environment;
        let values = exec.upload(values).expect("texels fit");
        let environment = Environment { resolution: *resolution, activation: *activation, values };
        let light = is_lit.then(|| {
            exec.prefilter(&environment, self.rules.scheme, LevelRange::ALL).expect("the resolution is allowed")
        });
        render(exec, &cloud, light.as_ref(), &self.camera, &self.rules).expect("the executor renders")
    }
    fn compare<E: Executor>(&self, exec: &mut E, frame: &E::Frame) -> (LossReport, E::FrameGrad) {
        let [width, height] = self.size();
        let target = exec.target(&Picture { width, height, rgba: &self.rgba, unclipped: self.unclipped.as_deref() });
        let target = target.expect("the pixels fit");
        let grad = exec.loss(frame, &target, &self.camera, &self.weights, self.background).expect("sizes agree");
        let report = exec.report().expect("losses come back").expect("no step exceeds the capacity");
        (report.loss, grad)
    }

    fn on_gpu(&self, gpu: &mut GpuExecutor) -> Compared {
        let frame = self.frame(gpu);
        let (report, grad) = self.compare(gpu, &frame);
        let mut compared = Compared::new(self, report);
        gpu.read_frame(&frame, &mut compared.frame).expect("the frame has that size");
        if let Some(values) = &mut compared.unlit {
            let unlit = self.frame_under(gpu, false);
            gpu.read_frame(&unlit, values).expect("the frame has that size");
        }
        gpu.read_frame_grad(&frame, &grad, &mut compared.grad).expect("the gradient has that size");
        compared
    }
    fn on_cpu(&self, cpu: &mut CpuExecutor) -> Compared {
        let frame = self.frame(cpu);
        let (report, grad) = self.compare(cpu, &frame);
        let mut compared = Compared::new(self, report);
        frame.read(&mut compared.frame);
        if let Some(values) = &mut compared.unlit {
            self.frame_under(cpu, false).read(values);
        }
        cpu.read_frame_grad(&frame, &grad, &mut compared.grad).expect("the gradient has that size");
        compared
    }
    /// The plain pipeline's losses and gradient of a picture, in `f64`.
    fn exactly(&self, compared: &Compared) -> Exact {
        let [width, height] = self.size();
        let channels = self.channels() + 1;
        let image = |values: &Vec<f32>| Image { width, height, channels, values: lift(values) };
        let (frame, unlit) = (image(&compared.frame), compared.unlit.as_ref().map(image));
        let target = self.plain_target();
        let frozen = freeze_weights(&frame, unlit.as_ref(), &self.camera);
        let grad = frame_loss_vjp(&frame, &target, &self.camera, &self.weights, &frozen);
        let report = self.exact_report(&frame, &target, &frozen);
        Exact { report, grad: grad.values.iter().map(|x| x.0).collect() }
    }
    /// Whether the true picture is white in this pixel.
    fn is_overexposed(&self, c: usize, pixel: usize) -> bool {
        self.weights.white(self.unclipped.is_none()) == White::Saturated
            && [c, 3].iter().all(|channel| self.rgba[4 * pixel + channel] == u8::MAX)
    }
    fn has_alpha(&self) -> bool {
        self.rgba.chunks_exact(4).any(|pixel| pixel[3] < 255)
    }
    fn plain_target(&self) -> plain::Target<Double> {
        let alpha = |pixel: &[u8]| f64::from(pixel[3]) / 255.0;
        let over = |c: usize| {
            let color = move |k: usize, pixel: &[u8]| match &self.unclipped {
                Some(colors) => f64::from(colors[k][c]),
                None => f64::from(pixel[c]) / 255.0,
            };
            self.rgba.chunks_exact(4).enumerate().map(move |(k, pixel)| {
                let behind = (1.0 - alpha(pixel)) * f64::from(self.background[c]);
                Double(color(k, pixel) * alpha(pixel) + behind)
            })
        };
        plain::Target {
            srgb: over(0).chain(over(1)).chain(over(2)).collect(),
            alpha: self.has_alpha().then(|| self.rgba.chunks_exact(4).map(|pixel| Double(alpha(pixel))).collect()),
            background: self.background,
            is_clipped: self.unclipped.is_none(),
        }
    }
    /// Each loss separately.
    fn exact_report(
        &self,
        frame: &Image<Vec<Double>>,
        target: &plain::Target<Double>,
        frozen: &FrozenWeights,
    ) -> LossReport {
        let LossWeights { normal_form, saturates, .. } = self.weights;
        let none = LossWeights { normal_form, saturates, ..LossWeights::NONE };
        let loss_of = |weights: LossWeights| frame_loss(frame, target, &self.camera, &weights, frozen).0;
        let keep = |value: f64, weight: f32| if weight == 0.0 { 0.0 } else { value };
        let weights = self.weights;
        let report = LossReport {
            absolute: loss_of(LossWeights { absolute: 1.0, ..none }),
            squared: loss_of(LossWeights { squared: 1.0, ..none }),
            ssim: keep(1.0 - loss_of(LossWeights { dssim: 1.0, ..none }), weights.dssim),
            normal: keep(loss_of(LossWeights { normal: 1.0, ..none }), weights.normal),
            smoothness: keep(loss_of(LossWeights { smoothness: 1.0, ..none }), weights.smoothness),
            coverage: keep(loss_of(LossWeights { coverage: 1.0, ..none }), weights.coverage),
            ..LossReport::default()
        };
        report.with_total(&weights.where_possible(self.has_alpha(), self.channels() > channel::DEPTH))
    }
}

/// Results of an executor for a scene.
#[derive(Clone, Debug, PartialEq)]
struct Compared {
    frame: Vec<f32>,
    /// The same without light, where light was added pixel by pixel.
    unlit: Option<Vec<f32>>,
    grad: Vec<f32>,
    report: LossReport,
}

/// Results of the plain pipeline.
struct Exact {
    grad: Vec<f64>,
    report: LossReport,
}

impl Compared {
    fn new(scene: &Scene, report: LossReport) -> Self {
        let zeros = vec![0.0; (scene.channels() + 1) * scene.pixel_count()];
        let unlit = scene.rules.is_deferred(scene.cloud.layout).then(|| zeros.clone());
        Self { frame: zeros.clone(), unlit, grad: zeros, report }
    }
}

/// Planes that belong together: colour, normal, depth, the size of residuals, planes that no loss
/// reads, transmittance.
fn groups(channels: usize) -> Vec<(&'static str, Range<usize>)> {
    let all = [
        ("colour", 0..3),
        ("normal", 3..6),
        ("depth", 6..7),
        ("residual", 7..8),
        ("rest", 8..channels),
        ("transmittance", channels..channels + 1),
    ];
    all.into_iter().filter(|(_, planes)| planes.start < planes.end && planes.end <= channels + 1).collect()
}

/// Zeros for the tiles in which a picture shows nothing but its background: these have no gradient.
fn where_rendered(scene: &Scene, frame: &[f32], grad: &[f64]) -> Vec<f64> {
    const SIZE: usize = 16;
    let ([width, _], count) = (scene.size(), scene.pixel_count());
    let passed = &frame[scene.channels() * count..];
    let tile_of = |pixel: usize| [pixel % width / SIZE, pixel / width / SIZE];
    let passes_alpha_test = |pixel: usize| passed[pixel] != 1.0;
    let seen: std::collections::HashSet<[usize; 2]> =
        (0..count).filter(|p| passes_alpha_test(*p)).map(tile_of).collect();
    grad.iter().enumerate().map(|(k, x)| if seen.contains(&tile_of(k % count)) { *x } else { 0.0 }).collect()
}

/// Distance of two gradients by groups of planes, each relative to its largest number.
fn differences(scene: &Scene, ours: &[f32], theirs: &[f64]) -> Vec<(&'static str, f64)> {
    let count = scene.pixel_count();
    let difference = |planes: Range<usize>| {
        let range = planes.start * count..planes.end * count;
        let ours: Vec<f64> = ours[range.clone()].iter().map(|x| f64::from(*x)).collect();
        let theirs = &theirs[range];
        if theirs.iter().chain(&ours).all(|x| *x == 0.0) { 0.0 } else { relative_difference(&ours, theirs) }
    };
    groups(scene.channels()).into_iter().map(|(name, planes)| (name, difference(planes))).collect()
}

#[track_caller]
fn assert_grad(what: &str, scene: &Scene, ours: &[f32], theirs: &[f64], tolerance: f64) {
    let differences = differences(scene, ours, theirs);
    for (name, difference) in differences {
        println!("{what}: {name} {difference:.1e}");
        assert!(difference <= tolerance, "{what}: {name} is {difference:e} apart, allowed are {tolerance:e}");
    }
}

/// The largest difference of two reports, each number as a share of the expected one; infinite for
/// NaN.
fn difference_of_reports(ours: &LossReport, theirs: &LossReport) -> f64 {
    let numbers = |report: &LossReport| {
        let LossReport { total, absolute, squared, ssim, normal, smoothness, coverage } = *report;
        [total, absolute, squared, ssim, normal, smoothness + LEAST_SMOOTHNESS, coverage]
    };
    let pairs = numbers(ours).into_iter().zip(numbers(theirs));
    pairs.map(|(a, b)| if a == b { 0.0 } else { relative_difference(&[a], &[b]) }).fold(0.0, f64::max)
}

#[track_caller]
fn assert_report(what: &str, ours: &LossReport, theirs: &LossReport, tolerance: f64) {
    let difference = difference_of_reports(ours, theirs);
    println!("{what}: reports {difference:.1e} apart");
    assert!(difference <= tolerance, "{what}: {ours:?} is {difference:e} from {theirs:?}");
}

#[test]
fn the_comparisons_of_gradients_and_reports_can_fail() {
    let scene = Scene::new(0, Layout::radiance(0), training(ShadingRules::PAPER), [3, 2], Truth::Noise, 0);
    let right = vec![0.5_f32; 9 * 6];
    let wide: Vec<f64> = right.iter().map(|x| f64::from(*x)).collect();
    let worst = |ours: &[f32]| differences(&scene, ours, &wide).iter().fold(0.0, |worst, (_, x)| f64::max(worst, *x));
    assert!(worst(&right) <= SAME_GRADIENT, "the same numbers are the same");
    for place in 0..right.len() {
        for number in [0.501, f32::NAN] {
            let mut wrong = right.clone();
            wrong[place] = number;
            assert!(worst(&wrong) > AS_THE_CPU_COMPARES, "{number} at {place} is seen");
        }
    }
    let report = LossReport { ssim: 0.5, absolute: 0.1, ..LossReport::default() };
    assert!(difference_of_reports(&report, &report) <= SAME_REPORT, "the same report is the same");
    for ssim in [0.500_01, f64::NAN] {
        let wrong = LossReport { ssim, ..report };
        assert!(difference_of_reports(&wrong, &report) > SAME_REPORT, "an SSIM of {ssim} is seen");
    }
}

fn training(shading: ShadingRules) -> RenderRules {
    let scheme = if shading == ShadingRules::OFFICIAL { PrefilterScheme::Official } else { PrefilterScheme::Exact };
    RenderRules::full(shading, scheme, Channels::Training)
}

fn shaded() -> Layout {
    Layout::shaded(Some(1))
}

/// Every form of shading, plain Gaussians, only colours; pictures of every shape; nothing, one and
/// many Gaussians. Those of one prefilter follow one another: executors keep the weights of one.
fn scenes() -> Vec<(String, Scene)> {
    let [paper, deferred, official] =
        [ShadingRules::PAPER, ShadingRules::DEFERRED, ShadingRules::OFFICIAL].map(training);
    let color = RenderRules { channels: Channels::Color, ..paper };
    let plain = Layout::radiance(1);
    let mut scenes = Vec::new();
    for truth in [Truth::Noise, Truth::Ellipse, Truth::Waves, Truth::Overexposed, Truth::Unclipped] {
        for (name, layout, rules) in [
            ("paper", shaded(), paper),
            ("deferred", shaded(), deferred),
            ("official", shaded(), official),
            ("plain", plain, paper),
            ("colour", plain, color),
        ] {
            let seed = scenes.len() as u64;
            let mut scene = Scene::new(80, layout, rules, [70, 45], truth, seed);
            if name == "colour" {
                scene.weights.sparse_coverage = 0.0;
            }
            scenes.push((format!("{name}, {truth:?}"), scene));
        }
        for (count, size) in [(3, [150, 131]), (0, [40, 40]), (1, [17, 16]), (9, [16, 17]), (9, [1, 1]), (20, [5, 90])]
        {
            let scene = Scene::new(count, shaded(), deferred, size, truth, scenes.len() as u64);
            scenes.push((format!("{count} in {size:?}, {truth:?}"), scene));
        }
    }
    for (truth, seed) in [Truth::Noise, Truth::Ellipse, Truth::Waves].into_iter().zip(100..) {
        scenes.push((format!("mirror, {truth:?}"), Scene::mirror(truth, seed)));
    }
    scenes.sort_by_key(|(_, scene)| scene.rules.scheme == PrefilterScheme::Official);
    scenes
}

#[test]
fn losses_and_gradients_are_those_of_the_plain_pipeline() {
    let Some(mut gpu) = executor() else { return };
    for (what, scene) in scenes() {
        let ours = scene.on_gpu(&mut gpu);
        let exact = scene.exactly(&ours);
        assert_grad(&what, &scene, &ours.grad, &where_rendered(&scene, &ours.frame, &exact.grad), SAME_GRADIENT);
        assert_report(&what, &ours.report, &exact.report, SAME_REPORT);
    }
}

#[test]
fn losses_and_gradients_are_those_of_the_cpu() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    for (what, scene) in scenes() {
        let (ours, theirs) = (scene.on_gpu(&mut gpu), scene.on_cpu(&mut cpu));
        let wide: Vec<f64> = theirs.grad.iter().map(|x| f64::from(*x)).collect();
        let wide = where_rendered(&scene, &ours.frame, &wide);
        assert_grad(&what, &scene, &ours.grad, &wide, AS_THE_CPU_COMPARES);
        assert_report(&what, &ours.report, &theirs.report, AS_THE_CPU_REPORTS);
    }
}

/// Scenes whose pictures are unknown in places: a band from edge to edge, and single pixels.
fn torn_scenes() -> Vec<Scene> {
    let mut scenes: Vec<Scene> = scenes().into_iter().map(|(_, scene)| scene).collect();
    for scene in &mut scenes {
        let width = scene.camera.width as usize;
        for (index, pixel) in scene.rgba.chunks_exact_mut(4).enumerate() {
            let (x, y) = (index % width, index / width);
            if (x + y) % 31 < 9 || index % 53 == 0 {
                pixel.copy_from_slice(&UNKNOWN);
            }
        }
    }
    scenes
}

#[test]
fn both_executors_compare_unknown_pixels_alike() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    for (k, scene) in torn_scenes().iter().enumerate() {
        let (ours, theirs) = (scene.on_gpu(&mut gpu), scene.on_cpu(&mut cpu));
        let wide: Vec<f64> = theirs.grad.iter().map(|x| f64::from(*x)).collect();
        let wide = where_rendered(scene, &ours.frame, &wide);
        assert_grad(&format!("torn {k}"), scene, &ours.grad, &wide, AS_THE_CPU_COMPARES);
        assert_report(&format!("torn {k}"), &ours.report, &theirs.report, AS_THE_CPU_REPORTS);
    }
}

#[test]
fn unknown_pixels_have_no_loss() {
    let mut cpu = CpuExecutor::new();
    for scene in torn_scenes() {
        let compared = scene.on_cpu(&mut cpu);
        let (channels, size) = (scene.channels(), scene.pixel_count());
        let is_unknown = |pixel: usize| scene.rgba[4 * pixel..4 * pixel + 4] == UNKNOWN;
        for pixel in (0..size).filter(|pixel| is_unknown(*pixel)) {
            let grads = (0..=channels).map(|channel| compared.grad[channel * size + pixel]);
            assert!(grads.clone().all(|grad| grad == 0.0), "{:?} at pixel {pixel}", grads.collect::<Vec<_>>());
        }

        let behind = |pixel: usize| compared.frame[channels * size + pixel];
        let shown = |c: usize, pixel: usize| compared.frame[c * size + pixel] + behind(pixel) * scene.background[c];
        let truth = scene.plain_target().srgb;
        let apart = |c: usize, pixel: usize| {
            let (shown, truth) = (f64::from(shown(c, pixel)), truth[c * size + pixel].0);
            let apart = if scene.is_overexposed(c, pixel) { shown.min(1.0) } else { shown } - truth;
            // Differences above white are relative.
            apart.abs() / truth.max(1.0)
        };
        let known = || (0..size).filter(|pixel| !is_unknown(*pixel));
        let sum: f64 =
            (0..3).flat_map(|c| known().map(move |pixel| (c, pixel))).map(|(c, pixel)| apart(c, pixel)).sum();
        let mean = sum / (3 * size) as f64;
        assert!((compared.report.absolute - mean).abs() < 1e-5, "{} and not {mean}", compared.report.absolute);
    }
}

#[test]
fn overexposed_pixels_agree_with_anything_brighter() {
    let mut cpu = CpuExecutor::new();
    let mut brighter = 0;
    for (what, scene) in scenes() {
        let compared = scene.on_cpu(&mut cpu);
        let (channels, size) = (scene.channels(), scene.pixel_count());
        let places = (0..3).flat_map(|c| (0..size).map(move |pixel| (c, pixel)));
        for (c, pixel) in places.filter(|(c, pixel)| scene.is_overexposed(*c, *pixel)) {
            let behind = compared.frame[channels * size + pixel];
            if compared.frame[c * size + pixel] + behind * scene.background[c] > 1.0 {
                assert_eq!(compared.grad[c * size + pixel], 0.0, "{what}: colour {c} at pixel {pixel}");
                brighter += 1;
            }
        }
    }
    assert!(brighter > 100, "{brighter} colours are brighter than white");
}

#[test]
fn single_losses_and_none_are_those_of_the_plain_pipeline() {
    let Some(mut gpu) = executor() else { return };
    let none = LossWeights::NONE;
    let single = [
        none,
        LossWeights { absolute: 1.0, ..none },
        LossWeights { squared: 1.0, ..none },
        LossWeights { dssim: 1.0, ..none },
        LossWeights { sparse_coverage: 1.0, ..none },
        LossWeights { residual_image: 1.0, ..none },
        LossWeights { smoothness: 1.0, ..none },
        LossWeights { coverage: 1.0, ..none },
    ];
    let normals = FORMS.map(|normal_form| LossWeights { normal: 1.0, normal_form, ..none });
    for (k, weights) in single.into_iter().chain(normals).enumerate() {
        let rules = training(ShadingRules::DEFERRED);
        let scene = Scene { weights, ..Scene::new(60, shaded(), rules, [53, 38], Truth::Ellipse, 3) };
        let ours = scene.on_gpu(&mut gpu);
        let exact = scene.exactly(&ours);
        let what = format!("loss {k}");
        assert_grad(&what, &scene, &ours.grad, &where_rendered(&scene, &ours.frame, &exact.grad), SAME_GRADIENT);
        assert_report(&what, &ours.report, &exact.report, SAME_REPORT);
    }
}

#[test]
fn losses_are_the_same_bits_twice_and_whatever_was_compared_before() {
    let Some(mut gpu) = executor() else { return };
    let rules = training(ShadingRules::DEFERRED);
    let scene = Scene::new(300, shaded(), rules, [170, 95], Truth::Ellipse, 11);
    let first = scene.on_gpu(&mut gpu);
    Scene::new(37, shaded(), rules, [180, 90], Truth::Noise, 12).on_gpu(&mut gpu);
    assert!(scene.on_gpu(&mut gpu) == first, "memory that was used before changes nothing");
    let mut another = executor().expect("there was one before");
    assert!(scene.on_gpu(&mut another) == first, "a new executor computes the same");
}

#[test]
fn pictures_of_another_size_are_refused() {
    let Some(mut gpu) = executor() else { return };
    let refused = gpu.target(&Picture::of_bytes(3, 2, &[0; 23])).expect_err("a byte is missing");
    assert_eq!(refused, GpuError::TargetSize { width: 3, height: 2, expected: 24, found: 23 });
    let one = [[f16::ONE; 3]];
    let refused = gpu.target(&Picture { unclipped: Some(&one), ..Picture::of_bytes(3, 2, &[0; 24]) });
    let expected = GpuError::TargetSize { width: 3, height: 2, expected: 18, found: 3 };
    assert_eq!(refused.expect_err("there is one colour"), expected);
    let scene = Scene::new(1, shaded(), training(ShadingRules::PAPER), [20, 10], Truth::Noise, 0);
    let frame = scene.frame(&mut gpu);
    let target = gpu.target(&Picture::of_bytes(10, 20, &[0; 800])).expect("the bytes fit");
    let refused = gpu.loss(&frame, &target, &scene.camera, &scene.weights, scene.background);
    assert_eq!(refused.expect_err("rows are columns"), GpuError::FrameSize { expected: [10, 20], found: [20, 10] });
}

/// Some exposure that mixes all channels.
const EXPOSURE: Exposure<f32> = [[0.8, 0.1, -0.05, 0.03], [0.02, 1.1, 0.07, -0.06], [-0.04, 0.05, 0.9, 0.1]];

/// A picture before and after its exposure, the gradient of the photograph, and the results of the
/// backward pass.
struct Exposed {
    before: Vec<f32>,
    after: Vec<f32>,
    of_photograph: Vec<f32>,
    of_picture: Vec<f32>,
    of_exposure: Exposure<f64>,
}

impl Scene {
    fn expose<E: ReadBack>(&self, exec: &mut E) -> Exposed {
        let zeros = vec![0.0; (self.channels() + 1) * self.pixel_count()];
        let [mut before, mut after, mut of_photograph, mut of_picture] = [(); 4].map(|()| zeros.clone());
        let frame = self.frame(exec);
        exec.read_frame(&frame, &mut before).expect("the frame has that size");
        let frame = exec.expose(frame, &EXPOSURE).expect("the executor exposes");
        exec.read_frame(&frame, &mut after).expect("the frame has that size");
        let (_, grad) = self.compare(exec, &frame);
        exec.read_frame_grad(&frame, &grad, &mut of_photograph).expect("it fits");
        let grad = exec.expose_vjp(&frame, &EXPOSURE, grad).expect("the executor goes back");
        exec.read_frame_grad(&frame, &grad, &mut of_picture).expect("it fits");
        let report = exec.report().expect("sums come back").expect("no step exceeds the capacity");
        assert_eq!(
            exec.report().expect("nothing is left").and_then(|report| report.exposure),
            None,
            "it is reported once"
        );
        Exposed { before, after, of_photograph, of_picture, of_exposure: report.exposure.expect("there was one") }
    }

    /// Core's result for the same picture and gradient in `f64`, pixel by pixel.
    fn expose_exactly(&self, exposed: &Exposed) -> (Vec<f64>, Vec<f64>, Exposure<f64>) {
        let (size, channels) = (self.pixel_count(), self.channels());
        let exposure = EXPOSURE.map(|row| row.map(|number| Double(f64::from(number))));
        let wide = |planes: &[f32]| planes.iter().map(|x| f64::from(*x)).collect::<Vec<f64>>();
        let (mut after, mut picture_grad) = (wide(&exposed.before), wide(&exposed.of_photograph));
        let mut exposure_grad = [[0.0; 4]; 3];
        for pixel in 0..size {
            let at = |planes: &[f64]| [0, 1, 2].map(|c| Double(planes[c * size + pixel]));
            let ([r, g, b], [dr, dg, db]) = (at(&after), at(&picture_grad));
            let coverage = Double(1.0 - after[channels * size + pixel]);
            let (own, color_grad, coverage_grad) = expose_vjp(&exposure, vec3(r, g, b), coverage, vec3(dr, dg, db));
            let shown = expose(&exposure, vec3(r, g, b), coverage).to_array();
            for (c, (shown, grad)) in shown.into_iter().zip(color_grad.to_array()).enumerate() {
                (after[c * size + pixel], picture_grad[c * size + pixel]) = (shown.0, grad.0);
            }
            picture_grad[channels * size + pixel] -= coverage_grad.0;
            let sums = exposure_grad.as_flattened_mut().iter_mut();
            sums.zip(own.as_flattened()).for_each(|(sum, own)| *sum += own.0);
        }
        (after, picture_grad, exposure_grad)
    }

    #[track_caller]
    fn assert_exposed(&self, what: &str, exposed: &Exposed) {
        let (after, picture_grad, exposure_grad) = self.expose_exactly(exposed);
        assert_grad(&format!("{what}, photograph"), self, &exposed.after, &after, SAME_GRADIENT);
        assert_grad(&format!("{what}, gradient"), self, &exposed.of_picture, &picture_grad, SAME_GRADIENT);
        let apart = relative_difference(exposed.of_exposure.as_flattened(), exposure_grad.as_flattened());
        assert!(apart <= SAME_GRADIENT, "{what}: the exposure's gradient is {apart:e} apart");
    }
}

#[test]
fn photographs_are_exposed_as_core_says_and_so_are_their_gradients() {
    let mut cpu = CpuExecutor::new();
    let mut gpu = executor();
    for (what, scene) in scenes() {
        let theirs = scene.expose(&mut cpu);
        scene.assert_exposed(&format!("{what} on the CPU"), &theirs);
        let Some(gpu) = &mut gpu else { continue };
        let ours = scene.expose(gpu);
        scene.assert_exposed(&format!("{what} on the GPU"), &ours);
        let apart = relative_difference(ours.of_exposure.as_flattened(), theirs.of_exposure.as_flattened());
        assert!(apart <= AS_THE_CPU_COMPARES, "{what}: the executors' gradients of the exposure are {apart:e} apart");
    }
}

/// Normals are smoothed by the gloss of the scene before exposure, not of the photograph.
#[test]
fn an_exposure_changes_nothing_of_smooth_normals() {
    fn assert_same_smoothness<E: Executor>(exec: &mut E, what: &str, scene: &Scene) -> f64 {
        let frame = scene.frame(exec);
        let (report, _) = scene.compare(exec, &frame);
        let exposed = exec.expose(frame, &EXPOSURE).expect("the executor exposes");
        assert_eq!(scene.compare(exec, &exposed).0.smoothness, report.smoothness, "{what}");
        report.smoothness
    }
    let (mut cpu, mut gpu) = (CpuExecutor::new(), executor());
    let mut largest = 0.0_f64;
    for (what, scene) in scenes() {
        let loss = assert_same_smoothness(&mut cpu, &what, &scene);
        if scene.rules.is_deferred(scene.cloud.layout) {
            largest = largest.max(loss);
        }
        if let Some(gpu) = &mut gpu {
            assert_same_smoothness(gpu, &what, &scene);
        }
    }
    assert!(largest > 2.0 * LEAST_SMOOTHNESS, "{largest}: pixels with gloss are smoothed");
}

#[test]
fn losses_of_normals_are_equal_on_both_executors() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    for weights in
        [LossWeights { smoothness: 1.0, ..LossWeights::NONE }, LossWeights { normal: 1.0, ..LossWeights::NONE }]
    {
        let scene = Scene { weights, ..Scene::mirror(Truth::Ellipse, 3) };
        let (ours, theirs) = (scene.on_gpu(&mut gpu), scene.on_cpu(&mut cpu));
        let wide: Vec<f64> = theirs.grad.iter().map(|x| f64::from(*x)).collect();
        assert!(wide.iter().any(|x| *x != 0.0), "there is something to compare of {weights:?}");
        let wide = where_rendered(&scene, &ours.frame, &wide);
        assert_grad(&format!("{weights:?}"), &scene, &ours.grad, &wide, AS_THE_CPU_COMPARES);
        assert_report(&format!("{weights:?}"), &ours.report, &theirs.report, AS_THE_CPU_REPORTS);
    }
}

#[test]
fn identity_exposures_change_no_bit() {
    let mut cpu = CpuExecutor::new();
    for (what, scene) in scenes() {
        let frame = scene.frame(&mut cpu);
        let (report, grad) = scene.compare(&mut cpu, &frame);
        let exposed = cpu.expose(frame.clone(), &IDENTITY).expect("the CPU exposes");
        let (same_report, same_grad) = scene.compare(&mut cpu, &exposed);
        assert_eq!(report, same_report, "{what}: losses");
        let same_grad = cpu.expose_vjp(&exposed, &IDENTITY, same_grad).expect("the CPU goes back");
        assert_eq!(grad, same_grad, "{what}: gradients");
    }
}
