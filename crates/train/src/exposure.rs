//! Exposures of the training photographs: an affine map of colours for each, trained with the
//! scene.
//!
//! A factor common to all maps is indistinguishable from the scene's colours, and one common to the
//! maps of all photographs under a light from that light. The mean of the maps of the photographs
//! under each light is therefore kept at the identity: each step subtracts its change from all of
//! them. Rendered without a map, a pixel then has the mean colour of the photographs.
//!
//! Maps that vary slowly across the scene are hard to distinguish from colours that do. Decoupled
//! weight decay (Loshchilov and Hutter 2019) pulls poorly determined parameters back to the
//! identity.
//!
//! The gradient of a map is twelve sums over a picture, tile by tile in order. Adam's step is taken
//! on the host, so that both executors do the same and a repeated step counts once. Removing the
//! common factor at the end of the training instead would require mapping it through the shading
//! function, which is not affine.

use specula_core::{
    expose::{Exposure, IDENTITY},
    optimise::{Moment, adam, corrected_epsilon, corrected_rate, is_usable},
    state::{AdamMoments, ExposureState},
};

/// Weight decay towards the identity per step, relative to the learning rate.
const DECAY: f32 = 10.0;

/// Initial exposures of `count` photographs: identities.
pub(crate) fn identities(count: usize) -> ExposureState {
    let zeros = vec![[[0.0; 4]; 3]; count];
    ExposureState { maps: vec![IDENTITY; count], moments: AdamMoments { mean: zeros.clone(), square: zeros } }
}

/// Takes Adam's step for one photograph, whose first step has the number 1. `peers` are the
/// photographs under its light, itself among them. Returns the number of skipped gradient entries
/// that were not finite.
pub(crate) fn step(
    exposures: &mut ExposureState,
    view: usize,
    peers: impl Fn(usize) -> bool,
    grad: &Exposure<f64>,
    rate: f32,
    number: u32,
) -> usize {
    let (corrected_rate, epsilon) = (corrected_rate(rate, number), corrected_epsilon(number));
    let kept = 1.0 - (DECAY * rate).min(1.0);
    let ExposureState { maps, moments } = exposures;
    let numbers = [&mut maps[view], &mut moments.mean[view], &mut moments.square[view]];
    let [values, means, squares] = numbers.map(|rows| rows.as_flattened_mut().iter_mut());
    let mut nonfinite = 0;
    let numbers = values.zip(means.zip(squares)).zip(IDENTITY.as_flattened()).zip(grad.as_flattened());
    for (((value, (mean, square)), identity), grad) in numbers {
        let grad = *grad as f32;
        if !is_usable(grad) {
            nonfinite += 1;
            continue;
        }
        let next = adam(Moment { value: *value, mean: *mean, square: *square }, grad, corrected_rate, epsilon);
        (*value, *mean, *square) = (identity + (next.value - identity) * kept, next.mean, next.square);
    }
    center(maps, peers);
    nonfinite
}

/// Subtracts from some maps the difference between their mean and the identity.
fn center(maps: &mut [Exposure<f32>], peers: impl Fn(usize) -> bool) {
    let mut maps: Vec<_> =
        maps.iter_mut().enumerate().filter(|(index, _)| peers(*index)).map(|(_, map)| map.as_flattened_mut()).collect();
    for (index, identity) in IDENTITY.as_flattened().iter().enumerate() {
        let numbers = maps.iter().map(|map| f64::from(map[index]));
        let excess = numbers.sum::<f64>() / maps.len() as f64 - f64::from(*identity);
        for map in &mut maps {
            map[index] = (f64::from(map[index]) - excess) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::random::uniform;

    /// Rounding error of sums of a few `f32` numbers near one.
    const ROUNDING: f32 = 1e-6;

    fn grad(step: u32) -> Exposure<f64> {
        let draw = |row: u64, k: u64| f64::from(uniform(5, u64::from(step), 4 * row + k)) - 0.2;
        [0, 1, 2].map(|row| [0, 1, 2, 3].map(|k| draw(row, k)))
    }

    #[test]
    fn the_mean_stays_the_identity() {
        const COUNT: usize = 7;
        let mut exposures = identities(COUNT);
        for k in 0..100 {
            let left_out = step(&mut exposures, k as usize % COUNT, |_| true, &grad(k), 0.05, k / COUNT as u32 + 1);
            assert_eq!(left_out, 0, "every number is finite");
        }
        assert!(exposures.maps.iter().all(|map| *map != IDENTITY), "all have moved");
        for (place, own) in IDENTITY.as_flattened().iter().enumerate() {
            let sum: f32 = exposures.maps.iter().map(|map| map.as_flattened()[place]).sum();
            assert!((sum / COUNT as f32 - own).abs() < ROUNDING, "the mean at {place} is {}", sum / COUNT as f32);
        }
    }

    #[test]
    fn the_mean_stays_the_identity_under_each_light() {
        const COUNT: usize = 6;
        let mut exposures = identities(COUNT);
        for k in 0..60 {
            let view = k as usize % COUNT;
            step(&mut exposures, view, |other| (other < 2) == (view < 2), &grad(k), 0.05, k / COUNT as u32 + 1);
        }
        for maps in [&exposures.maps[..2], &exposures.maps[2..]] {
            for (place, own) in IDENTITY.as_flattened().iter().enumerate() {
                let sum: f32 = maps.iter().map(|map| map.as_flattened()[place]).sum();
                assert!((sum / maps.len() as f32 - own).abs() < ROUNDING, "{place}");
            }
        }
    }

    #[test]
    fn the_map_of_a_single_photograph_stays_the_identity() {
        let mut exposures = identities(1);
        (1..20).for_each(|number| {
            assert_eq!(step(&mut exposures, 0, |_| true, &grad(number), 0.1, number), 0, "every number is finite");
        });
        assert_eq!(exposures.maps, [IDENTITY]);
    }

    #[test]
    fn undetermined_maps_decay_to_the_identity() {
        const RATE: f32 = 0.02;
        let mut exposures = identities(2);
        (exposures.maps[0][0][0], exposures.maps[1][0][0]) = (1.2, 0.8);
        assert_eq!(step(&mut exposures, 0, |_| true, &[[0.0; 4]; 3], RATE, 1), 0, "zeros are finite");
        // One of two maps decays, and centring halves the change for both.
        let apart = exposures.maps[0][0][0] - exposures.maps[1][0][0];
        assert!((apart - 0.4 + 0.2 * DECAY * RATE).abs() < ROUNDING, "they are {apart} apart");
    }

    #[test]
    fn gradients_that_are_not_finite_are_skipped_and_counted() {
        let mut exposures = identities(2);
        let mut grad = grad(1);
        (grad[0][1], grad[2][3]) = (f64::NAN, f64::INFINITY);
        assert_eq!(step(&mut exposures, 0, |_| true, &grad, 0.1, 1), 2);
        assert_eq!([exposures.maps[0][0][1], exposures.maps[0][2][3]], [0.0; 2], "they have not moved");
        assert!(exposures.maps.as_flattened().as_flattened().iter().all(|number| number.is_finite()));
    }
}
