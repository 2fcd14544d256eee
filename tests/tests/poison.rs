//! Scenes with any bits for numbers: what has no finite place is left out, all else renders and trains in its senses. Other
//! numbers that are not finite are refused where a scene is opened.

use core::cell::RefCell;
use proptest::{
    collection::vec,
    prelude::*,
    sample::{Index, select},
    test_runner::TestRunner,
};
use specula_core::{
    scene::{DIFFUSE, Gaussians, LOG_SCALE, MEAN, RadianceActivation, len_of_values},
    shade::ShadingRules,
};
use specula_cpu::CpuExecutor;
use specula_tests::{
    formulas::camera,
    strategies::{random_cloud, random_environment, same_every_time},
    stress::{Case, LAYOUT, results::Results},
};

type Cloud = Gaussians<Vec<f32>>;

/// Scenes that are tried.
const CASES: u32 = 100;
const COUNT: usize = 40;
const RESOLUTION: usize = 16;

/// What colours and residuals of normals are made of; the square of what is much larger has no place in an `f32`.
const LARGEST: f32 = 1e15;

/// Numbers at every edge.
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

/// A number of the scene, and what it becomes.
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
        let (gaussian, plane) = (place / planes, place % planes);
        if is_place(plane) || plane < DIFFUSE && number.is_finite() || number.abs() <= LARGEST {
            cloud.set(gaussian, plane, [*number]);
        }
    }
    cloud
}

/// Whether a plane says where a Gaussian is.
fn is_place(plane: usize) -> bool {
    (MEAN..LOG_SCALE).contains(&plane)
}

/// The Gaussians that have a finite place.
fn placed(cloud: &Cloud) -> Cloud {
    let numbers = |k: usize| (0..LAYOUT.plane_count()).map(move |plane| cloud.get::<1>(k, plane)[0]);
    let kept: Vec<usize> = (0..cloud.count)
        .filter(|k| numbers(*k).enumerate().all(|(plane, number)| !is_place(plane) || number.is_finite()))
        .collect();
    let values = vec![0.0; len_of_values(kept.len(), LAYOUT)];
    let mut rest = Gaussians { count: kept.len(), layout: LAYOUT, values };
    for (to, from) in kept.into_iter().enumerate() {
        numbers(from).enumerate().for_each(|(plane, number)| rest.set(to, plane, [number]));
    }
    rest
}

#[test]
fn what_is_not_finite_is_left_out_and_the_rest_renders() {
    let exec = RefCell::new(CpuExecutor::new());
    let light = random_environment(RESOLUTION, RadianceActivation::Exponential, 3);
    let under =
        [(None, ShadingRules::PAPER), (Some(&light), ShadingRules::PAPER), (Some(&light), ShadingRules::DEFERRED)];
    let runner = &mut TestRunner::new(ProptestConfig { cases: CASES, ..same_every_time() });
    let outcome = runner.run(&poison(), |poison| {
        let cloud = poisoned(&poison);
        for (light, shading) in under {
            let results = |cloud: Cloud| {
                let case = Case { environment: light.cloned(), ..Case::new("poison", camera(48, 32), cloud) };
                Results::new(&mut *exec.borrow_mut(), &case, shading)
            };
            let with = results(cloud.clone());
            prop_assert!(with.picture.iter().all(|number| number.is_finite()), "the picture");
            prop_assert!(with.losses.iter().all(|number| number.is_finite()), "the losses: {:?}", with.losses);
            prop_assert!(with.gradient.iter().all(|number| number.is_finite()), "a gradient");
            prop_assert!(
                with.picture == results(placed(&cloud)).picture,
                "the picture changes without what has no place"
            );
        }
        Ok(())
    });
    assert!(outcome.is_ok(), "{}", outcome.unwrap_err());
}
