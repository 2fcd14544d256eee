//! Pictures rendered by a plan, equal to the full ones to the last bit.

use proptest::prelude::*;
use specula_core::{
    camera::Camera,
    color::Picture,
    executor::{Executor, Renderer},
    loss::{LossWeights, NormalForm},
    plan::{Needs, Plan, Unlit},
    prefilter::{LevelRange, Levels, PrefilterScheme},
    rules::{Channels, RenderRules, channel},
    scene::{Environment, Gaussians, Image, Layout, NORMAL_RESIDUAL_1, OPACITY, ROUGHNESS, RadianceActivation, TINT},
    shade::{ShadingForm, ShadingRules},
};
use specula_cpu::{CpuError, CpuExecutor};
use specula_tests::strategies::{camera, random_cloud, random_environment, same_every_time};
use specula_train::evaluate::{largest_difference, render_view};
use std::{
    collections::HashMap,
    sync::{LazyLock, Mutex, PoisonError},
};

/// Executors by scheme and levels, so no operator of the prefilter is built twice.
type Executors = HashMap<(PrefilterScheme, LevelRange), CpuExecutor>;

/// Runs `work` on the executor for these rules.
fn on_executor<T>(rules: &RenderRules, work: impl FnOnce(&mut CpuExecutor) -> Result<T, CpuError>) -> T {
    static EXECUTORS: LazyLock<Mutex<Executors>> = LazyLock::new(Mutex::default);
    let mut executors = EXECUTORS.lock().unwrap_or_else(PoisonError::into_inner);
    work(executors.entry((rules.scheme, rules.levels)).or_default()).expect("the CPU renders")
}

/// A raw tint that activates to 1e-13: it reflects less than the last bit of a diffuse colour
/// holds.
const NO_TINT: f32 = -30.0;
/// Raw light that activates to zero.
const BLACK: f32 = -200.0;

#[derive(Clone, Debug)]
struct Scene {
    gaussians: Gaussians<Vec<f32>>,
    light: Option<Environment<Vec<f32>>>,
    asked: RenderRules,
}

impl Scene {
    fn new(layout: Layout, shading: ShadingRules, channels: Channels, seed: u64) -> Self {
        let (scheme, resolution) = match shading.form {
            ShadingForm::Official => (PrefilterScheme::Official, 64),
            _ => (PrefilterScheme::Exact, 16),
        };
        let light = random_environment(resolution, RadianceActivation::Identity, seed);
        Self {
            gaussians: random_cloud(30, layout, seed),
            light: layout.is_shaded().then_some(light),
            asked: RenderRules { sh_degree: layout.sh_degree, ..RenderRules::full(shading, scheme, channels) },
        }
    }

    fn deferred(channels: Channels) -> Self {
        Self::new(Layout::shaded(Some(3)), ShadingRules::DEFERRED, channels, 7)
    }

    fn fill(&mut self, planes: core::ops::Range<usize>, number: f32) {
        for (gaussian, plane) in (0..self.gaussians.count).flat_map(|g| planes.clone().map(move |plane| (g, plane))) {
            self.gaussians.set(gaussian, plane, [number]);
        }
    }

    /// Clears a band of the harmonics.
    fn clear_band(&mut self, band: usize) {
        let layout = self.gaussians.layout;
        let first = layout.sh_start();
        let end = layout.sh_end();
        self.fill((first + 3 * band * band).min(end)..(first + 3 * (band + 1) * (band + 1)).min(end), 0.0);
    }

    fn darken(&mut self, activation: RadianceActivation) {
        if let Some(light) = &mut self.light {
            light.activation = activation;
            light.values.fill(if activation == RadianceActivation::Exponential { BLACK } else { 0.0 });
        }
    }

    fn needs(&self) -> Needs {
        Needs::of(&self.gaussians).under(self.light.as_ref())
    }

    fn plan(&self) -> Plan {
        let levels = self.light.as_ref().map(|light| Levels::new(self.asked.scheme, light.resolution));
        Plan::new(self.gaussians.layout, &self.needs(), levels.as_ref(), &self.asked)
    }

    fn picture(&self, rules: &RenderRules, camera: &Camera) -> Image<Vec<f32>> {
        on_executor(rules, |exec| {
            let light = self.light.as_ref().filter(|_| rules.is_lit);
            let light = light.map(|light| exec.prefilter(light, rules.scheme, rules.levels)).transpose()?;
            render_view(exec, &self.gaussians, light.as_ref(), camera, rules)
        })
    }

    /// Difference of the picture by these rules from the full one.
    fn difference(&self, rules: &RenderRules, camera: &Camera) -> f32 {
        let full = self.picture(&self.plan().full, camera);
        largest_difference(&self.picture(rules, camera), &full, self.asked.channels)
    }
}

/// Features removed from a scene; a roughness is the same for all Gaussians.
#[derive(Clone, Debug)]
struct Cleared {
    roughness: Option<f32>,
    bands: [bool; 4],
    residuals: Option<f32>,
    tints: bool,
    light: Option<Option<RadianceActivation>>,
}

fn cleared() -> impl Strategy<Value = Cleared> {
    let light = prop_oneof![
        Just(None),
        Just(Some(None)),
        Just(Some(Some(RadianceActivation::Identity))),
        Just(Some(Some(RadianceActivation::Exponential)))
    ];
    let residuals = prop_oneof![Just(None), Just(Some(0.0)), Just(Some(-0.0))];
    let roughness = prop_oneof![Just(None), Just(Some(-8.0)), Just(Some(-0.5)), Just(Some(3.0))];
    (roughness, any::<[bool; 4]>(), residuals, any::<bool>(), light)
        .prop_map(|(roughness, bands, residuals, tints, light)| Cleared { roughness, bands, residuals, tints, light })
}

impl Cleared {
    fn of(&self, scene: &mut Scene) {
        (0..4).filter(|band| self.bands[*band]).for_each(|band| scene.clear_band(band));
        if !scene.gaussians.layout.is_shaded() {
            return;
        }
        if let Some(zero) = self.residuals {
            scene.fill(NORMAL_RESIDUAL_1..NORMAL_RESIDUAL_1 + 6, zero);
        }
        if let Some(raw) = self.roughness {
            scene.fill(ROUGHNESS..ROUGHNESS + 1, raw);
        }
        if self.tints {
            scene.fill(TINT..ROUGHNESS, NO_TINT);
        }
        match self.light {
            Some(Some(activation)) => scene.darken(activation),
            Some(None) => scene.light = None,
            None => {}
        }
    }
}

fn scene() -> impl Strategy<Value = Scene> {
    let shaded = prop_oneof![Just(None), (0..4_u8).prop_map(Some)].prop_map(Layout::shaded);
    let layout = prop_oneof![4 => shaded, 1 => (0..4_u8).prop_map(Layout::radiance)];
    let shading = prop_oneof![Just(ShadingRules::PAPER), Just(ShadingRules::DEFERRED), Just(ShadingRules::OFFICIAL)];
    let channels = prop_oneof![Just(Channels::Color), Just(Channels::Training), Just(Channels::Layers)];
    let layout =
        (layout, any::<bool>()).prop_map(|(layout, filtered)| if filtered { layout.antialiased() } else { layout });
    let physical = (layout.clone(), any::<bool>()).prop_map(|(layout, is_physical)| match is_physical {
        true if layout.is_shaded() => (layout.physical(), Some(ShadingRules::PHYSICAL)),
        _ => (layout, None),
    });
    let layout_and_shading =
        (physical, shading).prop_map(|((layout, physical), shading)| (layout, physical.unwrap_or(shading)));
    (layout_and_shading, channels, any::<u64>(), cleared()).prop_map(|((layout, shading), channels, seed, cleared)| {
        let mut scene = Scene::new(layout, shading, channels, seed);
        cleared.of(&mut scene);
        scene
    })
}

proptest! {
    #![proptest_config(same_every_time())]

    #[test]
    fn a_planned_picture_is_the_full_one_to_the_last_bit(scene in scene(), camera in camera()) {
        let plan = scene.plan();
        prop_assert_eq!(scene.difference(&plan.rules, &camera), 0.0, "{:?}", plan);
    }
}

fn front() -> Camera {
    Camera::look_at(glam::Vec3::new(2.0, -3.0, 1.5), glam::Vec3::ZERO, glam::Vec3::Z, 0.7, 40, 32)
}

mod the_comparison_fails_where_something_needed_is_left_out {
    use super::*;

    /// Omits a term that a scene needs, and expects the verification to fail.
    fn is_found_out(scene: &Scene, leave_out: impl FnOnce(&mut RenderRules)) {
        let mut rules = scene.plan().rules;
        leave_out(&mut rules);
        assert!(scene.difference(&rules, &front()) > 0.0, "nothing was missed");
    }

    #[test]
    fn light() {
        for shading in [ShadingRules::PAPER, ShadingRules::DEFERRED, ShadingRules::OFFICIAL] {
            let scene = Scene::new(Layout::shaded(None), shading, Channels::Color, 3);
            is_found_out(&scene, |rules| rules.is_lit = false);
        }
    }

    #[test]
    fn a_light_that_reflects_only_just() {
        let mut scene = Scene::new(Layout::shaded(None), ShadingRules::PAPER, Channels::Color, 3);
        scene.fill(TINT..ROUGHNESS, -13.0);
        is_found_out(&scene, |rules| rules.is_lit = false);
    }

    #[test]
    fn a_band() {
        is_found_out(&Scene::deferred(Channels::Color), |rules| rules.sh_degree = Some(2));
    }

    #[test]
    fn a_level() {
        is_found_out(&Scene::deferred(Channels::Color), |rules| rules.levels.first = rules.levels.end - 3);
    }

    #[test]
    fn normal_residuals() {
        is_found_out(&Scene::deferred(Channels::Color), |rules| rules.normal_residuals = false);
    }

    #[test]
    fn a_channel() {
        is_found_out(&Scene::deferred(Channels::Training), |rules| rules.channels = Channels::Color);
    }
}

/// A Gaussian brings ten numbers where light is added pixel by pixel, and three without light.
#[test]
fn a_colour_picture_blends_no_more_than_light_needs() {
    let mut scene = Scene::deferred(Channels::Color);
    let channels = |scene: &Scene| scene.picture(&scene.plan().rules, &front()).channels - 1;
    assert_eq!(channels(&scene), 10);
    scene.darken(RadianceActivation::Exponential);
    assert_eq!(channels(&scene), 3);
    assert_eq!(scene.picture(&scene.plan().full, &front()).channels - 1, 12);
}

#[test]
fn a_plan_says_why_there_is_no_light() {
    let mut scene = Scene::new(Layout::shaded(None), ShadingRules::PAPER, Channels::Color, 3);
    assert_eq!(scene.plan().unlit, None);
    scene.fill(TINT..ROUGHNESS, NO_TINT);
    assert_eq!(scene.plan().unlit, Some(Unlit::LostInRounding));
    scene.asked.channels = Channels::Layers;
    assert_eq!(scene.plan().unlit, None, "layers show even what is lost in colours");
    scene.light = None;
    assert_eq!(scene.plan().unlit, Some(Unlit::Dark));
    scene.fill(OPACITY..OPACITY + 1, -20.0);
    assert_eq!(scene.plan().unlit, Some(Unlit::NothingShaded), "nothing is drawn");
}

#[test]
fn a_light_lost_behind_a_residual_of_its_pixel_is_not_left_out() {
    let mut scene = Scene::deferred(Channels::Color);
    scene.fill(TINT..ROUGHNESS, NO_TINT);
    assert!(scene.plan().rules.is_lit, "a residual can cancel the diffuse colour");
    (0..4).for_each(|band| scene.clear_band(band));
    assert!(!scene.plan().rules.is_lit, "without residuals nothing can");
    scene.asked.shading = ShadingRules::OFFICIAL;
    assert!(scene.plan().rules.is_lit, "the authors' form reflects without a tint");
}

#[test]
fn a_plan_reads_only_what_it_uses() {
    let mut scene = Scene::deferred(Channels::Color);
    let read = |scene: &Scene| scene.plan().rules.numbers_read(scene.gaussians.layout);
    assert_eq!(read(&scene), scene.gaussians.layout.plane_count());
    scene.clear_band(3);
    assert_eq!(read(&scene), 24 + 3 * 9);
    scene.clear_band(1);
    assert_eq!(read(&scene), 24 + 3 * 9, "band 2 is still there");
    scene.fill(NORMAL_RESIDUAL_1..NORMAL_RESIDUAL_1 + 6, 0.0);
    assert_eq!(read(&scene), 18 + 3 * 9);
    scene.light = None;
    assert_eq!(read(&scene), 14 + 3 * 9);
    let physical = Scene::new(Layout::shaded(Some(3)).physical(), ShadingRules::PHYSICAL, Channels::Color, 7);
    // Mean, scales, quat, opacity; roughness and residuals; albedo, metalness and ambient transfer.
    assert_eq!(read(&physical), 11 + 7 + 7);
}

#[test]
fn nan_is_never_omitted() {
    let mut scene = Scene::deferred(Channels::Color);
    scene.clear_band(3);
    scene.gaussians.set(4, scene.gaussians.layout.plane_count() - 1, [f32::NAN]);
    assert_eq!(scene.plan().rules.sh_degree, Some(3));
    let light = scene.light.as_mut().expect("there is a light");
    light.values.fill(0.0);
    light.values[5] = f32::NAN;
    assert_eq!(scene.plan().unlit, None);
}

#[test]
fn levels_are_those_around_the_roughness() {
    let mut scene = Scene::deferred(Channels::Color);
    let levels = Levels::new(PrefilterScheme::Exact, 64);
    // Levels have the roughness 0, 0.07, 0.125, 0.17, 0.23, 0.3, 0.4, 0.55, 0.75, 1.
    for (raw, first, end) in [(-20.0, 0, 2), (0.0, 6, 8), (20.0, 8, 10)] {
        scene.fill(ROUGHNESS..ROUGHNESS + 1, raw);
        assert_eq!(scene.needs().levels(&levels), LevelRange { first, end });
    }
    assert_eq!(Needs::NOTHING.levels(&levels), LevelRange::NONE);
    assert_eq!(scene.plan().rules.levels, LevelRange { first: 7, end: 11 }, "a level more on either side");
    scene.fill(ROUGHNESS..ROUGHNESS + 1, -20.0);
    let last = LevelRange::ALL.end;
    assert!(scene.plan().rules.levels.end < last, "mirrors read the first levels");
    assert_eq!(scene.plan().tracing(true).rules.levels.end, last, "surfaces that mirrors show may be rough");
    assert_eq!(scene.plan().tracing(false), scene.plan());
}

#[test]
fn channels_that_are_left_out_have_no_place() {
    for channels in [Channels::Color, Channels::Training, Channels::Lit, Channels::Surface, Channels::Layers] {
        assert_eq!(Channels::with_count(channels.count()), Some(channels));
        let mut places: Vec<usize> = (0..Channels::Layers.count()).filter_map(|c| channels.index_of(c)).collect();
        places.sort_unstable();
        assert_eq!(places, (0..channels.count()).collect::<Vec<_>>(), "{channels:?}");
    }
    assert_eq!(Channels::with_count(4), None);
    assert_eq!(Channels::Lit.index_of(channel::DEPTH), None);
    assert_eq!(Channels::Lit.index_of(channel::ROUGHNESS), Some(9));
}

/// Channels that no loss reads have no gradient, so their presence does not matter.
#[test]
fn gradients_do_not_depend_on_channels_that_nothing_reads() {
    let scene = Scene::deferred(Channels::Color);
    let [lean, full] = [Channels::Color, Channels::Training].map(|channels| {
        let rules = RenderRules { channels, ..scene.asked };
        gradient(&scene, &rules, &front())
    });
    assert!(lean.iter().any(|number| *number != 0.0), "there is something to compare");
    assert!(lean == full, "the gradients differ");
}

fn gradient(scene: &Scene, rules: &RenderRules, camera: &Camera) -> Vec<f32> {
    const WEIGHTS: LossWeights = LossWeights {
        absolute: 0.5,
        squared: 0.5,
        dssim: 0.2,
        normal_form: NormalForm::Cosine,
        coverage: 0.1,
        ..LossWeights::NONE
    };
    on_executor(rules, |exec| {
        let environment = scene.light.as_ref().expect("there is a light");
        let light = exec.prefilter(environment, rules.scheme, rules.levels)?;
        let mut splats = exec.project(&scene.gaussians, camera)?;
        let colors = exec.shade(&scene.gaussians, camera, &mut splats, Some(&light), rules)?;
        let tiles = exec.bin(&splats, camera)?;
        let surface = exec.blend(&splats, &colors, &tiles, camera)?;
        let frame = exec.shade_pixels(surface, Some(&light), camera, rules)?;
        let target = exec.target(&Picture::of_bytes(40, 32, &vec![100; 40 * 32 * 4]))?;
        let grad = exec.loss(&frame, &target, camera, &WEIGHTS, [1.0; 3])?;
        let (grad, light_grad) = exec.shade_pixels_vjp(&frame, Some(&light), camera, rules, grad)?;
        let grads = exec.blend_vjp(&splats, &colors, &tiles, &frame, &grad, camera)?;
        let (grad, _) = exec.gaussians_vjp(&scene.gaussians, camera, &splats, Some(&light), rules, &WEIGHTS, &grads)?;
        let environment_grad = exec.prefilter_vjp(environment, &light, &light_grad.expect("there is a light"))?;
        Ok([grad.values, environment_grad].concat())
    })
}
