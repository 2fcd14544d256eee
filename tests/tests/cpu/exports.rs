//! Exports to other programs instead of a shading function: fitted harmonics and fused surfaces.

use proptest::{collection::vec, prelude::*};
use specula_core::{
    sh::MAX_COUNT,
    sh_fit::{Fit, Harmonics, harmonics},
    tsdf::{CORNERS, Voxel, vertex},
};
use specula_tests::strategies::{same_every_time, unit_vector};

/// Coefficients are `f32`; the fit is in `f64`, its normal equations of random directions are well
/// conditioned.
const ROUNDING: f32 = 1e-5;

fn color_of(harmonics: &Harmonics, coefficients: &[[f32; 3]]) -> [f32; 3] {
    let sum = |c: usize| coefficients.iter().zip(harmonics).map(|(color, y)| f64::from(color[c]) * y).sum::<f64>();
    [0, 1, 2].map(|c| (0.5 + sum(c)) as f32)
}

fn seen(directions: &[[f64; 3]], count: usize) -> Vec<Harmonics> {
    directions.iter().map(|direction| harmonics(direction.map(|x| x as f32), count)).collect()
}

fn close(found: &[[f32; 3]], expected: &[[f32; 3]]) -> bool {
    found.iter().flatten().zip(expected.iter().flatten()).all(|(a, b)| (a - b).abs() < ROUNDING)
}

proptest! {
    #![proptest_config(same_every_time())]

    #[test]
    fn fits_recover_harmonics(
        degree in 0..4_usize,
        coefficients in vec([-1.0..1.0_f32, -1.0..1.0, -1.0..1.0], MAX_COUNT),
        directions in vec((unit_vector(), 0.1..1.0_f64), 200),
    ) {
        let count = (degree + 1).pow(2);
        let mut fit = Fit::new(count);
        for (direction, weight) in &directions {
            let harmonics = seen(&[*direction], count)[0];
            fit.add(&harmonics, color_of(&harmonics, &coefficients[..count]), *weight);
        }
        let found = fit.solve().expect("200 directions decide 16 coefficients");
        prop_assert!(close(&found[..count], &coefficients[..count]), "{found:?} is not {coefficients:?}");
        prop_assert!(found[count..].iter().flatten().all(|x| *x == 0.0), "what is not fitted is zero");
    }

    #[test]
    fn directions_that_are_shared_need_to_be_summed_once(
        colors in vec([0.0..1.0_f32, 0.0..1.0, 0.0..1.0], 60),
        directions in vec(unit_vector(), 60),
        weight in 0.1..10.0_f64,
    ) {
        let (harmonics, mut shared, mut whole) = (seen(&directions, 9), Fit::new(9), Fit::new(9));
        harmonics.iter().for_each(|harmonics| shared.add_direction(harmonics, 1.0));
        let mut one = shared.without_colors(weight);
        for (harmonics, color) in harmonics.iter().zip(&colors) {
            one.add_color(harmonics, *color, weight);
            whole.add(harmonics, *color, weight);
        }
        let [one, whole] = [one, whole].map(|fit| fit.solve().expect("60 directions decide 9 coefficients"));
        prop_assert!(close(&one, &whole), "{one:?} is not {whole:?}");
    }

    #[test]
    fn no_other_coefficients_come_closer(
        colors in vec([0.0..1.0_f32, 0.0..1.0, 0.0..1.0], 60),
        directions in vec(unit_vector(), 60),
        other in vec([-0.1..0.1_f32, -0.1..0.1, -0.1..0.1], 9),
    ) {
        let harmonics = seen(&directions, 9);
        let mut fit = Fit::new(9);
        harmonics.iter().zip(&colors).for_each(|(harmonics, color)| fit.add(harmonics, *color, 1.0));
        let best = fit.solve().expect("60 directions decide 9 coefficients");
        let square = |(a, b): (f32, &f32)| f64::from(a - b).powi(2);
        let error = |coefficients: &[[f32; 3]]| {
            let shown = harmonics.iter().map(|harmonics| color_of(harmonics, coefficients));
            shown.zip(&colors).map(|(a, b)| a.into_iter().zip(b).map(square).sum::<f64>()).sum::<f64>()
        };
        let moved: Vec<[f32; 3]> =
            best.iter().zip(&other).map(|(a, b)| core::array::from_fn(|c| a[c] + b[c])).collect();
        prop_assert!(error(&best[..9]) <= error(&moved) + 1e-9, "something else is closer");
    }

    #[test]
    fn a_plane_through_a_cell_is_found(normal in unit_vector(), offset in -0.2..0.2_f32) {
        let normal = normal.map(|x| x as f32);
        let at = |k: usize, corner: usize| (corner >> k & 1) as f32 - 0.5;
        let distances: [f32; CORNERS] =
            core::array::from_fn(|corner| (0..3).map(|k| normal[k] * at(k, corner)).sum::<f32>() - offset);
        let (place, found) = vertex(&distances).expect("the plane goes through the cell");
        let off: f32 = (0..3).map(|k| normal[k] * (place[k] - 0.5)).sum::<f32>() - offset;
        prop_assert!(off.abs() < ROUNDING, "the vertex is {off} off the plane");
        let cosine: f32 = found.iter().zip(&normal).map(|(a, b)| a * b).sum();
        prop_assert!(cosine > 1.0 - ROUNDING, "{found:?} is not {normal:?}");
    }
}

#[test]
fn fits_of_too_few_directions_are_undetermined() {
    let mut fit = Fit::new(4);
    for _ in 0..100 {
        fit.add(&harmonics([0.0, 0.0, 1.0], 4), [0.25; 3], 1.0);
    }
    assert!(fit.solve().is_none(), "one direction does not decide four coefficients");
    assert!(Fit::new(1).solve().is_none(), "nothing was seen");
}

#[test]
fn a_voxel_is_the_mean_of_what_is_seen_and_learns_nothing_behind_a_surface() {
    let voxel = Voxel::default().seen(0.5, [1.0, 0.0, 0.0], 1.0).seen(-0.25, [0.0, 0.0, 1.0], 3.0);
    assert!((voxel.distance - (0.5 - 3.0 * 0.25) / 4.0).abs() < ROUNDING && voxel.weight == 4.0, "{voxel:?}");
    assert!(close(&[voxel.color], &[[0.25, 0.0, 0.75]]), "{voxel:?}");
    for nothing in
        [voxel.seen(-1.5, [1.0; 3], 1.0), voxel.seen(0.5, [1.0; 3], 0.0), voxel.seen(f32::NAN, [1.0; 3], 1.0)]
    {
        assert_eq!(nothing, voxel);
    }
    let free = voxel.seen(f32::INFINITY, [1.0; 3], 4.0);
    assert!((free.distance - 0.5 * (1.0 - 0.0625)).abs() < ROUNDING, "far before a surface counts as 1: {free:?}");
    assert_eq!(free.color, voxel.color, "nothing is seen there");
}

#[test]
fn a_cell_on_one_side_of_the_surface_has_no_vertex() {
    assert!(vertex(&[0.5; CORNERS]).is_none() && vertex(&[-0.5; CORNERS]).is_none(), "nothing changes its sign");
}
