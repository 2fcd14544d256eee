//! Harmonics that come closest to colours that were seen from some directions: weighted least squares.
//!
//! Minimises Σ w (½ + Σ_k Y_k(d) c_k − colour)² for each of red, green and blue over the coefficients c, by the normal
//! equations N c = r with N = Σ w Y Yᵀ and r = Σ w Y (colour − ½) (Lawson and Hanson 1974, chapter 19), in `f64`. N
//! depends on directions and weights alone, so where many Gaussians are seen from the same directions it is summed once.

use crate::{
    double::Double,
    math,
    sh::{MAX_COUNT, basis},
    vector::vec3,
};

/// Numbers of a lower triangle with [`MAX_COUNT`] rows.
const TRIANGLE: usize = MAX_COUNT * (MAX_COUNT + 1) / 2;

/// Harmonics at a unit direction, which points from the eye to the Gaussian.
pub type Harmonics = [f64; MAX_COUNT];

/// The first `count` = 1, 4, 9 or 16 harmonics at a unit direction; the rest is zero.
pub fn harmonics(direction: [f32; 3], count: usize) -> Harmonics {
    let [x, y, z] = direction.map(Double::from);
    basis(vec3(x, y, z), count).map(|value| value.0)
}

/// The normal equations of a fit.
#[derive(Clone, Debug)]
pub struct Fit {
    count: usize,
    /// Lower triangle of N, row by row.
    normal: [f64; TRIANGLE],
    right: [[f64; 3]; MAX_COUNT],
}

impl Fit {
    /// A fit of `count` = 1, 4, 9 or 16 harmonics that has seen nothing yet.
    pub fn new(count: usize) -> Self {
        Self { count, normal: [0.0; TRIANGLE], right: [[0.0; 3]; MAX_COUNT] }
    }

    /// The same directions with all weights times `weight`, and no colours yet.
    pub fn without_colors(&self, weight: f64) -> Self {
        Self { normal: self.normal.map(|number| number * weight), ..Self::new(self.count) }
    }

    /// A colour that was seen, sRGB-encoded, with a weight that is not negative.
    pub fn add(&mut self, harmonics: &Harmonics, color: [f32; 3], weight: f64) {
        self.add_direction(harmonics, weight);
        self.add_color(harmonics, color, weight);
    }

    /// The direction of [`Fit::add`] alone.
    pub fn add_direction(&mut self, harmonics: &Harmonics, weight: f64) {
        for (row, value) in harmonics[..self.count].iter().enumerate() {
            let start = row * (row + 1) / 2;
            for (sum, other) in self.normal[start..=start + row].iter_mut().zip(harmonics) {
                *sum += weight * value * other;
            }
        }
    }

    /// The colour of [`Fit::add`] alone.
    pub fn add_color(&mut self, harmonics: &Harmonics, color: [f32; 3], weight: f64) {
        for (right, value) in self.right[..self.count].iter_mut().zip(harmonics) {
            for (sum, channel) in right.iter_mut().zip(color) {
                *sum += weight * value * (f64::from(channel) - 0.5);
            }
        }
    }

    /// The coefficients, red, green and blue of each. None where the directions do not decide all of them, or where a
    /// number is not finite.
    pub fn solve(&self) -> Option<[[f32; 3]; MAX_COUNT]> {
        let root = self.root()?;
        let mut solution = self.right;
        for row in 0..self.count {
            for before in 0..row {
                subtract(&mut solution, row, before, root[row * (row + 1) / 2 + before]);
            }
            solution[row] = solution[row].map(|sum| sum / root[row * (row + 1) / 2 + row]);
        }
        for row in (0..self.count).rev() {
            for after in row + 1..self.count {
                subtract(&mut solution, row, after, root[after * (after + 1) / 2 + row]);
            }
            solution[row] = solution[row].map(|sum| sum / root[row * (row + 1) / 2 + row]);
        }
        let solution = solution.map(|color| color.map(|sum| sum as f32));
        solution.iter().flatten().all(|number| number.is_finite()).then_some(solution)
    }

    /// The lower triangle L with L Lᵀ = N, by Cholesky. None unless N is positive definite beyond rounding.
    fn root(&self) -> Option<[f64; TRIANGLE]> {
        const ROUNDING: f64 = 1e-12;
        let mut root = self.normal;
        for row in 0..self.count {
            let start = row * (row + 1) / 2;
            for column in 0..=row {
                let other = column * (column + 1) / 2;
                let sum: f64 = (0..column).map(|k| root[start + k] * root[other + k]).sum();
                let rest = root[start + column] - sum;
                root[start + column] = match column == row {
                    false => rest / root[other + column],
                    true if rest > ROUNDING * self.normal[start + row] => math::sqrt64(rest),
                    true => return None,
                };
            }
        }
        Some(root)
    }
}

/// Row −= factor · other row.
fn subtract(rows: &mut [[f64; 3]; MAX_COUNT], row: usize, other: usize, factor: f64) {
    let taken = rows[other];
    rows[row].iter_mut().zip(taken).for_each(|(number, taken)| *number -= factor * taken);
}
