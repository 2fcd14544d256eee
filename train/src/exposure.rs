//! How the photographs of a training were exposed: a map of colours for each, which is learned beside the scene.
//!
//! A factor that all maps share cannot be told from the scene's own colours. So the mean of the maps is kept at the
//! identity: after every step what it has moved is taken out of all of them. The mean of what the photographs would show of
//! a pixel is then its colour as it is rendered without any map: the scene looks as the photographs do on average.
//!
//! Maps that change slowly from one side of the scene to the other are hard to tell from colours that do so. What
//! photographs hardly decide therefore goes back to the identity, by a decay of its own beside Adam's step (Loshchilov and
//! Hutter 2019, "Decoupled Weight Decay Regularization").

use specula_core::{
    expose::{Exposure, IDENTITY},
    optimise::{Moment, adam, corrected_epsilon, corrected_rate, is_usable},
};

/// What of a map's distance from the identity is taken back with each step, for a learning rate of one.
const DECAY: f32 = 10.0;

/// The exposures of all photographs, and Adam's moments of their numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Exposures {
    /// A map for each photograph; their mean is the identity, up to rounding.
    pub maps: Vec<Exposure<f32>>,
    /// Running means of the gradients.
    pub mean: Vec<Exposure<f32>>,
    /// Running means of the squared gradients.
    pub square: Vec<Exposure<f32>>,
}

impl Exposures {
    /// Before the first step all photographs show colours as they are.
    pub fn start(count: usize) -> Self {
        let zeros = vec![[[0.0; 4]; 3]; count];
        Self { maps: vec![IDENTITY; count], mean: zeros.clone(), square: zeros }
    }

    /// Whether they are those of so many photographs.
    pub fn are_of(&self, count: usize) -> bool {
        [self.maps.len(), self.mean.len(), self.square.len()] == [count; 3]
    }

    /// Adam's step for one photograph; its first has the number 1. Returns how many numbers of the gradient were not finite
    /// and left out.
    pub(crate) fn step(&mut self, view: usize, grad: &Exposure<f64>, rate: f32, number: u32) -> usize {
        let (corrected_rate, epsilon) = (corrected_rate(rate, number), corrected_epsilon(number));
        let kept = 1.0 - (DECAY * rate).min(1.0);
        let numbers = [&mut self.maps[view], &mut self.mean[view], &mut self.square[view]];
        let [maps, means, squares] = numbers.map(|rows| rows.as_flattened_mut().iter_mut());
        let mut nonfinite = 0;
        let numbers = maps.zip(means.zip(squares)).zip(IDENTITY.as_flattened()).zip(grad.as_flattened());
        for (((value, (mean, square)), own), grad) in numbers {
            let grad = *grad as f32;
            if !is_usable(grad) {
                nonfinite += 1;
                continue;
            }
            let next = adam(Moment { value: *value, mean: *mean, square: *square }, grad, corrected_rate, epsilon);
            (*value, *mean, *square) = (own + (next.value - own) * kept, next.mean, next.square);
        }
        self.centre();
        nonfinite
    }

    /// Takes out of every map by what their mean is not the identity.
    fn centre(&mut self) {
        for (place, own) in IDENTITY.as_flattened().iter().enumerate() {
            let numbers = self.maps.iter().map(|map| f64::from(map.as_flattened()[place]));
            let excess = numbers.sum::<f64>() / self.maps.len() as f64 - f64::from(*own);
            for map in &mut self.maps {
                let number = &mut map.as_flattened_mut()[place];
                *number = (f64::from(*number) - excess) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::random::uniform;

    /// Sums of a few numbers near one, in `f32`.
    const ROUNDING: f32 = 1e-6;

    fn grad(step: u32) -> Exposure<f64> {
        let draw = |row: u64, k: u64| f64::from(uniform(5, u64::from(step), 4 * row + k)) - 0.2;
        [0, 1, 2].map(|row| [0, 1, 2, 3].map(|k| draw(row, k)))
    }

    #[test]
    fn the_mean_stays_the_identity() {
        const COUNT: usize = 7;
        let mut exposures = Exposures::start(COUNT);
        for step in 0..100 {
            let left_out = exposures.step(step as usize % COUNT, &grad(step), 0.05, step / COUNT as u32 + 1);
            assert_eq!(left_out, 0, "every number is finite");
        }
        assert!(exposures.maps.iter().all(|map| *map != IDENTITY), "all have moved");
        for (place, own) in IDENTITY.as_flattened().iter().enumerate() {
            let sum: f32 = exposures.maps.iter().map(|map| map.as_flattened()[place]).sum();
            assert!((sum / COUNT as f32 - own).abs() < ROUNDING, "the mean at {place} is {}", sum / COUNT as f32);
        }
    }

    #[test]
    fn a_photograph_alone_shows_the_scene_as_it_is() {
        let mut exposures = Exposures::start(1);
        (1..20).for_each(|step| assert_eq!(exposures.step(0, &grad(step), 0.1, step), 0, "every number is finite"));
        assert_eq!(exposures.maps, [IDENTITY]);
    }

    #[test]
    fn what_nothing_decides_goes_back_to_the_identity() {
        const RATE: f32 = 0.02;
        let mut exposures = Exposures::start(2);
        (exposures.maps[0][0][0], exposures.maps[1][0][0]) = (1.2, 0.8);
        assert_eq!(exposures.step(0, &[[0.0; 4]; 3], RATE, 1), 0, "zeros are finite");
        // One of two maps has lost its share, and both lose half of that as their mean is centred.
        let apart = exposures.maps[0][0][0] - exposures.maps[1][0][0];
        assert!((apart - 0.4 + 0.2 * DECAY * RATE).abs() < ROUNDING, "they are {apart} apart");
    }

    #[test]
    fn what_is_not_finite_is_left_out_and_counted() {
        let mut exposures = Exposures::start(2);
        let mut grad = grad(1);
        (grad[0][1], grad[2][3]) = (f64::NAN, f64::INFINITY);
        assert_eq!(exposures.step(0, &grad, 0.1, 1), 2);
        assert_eq!([exposures.maps[0][0][1], exposures.maps[0][2][3]], [0.0; 2], "they have not moved");
        assert!(exposures.maps.as_flattened().as_flattened().iter().all(|number| number.is_finite()));
    }
}
