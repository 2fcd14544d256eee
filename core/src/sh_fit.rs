//! Fit of harmonics to colours seen from some directions, by weighted least squares.
//!
//! Minimises Σ w (½ + Σ_k Y_k(d) c_k − colour)² for each of red, green and blue over the
//! coefficients c ([`crate::least_squares`]). For many Gaussians seen from the same directions,
//! these are summed once.

use crate::{
    double::Double,
    least_squares::{LeastSquares, Row, UNKNOWNS_MAX},
    sh::{MAX_COUNT, basis},
    vector::vec3,
};

/// Harmonics at a unit direction, which points from the eye to the Gaussian.
pub type Harmonics = Row;

const _: () = assert!(MAX_COUNT == UNKNOWNS_MAX, "a fit has an unknown for every harmonic");

/// The first `count` = 1, 4, 9 or 16 harmonics at a unit direction; the rest is zero.
pub fn harmonics(direction: [f32; 3], count: usize) -> Harmonics {
    let [x, y, z] = direction.map(Double::from);
    basis(vec3(x, y, z), count).map(|value| value.0)
}

/// The normal equations of a fit.
#[derive(Clone, Debug)]
pub struct Fit(LeastSquares);

impl Fit {
    /// Empty fit of `count` = 1, 4, 9 or 16 harmonics.
    pub fn new(count: usize) -> Self {
        Self(LeastSquares::new(count))
    }

    /// The same directions with all weights times `weight`, and no colours yet.
    #[must_use]
    pub fn without_colors(&self, weight: f64) -> Self {
        Self(self.0.without_targets(weight))
    }

    /// Adds an observed colour, sRGB-encoded, with a non-negative weight.
    pub fn add(&mut self, harmonics: &Harmonics, color: [f32; 3], weight: f64) {
        self.0.add(harmonics, target_of(color), weight);
    }

    /// Adds only the direction of a colour, as [`Fit::add`] does.
    pub fn add_direction(&mut self, harmonics: &Harmonics, weight: f64) {
        self.0.add_row(harmonics, weight);
    }

    /// Adds only a colour, as [`Fit::add`] does.
    pub fn add_color(&mut self, harmonics: &Harmonics, color: [f32; 3], weight: f64) {
        self.0.add_target(harmonics, target_of(color), weight);
    }

    /// Coefficients, red, green and blue of each; `None` if the directions do not determine all of
    /// them, or if a number is not finite.
    pub fn solve(&self) -> Option<[[f32; 3]; MAX_COUNT]> {
        self.0.solve()
    }
}

/// Colour of the harmonics without the constant.
fn target_of(color: [f32; 3]) -> [f64; 3] {
    color.map(|channel| f64::from(channel) - 0.5)
}
