//! Weighted least squares by the normal equations.
//!
//! Minimises Σ w |Σ_k x_k c_k − t|² over the unknowns c, three targets t at once, by N c = r with N
//! = Σ w x xᵀ and r = Σ w x t (Lawson and Hanson 1974, chapter 19), in `f64`. N does not depend on
//! the targets, so it is summed once for many fits with the same rows x.

use crate::math;

/// Maximum number of unknowns of a fit.
pub const UNKNOWNS_MAX: usize = 16;
/// Numbers of a lower triangle with [`UNKNOWNS_MAX`] rows.
const TRIANGLE: usize = UNKNOWNS_MAX * (UNKNOWNS_MAX + 1) / 2;

/// Coefficients of the unknowns in one equation; those beyond the fit's count are ignored.
pub type Row = [f64; UNKNOWNS_MAX];

/// The normal equations of a fit.
#[derive(Clone, Debug)]
pub struct LeastSquares {
    count: usize,
    /// Lower triangle of N, row by row.
    normal: [f64; TRIANGLE],
    right: [[f64; 3]; UNKNOWNS_MAX],
}

impl LeastSquares {
    /// Empty fit of `count` unknowns, at most [`UNKNOWNS_MAX`].
    pub fn new(count: usize) -> Self {
        Self { count, normal: [0.0; TRIANGLE], right: [[0.0; 3]; UNKNOWNS_MAX] }
    }

    /// The same rows with all weights times `weight`, and no targets yet.
    pub(crate) fn without_targets(&self, weight: f64) -> Self {
        Self { normal: self.normal.map(|number| number * weight), ..Self::new(self.count) }
    }

    /// Adds an equation, with a weight that is not negative.
    pub fn add(&mut self, row: &Row, target: [f64; 3], weight: f64) {
        self.add_row(row, weight);
        self.add_target(row, target, weight);
    }

    /// Adds only the row of an equation, as [`LeastSquares::add`] does.
    pub(crate) fn add_row(&mut self, values: &Row, weight: f64) {
        for (row, value) in values[..self.count].iter().enumerate() {
            let start = row * (row + 1) / 2;
            for (sum, other) in self.normal[start..=start + row].iter_mut().zip(values) {
                *sum += weight * value * other;
            }
        }
    }

    /// Adds only the target of an equation, as [`LeastSquares::add`] does.
    pub(crate) fn add_target(&mut self, values: &Row, target: [f64; 3], weight: f64) {
        for (right, value) in self.right[..self.count].iter_mut().zip(values) {
            for (sum, target) in right.iter_mut().zip(target) {
                *sum += weight * value * target;
            }
        }
    }

    /// Unknowns for each of the three targets; `None` if the rows do not determine all of them, or
    /// if a number is not finite.
    pub fn solve(&self) -> Option<[[f32; 3]; UNKNOWNS_MAX]> {
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
        let solution = solution.map(|unknown| unknown.map(|sum| sum as f32));
        solution.iter().flatten().all(|number| number.is_finite()).then_some(solution)
    }

    /// Lower triangle L with L Lᵀ = N, by Cholesky. `None` unless N is positive definite beyond
    /// rounding.
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
fn subtract(rows: &mut [[f64; 3]; UNKNOWNS_MAX], row: usize, other: usize, factor: f64) {
    let taken = rows[other];
    rows[row].iter_mut().zip(taken).for_each(|(number, taken)| *number -= factor * taken);
}
