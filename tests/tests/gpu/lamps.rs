//! Lamps on the device: each formula, pictures and refused input, against the host and the CPU
//! executor.

use specula_core::{
    executor::{Occluder, Renderer},
    lamps::{Lamp, LampError},
    near_field::NearField,
    pack::Storage,
    prefilter::{LevelRange, PrefilterScheme},
    rules::{Channels, LightLayer, RenderRules},
    scene::{Environment, Gaussians, Layout, RadianceActivation},
    shade::ShadingRules,
};
use specula_cpu::CpuExecutor;
use specula_gpu::{
    GpuError, GpuExecutor,
    stages::illuminate::formulas::{
        AxesOfDisc, DirectLightOf, LitPixelOf, ShadowRayOf, ShareSeen, ShiftOfPixel, TowardLamp,
    },
};
use specula_tests::{
    compare::{assert_psnr, psnr},
    device::executor,
    formulas::{ROWS, assert_every_formula_has_a_case, assert_same, camera, numbers_of, side_by_side, uniform_rows},
    near_fields::{lit_near_field, polished, random_near_field},
    strategies::{random_cloud, random_environment},
};
use specula_train::evaluate::render_view;

/// Pictures in `f32` on two executors: 1e-5 is 100 dB; a pixel of which a ray hits the other of
/// two triangles brings a small picture down to 80 dB.
const SAME_FRAME: f64 = 75.0;
/// A picture whose light has 11 bits in each texel.
const IN_HALVES: f64 = 55.0;
const RAYS: usize = 16;

#[test]
fn every_formula_is_on_the_device_what_it_is_on_the_host() {
    let Some(mut gpu) = executor() else { return };
    let gpu = &mut gpu;
    let share = [0.0, 1.0];
    let blended = Channels::Layers;
    let mut bounds = vec![[0.1, 0.9]; blended.count() + 1];
    bounds.extend([[0.0, 70.0], [0.0, 45.0]]);
    let pixels = side_by_side(&uniform_rows(1, &bounds), &numbers_of(&camera(70, 45)).repeat(ROWS));
    let rows = side_by_side(&pixels, &uniform_rows(2, &[[0.0, 0.1]]));
    assert_same(gpu, &LitPixelOf(blended), &rows);

    let direction = [[0.3, 0.6], [-0.5, -0.2], [0.5, 0.8]];
    let [place, light] = [[[1.0, 3.0]; 3], [[0.0, 5.0]; 3]];
    let lamp = |is_sphere: f32| [place.to_vec(), vec![[is_sphere; 2]], light.to_vec(), vec![[0.05, 0.5]]].concat();
    for (seed, is_sphere) in [(3, 0.0), (4, 1.0)] {
        let rows = [lamp(is_sphere), vec![[-0.5, 0.5]; 3], direction.to_vec()].concat();
        assert_same(gpu, &TowardLamp, &uniform_rows(seed, &rows));
    }
    assert_same(gpu, &AxesOfDisc, &uniform_rows(5, &direction));
    let whole: Vec<f32> =
        uniform_rows(6, &[[0.0, 3000.0], [0.0, 2000.0], [0.0, 60.0]]).iter().map(|x| x.floor()).collect();
    assert_same(gpu, &ShiftOfPixel, &whole);
    let disc = [vec![[0.05, 0.5]], vec![[-0.6, 0.6]; 6], vec![share], vec![[-0.7, 0.7]; 2]].concat();
    let place = [[-0.7, 0.7], [-0.7, 0.7], [0.1, 0.9], [0.01, 0.05]];
    assert_same(
        gpu,
        &ShadowRayOf,
        &uniform_rows(7, &[direction.to_vec(), direction.to_vec(), disc, place.to_vec()].concat()),
    );
    assert_same(gpu, &ShareSeen, &uniform_rows(8, &[[0.5, 2.0], [0.0, 0.5]]));
    let pixel =
        [direction.to_vec(), vec![[0.1, 0.9]], direction.to_vec(), vec![[0.04, 0.9]; 3], vec![[0.1, 0.9]]].concat();
    let toward = [direction.to_vec(), light.to_vec(), vec![[0.0, 0.2]], vec![share]].concat();
    assert_same(gpu, &DirectLightOf, &uniform_rows(9, &[pixel, toward].concat()));
}

#[test]
fn no_formula_is_left_out() {
    let formulas = [include_str!("../../../exec-gpu/src/stages/illuminate/formulas.rs")];
    assert_every_formula_has_a_case(&formulas, include_str!("lamps.rs"), 7);
}

/// Physical Gaussians among triangles.
struct Scene {
    gaussians: Gaussians<Vec<f32>>,
    light: Environment<Vec<f32>>,
    near_field: NearField<Vec<f32>>,
    /// Light that the near field reflects onto itself.
    reflected: Vec<f32>,
}

impl Scene {
    fn new(seed: u64) -> Self {
        Self {
            gaussians: polished(random_cloud(80, Layout::shaded(Some(1)).physical(), seed)),
            light: random_environment(16, RadianceActivation::Identity, seed),
            near_field: random_near_field(60, seed),
            reflected: Vec::new(),
        }
    }

    fn picture<E: Renderer>(&self, exec: &mut E, rules: &RenderRules, has_shadows: bool) -> Vec<f64> {
        let gaussians = exec.upload_gaussians(&self.gaussians).expect("they fit");
        let environment = self.light.with_values(exec.upload(&self.light.values).expect("they fit"));
        let light = exec.prefilter(&environment, rules.scheme, LevelRange::ALL).expect("16 is a power of two");
        let near_field = self.near_field.with_values(self.near_field.values.as_slice());
        let near_field = exec.upload_near_field(&near_field).expect("it is whole");
        let light = exec.surround(light, &near_field).expect("the executor traces");
        let occluder = has_shadows.then_some(Occluder { surface: &near_field, reflected: &self.reflected });
        let light = exec.add_lamps(light, &lamps(), RAYS, occluder).expect("they can shine");
        let image = render_view(exec, &gaussians, Some(&light), &camera(70, 45), rules).expect("the executor renders");
        image.values.iter().map(|x| f64::from(*x)).collect()
    }
}

/// A sun of a large disc, a point and a ball.
fn lamps() -> [Lamp; 3] {
    [
        Lamp::Sun { direction: [0.5, -1.0, 0.8], irradiance: [2.0, 1.5, 1.0], diameter: 0.2 },
        Lamp::Sphere { position: [1.5, -1.0, 1.0], intensity: [3.0; 3], radius: 0.0 },
        Lamp::Sphere { position: [-1.0, -1.5, 1.0], intensity: [1.0, 2.0, 3.0], radius: 0.3 },
    ]
}

fn rules(illuminates: bool, traces_near: bool, channels: Channels) -> RenderRules {
    let full = RenderRules::full(ShadingRules::PHYSICAL, PrefilterScheme::Exact, channels);
    RenderRules { illuminates, traces_near, ..full }
}

#[test]
fn both_executors_render_the_same_light_and_shadows() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    for (seed, traces_near, has_shadows) in [(1, false, true), (2, true, true), (3, false, false)] {
        let scene = Scene::new(seed);
        let lit = rules(true, traces_near, Channels::Layers);
        let (ours, theirs) = (scene.picture(&mut gpu, &lit, has_shadows), scene.picture(&mut cpu, &lit, has_shadows));
        println!("seed {seed}: {:.1} dB", psnr(&ours, &theirs));
        assert_psnr(&ours, &theirs, SAME_FRAME);
        assert!(scene.picture(&mut gpu, &lit, has_shadows) == ours, "the same bits twice");
        let unlit = scene.picture(&mut gpu, &rules(false, traces_near, Channels::Layers), has_shadows);
        assert!(psnr(&ours, &unlit) < 40.0, "lamps shine");
        let irradiance = RenderRules { light_layer: LightLayer::Irradiance, ..lit };
        let [other, theirs] =
            [scene.picture(&mut gpu, &irradiance, has_shadows), scene.picture(&mut cpu, &irradiance, has_shadows)];
        assert_psnr(&other, &theirs, SAME_FRAME);
        assert!(other != ours, "the layer of light is another");
        let open = scene.picture(&mut gpu, &lit, false);
        assert_eq!(open != ours, has_shadows, "surfaces cast shadows");
    }
}

#[test]
fn both_executors_add_the_same_reflected_light() {
    let Some(mut gpu) = executor() else { return };
    let (near_field, reflected) = lit_near_field(60, 6);
    let dark = Scene { near_field, ..Scene::new(6) };
    let without = dark.picture(&mut gpu, &rules(true, false, Channels::Layers), true);
    let scene = Scene { reflected, ..dark };
    let lit = rules(true, false, Channels::Layers);
    let (ours, theirs) = (scene.picture(&mut gpu, &lit, true), scene.picture(&mut CpuExecutor::new(), &lit, true));
    println!("{:.1} dB", psnr(&ours, &theirs));
    assert_psnr(&ours, &theirs, SAME_FRAME);
    assert!(scene.picture(&mut gpu, &lit, true) == ours, "the same bits twice");
    assert!(psnr(&ours, &without) < 50.0, "light is reflected");
}

#[test]
fn light_in_halves_has_lamps_as_well() {
    let Some(mut gpu) = executor() else { return };
    let scene = Scene::new(4);
    let lit = rules(true, false, Channels::Color);
    let full = scene.picture(&mut gpu, &lit, true);
    let mut viewer = GpuExecutor::viewer(gpu.gpu().clone(), Storage::F16);
    let halves = scene.picture(&mut viewer, &lit, true);
    println!("{:.1} dB", psnr(&halves, &full));
    assert_psnr(&halves, &full, IN_HALVES);
}

#[test]
fn lamps_with_a_fault_are_refused() {
    let Some(mut gpu) = executor() else { return };
    let scene = Scene::new(5);
    let environment = scene.light.with_values(gpu.upload(&scene.light.values).expect("they fit"));
    let light = gpu.prefilter(&environment, PrefilterScheme::Exact, LevelRange::ALL).expect("16 is a power of two");
    let nowhere = Lamp::Sun { direction: [0.0; 3], irradiance: [1.0; 3], diameter: 0.0 };
    let refused = gpu.add_lamps(light, &[nowhere], RAYS, None).expect_err("it has no direction");
    assert!(matches!(refused, GpuError::Lamps(LampError::Number { index: 0 })), "{refused}");
}
