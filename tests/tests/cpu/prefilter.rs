//! Light filtered by the CPU executor against its integral, and custom levels.

use rayon::prelude::*;
use specula_core::{
    cubemap::{texel_direction, texel_index},
    executor::Renderer,
    pack::Storage,
    prefilter::{Level, LevelRange, Levels, MipRoughness, PrefilterScheme},
    scene::{Environment, RadianceActivation},
};
use specula_cpu::{CpuExecutor, stages::prefilter::Light};
use specula_prefilter::Operator;
use specula_tests::{
    compare::{ROUNDING_F32, assert_close},
    lobe::{CubeMap, filtered},
    prefilter_error::{Errors, Truth},
};

const BASE: usize = 64;
/// A quarter of the directions of the published figures.
const DIRECTIONS: usize = 40;
/// With this few directions the errors found are up to a seventh larger.
const FEW_DIRECTIONS: f64 = 1.15;
/// Guaranteed errors for light in display range and for light of full range.
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
    let weights = |scheme| Operator::new(scheme, BASE, LevelRange::ALL).product_count().expect("there are few");
    let [ours, official] = [PrefilterScheme::Exact, PrefilterScheme::Official].map(weights);
    assert!(2 * ours <= official, "{ours} and {official}");
}

/// Distance of each level of a chain from the integral at most, as a share of it, at the centres of
/// the selected texels; without the first, which is the light.
fn off_at_centres(map: &CubeMap<1>, is_looked_at: impl Fn([f64; 3]) -> bool) -> Vec<f64> {
    let levels = Levels::mips(MipRoughness::Linear, BASE, 5).expect("a chain");
    let values = map.texels.iter().flat_map(|[x]| [*x as f32; 3]).collect();
    let environment = Environment { resolution: BASE, activation: RadianceActivation::Identity, values };
    let light = CpuExecutor::new().prefilter_into(&environment, PrefilterScheme::Exact, levels).expect("it fits");
    let level_error = |(number, level): (usize, &Level)| {
        let (size, faces) = (level.resolution, light.faces(number));
        let centre = |k: usize| (k, texel_direction(k / (size * size), k % size, k / size % size, size));
        let places: Vec<_> = (0..6 * size * size).map(centre).filter(|(_, dir)| is_looked_at(*dir)).collect();
        let off = |(k, direction): &(usize, [f64; 3])| {
            let [truth] = filtered(|dir| map.sample(dir), *direction, level.roughness.into(), BASE);
            (f64::from(faces[3 * k]) / truth - 1.0).abs()
        };
        places.par_iter().map(off).reduce(|| 0.0, f64::max)
    };
    levels.as_slice().iter().enumerate().skip(1).map(level_error).collect()
}

/// A sun is not smooth over nodes that stand for many texels, as `specula prefilter --help` notes.
#[test]
fn beside_a_sun_of_a_texel_a_chain_is_not_exact() {
    /// The sun, the sky, and the cosine from the sun of selected texels.
    const SUN: f64 = 16_384.0;
    const SKY: f64 = 0.25;
    const BESIDE: f64 = 0.9;
    /// Bound of each level's error, and the least of the first, so that the help stays up to date:
    /// 1.042, 0.332, 0.085 and 0.026 were found.
    const AT_MOST: [f64; 4] = [1.1, 0.36, 0.1, 0.04];
    const AT_LEAST: f64 = 0.3;
    let (face, column, row) = (0, 20, 33);
    let mut texels = vec![[SKY]; 6 * BASE * BASE];
    texels[texel_index(face, column, row, BASE)] = [SUN];
    let sun = texel_direction(face, column, row, BASE);
    let cosine = |direction: [f64; 3]| -> f64 { (0..3).map(|k| direction[k] * sun[k]).sum() };
    let off = off_at_centres(&CubeMap { resolution: BASE, texels }, |direction| cosine(direction) > BESIDE);
    assert!(off.iter().zip(AT_MOST).all(|(off, at_most)| *off < at_most), "{off:?}");
    assert!(off[0] > AT_LEAST, "{off:?}: the help says more than is so");
}

/// A lobe that is cut keeps its energy: rows sum to one, whatever is cut off.
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
