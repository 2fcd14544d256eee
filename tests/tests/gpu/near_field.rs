//! Reflected rays on the device: each formula, pictures and refused input, against the host and the
//! CPU executor. Gradients are beside those of other lights.

use specula_core::{
    executor::Renderer,
    near_field::{NearField, NearFieldError, VERTEX_LEN},
    pack::Storage,
    prefilter::{LevelRange, PrefilterScheme},
    rules::{Channels, LightLayer, RenderRules},
    scene::{Environment, Gaussians, Layout, RadianceActivation},
    shade::ShadingRules,
};
use specula_cpu::CpuExecutor;
use specula_gpu::{
    GpuError, GpuExecutor,
    stages::trace::formulas::{BoxSpan, CrossingOf, FarReflection, InverseDirection, NearReflection, RayOfPixel},
};
use specula_tests::{
    compare::{assert_psnr, psnr},
    device::executor,
    formulas::{ROWS, assert_every_formula_has_a_case, assert_same, camera, numbers_of, side_by_side, uniform_rows},
    near_fields::{polished, random_near_field},
    strategies::{random_cloud, random_environment},
};
use specula_train::evaluate::render_view;

/// Pictures in `f32` on two executors: 1e-5 is 100 dB; a pixel whose ray hits the other of two
/// triangles brings a small picture down to 80 dB.
const SAME_FRAME: f64 = 75.0;
/// A picture whose light has 11 bits in each texel.
const IN_HALVES: f64 = 55.0;

#[test]
fn every_formula_is_on_the_device_what_it_is_on_the_host() {
    let Some(mut gpu) = executor() else { return };
    let gpu = &mut gpu;
    let share = [0.0, 1.0];
    for blended in [Channels::Training, Channels::Surface, Channels::Layers] {
        let mut bounds = vec![[0.1, 0.9]; blended.count() + 1];
        bounds.extend([[0.0, 70.0], [0.0, 45.0]]);
        let pixels = side_by_side(&uniform_rows(1, &bounds), &numbers_of(&camera(70, 45)).repeat(ROWS));
        let rows = side_by_side(&pixels, &uniform_rows(2, &[[0.0, 0.1]]));
        assert_same(gpu, &RayOfPixel(blended), &rows);
    }
    assert_same(gpu, &InverseDirection, &uniform_rows(3, &[[0.05, 1.0], [-1.0, -0.05], [0.05, 1.0]]));
    let corners = [[-1.0, -0.2], [0.2, 1.0]].map(|bounds| [bounds; 3]).concat();
    let rays = [[[-3.0, 3.0]; 3], [[0.5, 4.0]; 3]].concat();
    assert_same(gpu, &BoxSpan, &uniform_rows(4, &[corners, rays].concat()));
    // Rays through the middle of triangles that face them.
    let around = |x: f32, y: f32| [[x - 0.2, x + 0.2], [y - 0.2, y + 0.2], [1.9, 2.1]];
    let triangle = [around(-3.0, -3.0), around(0.0, 4.0), around(3.0, -3.0)].concat();
    let ray = [[-0.3, 0.3], [-0.3, 0.3], [-0.3, 0.3], [-0.1, 0.1], [-0.1, 0.1], [0.9, 1.0]];
    let back_depth = vec![[-0.5, 0.5]];
    assert_same(gpu, &CrossingOf, &uniform_rows(5, &[triangle.clone(), ray.to_vec(), back_depth.clone()].concat()));
    // Two corners changed places: the back.
    let back = [&triangle[..3], &triangle[6..], &triangle[3..6]].concat();
    assert_same(gpu, &CrossingOf, &uniform_rows(5, &[back, ray.to_vec(), back_depth].concat()));

    let direction = [[0.2, 1.0], [-0.5, 0.5], [-0.5, 0.5]];
    assert_same(gpu, &FarReflection, &uniform_rows(6, &[direction.to_vec(), vec![share]].concat()));
    let hit = [direction.to_vec(), vec![[0.05, 0.95], [0.0, 0.5], [0.0, 0.5]]].concat();
    assert_same(gpu, &NearReflection, &uniform_rows(7, &[hit, vec![[0.1, 0.9]; 3 * VERTEX_LEN]].concat()));
}

#[test]
fn no_formula_is_left_out() {
    let formulas = [include_str!("../../../exec-gpu/src/stages/trace/formulas.rs")];
    assert_every_formula_has_a_case(&formulas, include_str!("near_field.rs"), 6);
}

/// Polished Gaussians among triangles.
struct Scene {
    gaussians: Gaussians<Vec<f32>>,
    light: Environment<Vec<f32>>,
    near_field: NearField<Vec<f32>>,
}

impl Scene {
    fn new(seed: u64) -> Self {
        Self {
            gaussians: polished(random_cloud(80, Layout::shaded(Some(3)), seed)),
            light: random_environment(16, RadianceActivation::Identity, seed),
            near_field: random_near_field(60, seed),
        }
    }

    fn picture<E: Renderer>(&self, exec: &mut E, rules: &RenderRules) -> Vec<f64> {
        let gaussians = exec.upload_gaussians(&self.gaussians).expect("they fit");
        let environment = self.light.with_values(exec.upload(&self.light.values).expect("they fit"));
        let light = exec.prefilter(&environment, rules.scheme, LevelRange::ALL).expect("16 is a power of two");
        let near_field = self.near_field.with_values(self.near_field.values.as_slice());
        let near_field = exec.upload_near_field(&near_field).expect("it is whole");
        let light = exec.surround(light, &near_field).expect("the executor traces");
        let image = render_view(exec, &gaussians, Some(&light), &camera(70, 45), rules).expect("the executor renders");
        image.values.iter().map(|x| f64::from(*x)).collect()
    }
}

fn rules(traces_near: bool, channels: Channels) -> RenderRules {
    RenderRules { traces_near, ..RenderRules::full(ShadingRules::DEFERRED, PrefilterScheme::Exact, channels) }
}

#[test]
fn both_executors_render_the_same_reflections() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    for (seed, channels) in (1..).zip([Channels::Color, Channels::Training, Channels::Layers]) {
        let scene = Scene::new(seed);
        let near = rules(true, channels);
        let (ours, theirs) = (scene.picture(&mut gpu, &near), scene.picture(&mut cpu, &near));
        println!("{channels:?}: {:.1} dB", psnr(&ours, &theirs));
        assert_psnr(&ours, &theirs, SAME_FRAME);
        assert!(scene.picture(&mut gpu, &near) == ours, "the same bits twice");
        // Colours and layers of the same length, where both have depths.
        if channels == Channels::Layers {
            let far = scene.picture(&mut gpu, &rules(false, channels));
            assert!(psnr(&ours, &far) < 50.0, "rays meet something");
            for light_layer in LightLayer::OTHERS {
                let rules = RenderRules { light_layer, ..near };
                let (other, theirs) = (scene.picture(&mut gpu, &rules), scene.picture(&mut cpu, &rules));
                assert_psnr(&other, &theirs, SAME_FRAME);
                assert!(other != ours, "{light_layer:?} is another light");
            }
        }
    }
}

#[test]
fn light_in_halves_is_around_a_near_field_as_well() {
    let Some(mut gpu) = executor() else { return };
    let scene = Scene::new(4);
    let near = rules(true, Channels::Layers);
    let full = scene.picture(&mut gpu, &near);
    let mut viewer = GpuExecutor::viewer(gpu.gpu().clone(), Storage::F16);
    let halves = scene.picture(&mut viewer, &near);
    println!("{:.1} dB", psnr(&halves, &full));
    assert_psnr(&halves, &full, IN_HALVES);
    assert!(halves != full, "it was rounded");
}

#[test]
fn damaged_near_fields_are_refused_and_unlit_pictures_ignore_whole_ones() {
    let Some(mut gpu) = executor() else { return };
    let scene = Scene::new(5);
    let mut damaged = scene.near_field.clone();
    damaged.values[3] = 0.0;
    let refused = gpu.upload_near_field(&damaged.with_values(&damaged.values)).expect_err("the root leads to itself");
    assert!(matches!(refused, GpuError::NearField(NearFieldError::Node { index: 0 })), "{refused}");
    let [near, far] = [true, false]
        .map(|traces| scene.picture(&mut gpu, &RenderRules { is_lit: false, ..rules(traces, Channels::Layers) }));
    assert!(near == far);
}
