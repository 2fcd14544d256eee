//! Scenes with any bits for numbers: Gaussians that are not finite are skipped to the last bit and
//! counted, finite ones of any size make finite pictures and gradients.

use core::{cell::RefCell, slice};
use proptest::{
    collection::vec,
    prelude::*,
    sample::{Index, select},
    test_runner::TestRunner,
};
use specula_core::{
    cull::{CullReason, CullStats},
    executor::Renderer,
    plan::{Needs, Plan},
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules},
    scene::{
        Environment, Gaussians, LOG_SCALE, Layout, MEAN, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY,
        RadianceActivation, len_of_values,
    },
    shade::ShadingRules,
};
use specula_cpu::CpuExecutor;
use specula_tests::{
    formulas::camera,
    strategies::{as_many_as_wanted, random_cloud, random_environment},
    stress::{Case, LAYOUT, results::Results},
};
use specula_train::evaluate::render_view;

type Cloud = Gaussians<Vec<f32>>;

/// Scenes that are tried.
const CASES: u32 = 100;
const COUNT: usize = 40;
const RESOLUTION: usize = 16;
/// Light looked up by Gaussians, and by pixels.
const SHADINGS: [ShadingRules; 2] = [ShadingRules::PAPER, ShadingRules::DEFERRED];

/// Numbers at every limit.
const EDGES: [f32; 12] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN,
    f32::MIN_POSITIVE,
    1e-45,
    -0.0,
    1e18,
    -1e18,
    88.8,
    -104.0,
];

/// A number of the scene, and its new value.
type Poison = (Index, f32);

fn poison() -> impl Strategy<Value = Vec<Poison>> {
    let number = prop_oneof![any::<u32>().prop_map(f32::from_bits), select(&EDGES)];
    vec((any::<Index>(), number), 1..12)
}

fn poisoned(poison: &[Poison]) -> Cloud {
    let mut cloud = random_cloud(COUNT, LAYOUT, 50);
    let planes = LAYOUT.plane_count();
    for (place, number) in poison {
        let place = place.index(COUNT * planes);
        cloud.set(place / planes, place % planes, [*number]);
    }
    cloud
}

fn is_finite(cloud: &Cloud, gaussian: usize) -> bool {
    (0..cloud.layout.plane_count()).all(|plane| cloud.get::<1>(gaussian, plane)[0].is_finite())
}

/// The Gaussians whose numbers are all finite.
fn finite(cloud: &Cloud) -> Cloud {
    let layout = cloud.layout;
    let kept: Vec<usize> = (0..cloud.count).filter(|k| is_finite(cloud, *k)).collect();
    let mut rest = Gaussians { count: kept.len(), layout, values: vec![0.0; len_of_values(kept.len(), layout)] };
    for (to, from) in kept.into_iter().enumerate() {
        (0..layout.plane_count()).for_each(|plane| rest.set(to, plane, cloud.get::<1>(from, plane)));
    }
    rest
}

fn light() -> Environment<Vec<f32>> {
    random_environment(RESOLUTION, RadianceActivation::Exponential, 3)
}

fn results(
    exec: &mut CpuExecutor,
    cloud: Cloud,
    light: Option<&Environment<Vec<f32>>>,
    shading: ShadingRules,
) -> Results {
    let case = Case { environment: light.cloned(), ..Case::new("poison", camera(48, 32), cloud) };
    Results::new(exec, &case, shading)
}

/// The clause of the contract that a cloud breaks, if any.
fn fault(
    exec: &mut CpuExecutor,
    cloud: &Cloud,
    light: Option<&Environment<Vec<f32>>>,
    shading: ShadingRules,
) -> Option<String> {
    let with = results(exec, cloud.clone(), light, shading);
    for (what, numbers) in [("picture", &with.picture), ("losses", &with.losses), ("gradient", &with.gradient)] {
        if let Some(number) = numbers.iter().position(|number| !number.is_finite()) {
            return Some(format!("number {number} of the {what} is {}", numbers[number]));
        }
    }
    if with.nonfinite != 0 {
        return Some(format!("{} gradients are not finite", with.nonfinite));
    }
    if with.picture != results(exec, finite(cloud), light, shading).picture {
        return Some("the picture changes without what is not finite".into());
    }
    let moved = |(plane, gaussian): &(usize, usize)| with.gradient[plane * cloud.count + gaussian] != 0.0;
    let left_out = (0..cloud.count).filter(|gaussian| !is_finite(cloud, *gaussian));
    let picture_planes = left_out.flat_map(|gaussian| planes_of_pictures().map(move |plane| (plane, gaussian)));
    picture_planes
        .into_iter()
        .find(moved)
        .map(|(plane, gaussian)| format!("plane {plane} of {gaussian} has a gradient"))
}

/// Planes that losses only reach through pictures.
fn planes_of_pictures() -> impl Iterator<Item = usize> {
    let is_of_attributes =
        |plane: &usize| *plane == OPACITY || (NORMAL_RESIDUAL_1..NORMAL_RESIDUAL_2 + 3).contains(plane);
    (0..LAYOUT.plane_count()).filter(move |plane| !is_of_attributes(plane))
}

#[test]
fn gaussians_of_any_bits_are_drawn_or_skipped_and_nothing_else_changes() {
    let exec = RefCell::new(CpuExecutor::new());
    let light = light();
    let under =
        [(None, ShadingRules::PAPER), (Some(&light), ShadingRules::PAPER), (Some(&light), ShadingRules::DEFERRED)];
    let runner = &mut TestRunner::new(as_many_as_wanted(CASES));
    let outcome = runner.run(&poison(), |poison| {
        let cloud = poisoned(&poison);
        for (light, shading) in under {
            let fault = fault(&mut exec.borrow_mut(), &cloud, light, shading);
            prop_assert!(fault.is_none(), "{:?}, {}: {fault:?}", shading.form, light.is_some());
        }
        Ok(())
    });
    assert!(outcome.is_ok(), "{}", outcome.unwrap_err());
}

/// Values of a plane under test, that are not finite or huge.
const WRONG: &[f32] = &[f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
const HUGE: &[f32] = &[3e38, -3e38];
/// The Gaussians that are changed: in different blocks, near and far.
const CHANGED: [usize; 5] = [0, 7, 15, 16, 39];

/// Sets a plane of the changed Gaussians, to one number after the other.
fn with_plane(cloud: &Cloud, plane: usize, numbers: &[f32]) -> Cloud {
    let mut cloud = cloud.clone();
    let changed = CHANGED.into_iter().zip(numbers.iter().cycle());
    changed.for_each(|(gaussian, number)| cloud.set(gaussian, plane, [*number]));
    cloud
}

#[test]
fn every_plane_of_a_shaded_gaussian_may_be_anything() {
    let mut exec = CpuExecutor::new();
    let (light, cloud) = (light(), random_cloud(COUNT, LAYOUT, 51));
    let planes = 0..LAYOUT.plane_count();
    assert_may_be_anything(&mut exec, &cloud, &light, planes);
    // Of filters all that a splat is made of.
    let layout = LAYOUT.antialiased();
    let planes = (0..=OPACITY).chain(layout.filter_plane());
    assert_may_be_anything(&mut exec, &random_cloud(COUNT, layout, 51), &light, planes);
}

fn assert_may_be_anything(
    exec: &mut CpuExecutor,
    cloud: &Cloud,
    light: &Environment<Vec<f32>>,
    planes: impl Iterator<Item = usize>,
) {
    let cases = planes.flat_map(|plane| [WRONG, HUGE].map(|numbers| (plane, numbers)));
    for ((plane, numbers), shading) in cases.flat_map(|case| SHADINGS.map(|shading| (case, shading))) {
        let fault = fault(exec, &with_plane(cloud, plane, numbers), Some(light), shading);
        assert_eq!(fault, None, "plane {plane} is {numbers:?}, {:?}", shading.form);
    }
}

#[test]
fn every_plane_of_a_plain_gaussian_may_be_anything() {
    [Layout::radiance(3), Layout::radiance(0).antialiased()].into_iter().for_each(assert_plain_may_be_anything);
}

fn assert_plain_may_be_anything(layout: Layout) {
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Training);
    let mut exec = CpuExecutor::new();
    let mut render =
        |cloud: &Cloud| render_view(&mut exec, cloud, None, &camera(48, 32), &rules).expect("the CPU renders").values;
    let cloud = random_cloud(COUNT, layout, 52);
    for plane in 0..layout.plane_count() {
        for numbers in [WRONG, HUGE] {
            let cloud = with_plane(&cloud, plane, numbers);
            let with = render(&cloud);
            assert!(with.iter().all(|number| number.is_finite()), "plane {plane} is {numbers:?}");
            assert!(with == render(&finite(&cloud)), "plane {plane} is {numbers:?}: another picture");
        }
    }
}

#[test]
fn plans_do_not_hide_nonfinite_gaussians() {
    let mut exec = CpuExecutor::new();
    let (light, mut cloud) = (light(), random_cloud(COUNT, LAYOUT, 53));
    // No tint, so that a plan omits the light and all that it needs.
    (0..COUNT).for_each(|gaussian| cloud.set(gaussian, specula_core::scene::TINT, [-200.0; 3]));
    let full = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    let filtered = exec.prefilter(&light, full.scheme, full.levels).expect("16 is a power of two");
    for plane in 0..LAYOUT.plane_count() {
        let cloud = with_plane(&cloud, plane, WRONG);
        let plan = Plan::new(LAYOUT, &Needs::of(&cloud).under(Some(&light)), None, &full);
        let mut render = |cloud: &Cloud, rules: &RenderRules| {
            let image = render_view(&mut exec, cloud, Some(&filtered), &camera(48, 32), rules);
            image.expect("the CPU renders").values[..3 * 48 * 32].to_vec()
        };
        let planned = render(&cloud, &plan.rules);
        assert!(planned == render(&finite(&cloud), &full), "plane {plane} is not finite");
    }
}

/// Cull reason of a plane that is not finite.
fn reason(plane: usize) -> CullReason {
    match plane {
        MEAN..LOG_SCALE => CullReason::NonfiniteMean,
        LOG_SCALE..6 => CullReason::NonfiniteScale,
        6..OPACITY => CullReason::NonfiniteQuat,
        OPACITY => CullReason::NonfiniteOpacity,
        11..17 => CullReason::NonfiniteColor,
        17 => CullReason::NonfiniteRoughness,
        18..24 => CullReason::NonfiniteResidual,
        plane if plane == LAYOUT.sh_end() => CullReason::NonfiniteFilter,
        _ => CullReason::NonfiniteHarmonics,
    }
}

#[test]
fn materials_that_are_not_finite_are_told_from_filters() {
    let layout = LAYOUT.physical().antialiased();
    for plane in layout.sh_end()..layout.plane_count() {
        let mut cloud = random_cloud(COUNT, layout, 54);
        cloud.set(3, plane, [f32::NAN]);
        let is_filter = Some(plane) == layout.filter_plane();
        let expected = if is_filter { CullReason::NonfiniteFilter } else { CullReason::NonfiniteMaterial };
        assert_eq!(CullReason::of(&cloud, 3, None), expected, "plane {plane}");
    }
}

#[test]
fn nonfinite_gaussians_are_counted_by_reason() {
    let cloud = random_cloud(COUNT, LAYOUT.antialiased(), 54);
    assert_eq!(CullStats::of(&cloud, None).nonfinite(), 0, "there is nothing wrong");
    for plane in 0..cloud.layout.plane_count() {
        for number in WRONG {
            let cloud = with_plane(&cloud, plane, slice::from_ref(number));
            for camera in [None, Some(camera(48, 32))] {
                let cull = CullStats::of(&cloud, camera.as_ref());
                assert_eq!(cull.count(reason(plane)), CHANGED.len(), "plane {plane} is {number}");
                assert_eq!(cull.nonfinite(), CHANGED.len(), "plane {plane} is {number}");
            }
        }
    }
}

/// Gaussians that a picture has splats for are those that the cull statistics count as drawn, or
/// outside.
#[test]
fn a_census_counts_what_the_executor_draws() {
    let mut exec = CpuExecutor::new();
    let rules = RenderRules::full(ShadingRules::DEFERRED, PrefilterScheme::Exact, Channels::Training);
    for case in specula_tests::stress::every_case() {
        let mut splats = exec.project(&case.cloud, &case.camera).expect("the CPU projects");
        exec.shade(&case.cloud, &case.camera, &mut splats, None, &rules).expect("the CPU shades");
        let drawn = splats.records().iter().filter(|record| record.reach > 0.0).count();
        let cull = CullStats::of(&case.cloud, Some(&case.camera));
        let counted = cull.count(CullReason::Drawn) + cull.count(CullReason::Outside);
        if !case.is_on_edge {
            assert_eq!(counted, drawn, "{}: {cull:?}", case.name);
        }
        let all: usize = CullReason::ALL.into_iter().map(|reason| cull.count(reason)).sum();
        assert_eq!(all, case.cloud.count, "{}: every Gaussian has one reason", case.name);
    }
}
