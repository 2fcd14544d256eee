//! The GPU executor against core, and against the CPU executor.

use specula_core::{
    camera::Camera,
    executor::{RenderRules, Renderer},
    pipeline::render,
    plan::Channels,
    prefilter::{LevelRange, Levels, PrefilterScheme},
    scene::{Environment, Gaussians, Layout, RadianceActivation},
    shade::ShadingRules,
};
use specula_cpu::CpuExecutor;
use specula_gpu::formulas::{
    ColorOfPixel, ColorsOf, Exp2Fraction, LevelOf, LitColorsOf, Log2Mantissa, ShadingOf, SplatOf, SurfaceOf,
    SurfaceOfPixel, TexelsAt,
    blend::{BlendEnd, BlendSplat, BlendStart, PixelBlock},
};
use specula_tests::{
    compare::{assert_psnr, psnr},
    device::executor,
    formulas::{ROWS, assert_same, camera, gaussian_rows, numbers_of, side_by_side, uniform_rows},
    strategies::{random_cloud, random_environment},
};

/// Both executors round a few hundred operations, each in its own order; a pixel on the other side of the cut at 1/255
/// brings a small picture down to 85 dB.
const SAME_FRAME: f64 = 80.0;
const RESOLUTION: usize = 16;

fn shading(rules: ShadingRules, channels: Channels) -> ShadingOf {
    ShadingOf { layout: Layout::shaded(Some(3)), rules: RenderRules::full(rules, PrefilterScheme::Exact, channels) }
}

#[test]
fn every_formula_is_on_the_device_what_it_is_on_the_host() {
    let Some(mut gpu) = executor() else { return };
    let gpu = &mut gpu;
    assert_same(gpu, &Exp2Fraction, &uniform_rows(1, &[[-0.5, 0.5]]));
    assert_same(gpu, &Log2Mantissa, &uniform_rows(2, &[[0.71, 1.41]]));
    for (block, channels) in [
        (PixelBlock { width: 1, height: 1 }, 12),
        (PixelBlock { width: 2, height: 1 }, 3),
        (PixelBlock { width: 4, height: 2 }, 8),
    ] {
        assert_same(gpu, &BlendStart { block }, &uniform_rows(3, &vec![[0.0, 1.0]; block.count()]));
        let mut bounds = vec![[0.1, 0.8], [-0.5, 0.5], [0.1, 0.8], [-3.0, 0.0], [-3.0, 3.0], [-3.0, 3.0]];
        bounds.extend(vec![[-1.0, 1.0]; channels]);
        bounds.extend(vec![[0.05, 1.0]; 2 * block.count()]);
        bounds.extend(vec![[-1.0, 1.0]; block.count() * channels]);
        assert_same(gpu, &BlendSplat { block, channels }, &uniform_rows(4, &bounds));
        assert_same(gpu, &BlendEnd { block }, &uniform_rows(3, &vec![[0.0, 1.0]; block.count()]));
    }
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
    let formulas =
        [include_str!("../../exec-gpu/src/formulas.rs"), include_str!("../../exec-gpu/src/formulas/blend.rs")];
    let formulas = formulas.concat();
    let own: String = include_str!("gpu.rs").split_whitespace().collect();
    let names = formulas.split("impl Formula for ").skip(1).filter_map(|rest| rest.split_whitespace().next());
    let count = names.inspect(|name| {
        assert!(own.contains(&format!("assert_same(gpu,&{name}")), "{name} has no case on the device");
    });
    assert!(count.count() > 10, "formulas are found by how they are written");
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
