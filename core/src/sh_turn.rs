//! Rotation of the harmonics of a scene: each degree rotates within itself.
//!
//! For the same colour Σ c_k Y_k(d) towards R d, c′_j = Σ_k c_k ∫ Y_k(R⁻¹ d) Y_j(d) dω / ∫ Y_j² dω.
//! The integrands are polynomials of degree 6 at most, which Gauss quadrature along z with equal
//! steps around it integrates exactly, up to rounding.

use crate::{
    double::Double,
    math,
    sh::{MAX_COUNT, basis},
    vector::{Mat3, vec3},
};
use core::f64::consts::TAU;

/// Nodes and weights of four-point Gauss–Legendre quadrature, exact up to degree 7; the positive
/// half of them.
const NODES: [(f64, f64); 2] =
    [(0.339_981_043_584_856_26, 0.652_145_154_862_546_1), (0.861_136_311_594_052_6, 0.347_854_845_137_453_85)];
/// Steps around z, exact up to degree 7.
const AROUND: usize = 8;

/// Rotation of harmonics: row j has the weights of the old coefficients in the new coefficient j.
pub type ShTurn = [[f64; MAX_COUNT]; MAX_COUNT];

/// Rotation of harmonics for a rotation of directions and positions, given by its rows.
pub fn turn(rotation: [[f64; 3]; 3]) -> ShTurn {
    let matrix = Mat3 { rows: rotation.map(|[x, y, z]| vec3(Double(x), Double(y), Double(z))) };
    let mut sums = [[0.0; MAX_COUNT]; MAX_COUNT];
    let mut squares = [0.0; MAX_COUNT];
    for (direction, weight) in nodes() {
        let new = basis(direction, MAX_COUNT).map(|value| value.0);
        let old = basis(matrix.transform_transposed(direction), MAX_COUNT).map(|value| value.0);
        for j in 0..MAX_COUNT {
            squares[j] += weight * new[j] * new[j];
            (0..MAX_COUNT).for_each(|k| sums[j][k] += weight * new[j] * old[k]);
        }
    }
    core::array::from_fn(|j| {
        core::array::from_fn(|k| if k.isqrt() == j.isqrt() { sums[j][k] / squares[j] } else { 0.0 })
    })
}

/// Coefficients of a colour, red, green and blue of each harmonic, after a rotation.
pub fn turned(turn: &ShTurn, colors: &[[f32; 3]; MAX_COUNT]) -> [[f32; 3]; MAX_COUNT] {
    turn.map(|weights| {
        core::array::from_fn(|channel| {
            weights.iter().zip(colors).map(|(weight, color)| weight * f64::from(color[channel])).sum::<f64>() as f32
        })
    })
}

/// Directions all around, and the solid angle of each.
fn nodes() -> impl Iterator<Item = (crate::vector::Vec3<Double>, f64)> {
    let heights = NODES.into_iter().flat_map(|(z, weight)| [(z, weight), (-z, weight)]);
    heights.flat_map(|(z, weight)| {
        (0..AROUND).map(move |step| {
            let (turn, radius) = (TAU * step as f64 / AROUND as f64, math::sqrt64(1.0 - z * z));
            let (x, y) = (radius * math::cos64(turn), radius * math::sin64(turn));
            (vec3(Double(x), Double(y), Double(z)), weight * TAU / AROUND as f64)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::Vec3;

    /// Rounding of sums of sixteen products, and of the quadrature's sums.
    const ROUNDED: f64 = 1e-13;

    /// A rotation from a quat of any length (Rodrigues).
    fn rotation([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
        let s = 2.0 / (w * w + x * x + y * y + z * z);
        [
            [1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)],
        ]
    }

    fn value(coefficients: &[f64; MAX_COUNT], direction: Vec3<Double>) -> f64 {
        basis(direction, MAX_COUNT).iter().zip(coefficients).map(|(y, c)| y.0 * c).sum()
    }

    const TURNS: [[f64; 4]; 4] =
        [[1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [0.3, -0.5, 0.7, 0.2], [-0.1, 0.9, 0.4, -0.8]];

    #[test]
    fn rotated_harmonics_give_the_old_colours_in_rotated_directions() {
        let coefficients: [f64; MAX_COUNT] = core::array::from_fn(|k| math::sin64(1.0 + 2.3 * k as f64));
        for rotation in TURNS.map(rotation) {
            let turn = turn(rotation);
            let after = turn.map(|row| row.iter().zip(&coefficients).map(|(weight, c)| weight * c).sum());
            let matrix = Mat3 { rows: rotation.map(|[x, y, z]| vec3(Double(x), Double(y), Double(z))) };
            for [x, y, z] in TURNS.map(rotation_column) {
                let direction = vec3(Double(x), Double(y), Double(z));
                let [before, after] = [value(&coefficients, direction), value(&after, matrix.transform(direction))];
                assert!((before - after).abs() <= ROUNDED, "{before} became {after}");
            }
        }
    }

    /// Some unit direction.
    fn rotation_column(quat: [f64; 4]) -> [f64; 3] {
        rotation([quat[1] + 0.4, quat[2], quat[3], quat[0]]).map(|row| row[0])
    }

    #[test]
    fn rotations_compose_and_the_identity_changes_nothing() {
        let product =
            |a: &ShTurn, b: &ShTurn, j: usize, k: usize| (0..MAX_COUNT).map(|i| a[j][i] * b[i][k]).sum::<f64>();
        let [one, other] = [rotation(TURNS[2]), rotation(TURNS[3])];
        let both =
            core::array::from_fn(|i| core::array::from_fn(|j| (0..3).map(|k| other[i][k] * one[k][j]).sum::<f64>()));
        let (both, one, other, none) = (turn(both), turn(one), turn(other), turn(rotation(TURNS[0])));
        for (j, k) in (0..MAX_COUNT).flat_map(|j| (0..MAX_COUNT).map(move |k| (j, k))) {
            assert!((both[j][k] - product(&other, &one, j, k)).abs() <= ROUNDED);
            assert!((none[j][k] - f64::from(u8::from(j == k))).abs() <= ROUNDED);
        }
    }
}
