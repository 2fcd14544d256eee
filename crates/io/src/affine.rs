//! Gaussians under an affine map: x ↦ A x + b takes a mean μ to A μ + b and a covariance Σ to A Σ
//! Aᵀ. Harmonics are rotated or mirrored by the orthogonal part of A, without loss if A is a
//! product of a rotation, a reflection and a uniform scale.

use crate::splat::unit;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use specula_core::{
    eigen,
    scene::{Gaussians, LOG_SCALE, MEAN, QUAT},
    sh::MAX_COUNT,
    sh_turn,
};

/// Smallest scale whose logarithm is taken, in world units.
pub(crate) const SCALE_MIN: f64 = 1e-12;

/// Relative difference from a uniformly scaled orthogonal matrix up to which a map counts as one.
pub(crate) const UNIFORM: f64 = 1e-3;

/// Maps plain Gaussians in place. Returns true if harmonics are mapped without loss.
pub(crate) fn map(gaussians: &mut Gaussians<Vec<f32>>, map: DAffine3) -> bool {
    let orthogonal = orthogonal_part(map.matrix3);
    let turn = sh_turn::turn(orthogonal.transpose().to_cols_array_2d());
    let (start, count) = (gaussians.layout.sh_start(), gaussians.layout.sh_count());
    for index in 0..gaussians.count {
        let mean = DVec3::from(gaussians.get::<3>(index, MEAN).map(f64::from));
        gaussians.set(index, MEAN, map.transform_point3(mean).as_vec3().to_array());
        let (quat, log_scales) =
            shape(map.matrix3, gaussians.get(index, QUAT), gaussians.get::<3>(index, LOG_SCALE).map(f64::from));
        gaussians.set(index, QUAT, quat);
        gaussians.set(index, LOG_SCALE, log_scales);
        let mut harmonics = [[0.0; 3]; MAX_COUNT];
        (0..count).for_each(|k| harmonics[k] = gaussians.get(index, start + 3 * k));
        let harmonics = sh_turn::turned(&turn, &harmonics);
        (0..count).for_each(|k| gaussians.set(index, start + 3 * k, harmonics[k]));
    }
    let scale = map.matrix3.determinant().abs().cbrt();
    map.matrix3.abs_diff_eq(orthogonal * scale, UNIFORM * scale)
}

/// Orthogonal matrix Q of the polar decomposition A = Q (Aᵀ A)^½.
fn orthogonal_part(matrix: DMat3) -> DMat3 {
    let inverse_root = eigen::symmetric((matrix.transpose() * matrix).to_cols_array_2d()).map(|(square, axis)| {
        let axis = DVec3::from(axis);
        DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z) * square.sqrt().recip()
    });
    matrix * inverse_root.into_iter().sum::<DMat3>()
}

/// Quat (w, x, y, z) and log scales of the Gaussian with the covariance A Σ Aᵀ.
fn shape(matrix: DMat3, quat: [f32; 4], log_scales: [f64; 3]) -> ([f32; 4], [f32; 3]) {
    let [w, x, y, z] = unit(quat).map(f64::from);
    let axes = matrix * DMat3::from_quat(DQuat::from_xyzw(x, y, z, w));
    let axes = axes * DMat3::from_diagonal(DVec3::from(log_scales.map(f64::exp)));
    let [a, b, c] = eigen::symmetric((axes * axes.transpose()).to_cols_array_2d());
    let turned = DMat3::from_cols(a.1.into(), b.1.into(), DVec3::from(a.1).cross(b.1.into()));
    let quat = DQuat::from_mat3(&turned).as_quat();
    ([quat.w, quat.x, quat.y, quat.z], [a, b, c].map(|(square, _)| square.sqrt().max(SCALE_MIN).ln() as f32))
}
