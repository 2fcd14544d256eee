//! Densification on the device against that of the CPU executor.

use specula_core::{
    activation::sigmoid,
    color::Picture,
    densify::DensifyRules,
    executor::{DensifyReport, Executor, RandomKey, Renderer},
    loss::{LossWeights, NormalForm},
    prefilter::PrefilterScheme,
    random::uniform,
    region::Ball,
    rules::{Channels, RenderRules},
    scene::{BLOCK, Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT, TINT},
    shade::ShadingRules,
    state::{AdamMoments, Statistics},
};
use specula_cpu::CpuExecutor;
use specula_gpu::{
    GpuExecutor, SplatGrads,
    stages::{
        densify::formulas::{CellAt, Decide, MeasuresOf, SplitChild},
        observe::formulas::GradLength,
    },
};
use specula_tests::{
    compare::ROUNDING_F32,
    device::{executor, executor_in_chunks_of},
    formulas::{ROWS, assert_every_formula_has_a_case, assert_same, camera, side_by_side, uniform_rows},
    strategies::random_cloud,
};

/// The planes of a Gaussian in each row.
fn plane_rows(layout: Layout) -> Vec<f32> {
    let cloud = random_cloud(ROWS, layout, 3);
    let row = |index: usize| (0..layout.plane_count()).map(move |plane| (index, plane));
    (0..ROWS).flat_map(row).map(|(index, plane)| cloud.get::<1>(index, plane)[0]).collect()
}

#[test]
fn every_formula_is_on_the_device_what_it_is_on_the_host() {
    let Some(mut gpu) = executor() else { return };
    let gpu = &mut gpu;
    assert_same(gpu, &GradLength, &uniform_rows(1, &[[-1e-3, 1e-3], [-1e-3, 1e-3], [20.0, 400.0], [20.0, 400.0]]));
    assert_same(gpu, &CellAt, &uniform_rows(2, &[[-1.0, 1.0], [-1.2, -1.0], [1.0, 1.1]]));
    assert_same(gpu, &Decide, &uniform_rows(5, &[[0.0, 1.0]; 7]));
    for layout in [Layout::radiance(0), Layout::shaded(Some(3))] {
        let rows = plane_rows(layout);
        assert_same(gpu, &MeasuresOf { layout }, &side_by_side(&rows, &uniform_rows(3, &[[0.0, 0.1], [0.0, 9.0]])));
        assert_same(gpu, &SplitChild { layout }, &side_by_side(&rows, &uniform_rows(4, &[[-3.0, 3.0]; 3])));
    }
}

#[test]
fn no_formula_is_left_out() {
    let formulas = [
        include_str!("../../../exec-gpu/src/stages/densify/formulas.rs"),
        include_str!("../../../exec-gpu/src/stages/observe/formulas.rs"),
    ];
    assert_every_formula_has_a_case(&formulas, include_str!("densify.rs"), 5);
}

const KEY: RandomKey = RandomKey { seed: 9, stream: 4 };
/// Gaussians more than there are at first.
const UNLIMITED: usize = 1 << 20;

/// All that densification changes, where an executor keeps it.
#[derive(Clone, Debug)]
struct Scene<A> {
    gaussians: Gaussians<A>,
    moments: AdamMoments<A>,
    statistics: Statistics<A>,
}

type HostScene = Scene<Vec<f32>>;

impl HostScene {
    /// A scene no number of which is near a threshold or the border of a cell, however a machine
    /// rounds: centres lie in the middle of cells, and logarithms of scales, logits of opacities
    /// and mean gradients are multiples of what [`step`] gives. The first colour of each Gaussian
    /// is its number.
    fn new(count: usize, layout: Layout, seed: u64) -> Self {
        let draw = |index: usize, what: u64| uniform(seed, index as u64, 5000 + what);
        let gaussians = snapped(random_cloud(count, layout, seed));
        let numbers = |what: u64| (0..gaussians.values.len()).map(|index| draw(index, what)).collect();
        let moments = AdamMoments { mean: numbers(1), square: numbers(2) };
        let views = |index: usize| [0.0_f32, 1.0, 2.0, 4.0][(4.0 * draw(index, 3)) as usize];
        let mean_grad = |index: usize| (32.0 * draw(index, 4)).floor() * GRAD_STEP;
        let grad_sum = (0..count).map(|index| mean_grad(index) * views(index).max(1.0)).collect();
        let statistics = Statistics { grad_sum, view_count: (0..count).map(views).collect() };
        Self { gaussians, moments, statistics }
    }

    /// Replaces some numbers by NaN or infinity.
    fn poisoned(mut self) -> Self {
        let scene = &mut self;
        for index in 0..scene.gaussians.count {
            let poison = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][index % 3];
            match index % 31 {
                3 | 4 => scene.gaussians.set(index, OPACITY, [poison]),
                7 | 8 => scene.gaussians.set(index, LOG_SCALE + index % 3, [poison]),
                11 | 12 => scene.gaussians.set(index, MEAN + index % 2, [poison]),
                15 | 16 => scene.statistics.grad_sum[index] = poison,
                20 => scene.gaussians.set(index, QUAT, [poison; 4]),
                _ => {}
            }
        }
        self
    }

    fn upload<E: Renderer>(&self, exec: &mut E) -> Scene<E::Array> {
        let mut put = |values: &[f32]| exec.upload(values).expect("numbers fit");
        let statistics =
            Statistics { grad_sum: put(&self.statistics.grad_sum), view_count: put(&self.statistics.view_count) };
        let mut put = |values| exec.upload_gaussians(&self.gaussians.with_values(values)).expect("numbers fit");
        Scene {
            gaussians: put(&self.gaussians.values),
            moments: AdamMoments { mean: put(&self.moments.mean).values, square: put(&self.moments.square).values },
            statistics,
        }
    }
}

const STEP: f32 = 1.0 / 8.0;
const GRAD_STEP: f32 = 1.0 / 64.0;

/// A cloud from -1 to 1 as [`HostScene::new`] has it.
fn snapped(mut cloud: Gaussians<Vec<f32>>) -> Gaussians<Vec<f32>> {
    for index in 0..cloud.count {
        let cell = |x: f32| ((x.clamp(-0.99, 0.99) + 1.0) * 512.0).floor();
        let mean = match index {
            0 => [-1.0; 3],
            1 => [1.0; 3],
            _ => cloud.get(index, MEAN).map(|x| (cell(x) + 0.5) / 512.0 - 1.0),
        };
        cloud.set(index, MEAN, mean);
        let scales = cloud.get::<3>(index, LOG_SCALE).map(|x| (x / STEP).round() * STEP);
        cloud.set(index, LOG_SCALE, scales);
        let opacity = cloud.get::<1>(index, OPACITY).map(|x| (x / STEP).round() * STEP);
        cloud.set(index, OPACITY, opacity);
        cloud.set(index, cloud.layout.sh_start(), [index as f32]);
    }
    cloud
}

/// Index of a child's parent.
fn parent_of(cloud: &Gaussians<Vec<f32>>, child: usize) -> usize {
    let [parent] = cloud.get::<1>(child, cloud.layout.sh_start());
    parent as usize
}

impl<A> Scene<A> {
    fn densify<E: Executor<Array = A>>(
        &mut self,
        exec: &mut E,
        rules: &DensifyRules,
        count_max: usize,
    ) -> DensifyReport {
        let Self { gaussians, moments, statistics } = self;
        exec.densify(gaussians, moments, statistics, rules, count_max, KEY).expect("the executor densifies")
    }

    fn download<E: Renderer<Array = A>>(&self, exec: &mut E) -> HostScene {
        let Gaussians { count, layout, ref values } = self.gaussians;
        let len = specula_core::scene::len_of_values(count, layout);
        let mut get = |array: &A, len: usize| {
            let mut numbers = vec![0.0; len];
            exec.download(array, &mut numbers).expect("the array has that length");
            numbers
        };
        Scene {
            gaussians: Gaussians { count, layout, values: get(values, len) },
            moments: AdamMoments { mean: get(&self.moments.mean, len), square: get(&self.moments.square, len) },
            statistics: Statistics {
                grad_sum: get(&self.statistics.grad_sum, count),
                view_count: get(&self.statistics.view_count, count),
            },
        }
    }
}

/// First difference of the device's scene after densification from that of the CPU: to the last
/// bit, but for means and scales of children, which are the same up to rounding.
fn difference(ours: &HostScene, theirs: &HostScene, before: &Gaussians<Vec<f32>>) -> Option<String> {
    let (cloud, planes) = (&theirs.gaussians, theirs.gaussians.layout.plane_count());
    if ours.gaussians.count != cloud.count {
        return Some(format!("{} Gaussians, not {}", ours.gaussians.count, cloud.count));
    }
    let bits = |values: &[f32]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    for (name, ours, theirs) in [
        ("means", &ours.moments.mean, &theirs.moments.mean),
        ("squares", &ours.moments.square, &theirs.moments.square),
        ("gradients", &ours.statistics.grad_sum, &theirs.statistics.grad_sum),
        ("views", &ours.statistics.view_count, &theirs.statistics.view_count),
    ] {
        if bits(ours) != bits(theirs) {
            return Some(format!("{name} are not the same"));
        }
    }
    let is_part = |place: usize| {
        let log_scales = |cloud: &Gaussians<Vec<f32>>, index: usize| bits(&cloud.get::<3>(index, LOG_SCALE));
        place < cloud.count && log_scales(cloud, place) != log_scales(before, parent_of(cloud, place))
    };
    let size_of = |place: usize| cloud.get::<3>(place, MEAN).iter().fold(1.0_f32, |size, x| size.max(x.abs()));
    for (index, (ours, theirs)) in ours.gaussians.values.iter().zip(&cloud.values).enumerate() {
        let (place, plane) = (index / BLOCK / planes * BLOCK + index % BLOCK, index / BLOCK % planes);
        let is_close = || f64::from((ours - theirs).abs()) <= ROUNDING_F32 * f64::from(size_of(place));
        let is_none = ours.is_nan() && theirs.is_nan();
        let is_same = ours.to_bits() == theirs.to_bits();
        if !(is_same || plane < QUAT && is_part(place) && (is_none || is_close())) {
            return Some(format!("{ours} is not {theirs}, in plane {plane} of Gaussian {place}"));
        }
    }
    None
}

const RULES: DensifyRules = DensifyRules {
    grad_min: 15.5 * GRAD_STEP,
    // Powers of e half way between two steps: e^(-1.8125), e^(-1.1875).
    split_scale: 0.163_245_5,
    opacity_min: 0.355,
    scale_max: f32::INFINITY,
};

/// Rules, and the largest number of Gaussians for a number of them.
fn cases(count: usize) -> Vec<(&'static str, DensifyRules, usize)> {
    vec![
        ("everything happens", RULES, UNLIMITED),
        ("all go", DensifyRules { opacity_min: 2.0, ..RULES }, UNLIMITED),
        ("nothing happens", DensifyRules { opacity_min: 0.0, grad_min: 1e9, ..RULES }, UNLIMITED),
        ("all are split", DensifyRules { opacity_min: 0.0, grad_min: 0.0, split_scale: 0.0, ..RULES }, UNLIMITED),
        ("all are copied", DensifyRules { opacity_min: 0.0, grad_min: 0.0, split_scale: 1e9, ..RULES }, UNLIMITED),
        ("no growth", RULES, 0),
        ("some growth", RULES, count),
        ("growth by one", DensifyRules { opacity_min: 0.0, ..RULES }, count + 1),
        ("large ones go", DensifyRules { scale_max: 0.304_996, ..RULES }, UNLIMITED),
    ]
}

#[test]
fn thresholds_lie_between_steps() {
    let half_way = |number: f32, step: f32| ((number / step).rem_euclid(1.0) - 0.5).abs() < 0.4;
    assert!(half_way(RULES.split_scale.ln(), STEP), "the scale of a split");
    assert!(half_way(0.304_996_f32.ln(), STEP), "the largest scale");
    assert!(half_way(RULES.grad_min, GRAD_STEP), "the least gradient");
    let logit = (RULES.opacity_min / (1.0 - RULES.opacity_min)).ln();
    assert!(half_way(logit, STEP) && (sigmoid(logit) - RULES.opacity_min).abs() < 1e-6, "the least opacity");
}

/// Densifies on both executors; returns the CPU's result.
fn assert_densified_alike(
    gpu: &mut GpuExecutor,
    before: &HostScene,
    name: &str,
    rules: &DensifyRules,
    count_max: usize,
) -> (DensifyReport, HostScene) {
    let mut cpu = CpuExecutor::new();
    let (mut ours, mut theirs) = (before.upload(gpu), before.clone());
    let reports = [ours.densify(gpu, rules, count_max), theirs.densify(&mut cpu, rules, count_max)];
    assert_eq!(reports[0], reports[1], "{name}, of {}", before.gaussians.count);
    let difference = difference(&ours.download(gpu), &theirs, &before.gaussians);
    assert_eq!(difference, None, "{name}, of {}", before.gaussians.count);
    (reports[0], theirs)
}

#[test]
fn densified_clouds_are_those_of_the_cpu_twice() {
    let Some(mut gpu) = executor() else { return };
    for (seed, count) in [0, 1, 17, 5000].into_iter().enumerate() {
        for layout in [Layout::radiance(0), Layout::shaded(Some(1)), Layout::radiance(0).antialiased()] {
            for (name, rules, count_max) in cases(count) {
                let scene = HostScene::new(count, layout, seed as u64);
                let (report, once) = assert_densified_alike(&mut gpu, &scene, name, &rules, count_max);
                println!("{count}, {name}: {report:?}");
                let again = HostScene {
                    gaussians: snapped(once.gaussians.clone()),
                    moments: once.moments,
                    ..HostScene::new(once.gaussians.count, layout, 77)
                };
                assert_densified_alike(&mut gpu, &again, name, &rules, count_max);
                assert_densified_alike(&mut gpu, &scene.poisoned(), name, &rules, count_max);
            }
        }
    }
}

#[test]
fn every_action_occurs() {
    let scene = || HostScene::new(5000, Layout::radiance(0), 3);
    let mut cpu = CpuExecutor::new();
    let all = scene().densify(&mut cpu, &RULES, UNLIMITED);
    assert!(all.cloned > 100 && all.split > 100 && all.pruned > 100, "{all:?}");
    let some = scene().densify(&mut cpu, &RULES, 5000);
    assert!(some.cloned + some.split < all.cloned + all.split && some.cloned > 10 && some.split > 10, "{some:?}");
    assert_eq!(some.cloned + some.split, some.pruned, "Gaussians grow only in place of pruned ones");
}

#[test]
fn densification_continues_from_its_result() {
    let Some(mut gpu) = executor() else { return };
    let mut first = HostScene::new(3000, Layout::shaded(Some(0)), 5).upload(&mut gpu);
    first.densify(&mut gpu, &RULES, UNLIMITED);
    let fresh = HostScene::new(first.gaussians.count, Layout::shaded(Some(0)), 6).statistics;
    let mut again = HostScene { statistics: fresh.clone(), ..first.download(&mut gpu) }.upload(&mut gpu);
    first.statistics = again_on_device(&mut gpu, &fresh);
    let reports = [first.densify(&mut gpu, &RULES, 4000), again.densify(&mut gpu, &RULES, 4000)];
    assert_eq!(reports[0], reports[1], "arrays that densification made are as good as others");
    let [first, again] = [first, again].map(|scene| scene.download(&mut gpu));
    assert_eq!(difference(&first, &again, &again.gaussians), None, "and so are their numbers");
}

/// Bits of all that densification changes.
fn bits_of(scene: &HostScene) -> Vec<u32> {
    let HostScene { gaussians, moments, statistics } = scene;
    let lists =
        [&gaussians.values, &moments.mean, &moments.square, &statistics.grad_sum, &statistics.view_count].into_iter();
    lists.flatten().map(|number| number.to_bits()).collect()
}

#[test]
fn densification_is_the_same_to_the_last_bit_in_pieces() {
    const COUNT: usize = 1000;
    let (layout, again) = (Layout::shaded(Some(0)), DensifyRules { grad_min: 0.0, ..RULES });
    let bytes = 4 * layout.plane_count() * 224;
    let (Some(mut whole), Some(mut divided)) = (executor(), executor_in_chunks_of(bytes as u64)) else { return };
    for (seed, (name, rules, count_max)) in (0..).zip(cases(COUNT)) {
        let densified = |gpu: &mut GpuExecutor| {
            let mut scene = HostScene::new(COUNT, layout, seed).poisoned().upload(gpu);
            let pieces = scene.gaussians.values.chunk_count();
            // Once more, so that pieces are taken as densification made them.
            let reports = [scene.densify(gpu, &rules, count_max), scene.densify(gpu, &again, 1500)];
            gpu.limit_plane(&mut scene.gaussians, &mut scene.moments, OPACITY, -1.0, None).expect("it limits");
            (pieces, reports, scene.gaussians.count, bits_of(&scene.download(gpu)))
        };
        let (expected, actual) = (densified(&mut whole), densified(&mut divided));
        assert_eq!([expected.0, actual.0], [1, 5], "{name}: one has pieces");
        assert_eq!((expected.1, expected.2), (actual.1, actual.2), "{name}: as many");
        assert!(expected.3 == actual.3, "{name}: the same numbers");
    }
}

fn again_on_device(
    gpu: &mut GpuExecutor,
    statistics: &Statistics<Vec<f32>>,
) -> Statistics<<GpuExecutor as Renderer>::Array> {
    let mut put = |values: &[f32]| gpu.upload(values).expect("numbers fit");
    Statistics { grad_sum: put(&statistics.grad_sum), view_count: put(&statistics.view_count) }
}

#[test]
fn the_comparison_of_scenes_can_fail() {
    let before = HostScene::new(100, Layout::radiance(0), 1);
    let mut after = before.clone();
    after.densify(&mut CpuExecutor::new(), &RULES, UNLIMITED);
    let is_part = |place: &usize| {
        let parent = parent_of(&after.gaussians, *place);
        after.gaussians.get::<3>(*place, LOG_SCALE) != before.gaussians.get::<3>(parent, LOG_SCALE)
    };
    let part = (0..after.gaussians.count).find(is_part).expect("some are split");
    let other = (0..after.gaussians.count).find(|place| !is_part(place)).expect("some are not");
    let changed = |change: &dyn Fn(&mut HostScene)| {
        let mut scene = after.clone();
        change(&mut scene);
        difference(&scene, &after, &before.gaussians)
    };
    let moved = |place: usize, plane: usize, by: f32| {
        changed(&|scene| {
            let number = scene.gaussians.get::<1>(place, plane).map(|x| x + by * (1.0 + x.abs()));
            scene.gaussians.set(place, plane, number);
        })
    };
    assert_eq!(moved(part, MEAN, 0.0), None, "the same is the same");
    assert_eq!(moved(part, MEAN, 2e-7), None, "parts may be rounded");
    assert!(moved(part, MEAN, 1e-5).is_some(), "but not moved");
    assert!(moved(part, QUAT, 2e-7).is_some(), "nor turned");
    assert!(moved(part, MEAN, f32::NAN).is_some(), "NaN is seen");
    assert!(moved(other, MEAN, 2e-7).is_some(), "what is copied has the same bits");
    assert!(changed(&|scene| scene.gaussians.count -= 1).is_some(), "one is missing");
    assert!(changed(&|scene| scene.moments.mean[5] += 1.0).is_some(), "momentum");
    assert!(changed(&|scene| scene.statistics.grad_sum[3] = 1.0).is_some(), "statistics");
}

#[test]
fn a_plane_is_limited_and_forgets_its_momentum() {
    let Some(mut gpu) = executor() else { return };
    for count in [0, 1, 17, 5000] {
        let before = HostScene::new(count, Layout::shaded(Some(0)), 8).poisoned();
        let mut theirs = before.clone();
        let mut ours = before.upload(&mut gpu);
        let ball = Ball { center: [0.1, -0.3, 0.2], radius: 0.8 };
        for (plane, ceiling, outside) in [(OPACITY, 0.3, None), (TINT, -0.1, Some(ball)), (MEAN + 1, -0.2, None)] {
            let HostScene { gaussians, moments, .. } = &mut theirs;
            CpuExecutor::new().limit_plane(gaussians, moments, plane, ceiling, outside).expect("the CPU limits");
            let Scene { gaussians, moments, .. } = &mut ours;
            gpu.limit_plane(gaussians, moments, plane, ceiling, outside).expect("the device limits");
        }
        let difference = difference(&ours.download(&mut gpu), &theirs, &theirs.gaussians);
        assert_eq!(difference, None, "of {count}");
    }
}

/// Roundings of a length, summed over a few views.
const SAME_LENGTH: f32 = 1e-6;

fn weights() -> LossWeights {
    LossWeights {
        absolute: 0.5,
        squared: 0.3,
        dssim: 0.2,
        normal_form: NormalForm::Cosine,
        coverage: 0.1,
        ..LossWeights::NONE
    }
}

const COLORS: usize = 3;
/// Numbers of a splat's gradient: six of its geometry, and its colours.
const GRAD_PLANES: usize = 6 + COLORS;

fn assert_same_statistics(ours: &Statistics<Vec<f32>>, theirs: &Statistics<Vec<f32>>) {
    assert_eq!(ours.view_count, theirs.view_count, "how often Gaussians were seen");
    for (gaussian, (ours, theirs)) in ours.grad_sum.iter().zip(&theirs.grad_sum).enumerate() {
        let is_close = (ours - theirs).abs() <= SAME_LENGTH * theirs.abs();
        assert!(is_close, "gradients of Gaussian {gaussian} come to {ours}, not {theirs}");
    }
}

#[test]
#[should_panic(expected = "come to")]
fn the_comparison_of_statistics_can_fail() {
    let statistics = |sum: f32| Statistics { grad_sum: vec![1.0, sum], view_count: vec![1.0; 2] };
    assert_same_statistics(&statistics(f32::NAN), &statistics(1.0));
}

#[test]
fn a_view_is_observed_as_by_the_cpu() {
    let Some(mut gpu) = executor() else { return };
    for (count, width, height) in [(0, 70, 45), (1, 1, 1), (17, 17, 16), (3000, 70, 45)] {
        observe_on_both(&mut gpu, count, [width, height]);
    }
}

fn observe_on_both(gpu: &mut GpuExecutor, count: usize, [width, height]: [u32; 2]) {
    let mut cloud = random_cloud(count, Layout::radiance(0), 21);
    // Some stand beside the picture, some behind the camera.
    for index in 0..count {
        let mean = cloud.get::<3>(index, MEAN).map(|x| 5.0 * x);
        cloud.set(index, MEAN, mean);
    }
    let camera = camera(width, height);
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    let mut cpu = CpuExecutor::new();
    let mut splats = cpu.project(&cloud, &camera).expect("the CPU projects");
    let colors = cpu.shade(&cloud, &camera, &mut splats, None, &rules).expect("the CPU shades");
    let tiles = cpu.bin(&splats, &camera).expect("the CPU bins");
    let frame = cpu.blend(&splats, &colors, &tiles, &camera).expect("the CPU blends");
    let rgba: Vec<u8> = (0..width * height * 4).map(|k| (k * 37 % 251) as u8).collect();
    let target = cpu.target(&Picture::of_bytes(width as usize, height as usize, &rgba)).expect("the bytes fit");
    let grad = cpu.loss(&frame, &target, &camera, &weights(), [0.1, 0.2, 0.3]).expect("sizes agree");
    let grads = cpu.blend_vjp(&splats, &colors, &tiles, &frame, &grad, &camera).expect("the CPU goes back");

    let before = HostScene { gaussians: cloud, ..HostScene::new(count, Layout::radiance(0), 22) };
    let mut ours = before.upload(gpu);
    let mut theirs = before.statistics;
    let own_splats = gpu.project(&ours.gaussians, &camera).expect("the device projects");
    let mut values = grads.values().to_vec();
    // The second view has gradients that are not finite, or whose length is not.
    for _ in 0..2 {
        let grads = specula_cpu::stages::blend_vjp::SplatGrads::of_values(COLORS, &values);
        cpu.observe(&mut theirs, &splats, &grads, &camera).expect("the CPU observes");
        let grads = SplatGrads::new(COLORS, gpu.upload(&values).expect("numbers fit"));
        gpu.observe(&mut ours.statistics, &own_splats, &grads, &camera).expect("the device observes");
        for gaussian in (0..count).step_by(5) {
            let first = gaussian / BLOCK * GRAD_PLANES * BLOCK + gaussian % BLOCK;
            values[first + gaussian % 2 * BLOCK] = [f32::NAN, f32::INFINITY, 1e38, 1e17][gaussian / 5 % 4];
        }
    }
    assert_same_statistics(&ours.download(gpu).statistics, &theirs);
}
