//! The GPU executor's backward pass from pictures to Gaussians, and its optimiser, against core and
//! the CPU executor.

use core::iter;
use specula_core::{
    attributes::{AttributeLosses, GaussianShading},
    camera::Camera,
    double::Double,
    executor::{Executor, ReadBack, Renderer},
    loss::LossWeights,
    prefilter::{LevelRange, PrefilterScheme},
    random,
    rules::{Channels, RenderRules},
    scene::{BLOCK, Environment, Gaussians, Layout, MEAN, OPACITY, RadianceActivation, len_of_values},
    shade::ShadingRules,
    splat::SplatGrad,
    state::AdamMoments,
};
use specula_cpu::CpuExecutor;
use specula_gpu::{
    GpuExecutor, KernelSet, SplatGrads,
    stages::{
        blend::formulas::PixelBlock,
        blend_vjp::{
            ReplayBy, ReplayDivision,
            formulas::{MomentsVjp, PixelGrads, ReplayResume, ReplaySplat, ReplayStart, ReplayState},
        },
        gaussians_vjp::formulas::{AttributeLossesVjp, LookupVjp, PlanesVjp},
        optimise::formulas::AdamStep,
    },
};
use specula_tests::{
    compare::{ROUNDING_F32, relative_difference},
    device::executor,
    formulas::{
        ROWS, assert_every_formula_has_a_case, assert_same, camera, gaussian_rows, light_frame_rows, side_by_side,
        uniform_rows,
    },
    plain::{self, lift, lift_gaussians},
    strategies::{random_cloud, random_environment, under_turned_light},
};

/// Gradients of a small picture in `f32`, number by number, relative to the largest of its kind: a
/// pixel on the other side of the cut at 1/255 makes a few in ten thousand.
const SAME_SPLAT_GRADIENT: f64 = 5e-4;
/// The same for what follows from equal gradients of splats, where nothing is cut off: a few
/// hundred roundings.
const SAME_GRADIENT: f64 = 1e-5;
/// The same for lookups of a light whose texels are independent of their neighbours: a direction
/// that is rounded moves by 4e-6 of a texel on a map of 64.
const SAME_GRADIENT_UNDER_LIGHT: f64 = 1e-4;
/// Numbers of a splat's gradient before its channels.
const GEOMETRY: usize = 6;

fn rules(shading: ShadingRules, channels: Channels) -> RenderRules {
    let scheme = match shading {
        ShadingRules::OFFICIAL => PrefilterScheme::Official,
        _ => PrefilterScheme::Exact,
    };
    RenderRules::full(shading, scheme, channels)
}

#[test]
fn every_formula_is_on_the_device_what_it_is_on_the_host() {
    let Some(mut gpu) = executor() else { return };
    let gpu = &mut gpu;
    let unit = |seed: u64, count: usize| uniform_rows(seed, &vec![[-1.0, 1.0]; count]);
    for (block, channels) in [
        (PixelBlock { width: 2, height: 2 }, 3),
        (PixelBlock { width: 2, height: 1 }, 8),
        (PixelBlock { width: 4, height: 2 }, 10),
    ] {
        let len = block.count() * (2 * channels + 3);
        assert_same(gpu, &ReplayStart { block, channels }, &unit(1, len));
        assert_same(gpu, &ReplayResume { block }, &unit(1, 2 * block.count()));
        assert_same(gpu, &PixelGrads { block, channels }, &unit(1, block.count() * (channels + 1)));
        let mut bounds = vec![[0.1, 0.8], [-0.5, 0.5], [0.1, 0.8], [-3.0, 0.0], [-3.0, 3.0], [-3.0, 3.0]];
        bounds.extend(vec![[0.05, 1.0]; block.count()]);
        bounds.extend(vec![[-1.0, 1.0]; block.count() + channels + block.count() * channels]);
        assert_same(gpu, &ReplaySplat { block, channels }, &uniform_rows(2, &bounds));
    }
    for channels in [3, 12] {
        let mut bounds = vec![[0.1, 0.8], [-0.5, 0.5], [0.1, 0.8], [-3.0, 0.0], [-3.0, 3.0], [-3.0, 3.0], [0.05, 1.0]];
        bounds.extend(vec![[-1.0, 1.0]; 1 + 2 * channels]);
        assert_same(gpu, &ReplayState { channels }, &uniform_rows(4, &bounds));
    }
    let mut bounds = vec![[0.1, 2.0], [-1.0, 1.0], [0.1, 2.0], [0.1, 1.0]];
    bounds.extend([[-1.0, 1.0]; 6]);
    assert_same(gpu, &MomentsVjp, &uniform_rows(3, &bounds));

    for (shading, channels) in every_shading() {
        let rows = side_by_side(&gaussian_rows(shading.layout), &unit(4, GEOMETRY + channels));
        let planes_vjp = PlanesVjp { shading, is_lit: false, is_turned: false, moves_camera: false };
        assert_same(gpu, &planes_vjp, &rows);
        assert_same(gpu, &PlanesVjp { moves_camera: true, ..planes_vjp }, &rows);
        if shading.looks_light_up() {
            let rows = side_by_side(&rows, &uniform_rows(5, &[[0.0, 2.0]; 8]));
            assert_same(gpu, &LookupVjp(shading), &rows);
            let rows = side_by_side(&rows, &unit(6, 9));
            assert_same(gpu, &PlanesVjp { is_lit: true, ..planes_vjp }, &rows);
            let rows = side_by_side(&rows, &light_frame_rows());
            assert_same(gpu, &PlanesVjp { is_lit: true, is_turned: true, moves_camera: true, ..planes_vjp }, &rows);
        }
    }
    let physical = Layout::shaded(Some(1)).physical();
    for (layout, weights) in [
        (Layout::shaded(Some(1)), WEIGHTS),
        (Layout::shaded(None), LossWeights { sparse: 0.0, ..WEIGHTS }),
        (Layout::radiance(0), WEIGHTS),
        (physical, WEIGHTS),
        (physical, LossWeights { metalness: 0.2, ..LossWeights::NONE }),
    ] {
        let losses = AttributeLosses::new(&weights, layout);
        let rows = gaussian_rows(layout);
        let planes = rows.chunks(rows.len() / ROWS).flat_map(|row| &row[..layout.plane_count()]).copied();
        let rows = side_by_side(
            &planes.collect::<Vec<f32>>(),
            &uniform_rows(8, &[[-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0], [0.0, 2.0]]),
        );
        assert_same(gpu, &AttributeLossesVjp { layout, losses }, &rows);
    }
    let bounds = [[-1.0, 1.0], [-0.1, 0.1], [0.0, 0.01], [-1.0, 1.0], [0.001, 0.01], [1e-17, 1e-16]];
    assert_same(gpu, &AdamStep, &uniform_rows(9, &bounds));
}

/// Every way of shading, and how many channels are blended then.
fn every_shading() -> Vec<(GaussianShading, usize)> {
    let mut shadings = Vec::new();
    for channels in [Channels::Color, Channels::Training] {
        let plain = Layout::radiance(3);
        shadings.push(GaussianShading { layout: plain, rules: rules(ShadingRules::PAPER, channels) });
        for shading in [ShadingRules::PAPER, ShadingRules::DEFERRED, ShadingRules::OFFICIAL] {
            let layout = Layout::shaded(Some(2));
            shadings.push(GaussianShading { layout, rules: rules(shading, channels) });
            let rules = RenderRules { normal_residuals: false, sh_degree: None, ..rules(shading, channels) };
            shadings.push(GaussianShading { layout, rules });
            shadings.push(GaussianShading { layout: layout.antialiased(), rules });
        }
        let layout = Layout::shaded(Some(1)).physical();
        shadings.push(GaussianShading { layout, rules: rules(ShadingRules::PHYSICAL, channels) });
        shadings.push(GaussianShading { layout, rules: rules(ShadingRules::DEFERRED, channels) });
    }
    shadings.into_iter().map(|shading| (shading, shading.channels().count())).collect()
}

#[test]
fn no_formula_is_left_out() {
    let formulas = [
        include_str!("../../../exec-gpu/src/stages/blend_vjp/formulas.rs"),
        include_str!("../../../exec-gpu/src/stages/gaussians_vjp/formulas.rs"),
        include_str!("../../../exec-gpu/src/stages/optimise/formulas.rs"),
    ];
    assert_every_formula_has_a_case(&formulas, include_str!("back.rs"), 10);
}

/// A scene and the gradient of its picture.
struct Scene {
    cloud: Gaussians<Vec<f32>>,
    environment: Option<Environment<Vec<f32>>>,
    camera: Camera,
    rules: RenderRules,
    frame_grad: Vec<f32>,
}

impl Scene {
    fn new(count: usize, layout: Layout, rules: RenderRules, [width, height]: [u32; 2], seed: u64) -> Self {
        let cloud = random_cloud(count, layout, seed);
        let camera = camera(width, height);
        let planes = rules.blended(layout).count() + 1;
        let draw = |k: usize| 2.0 * random::uniform(seed, 77, k as u64) - 1.0;
        let frame_grad = (0..planes * (width * height) as usize).map(draw).collect();
        Self { cloud, environment: None, camera, rules, frame_grad }
    }

    fn lit(mut self, seed: u64) -> Self {
        let (activation, resolution) = match self.rules.scheme {
            PrefilterScheme::Exact => (RadianceActivation::Exponential, 16),
            PrefilterScheme::Official => (RadianceActivation::Identity, 64),
        };
        self.environment = Some(random_environment(resolution, activation, seed));
        self
    }

    fn channels(&self) -> usize {
        self.rules.blended(self.cloud.layout).count()
    }

    fn uploaded_environment<E: Renderer>(&self, exec: &mut E) -> Option<Environment<E::Array>> {
        let Environment { resolution, activation, values } = self.environment.as_ref()?;
        let values = exec.upload(values).expect("texels fit");
        Some(Environment { resolution: *resolution, activation: *activation, values })
    }

    fn light<E: Renderer>(&self, exec: &mut E) -> Option<E::Light> {
        let environment = self.uploaded_environment(exec)?;
        Some(exec.prefilter(&environment, self.rules.scheme, LevelRange::ALL).expect("the resolution is allowed"))
    }

    /// Forward to the picture and back to the splats.
    fn splat_grads<E: Back>(&self, exec: &mut E) -> Vec<f32> {
        let cloud = uploaded(exec, &self.cloud);
        let light = self.light(exec);
        let mut splats = exec.project(&cloud, &self.camera).expect("the executor projects");
        let colors =
            exec.shade(&cloud, &self.camera, &mut splats, light.as_ref(), &self.rules).expect("the executor shades");
        let tiles = exec.bin(&splats, &self.camera).expect("the executor bins");
        let frame = exec.blend(&splats, &colors, &tiles, &self.camera).expect("the executor blends");
        let grad = exec.upload_frame_grad(&frame, &self.frame_grad).expect("numbers fit");
        let grads = exec.blend_vjp(&splats, &colors, &tiles, &frame, &grad, &self.camera);
        exec.numbers_of(&grads.expect("the executor goes back"))
    }

    /// From the gradients of splats to those of the Gaussians, and of the environment where
    /// Gaussians look light up.
    fn gradients<E: Back>(&self, exec: &mut E, splat_grads: &[f32], weights: &LossWeights) -> (Vec<f32>, Vec<f32>) {
        let cloud = uploaded(exec, &self.cloud);
        let light = self.light(exec);
        let splats = exec.project(&cloud, &self.camera).expect("the executor projects");
        let grads = exec.grads_of(self, splat_grads);
        let back = exec.gaussians_vjp(&cloud, &self.camera, &splats, light.as_ref(), &self.rules, weights, &grads);
        let (grad, light_grad) = back.expect("the executor goes back");
        let mut values = vec![0.0; len_of_values(grad.count, grad.layout)];
        exec.download(&grad.values, &mut values).expect("numbers come back");
        let (Some(light), Some(light_grad)) = (light, light_grad) else { return (values, Vec::new()) };
        let environment = self.uploaded_environment(exec).expect("there is a light");
        let grad = exec.prefilter_vjp(&environment, &light, &light_grad).expect("the executor goes back");
        let mut texels = vec![0.0; environment.len_of_values()];
        exec.download(&grad, &mut texels).expect("numbers come back");
        (values, texels)
    }
}

/// Kernels may round the edge of an outline otherwise, and count a tile that another does not find.
#[test]
fn tiles_that_only_one_kernel_finds_change_nothing() {
    let Some(mut gpu) = executor() else { return };
    let rules = RenderRules::full(ShadingRules::DEFERRED, PrefilterScheme::Exact, Channels::Training);
    for (count, seed) in [(3000, 5), (40, 6)] {
        let scene = Scene::new(count, Layout::shaded(None), rules, [70, 45], seed);
        let mut grads = |recount: fn(u32) -> u32| {
            let cloud = uploaded(&mut gpu, &scene.cloud);
            let light = scene.light(&mut gpu);
            let mut splats = gpu.project(&cloud, &scene.camera).unwrap();
            let colors = gpu.shade(&cloud, &scene.camera, &mut splats, light.as_ref(), &scene.rules).unwrap();
            gpu.recount_tiles(&mut splats, recount).unwrap();
            let tiles = gpu.bin(&splats, &scene.camera).unwrap();
            let frame = gpu.blend(&splats, &colors, &tiles, &scene.camera).unwrap();
            let grad = gpu.upload_frame_grad(&frame, &scene.frame_grad).unwrap();
            let grads = gpu.blend_vjp(&splats, &colors, &tiles, &frame, &grad, &scene.camera).unwrap();
            gpu.numbers_of(&grads)
        };
        let counted = grads(|count| count);
        assert!(counted.iter().any(|number| *number != 0.0), "something is drawn");
        assert_eq!(grads(|count| if count == 1 { 2 } else { count }), counted);
        let fewer = grads(|count| if count > 1 { count - 1 } else { count });
        assert!(fewer.iter().all(|number| number.is_finite()) && fewer != counted);
    }
}

fn uploaded<E: Renderer>(
    exec: &mut E,
    Gaussians { count, layout, values }: &Gaussians<Vec<f32>>,
) -> Gaussians<E::Array> {
    Gaussians { count: *count, layout: *layout, values: exec.upload(values).expect("numbers fit") }
}

/// Executor whose gradients are numbers on the host.
trait Back: ReadBack {
    fn grads_of(&mut self, scene: &Scene, values: &[f32]) -> Self::SplatGrads;
    fn numbers_of(&mut self, grads: &Self::SplatGrads) -> Vec<f32>;
}

impl Back for CpuExecutor {
    fn grads_of(&mut self, scene: &Scene, values: &[f32]) -> Self::SplatGrads {
        specula_cpu::stages::blend_vjp::SplatGrads::of_values(scene.channels(), values)
    }
    fn numbers_of(&mut self, grads: &Self::SplatGrads) -> Vec<f32> {
        grads.values().to_vec()
    }
}

impl Back for GpuExecutor {
    fn grads_of(&mut self, scene: &Scene, values: &[f32]) -> Self::SplatGrads {
        SplatGrads::new(scene.channels(), self.upload(values).expect("numbers fit"))
    }
    fn numbers_of(&mut self, grads: &Self::SplatGrads) -> Vec<f32> {
        self.read_splat_grads(grads).expect("numbers come back")
    }
}

/// Index of a number of a Gaussian in an array of planes.
fn place(gaussian: usize, planes: usize, plane: usize) -> usize {
    (gaussian / BLOCK * planes + plane) * BLOCK + gaussian % BLOCK
}

/// The largest difference of any plane, as a share of the largest number in it or in those that it
/// belongs to.
#[track_caller]
fn difference(actual: &[f32], expected: &[f64], count: usize, kinds: &[usize]) -> f64 {
    assert_eq!(actual.len(), expected.len(), "lists of different lengths cannot be close");
    let planes = kinds.len();
    let groups = kinds.chunk_by(|a, b| a == b).scan(0, |first, group| {
        let own = *first..*first + group.len();
        *first = own.end;
        Some(own)
    });
    let group_difference = |group: core::ops::Range<usize>| {
        let places = || (0..count).flat_map(|g| group.clone().map(move |plane| place(g, planes, plane)));
        let actual: Vec<f64> = places().map(|k| f64::from(actual[k])).collect();
        let expected: Vec<f64> = places().map(|k| expected[k]).collect();
        relative_difference(&actual, &expected)
    };
    groups.map(group_difference).fold(0.0, f64::max)
}

/// Groups of planes in a splat's gradient.
fn splat_kinds(channels: usize) -> Vec<usize> {
    [0, 0, 1, 1, 1, 2].into_iter().chain((0..channels).map(|channel| 3 + channel / 3)).collect()
}

/// Groups of planes of a Gaussian.
fn plane_kinds(layout: Layout) -> Vec<usize> {
    let kind = |plane: usize| match plane {
        0..3 => 0,
        3..6 => 1,
        6..10 => 2,
        10 => 3,
        _ if !layout.is_shaded() => 10,
        11..14 => 4,
        14..17 => 5,
        17 => 6,
        18..24 => 7,
        _ => 10,
    };
    (0..layout.plane_count()).map(kind).collect()
}

#[test]
fn the_comparison_of_planes_can_fail() {
    let count = 20;
    let kinds = splat_kinds(3);
    let expected: Vec<f64> = (0..2 * BLOCK * kinds.len()).map(|k| 1.0 + k as f64).collect();
    let same: Vec<f32> = expected.iter().map(|x| *x as f32).collect();
    assert!(difference(&same, &expected, count, &kinds) == 0.0, "the same numbers are the same");
    for plane in 0..kinds.len() {
        let mut wrong = same.clone();
        wrong[place(19, kinds.len(), plane)] += 10.0;
        assert!(difference(&wrong, &expected, count, &kinds) > 0.01, "a wrong number in plane {plane} is seen");
        wrong[place(19, kinds.len(), plane)] = f32::NAN;
        assert!(difference(&wrong, &expected, count, &kinds) > 1.0, "NaN in plane {plane} is seen");
    }
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}

/// The gradients of splats in `f64`.
fn exact_splat_grads(scene: &Scene) -> Vec<f64> {
    let cloud = lift_gaussians::<Double>(&scene.cloud);
    let splats = plain::project(&cloud, &scene.camera);
    let colors = plain::shade(&cloud, &scene.camera, None, &scene.rules);
    let order = plain::front_to_back(&splats);
    let frame = plain::blend(&splats, &colors, &order, &scene.camera);
    let grad = plain::Frame { values: lift(&scene.frame_grad), ..frame.clone() };
    let (grads, channels) = plain::blend_vjp(&splats, &colors, &order, &frame, &grad);
    let planes = GEOMETRY + scene.channels();
    let mut values = vec![0.0; scene.cloud.count.next_multiple_of(BLOCK) * planes];
    for (gaussian, (SplatGrad { mean2d, root_conic, opacity, .. }, channels)) in iter::zip(grads, channels).enumerate()
    {
        // Gaussians that are not drawn may divide by a pivot of zero.
        let is_drawn = order.contains(&gaussian);
        let numbers = mean2d.into_iter().chain(root_conic).chain([opacity]).chain(channels);
        for (plane, number) in numbers.enumerate().filter(|_| is_drawn) {
            values[place(gaussian, planes, plane)] = number.0;
        }
    }
    values
}

#[test]
fn gradients_of_splats_are_those_of_the_cpu_and_of_the_plain_pipeline() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    let variants = [
        (Layout::radiance(1), rules(ShadingRules::PAPER, Channels::Color)),
        (Layout::radiance(0), rules(ShadingRules::PAPER, Channels::Training)),
        (Layout::shaded(Some(1)), rules(ShadingRules::PAPER, Channels::Training)),
        (Layout::shaded(Some(1)), rules(ShadingRules::DEFERRED, Channels::Training)),
        (Layout::shaded(Some(1)).antialiased(), rules(ShadingRules::DEFERRED, Channels::Training)),
    ];
    for (seed, (layout, rules)) in (1..).zip(variants) {
        for (size, count) in [([70, 45], 80), ([17, 16], 33), ([1, 1], 20), ([33, 40], 1), ([20, 20], 0)] {
            let scene = Scene::new(count, layout, rules, size, seed);
            let theirs = scene.splat_grads(&mut cpu);
            let exact = exact_splat_grads(&scene);
            let kinds = splat_kinds(scene.channels());
            let difference = |a: &[f32], b: &[f64]| difference(a, b, count, &kinds);
            let cpu_error = difference(&theirs, &exact);
            for kernels in KernelSet::ALL {
                gpu.set_kernels(kernels);
                let ours = scene.splat_grads(&mut gpu);
                let (apart, error) = (difference(&ours, &wide(&theirs)), difference(&ours, &exact));
                let what = format!("{kernels:?} {size:?} {:?}", rules.channels);
                println!("{what}: {apart:.1e} apart; {error:.1e} of f64, CPU {cpu_error:.1e}");
                assert!(apart <= SAME_SPLAT_GRADIENT, "{what}: the executors are {apart:e} apart");
                assert!(error <= SAME_SPLAT_GRADIENT, "{what}: {error:e} from f64");
                let padding = (count..count.next_multiple_of(BLOCK))
                    .flat_map(|g| (0..kinds.len()).map(move |plane| (g, plane)))
                    .map(|(g, plane)| ours[place(g, kinds.len(), plane)]);
                assert!(padding.into_iter().all(|x| x == 0.0), "what fills up the last block gets nothing");
            }
        }
    }
}

#[test]
fn many_channels_and_deep_tiles_go_back_as_on_the_cpu_however_they_are_divided() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    for channels in [Channels::Color, Channels::Layers] {
        let scene = Scene::new(4000, Layout::shaded(None), rules(ShadingRules::DEFERRED, channels), [70, 45], 3);
        let theirs = wide(&scene.splat_grads(&mut cpu));
        let block = |width, height| PixelBlock { width, height };
        let by_pixels = [block(2, 2), block(4, 2), block(4, 4)].map(ReplayBy::Pixels);
        let by_splats = [
            (block(4, 1), 32, 64),
            (block(2, 2), 64, 128),
            (block(8, 1), 32, 64),
            (block(2, 1), 64, 256),
            (block(4, 4), 3, 64),
        ];
        let by_splats = by_splats.map(|(block, count, segment)| ReplayBy::Splats { block, count, segment });
        for by in by_pixels.into_iter().chain(by_splats) {
            gpu.set_replay_division(ReplayDivision { by, ..gpu.replay_division() });
            let ours = scene.splat_grads(&mut gpu);
            let apart = difference(&ours, &theirs, scene.cloud.count, &splat_kinds(scene.channels()));
            println!("{} channels, {by:?}: {apart:.1e} apart", scene.channels());
            assert!(apart <= SAME_SPLAT_GRADIENT, "{} channels, {by:?}: {apart:e} apart", scene.channels());
        }
    }
}

#[test]
fn gradients_of_splats_are_the_same_bits_in_however_many_turns_and_on_every_executor() {
    let Some(mut gpu) = executor() else { return };
    let scene =
        Scene::new(500, Layout::shaded(Some(1)), rules(ShadingRules::DEFERRED, Channels::Training), [70, 45], 9);
    for kernels in KernelSet::ALL {
        gpu.set_kernels(kernels);
        let first = scene.splat_grads(&mut gpu);
        assert!(scene.splat_grads(&mut gpu) == first, "memory that was used before changes nothing");
        let parts = gpu.replay_division();
        for slots_max in [1000, 97, 1 << 30] {
            gpu.set_replay_division(ReplayDivision { slots_max, ..parts });
            assert!(scene.splat_grads(&mut gpu) == first, "{kernels:?}: {slots_max} slots at once change nothing");
        }
        for (slots_max, segments_max) in [(usize::MAX, 7), (97, 5), (1000, 1)] {
            gpu.set_replay_division(ReplayDivision { slots_max, segments_max, ..parts });
            let what = format!("{kernels:?}: {segments_max} segments and {slots_max} slots at once");
            assert!(scene.splat_grads(&mut gpu) == first, "{what} change nothing");
        }
        let mut another = executor().expect("there was one before");
        another.set_replay_division(ReplayDivision { slots_max: 300, ..parts });
        assert!(scene.splat_grads(&mut another) == first, "{kernels:?}: a new executor computes the same");
    }
}

const WEIGHTS: LossWeights =
    LossWeights { sparse: 0.02, residual: 0.3, metalness: 0.2, mean_light: 0.4, ..LossWeights::NONE };

#[test]
fn gradients_of_gaussians_are_those_of_the_cpu() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    for (seed, (GaussianShading { layout, rules }, _)) in (1..).zip(every_shading()) {
        for count in [0, 1, 90] {
            let scene = Scene::new(count, layout, rules, [70, 45], seed);
            let weights = if seed % 2 == 0 { WEIGHTS } else { LossWeights::NONE };
            assert_same_gradients(&mut gpu, &mut cpu, &scene, &weights, SAME_GRADIENT);
        }
    }
}

#[test]
fn gradients_of_gaussians_under_a_light_are_those_of_the_cpu() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    let shaded = every_shading().into_iter().filter(|(shading, _)| shading.layout.is_shaded());
    for (seed, (GaussianShading { layout, rules }, _)) in (1..).zip(shaded) {
        for count in [0, 90] {
            let scene = Scene::new(count, layout, rules, [70, 45], seed).lit(seed);
            assert_same_gradients(&mut gpu, &mut cpu, &scene, &WEIGHTS, SAME_GRADIENT_UNDER_LIGHT);
            if count > 0 && !rules.is_deferred(layout) {
                let turned = Scene { camera: under_turned_light(scene.camera), ..scene };
                assert_same_gradients(&mut gpu, &mut cpu, &turned, &WEIGHTS, SAME_GRADIENT_UNDER_LIGHT);
            }
        }
    }
}

fn assert_same_gradients(
    gpu: &mut GpuExecutor,
    cpu: &mut CpuExecutor,
    scene: &Scene,
    weights: &LossWeights,
    tolerance: f64,
) {
    let Scene { cloud, rules, .. } = scene;
    let splat_grads = scene.splat_grads(cpu);
    let ours = scene.gradients(gpu, &splat_grads, weights);
    let theirs = scene.gradients(cpu, &splat_grads, weights);
    let apart = difference(&ours.0, &wide(&theirs.0), cloud.count, &plane_kinds(cloud.layout));
    let light_apart = relative_difference(&wide(&ours.1), &wide(&theirs.1));
    let channels = scene.channels();
    println!("{:?}, {channels} channels: {apart:.1e} apart, the light {light_apart:.1e}", rules.shading.form);
    assert!(apart <= tolerance, "{rules:?}: the executors are {apart:e} apart");
    assert!(light_apart <= tolerance, "{rules:?}: the light's gradients are {light_apart:e} apart");
    let looks_light_up = scene.environment.is_some() && !rules.is_deferred(cloud.layout);
    assert_eq!(!ours.1.is_empty(), looks_light_up, "Gaussians that look light up have a gradient for it");
    assert!(scene.gradients(gpu, &splat_grads, weights) == ours, "the same bits every time");
}

#[test]
fn gradients_of_gaussians_without_a_picture_are_only_those_of_their_attributes() {
    let Some(mut gpu) = executor() else { return };
    let scene = Scene::new(20, Layout::shaded(None), rules(ShadingRules::PAPER, Channels::Color), [17, 16], 4);
    let none = vec![0.0; 2 * BLOCK * (GEOMETRY + scene.channels())];
    let (losses, _) = scene.gradients(&mut gpu, &none, &WEIGHTS);
    assert_eq!(losses[place(21, 24, OPACITY)], 0.0, "what fills up the last block gets nothing");
    let (theirs, _) = scene.gradients(&mut CpuExecutor::new(), &none, &WEIGHTS);
    let apart = difference(&losses, &wide(&theirs), 20, &plane_kinds(scene.cloud.layout));
    assert!(apart <= ROUNDING_F32, "{apart:e} apart");
    assert!(
        scene.gradients(&mut gpu, &none, &LossWeights::NONE).0.iter().all(|x| *x == 0.0),
        "there is nothing to learn"
    );
}

#[test]
fn a_gradient_that_is_not_a_number_stays_with_its_gaussian_and_is_counted() {
    let Some(mut gpu) = executor() else { return };
    let layout = Layout::shaded(Some(0));
    let mut scene = Scene::new(20, layout, rules(ShadingRules::PAPER, Channels::Color), [17, 16], 4);
    // One Gaussian is nowhere.
    scene.cloud.set(7, MEAN, [f32::NAN; 3]);
    let planes = GEOMETRY + scene.channels();
    let mut grads = scene.splat_grads(&mut gpu);
    assert!(grads.iter().all(|x| x.is_finite()), "a Gaussian that is nowhere is not drawn");
    grads[place(3, planes, 4)] = f32::NAN;
    grads[place(4, planes, GEOMETRY)] = f32::INFINITY;
    let (ours, _) = scene.gradients(&mut gpu, &grads, &WEIGHTS);
    for gaussian in 0..20 {
        let own = (0..layout.plane_count()).map(|plane| ours[place(gaussian, layout.plane_count(), plane)]);
        let is_finite = own.clone().all(|x| x.is_finite());
        assert_eq!(is_finite, ![3, 4].contains(&gaussian), "Gaussian {gaussian}: {:?}", own.collect::<Vec<_>>());
    }
}

/// Input and output of a step of Adam.
#[derive(Clone, Debug, PartialEq)]
struct Numbers {
    values: Vec<f32>,
    mean: Vec<f32>,
    square: Vec<f32>,
    grad: Vec<f32>,
}

impl Numbers {
    /// Sets some gradients to numbers that are not finite.
    fn new(len: usize) -> Self {
        let draw = |stream: u64, low: f32, high: f32| {
            (0..len).map(move |k| low + (high - low) * random::uniform(5, stream, k as u64)).collect::<Vec<f32>>()
        };
        let mut grad = draw(3, -1.0, 1.0);
        for (k, wrong) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -f32::NAN].into_iter().enumerate() {
            grad.iter_mut().skip(7 * k + 3).step_by(113).for_each(|x| *x = wrong);
        }
        Self { values: draw(0, -1.0, 1.0), mean: draw(1, -0.1, 0.1), square: draw(2, 0.0, 0.1), grad }
    }

    fn nonfinite(&self) -> usize {
        self.grad.iter().filter(|x| !x.is_finite()).count()
    }

    /// Some steps, one after the other, by what takes one; returns how many gradients were skipped.
    fn step<E: Executor>(
        &self,
        exec: &mut E,
        mut step: impl FnMut(&mut E, E::Array, &mut AdamMoments<E::Array>, E::Array, u32) -> E::Array,
    ) -> (usize, Self) {
        let mut upload = |values: &[f32]| exec.upload(values).expect("numbers fit");
        let mut moments = AdamMoments { mean: upload(&self.mean), square: upload(&self.square) };
        let mut values = upload(&self.values);
        let mut nonfinite = 0;
        for number in 1..4 {
            let grad = exec.upload(&self.grad).expect("numbers fit");
            values = step(exec, values, &mut moments, grad, number);
            let report = exec.report().expect("counts come back").expect("no step exceeds the capacity");
            nonfinite += report.nonfinite;
        }
        let mut download = |array: &E::Array| {
            let mut values = vec![0.0; self.values.len()];
            exec.download(array, &mut values).expect("numbers come back");
            values
        };
        let (values, mean, square) = (download(&values), download(&moments.mean), download(&moments.square));
        (nonfinite, Self { values, mean, square, grad: self.grad.clone() })
    }

    #[track_caller]
    fn assert_close(&self, expected: &Self) {
        for (what, ours, theirs) in [
            ("values", &self.values, &expected.values),
            ("means", &self.mean, &expected.mean),
            ("squares", &self.square, &expected.square),
        ] {
            let apart = relative_difference(&wide(ours), &wide(theirs));
            assert!(apart <= ROUNDING_F32, "{what} are {apart:e} apart");
        }
    }

    #[track_caller]
    fn assert_kept(&self, before: &Self) {
        for k in (0..before.grad.len()).filter(|k| !before.grad[*k].is_finite()) {
            let of = |numbers: &Self| [numbers.values[k], numbers.mean[k], numbers.square[k]];
            assert_eq!(of(self), of(before), "a number whose gradient is {} stays", before.grad[k]);
        }
    }
}

#[test]
fn adam_is_that_of_the_cpu_and_leaves_out_what_is_not_finite() {
    fn steps<E: Executor>(exec: &mut E, numbers: &Numbers, layout: Layout) -> (usize, Numbers) {
        let rates: Vec<f32> = (0..layout.plane_count()).map(|plane| 0.001 * (1 + plane) as f32).collect();
        let count = numbers.values.len() / layout.plane_count();
        numbers.step(exec, |exec, values, moments, grad, step| {
            let mut gaussians = Gaussians { count, layout, values };
            let grad = Gaussians { count, layout, values: grad };
            exec.optimise(&mut gaussians, moments, grad, &rates, step).expect("the executor steps");
            gaussians.values
        })
    }
    let Some(mut gpu) = executor() else { return };
    for (blocks, layout) in [(0, Layout::radiance(0)), (1, Layout::shaded(Some(3))), (40, Layout::shaded(Some(1)))] {
        let numbers = Numbers::new(blocks * BLOCK * layout.plane_count());
        let (nonfinite, ours) = steps(&mut gpu, &numbers, layout);
        let (theirs_nonfinite, theirs) = steps(&mut CpuExecutor::new(), &numbers, layout);
        assert_eq!((nonfinite, theirs_nonfinite), (3 * numbers.nonfinite(), nonfinite), "all are counted");
        ours.assert_close(&theirs);
        ours.assert_kept(&numbers);
        assert!(steps(&mut gpu, &numbers, layout).1.values == ours.values, "the same bits every time");
    }
}

#[test]
fn the_light_takes_the_cpus_step_and_stays_within_its_limits() {
    const RADIANCE_MAX: f32 = 0.6;
    fn steps<E: Executor>(
        exec: &mut E,
        numbers: &Numbers,
        (resolution, activation): (usize, RadianceActivation),
    ) -> (usize, Numbers) {
        numbers.step(exec, |exec, values, moments, grad, step| {
            let mut environment = Environment { resolution, activation, values };
            let done = exec.optimise_environment(&mut environment, moments, grad, 0.03, RADIANCE_MAX, step);
            done.expect("the executor steps");
            environment.values
        })
    }
    let Some(mut gpu) = executor() else { return };
    for activation in [RadianceActivation::Identity, RadianceActivation::Exponential] {
        for resolution in [1, 16] {
            let numbers = Numbers::new(18 * resolution * resolution);
            let (nonfinite, ours) = steps(&mut gpu, &numbers, (resolution, activation));
            let (theirs_nonfinite, theirs) = steps(&mut CpuExecutor::new(), &numbers, (resolution, activation));
            assert_eq!((nonfinite, theirs_nonfinite), (3 * numbers.nonfinite(), nonfinite), "all are counted");
            ours.assert_close(&theirs);
            let is_limited = ours.values.iter().all(|x| (0.0..=RADIANCE_MAX).contains(x));
            assert_eq!(is_limited, activation == RadianceActivation::Identity, "{activation:?}");
            if activation == RadianceActivation::Exponential {
                ours.assert_kept(&numbers);
            }
        }
    }
}
