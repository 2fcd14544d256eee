//! The GPU executor against core, and against the CPU executor.

use specula_core::{
    camera::Camera,
    double::Double,
    executor::{RenderRules, Renderer},
    pipeline::render,
    plan::Channels,
    prefilter::{LevelRange, Levels, PrefilterScheme},
    real::Real,
    scene::{Environment, Gaussians, Layout, RadianceActivation},
    shade::ShadingRules,
};
use specula_cpu::CpuExecutor;
use specula_gpu::{
    GpuExecutor,
    formula::{Formula, Inputs},
    formulas::{
        BlendStep, ColorOfPixel, ColorsOf, Exp2Fraction, LevelOf, LitColorsOf, Log2Mantissa, ShadingOf, SplatOf,
        StrengthAt, SurfaceOf, SurfaceOfPixel, TexelsAt,
    },
};
use specula_tests::{
    compare::{assert_psnr, psnr},
    device::executor,
    strategies::{random_cloud, random_environment},
};

/// Both executors round a few hundred operations, each in its own order; a pixel on the other side of the cut at 1/255
/// brings a small picture down to 85 dB.
const SAME_FRAME: f64 = 80.0;
/// What a device may round worse than `f32` does, as a multiple: divisions and roots are allowed 2.5 units in the last
/// place, and operations may be fused.
const WORSE_ROUNDING: f64 = 16.0;
/// Below this share of the largest result nothing is compared: a few units in the last place.
const LAST_PLACES: f64 = 2e-6;
const RESOLUTION: usize = 16;
const ROWS: usize = 500;

fn camera(width: u32, height: u32) -> Camera {
    Camera::look_at(glam::Vec3::new(2.0, -3.0, 1.5), glam::Vec3::new(0.2, 0.0, 0.1), glam::Vec3::Z, 0.7, width, height)
}

/// The numbers of a camera, as formulas take them.
fn numbers_of(camera: &Camera) -> Vec<f32> {
    let lifted = camera.lift(0.0_f32);
    let mut numbers: Vec<f32> = lifted.camera_from_world.rows.iter().flat_map(|row| row.to_array()).collect();
    numbers.extend(lifted.position.to_array());
    numbers.extend(lifted.focal_px);
    numbers.extend(lifted.principal_px);
    numbers.extend(lifted.slope_limit);
    numbers
}

/// Uniform numbers between two bounds, a row for each draw.
fn uniform_rows(seed: u64, bounds: &[[f32; 2]]) -> Vec<f32> {
    let draw = |k: usize, [low, high]: [f32; 2]| low + (high - low) * specula_core::random::uniform(seed, 0, k as u64);
    (0..ROWS * bounds.len()).map(|k| draw(k, bounds[k % bounds.len()])).collect()
}

/// A Gaussian and the camera in each row.
fn gaussian_rows(layout: Layout) -> Vec<f32> {
    let cloud = random_cloud(ROWS, layout, 3);
    let camera = numbers_of(&camera(70, 45));
    let planes = |index: usize| (0..layout.plane_count()).map(move |plane| (index, plane));
    (0..ROWS)
        .flat_map(|index| {
            let own = planes(index).map(|(index, plane)| cloud.get::<1>(index, plane)[0]);
            own.chain(camera.iter().copied()).collect::<Vec<f32>>()
        })
        .collect()
}

/// Gaussians with the numbers of another table behind each.
fn side_by_side(rows: &[f32], others: &[f32]) -> Vec<f32> {
    let (width, other) = (rows.len() / ROWS, others.len() / ROWS);
    rows.chunks(width).zip(others.chunks(other)).flat_map(|(a, b)| [a, b].concat()).collect()
}

fn on_host<R: Real>(formula: &impl Formula, rows: &[f32], number: impl Fn(f32) -> R) -> Vec<R> {
    let width = rows.len() / ROWS;
    let evaluate = |row: &[f32]| {
        let numbers: Vec<R> = row.iter().map(|x| number(*x)).collect();
        formula.evaluate(&mut Inputs::new(&numbers))
    };
    rows.chunks(width).flat_map(evaluate).collect()
}

/// How much further the device is from the exact results than `f32` on the host may be, as a share of what is allowed;
/// the largest of all results, of which each is compared with its own kind.
fn excess(device: &[f32], host: &[f32], exact: &[f64]) -> f64 {
    let height = exact.len() / ROWS;
    let column = |k: usize| (k..exact.len()).step_by(height);
    let of_result = |k: usize| {
        let scale = column(k).map(|i| exact[i].abs()).fold(f64::MIN_POSITIVE, f64::max);
        let rounding = column(k).map(|i| (f64::from(host[i]) - exact[i]).abs()).fold(0.0, f64::max);
        let allowed = WORSE_ROUNDING * rounding + LAST_PLACES * scale;
        column(k).map(|i| (f64::from(device[i]) - exact[i]).abs() / allowed).fold(0.0, nan_wins)
    };
    (0..height).map(of_result).fold(0.0, nan_wins)
}

fn nan_wins(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::INFINITY } else { a.max(b) }
}

#[track_caller]
fn assert_same(gpu: &mut GpuExecutor, formula: &impl Formula, rows: &[f32]) {
    let device = gpu.evaluate(formula, rows).expect("the device computes");
    let host = on_host(formula, rows, |x| x);
    let exact: Vec<f64> = on_host(formula, rows, |x| Double(f64::from(x))).iter().map(|x| x.0).collect();
    let excess = excess(&device, &host, &exact);
    println!("{}: {excess:.2} of what is allowed", formula.name());
    assert!(excess <= 1.0, "{} is {excess} times as far off as allowed", formula.name());
}

fn shading(rules: ShadingRules, channels: Channels) -> ShadingOf {
    ShadingOf { layout: Layout::shaded(Some(3)), rules: RenderRules::full(rules, PrefilterScheme::Exact, channels) }
}

#[test]
fn every_formula_is_on_the_device_what_it_is_on_the_host() {
    let Some(mut gpu) = executor() else { return };
    let gpu = &mut gpu;
    assert_same(gpu, &Exp2Fraction, &uniform_rows(1, &[[-0.5, 0.5]]));
    assert_same(gpu, &Log2Mantissa, &uniform_rows(2, &[[0.71, 1.41]]));
    assert_same(
        gpu,
        &StrengthAt,
        &uniform_rows(3, &[[0.1, 2.0], [-1.0, 1.0], [0.1, 2.0], [-7.0, 0.0], [-3.0, 3.0], [-3.0, 3.0]]),
    );
    assert_same(gpu, &BlendStep, &uniform_rows(4, &[[0.0, 1.2], [0.05, 1.0]]));
    assert_same(gpu, &TexelsAt, &uniform_rows(5, &[[-1.0, -0.1], [0.2, 0.8], [-1.0, 1.0], [16.0, 16.0]]));
    let levels = Levels::new(PrefilterScheme::Exact, 64).as_slice().to_vec();
    assert_same(gpu, &LevelOf { levels }, &uniform_rows(6, &[[0.0, 1.0]]));
    assert_same(gpu, &ColorOfPixel, &uniform_rows(7, &[[0.0, 1.0]; 10]));

    for layout in [Layout::radiance(3), Layout::shaded(Some(3))] {
        assert_same(gpu, &SplatOf { layout }, &gaussian_rows(layout));
    }
    let plain = Layout::radiance(3);
    for channels in [Channels::Color, Channels::Training] {
        let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, channels);
        assert_same(gpu, &ColorsOf(ShadingOf { layout: plain, rules }), &gaussian_rows(plain));
    }
    let rows = gaussian_rows(Layout::shaded(Some(3)));
    for rules in [ShadingRules::PAPER, ShadingRules::OFFICIAL, ShadingRules::DEFERRED] {
        let shading = shading(rules, Channels::Layers);
        assert_same(gpu, &ColorsOf(shading), &rows);
        assert_same(gpu, &SurfaceOf(shading), &rows);
        let light = uniform_rows(8, &[[0.0, 2.0]; 8]);
        assert_same(gpu, &LitColorsOf(shading), &side_by_side(&rows, &light));
    }
    for blended in [Channels::Lit, Channels::Surface, Channels::Layers] {
        let cameras = numbers_of(&camera(70, 45)).repeat(ROWS);
        let mut bounds = vec![[0.1, 0.9]; blended.count() + 1];
        bounds.extend([[0.0, 70.0], [0.0, 45.0]]);
        assert_same(gpu, &SurfaceOfPixel { blended }, &side_by_side(&uniform_rows(9, &bounds), &cameras));
    }
}

#[test]
fn no_formula_is_left_out() {
    let formulas = include_str!("../../exec-gpu/src/formulas.rs");
    let own: String = include_str!("gpu.rs").split_whitespace().collect();
    let names = formulas.split("impl Formula for ").skip(1).filter_map(|rest| rest.split_whitespace().next());
    let count = names.inspect(|name| {
        assert!(own.contains(&format!("assert_same(gpu,&{name}")), "{name} has no case on the device");
    });
    assert!(count.count() > 10, "formulas are found by how they are written");
}

#[test]
fn the_comparison_of_formulas_can_fail() {
    let exact: Vec<f64> = (0..ROWS).map(|k| 1.0 + k as f64).collect();
    let host: Vec<f32> = exact.iter().map(|x| *x as f32).collect();
    assert!(excess(&host, &host, &exact) <= 1.0, "the same numbers are the same");
    let mut wrong = host.clone();
    wrong[17] *= 1.001;
    assert!(excess(&wrong, &host, &exact) > 1.0, "one wrong number is seen");
    wrong[17] = f32::NAN;
    assert!(excess(&wrong, &host, &exact) > 1.0, "NaN is seen");
}

/// A scene for both executors.
struct Scene {
    cloud: Gaussians<Vec<f32>>,
    environment: Environment<Vec<f32>>,
    camera: Camera,
    rules: RenderRules,
}

impl Scene {
    fn new(count: usize, layout: Layout, rules: RenderRules, seed: u64) -> Self {
        let (activation, resolution) = match rules.scheme {
            PrefilterScheme::Exact => (RadianceActivation::Exponential, RESOLUTION),
            PrefilterScheme::Official => (RadianceActivation::Identity, 64),
        };
        Self {
            cloud: random_cloud(count, layout, seed),
            environment: random_environment(resolution, activation, seed),
            camera: camera(70, 45),
            rules,
        }
    }

    fn picture<E: Renderer>(&self, exec: &mut E) -> Vec<f64>
    where
        E::Error: core::fmt::Debug,
    {
        let Gaussians { count, layout, values } = &self.cloud;
        let cloud = Gaussians { count: *count, layout: *layout, values: exec.upload(values).expect("numbers fit") };
        let Environment { resolution, activation, values } = &self.environment;
        let values = exec.upload(values).expect("texels fit");
        let environment = Environment { resolution: *resolution, activation: *activation, values };
        let light = layout.is_shaded().then(|| {
            exec.prefilter(&environment, self.rules.scheme, LevelRange::ALL).expect("the resolution is allowed")
        });
        let frame = render(exec, &cloud, light.as_ref(), &self.camera, &self.rules).expect("the executor renders");
        let channels = self.rules.blended(*layout).count() + 1;
        let mut values = vec![0.0; channels * (self.camera.width * self.camera.height) as usize];
        exec.read_frame(&frame, &mut values).expect("the frame has that size");
        values.iter().map(|x| f64::from(*x)).collect()
    }
}

fn every_variant() -> Vec<(Layout, RenderRules)> {
    let mut variants = Vec::new();
    for channels in [Channels::Color, Channels::Training, Channels::Layers] {
        for (shading, scheme) in [
            (ShadingRules::PAPER, PrefilterScheme::Exact),
            (ShadingRules::DEFERRED, PrefilterScheme::Exact),
            (ShadingRules::OFFICIAL, PrefilterScheme::Official),
        ] {
            let rules = RenderRules::full(shading, scheme, channels);
            variants.push((Layout::shaded(Some(2)), rules));
            variants.push((Layout::shaded(None), RenderRules { normal_residuals: false, ..rules }));
        }
        if channels != Channels::Layers {
            let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, channels);
            variants.push((Layout::radiance(3), rules));
        }
    }
    variants
}

#[test]
fn both_executors_render_the_same_pictures() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    for (seed, (layout, rules)) in (0..).zip(every_variant()) {
        let scene = Scene::new(80, layout, rules, seed);
        let (ours, theirs) = (scene.picture(&mut gpu), scene.picture(&mut cpu));
        println!("{:?} {:?}: {:.1} dB", rules.shading.form, rules.channels, psnr(&ours, &theirs));
        assert_psnr(&ours, &theirs, SAME_FRAME);
    }
}

#[test]
fn a_device_renders_the_same_bits_twice_and_whatever_it_rendered_before() {
    let Some(mut gpu) = executor() else { return };
    let rules = RenderRules::full(ShadingRules::DEFERRED, PrefilterScheme::Exact, Channels::Training);
    let scene = Scene::new(5000, Layout::shaded(Some(1)), rules, 11);
    let first = scene.picture(&mut gpu);
    Scene::new(37, Layout::shaded(Some(1)), rules, 12).picture(&mut gpu);
    assert!(scene.picture(&mut gpu) == first, "memory that was used before changes nothing");
    let another = executor().expect("there was one before");
    let mut another = another;
    assert!(scene.picture(&mut another) == first, "a new executor computes the same");
}

#[test]
fn many_splats_and_no_splats_are_sorted_into_tiles() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    for count in [0, 1, 15, 2047, 2049, 20_000] {
        let scene = Scene::new(count, Layout::radiance(0), rules, 5);
        assert_psnr(&scene.picture(&mut gpu), &scene.picture(&mut cpu), SAME_FRAME);
    }
}
