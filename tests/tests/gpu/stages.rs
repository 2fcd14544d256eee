//! The GPU executor against core, and against the CPU executor.

use specula_core::{
    antialias::LowPass,
    attributes::GaussianShading,
    camera::Camera,
    executor::{Executor, Renderer},
    pack::{self, FULL_PLANES, Storage},
    pipeline::render,
    prefilter::{LevelRange, Levels, PrefilterScheme},
    rules::{Channels, RenderRules, channel},
    scene::{BLOCK, LOG_SCALE, Layout, MEAN, OPACITY, RadianceActivation},
    shade::ShadingRules,
};
use specula_cpu::CpuExecutor;
use specula_gpu::{
    GpuExecutor, KernelSet,
    codegen::real::{Exp2Fraction, Log2Mantissa},
    stages::{
        blend::formulas::{BlendEnd, BlendSplat, BlendStart, EndPixels, PixelBlock, ReadSurfaces},
        light::formulas::{LevelOf, TexelsAt},
        outline::formulas::{OutlineOf, TileColumns, TileRows},
        project::formulas::SplatOf,
        sampling::formulas::{DeviationOf, IntervalOf, LeastInterval},
        shade::formulas::{ColorsOf, LitColorsOf, SurfaceOf},
    },
};
use specula_tests::{
    compare::{SAME_FRAME, assert_all_close, assert_psnr, psnr},
    conformance::{variants::every_variant, view::View},
    device::{executor, executor_in_chunks_of},
    formulas::{
        ROWS, assert_every_formula_has_a_case, assert_same, camera, gaussian_rows, light_frame_rows, numbers_of,
        side_by_side, uniform_rows,
    },
    strategies::{random_cloud, random_environment},
};

/// A few units in the last place of white.
const SAME_PIXEL: f64 = 2e-6;

fn shading(rules: ShadingRules, channels: Channels) -> GaussianShading {
    GaussianShading {
        layout: Layout::shaded(Some(3)),
        rules: RenderRules::full(rules, PrefilterScheme::Exact, channels),
    }
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
        assert_same(gpu, &ReadSurfaces { block }, &uniform_rows(3, &vec![[0.5, 9.0]; block.count()]));
        let mut bounds = vec![[0.5, 9.0]; 1 + block.count()];
        bounds.extend(vec![[0.0, 1.0]; block.count()]);
        assert_same(gpu, &EndPixels { block }, &uniform_rows(4, &bounds));
    }
    assert_same(gpu, &TexelsAt, &uniform_rows(5, &[[-1.0, -0.1], [0.2, 0.8], [-1.0, 1.0], [16.0, 16.0]]));
    let levels = Levels::new(PrefilterScheme::Exact, 64).as_slice().to_vec();
    assert_same(gpu, &LevelOf { levels }, &uniform_rows(6, &[[0.0, 1.0]]));
    let shape = [[0.0, 70.0], [0.0, 45.0], [0.2, 1.0], [-0.3, 0.3], [0.2, 1.0], [1.0, 3.0]];
    assert_same(gpu, &OutlineOf, &uniform_rows(10, &shape));
    assert_same(gpu, &TileRows, &uniform_rows(11, &[[-20.0, 90.0], [0.5, 30.0], [0.0, 2.0], [5.0, 5.0]]));
    let outline = [[-9.0, 90.0], [0.0, 45.0], [-0.5, 0.5], [1.0, 90.0], [0.1, 0.5], [-3.0, 3.0], [3.0, 9.0]];
    let rows = uniform_rows(12, &[&outline[..], &[[0.0, 3.0], [0.0, 2.0], [5.0, 5.0]]].concat());
    assert_same(gpu, &TileColumns, &rows);

    let compensated = Layout { low_pass: LowPass::Compensated, ..Layout::radiance(0) };
    for layout in [Layout::radiance(3), Layout::shaded(Some(3)), compensated, Layout::shaded(None).antialiased()] {
        assert_same(gpu, &SplatOf { layout }, &gaussian_rows(layout));
    }
    let points = uniform_rows(13, &[[-5.0, 5.0]; 3]);
    assert_same(gpu, &IntervalOf, &side_by_side(&points, &numbers_of(&camera(70, 45)).repeat(ROWS)));
    assert_same(gpu, &LeastInterval, &uniform_rows(14, &[[0.0, 1.0]; 4]));
    assert_same(gpu, &DeviationOf, &uniform_rows(15, &[[0.0, 1.0]; 2]));
    let plain = Layout::radiance(3);
    for channels in [Channels::Color, Channels::Training] {
        let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, channels);
        assert_same(gpu, &ColorsOf(GaussianShading { layout: plain, rules }), &gaussian_rows(plain));
    }
    let rows = gaussian_rows(Layout::shaded(Some(3)));
    for rules in [ShadingRules::PAPER, ShadingRules::OFFICIAL, ShadingRules::DEFERRED] {
        let shading = shading(rules, Channels::Layers);
        assert_same(gpu, &ColorsOf(shading), &rows);
        assert_same(gpu, &SurfaceOf { shading, is_turned: false }, &rows);
        let turned = side_by_side(&rows, &light_frame_rows());
        assert_same(gpu, &SurfaceOf { shading, is_turned: true }, &turned);
        let light = uniform_rows(8, &[[0.0, 2.0]; 8]);
        assert_same(gpu, &LitColorsOf(shading), &side_by_side(&rows, &light));
    }
    let physical = Layout::shaded(Some(1)).physical();
    let rules = shading(ShadingRules::PHYSICAL, Channels::Layers).rules;
    assert_same(gpu, &ColorsOf(GaussianShading { layout: physical, rules }), &gaussian_rows(physical));
}

#[test]
fn no_formula_is_left_out() {
    let formulas = [
        include_str!("../../../exec-gpu/src/codegen/real.rs"),
        include_str!("../../../exec-gpu/src/stages/project/formulas.rs"),
        include_str!("../../../exec-gpu/src/stages/outline/formulas.rs"),
        include_str!("../../../exec-gpu/src/stages/sampling/formulas.rs"),
        include_str!("../../../exec-gpu/src/stages/shade/formulas.rs"),
        include_str!("../../../exec-gpu/src/stages/blend/formulas.rs"),
    ];
    assert_every_formula_has_a_case(&formulas, include_str!("stages.rs"), 16);
}

#[test]
fn many_splats_and_no_splats_are_sorted_into_tiles() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    for count in [0, 1, 15, 2047, 2049, 20_000] {
        let view = View::new(count, Layout::radiance(0), rules, 5);
        let theirs = view.picture(&mut cpu).expect("the CPU renders");
        for kernels in KernelSet::ALL {
            gpu.set_kernels(kernels);
            assert_psnr(&view.picture(&mut gpu).expect("the device renders"), &theirs, SAME_FRAME);
        }
    }
}

#[test]
fn pictures_do_not_depend_on_the_variants_of_the_kernels() {
    let Some(mut gpu) = executor() else { return };
    for (channels, count) in
        [(Channels::Color, 0), (Channels::Color, 20_000), (Channels::Training, 5000), (Channels::Layers, 3000)]
    {
        let rules = RenderRules::full(ShadingRules::DEFERRED, PrefilterScheme::Exact, channels);
        let view = View::new(count, Layout::shaded(None), rules, 13);
        let [one, other] = KernelSet::ALL.map(|kernels| {
            gpu.set_kernels(kernels);
            view.picture(&mut gpu).expect("the device renders")
        });
        // Compilers may join a product and a sum in one kernel and not in another, which on
        // hardware can move a splat over the cut.
        let apart = one.iter().zip(&other).map(|(one, other)| (one - other).abs()).fold(0.0, f64::max);
        if gpu.gpu().is_software() {
            assert!(apart <= SAME_PIXEL, "{count} splats with {channels:?}: {apart:e} apart");
        }
        assert_psnr(&one, &other, SAME_FRAME);
    }
}

/// A viewer on the first adapter.
fn viewer(storage: Storage) -> Option<GpuExecutor<Storage>> {
    executor().map(|exec| GpuExecutor::viewer(exec.gpu().clone(), storage))
}

/// The CPU's picture of numbers that are rounded as they are stored.
fn rounded(view: &View, cpu: &mut CpuExecutor, storage: Storage) -> Vec<f64> {
    let mut gaussians = view.gaussians.clone();
    storage.round(&mut gaussians);
    let mut light = view.light(cpu).expect("the CPU filters");
    light.iter_mut().for_each(|light| light.round(storage));
    let frame = render(cpu, &gaussians, light.as_ref(), &view.camera, &view.rules).expect("the CPU renders");
    view.read(cpu, &frame).expect("the frame has that size")
}

#[test]
fn a_viewer_of_halves_shows_the_picture_of_rounded_attributes_on_the_cpu() {
    let Some(mut viewer) = viewer(Storage::F16) else { return };
    let mut cpu = CpuExecutor::new();
    let variants = every_variant().into_iter().filter(|(_, rules)| rules.channels == Channels::Training);
    for (seed, (layout, rules)) in (0..).zip(variants) {
        let view = View::new(80, layout, rules, seed);
        let ours = view.picture(&mut viewer).expect("the viewer renders");
        let theirs = rounded(&view, &mut cpu, Storage::F16);
        let in_full = psnr(&rounded(&view, &mut cpu, Storage::F32), &theirs);
        println!("{:?}: {:.1} dB; {in_full:.1} dB from full", rules.shading.form, psnr(&ours, &theirs));
        assert_psnr(&ours, &theirs, SAME_FRAME);
        assert!(psnr(&ours, &theirs) > in_full, "rounding counts for more than what the executors differ by");
    }
}

/// Roundings of a matrix product, a root and a quotient.
const SAME_DEVIATION: f32 = 1e-6;

#[test]
fn both_executors_find_the_same_filters_in_space() {
    for pieces in [false, true] {
        let Some(mut gpu) = (if pieces { executor_in_chunks_of(1) } else { executor() }) else { return };
        let mut cpu = CpuExecutor::new();
        let layout = Layout::shaded(Some(1)).antialiased();
        let plane = layout.filter_plane().expect("it has a filter");
        let views = [camera(70, 45), Camera { focal_px: [300.0, 280.0], ..camera(40, 40) }, camera(9, 300)];
        for count in [0, 1, 75] {
            let mut theirs = random_cloud(count, layout, 4);
            let mut ours = gpu.upload_gaussians(&theirs).expect("they fit");
            cpu.sampling(&mut theirs, &views).expect("the CPU samples");
            gpu.sampling(&mut ours, &views).expect("the device samples");
            let mut values = theirs.values.clone();
            gpu.download(&ours.values, &mut values).expect("there are as many");
            let ours = theirs.with_values(values);
            for gaussian in 0..count {
                let [[ours], [theirs]] = [&ours, &theirs].map(|cloud| cloud.get::<1>(gaussian, plane));
                assert!((ours / theirs - 1.0).abs() < SAME_DEVIATION, "{ours} for {theirs} of {gaussian}");
            }
        }
    }
}

#[test]
fn a_viewer_of_numbers_in_full_is_the_executor() {
    let (Some(mut viewer), Some(mut exec)) = (viewer(Storage::F32), executor()) else { return };
    for rules in [ShadingRules::PAPER, ShadingRules::DEFERRED] {
        let rules = RenderRules::full(rules, PrefilterScheme::Exact, Channels::Training);
        let view = View::new(80, Layout::shaded(Some(1)), rules, 3);
        assert!(view.picture(&mut viewer) == view.picture(&mut exec), "the same kernels give the same bits");
    }
}

#[test]
fn a_viewer_shows_the_same_in_pieces() {
    for storage in [Storage::F32, Storage::F16] {
        let (Some(mut whole), Some(divided)) = (viewer(storage), executor_in_chunks_of(1)) else { return };
        let mut divided = GpuExecutor::viewer(divided.gpu().clone(), storage);
        for (layout, shading) in [
            (Layout::radiance(3), ShadingRules::PAPER),
            (Layout::shaded(Some(2)), ShadingRules::PAPER),
            (Layout::shaded(None), ShadingRules::DEFERRED),
        ] {
            let rules = RenderRules::full(shading, PrefilterScheme::Exact, Channels::Training);
            let view = View::new(75, layout, rules, 8);
            let stored = divided.upload_gaussians(&view.gaussians).expect("numbers fit");
            assert_eq!(stored.values.chunk_count(), 5, "a block in each");
            assert!(view.picture(&mut divided) == view.picture(&mut whole), "{storage:?} {layout:?}");
            let mut back = [vec![0.0; view.gaussians.values.len()], view.gaussians.values.clone()];
            divided.download(&stored.values, &mut back[0]).expect("there are as many");
            storage.round(&mut view.gaussians.with_values(&mut *back[1]));
            assert!(back[0] == back[1], "{storage:?} {layout:?} comes back");
        }
    }
}

/// Numbers at the edges of halves: the largest, beyond it, steps between two halves, the smallest,
/// and none at all.
const EDGES: [f32; 20] = [
    65_504.0,
    65_519.0,
    65_520.0,
    1e9,
    -7e4,
    f32::MAX,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::NAN,
    1.0 + 1.0 / 2048.0,
    1.0 + 3.0 / 2048.0,
    -1.0 - 1.0 / 2047.0,
    6.103_515_6e-5,
    6.1e-5,
    5.960_464_5e-8,
    2.980_232_2e-8,
    8.940_697e-8,
    1e-9,
    -0.0,
    0.0,
];

#[test]
fn gaussians_come_back_from_a_device_as_the_processor_rounds_them() {
    let Some(mut viewer) = viewer(Storage::F16) else { return };
    for layout in [Layout::radiance(3), Layout::shaded(Some(3)), Layout::shaded(None)] {
        let mut cloud = random_cloud(EDGES.len(), layout, 4);
        for (gaussian, number) in EDGES.into_iter().enumerate() {
            (0..layout.plane_count()).for_each(|plane| cloud.set(gaussian, plane, [number]));
        }
        let stored = viewer.upload_gaussians(&cloud).expect("numbers fit");
        let mut back = vec![0.0; cloud.values.len()];
        viewer.download(&stored.values, &mut back).expect("there are as many");
        Storage::F16.round(&mut cloud);
        let bits = |values: &[f32]| values.iter().map(|x| x.to_bits()).collect::<Vec<u32>>();
        assert!(bits(&back) == bits(&cloud.values), "{layout:?}");

        let words = FULL_PLANES + (layout.plane_count() - FULL_PLANES).div_ceil(2);
        assert_eq!(4 * stored.values.len(), 4 * words * EDGES.len().next_multiple_of(BLOCK), "two numbers to a word");
    }
}

#[test]
fn kernels_read_halves_at_the_edges() {
    /// Tolerance relative to the largest number of a colour.
    const SAME_COLOR: f64 = 1e-6;
    let Some(mut viewer) = viewer(Storage::F16) else { return };
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Layers);
    let mut view = View::new(1, Layout::shaded(Some(0)), rules, 6);
    view.gaussians.set(0, MEAN, [0.0; 3]);
    view.gaussians.set(0, LOG_SCALE, [-0.5; 3]);
    view.gaussians.set(0, OPACITY, [9.0]);
    for colors in [[65_504.0, 1e9, -7e4], [6.1e-5, 5.960_464_5e-8, 8.940_697e-8], [1.0 + 3.0 / 2048.0, -1e-6, 0.1]] {
        view.gaussians.set(0, view.gaussians.layout.sh_start(), colors);
        let ours = view.picture(&mut viewer).expect("the viewer renders");
        let theirs = rounded(&view, &mut CpuExecutor::new(), Storage::F16);
        let size = view.pixels();
        for plane in channel::RESIDUAL..channel::RESIDUAL + 3 {
            let [ours, theirs] = [&ours, &theirs].map(|picture| &picture[plane * size..(plane + 1) * size]);
            assert!(theirs.iter().any(|x| *x != 0.0), "the Gaussian is seen");
            assert_all_close(ours, theirs, SAME_COLOR);
        }
    }
}

#[test]
fn a_light_is_rounded_on_a_device_as_on_the_processor() {
    let Some(mut viewer) = viewer(Storage::F16) else { return };
    let mut environment = random_environment(16, RadianceActivation::Identity, 8);
    for (index, radiance) in environment.values.iter_mut().enumerate() {
        *radiance *= 10.0_f32.powi(index as i32 % 19 - 9);
    }
    let mut edges = environment.clone();
    edges.values.fill(0.0);
    for (texel, edge) in EDGES.into_iter().enumerate() {
        edges.values[30 * texel] = edge;
    }
    for environment in [environment, edges] {
        let environment = environment.with_values(viewer.upload(&environment.values).expect("texels fit"));
        let mut levels = |storage: Storage| {
            viewer.set_storage(storage);
            let light = viewer.prefilter(&environment, PrefilterScheme::Exact, LevelRange::ALL);
            let light = light.expect("the resolution is allowed");
            viewer.read_light(&light).expect("levels can be read")
        };
        let (in_full, halves) = (levels(Storage::F32), levels(Storage::F16));
        for (number, half) in in_full.iter().zip(&halves) {
            let [expected, _] = pack::unpack2(pack::pack2(*number, 0.0));
            assert!(
                half.to_bits() == expected.to_bits() || (half.is_nan() && expected.is_nan()),
                "{number} became {half}, not {expected}"
            );
        }
        let is_beyond = |x: &f32| x.is_finite() && *x > 65_504.0;
        assert!(in_full.iter().any(is_beyond) && in_full.iter().any(|x| *x > 0.0 && *x < 6e-5), "edges are there");
    }
}
