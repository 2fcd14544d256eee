//! Eigenvalues and eigenvectors of symmetric matrices of three rows, in `f64`.

use crate::math;

/// Rotations that make every matrix diagonal up to rounding: each sweep of three squares the
/// remainder beside the diagonal.
const SWEEPS: usize = 12;

/// The eigenvalues of a symmetric matrix, smallest first, each with its eigenvector of unit length;
/// the vectors are at right angles. By Jacobi rotations (Golub and Van Loan 2013, section 8.5),
/// which are exact to rounding even for equal eigenvalues. Only the upper triangle is read.
pub fn symmetric(matrix: [[f64; 3]; 3]) -> [(f64, [f64; 3]); 3] {
    let mut matrix = matrix;
    let mut vectors = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for (p, q) in (0..SWEEPS).flat_map(|_| [(0, 1), (0, 2), (1, 2)]) {
        turn(&mut matrix, &mut vectors, p, q);
    }
    let mut pairs = [0, 1, 2].map(|k| (matrix[k][k], vectors[k]));
    pairs.sort_unstable_by(|(one, _), (other, _)| one.total_cmp(other));
    pairs
}

/// Turns the axes p < q so that the number beside the diagonal between them becomes zero.
fn turn(matrix: &mut [[f64; 3]; 3], vectors: &mut [[f64; 3]; 3], p: usize, q: usize) {
    let beside = matrix[p][q];
    if beside == 0.0 {
        return;
    }
    let slope = (matrix[q][q] - matrix[p][p]) / (2.0 * beside);
    let tan = slope.signum() / (slope.abs() + math::sqrt64(slope * slope + 1.0));
    let cos = 1.0 / math::sqrt64(tan * tan + 1.0);
    let sin = tan * cos;
    matrix[p][p] -= tan * beside;
    matrix[q][q] += tan * beside;
    matrix[p][q] = 0.0;
    let r = 3 - p - q;
    let [(i, j), (k, l)] = [(p.min(r), p.max(r)), (q.min(r), q.max(r))];
    (matrix[i][j], matrix[k][l]) = (cos * matrix[i][j] - sin * matrix[k][l], sin * matrix[i][j] + cos * matrix[k][l]);
    for axis in 0..3 {
        let [one, other] = [vectors[p][axis], vectors[q][axis]];
        (vectors[p][axis], vectors[q][axis]) = (cos * one - sin * other, sin * one + cos * other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of a few dozen operations on numbers of about one.
    const ROUNDED: f64 = 1e-14;

    fn times(matrix: [[f64; 3]; 3], vector: [f64; 3]) -> [f64; 3] {
        matrix.map(|row| (0..3).map(|k| row[k] * vector[k]).sum())
    }

    fn assert_are_eigenvectors(matrix: [[f64; 3]; 3]) {
        let pairs = symmetric(matrix);
        for (value, vector) in pairs {
            let turned = times(matrix, vector);
            (0..3).for_each(|k| assert!((turned[k] - value * vector[k]).abs() <= ROUNDED, "{matrix:?}: {pairs:?}"));
        }
        for (i, j) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)] {
            let dot: f64 = (0..3).map(|k| pairs[i].1[k] * pairs[j].1[k]).sum();
            assert!((dot - f64::from(u8::from(i == j))).abs() <= ROUNDED, "{pairs:?}");
        }
        assert!(pairs[0].0 <= pairs[1].0 && pairs[1].0 <= pairs[2].0);
    }

    #[test]
    fn a_matrix_multiplies_its_eigenvectors_by_their_eigenvalues() {
        assert_are_eigenvectors([[2.0, -1.0, 0.5], [-1.0, 0.3, 0.7], [0.5, 0.7, -1.0]]);
        assert_are_eigenvectors([[1.0, 1e-9, 0.0], [1e-9, 1.0, 1e-9], [0.0, 1e-9, 1.0]]);
        assert_are_eigenvectors([[0.0; 3]; 3]);
        // a aᵀ + b bᵀ has an eigenvalue of zero, at right angles to both.
        let ([a, b], zip) = ([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]], |i: usize, j: usize, v: [f64; 3]| v[i] * v[j]);
        let plane = core::array::from_fn(|i| core::array::from_fn(|j| zip(i, j, a) + zip(i, j, b)));
        assert_are_eigenvectors(plane);
        let (value, [x, y, z]) = symmetric(plane)[0];
        assert!(value.abs() <= ROUNDED && y.abs() <= ROUNDED && ((0.8 * x - 0.6 * z).abs() - 1.0).abs() <= ROUNDED);
    }
}
