//! Light filtered by the CPU executor against its integral, and levels of one's own.

use specula_core::{
    executor::Renderer,
    pack::Storage,
    prefilter::{Level, LevelRange, Levels, MipRoughness, PrefilterScheme},
    scene::{Environment, RadianceActivation},
};
use specula_cpu::{CpuExecutor, prefilter::Light};
use specula_prefilter::Operator;
use specula_tests::{
    compare::{ROUNDING_F32, assert_close},
    prefilter_error::{Errors, Truth},
};

const BASE: usize = 64;
/// A quarter of the directions of the published figures.
const DIRECTIONS: usize = 40;
/// So few directions find errors that are up to a seventh larger.
const FEW_DIRECTIONS: f64 = 1.15;
/// What is promised of light as a display shows it, and of light of full range.
const BOUNDS: [f64; 2] = [0.01, 0.05];
/// Halves are 2⁻¹¹ apart at most, relatively.
const HALVES: f64 = 5e-4;

fn filter(truth: &Truth, scheme: PrefilterScheme) -> [Light; 2] {
    let mut exec = CpuExecutor::new();
    truth.environments().map(|light| exec.prefilter(&light, scheme, LevelRange::ALL).expect("64 is allowed"))
}

fn errors(truth: &Truth, lights: &[Light; 2]) -> [Errors; 2] {
    truth.errors(lights[0].levels(), [lights[0].texels(), lights[1].texels()])
}

#[test]
fn our_levels_are_within_one_and_five_per_cent_of_the_integral_and_the_official_ones_are_not() {
    let truth = Truth::new(BASE, DIRECTIONS);
    let mut ours = filter(&truth, PrefilterScheme::Exact);
    let official = errors(&truth, &filter(&truth, PrefilterScheme::Official));
    let found = errors(&truth, &ours);
    for kind in 0..2 {
        let (ours, official) = (found[kind].rms(), official[kind].rms());
        assert!(ours <= FEW_DIRECTIONS * BOUNDS[kind], "{ours} of at most {}", BOUNDS[kind]);
        assert!(official > 4.0 * BOUNDS[kind], "{official}: the comparison tells the schemes apart");
        assert!(found[kind].worst() <= 2.5 * BOUNDS[kind], "{:?}", found[kind]);
        assert_close(found[kind].0[0], 0.0, ROUNDING_F32);
    }
    ours.iter_mut().for_each(|light| light.round(Storage::F16));
    let rounded = errors(&truth, &ours);
    for (rounded, found) in rounded.iter().zip(found) {
        assert_close(rounded.rms(), found.rms(), HALVES);
        assert!(rounded.0[0] > 0.0, "halves are not the numbers themselves");
    }
}

#[test]
fn our_weights_are_half_of_the_official_ones() {
    let weights = |scheme| {
        let operator = Operator::new(scheme, BASE, LevelRange::ALL);
        operator.rows().expect("there are few").forward.weights.len()
    };
    let [ours, official] = [PrefilterScheme::Exact, PrefilterScheme::Official].map(weights);
    assert!(2 * ours <= official, "{ours} and {official}");
}

/// A lobe that is cut keeps its energy: rows sum to one, whatever is left out.
#[test]
fn a_constant_light_stays_constant_in_levels_of_ones_own() {
    let mut exec = CpuExecutor::new();
    for (roughness, resolution, count) in
        [(MipRoughness::Linear, 32, 6), (MipRoughness::Filament, 32, 4), (MipRoughness::Linear, 16, 2)]
    {
        let levels = Levels::mips(roughness, resolution, count).expect("a chain");
        let values = [0.25, 1.0, 7.0].repeat(6 * resolution * resolution);
        let environment = Environment { resolution, activation: RadianceActivation::Identity, values };
        let light = exec.prefilter_into(&environment, PrefilterScheme::Exact, levels).expect("as fine as the first");
        assert_eq!(light.levels(), levels.as_slice(), "{roughness:?}");
        for level in 0..count {
            let faces = light.faces(level);
            let size = resolution >> level;
            assert_eq!(faces.len(), 18 * size * size, "{roughness:?}: level {level} has six faces");
            for texel in faces.chunks_exact(3) {
                for (found, expected) in texel.iter().zip([0.25, 1.0, 7.0]) {
                    assert_close(f64::from(*found) / expected, 1.0, 10.0 * ROUNDING_F32);
                }
            }
        }
    }
}

#[test]
fn the_faces_of_the_first_level_are_the_light() {
    let values: Vec<f32> = (0..18 * 16 * 16).map(|k| k as f32).collect();
    let environment = Environment { resolution: 16, activation: RadianceActivation::Identity, values };
    let levels = Levels::mips(MipRoughness::Linear, 16, 3).expect("a chain");
    let light = CpuExecutor::new().prefilter_into(&environment, PrefilterScheme::Exact, levels).expect("it fits");
    assert_eq!(light.faces(0), environment.values, "a mirror shows what is there");
    let other = Environment { resolution: 8, values: vec![1.0; 18 * 64], ..environment };
    assert!(CpuExecutor::new().prefilter_into(&other, PrefilterScheme::Exact, levels).is_err(), "8 is not 16");
}

#[test]
fn chains_are_those_that_engines_look_up() {
    let roughness = |chain: Option<Levels>| -> Vec<f32> {
        chain.expect("a chain").as_slice().iter().map(|level| level.roughness).collect()
    };
    assert_eq!(roughness(Levels::mips(MipRoughness::Linear, 256, 5)), [0.0, 0.25, 0.5, 0.75, 1.0]);
    for (level, roughness) in roughness(Levels::mips(MipRoughness::Filament, 256, 5)).into_iter().enumerate() {
        let found = 4.0 * f64::from(roughness) * (2.0 - f64::from(roughness));
        assert_close(found, level as f64, 10.0 * ROUNDING_F32);
    }
    assert!(Levels::mips(MipRoughness::Linear, 256, 1).is_none(), "one level has nowhere to go");
    assert!(Levels::mips(MipRoughness::Linear, 8, 5).is_none(), "half a texel is none");
    assert!(Levels::mips(MipRoughness::Linear, 2048, 11).is_none(), "there are too many");
}

#[test]
fn levels_that_cannot_be_looked_up_are_none() {
    let of = |levels: &[(f32, usize)]| {
        let levels: Vec<Level> = levels
            .iter()
            .map(|(roughness, resolution)| Level { roughness: *roughness, resolution: *resolution })
            .collect();
        Levels::of(&levels)
    };
    assert!(of(&[(0.0, 16), (0.5, 16), (1.0, 8)]).is_some(), "they grow and shrink");
    for levels in [
        &[(0.0, 16)][..],
        &[(0.0, 16), (0.0, 8)],
        &[(0.0, 8), (1.0, 16)],
        &[(0.0, 16), (1.5, 8)],
        &[(f32::NAN, 16), (1.0, 8)],
        &[(0.0, 12), (1.0, 6)],
    ] {
        assert!(of(levels).is_none(), "{levels:?}");
    }
}
