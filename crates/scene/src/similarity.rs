//! Similarity transforms of Gaussians.

use core::ops::Range;
use glam::{DMat3, DQuat, DVec3};
use specula_core::{
    scene::{Gaussians, LOG_SCALE, MEAN, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, QUAT},
    sh::MAX_COUNT,
    sh_turn,
};

/// Rotation R, uniform scale s > 0 and translation t: a point p becomes s R p + t.
#[derive(Clone, Copy, Debug)]
pub struct Similarity {
    pub(crate) rotation: DMat3,
    pub(crate) scale: f64,
    /// Point c that is subtracted first; the origin unless the scene is placed upright.
    pub(crate) centre: DVec3,
    pub(crate) translation: DVec3,
}

impl Similarity {
    /// Transform p ↦ s R p + t with a rotation of unit length.
    pub fn new(rotation: DQuat, scale: f64, translation: DVec3) -> Self {
        Self { rotation: DMat3::from_quat(rotation), scale, centre: DVec3::ZERO, translation }
    }

    /// Point, transformed.
    pub fn point(&self, point: [f32; 3]) -> [f32; 3] {
        let moved = self.scale * (self.rotation * (DVec3::from(point.map(f64::from)) - self.centre));
        (moved + self.translation).as_vec3().to_array()
    }

    /// Direction, rotated, of the same length.
    pub fn direction(&self, direction: [f32; 3]) -> [f32; 3] {
        (self.rotation * DVec3::from(direction.map(f64::from))).as_vec3().to_array()
    }

    /// Transforms some of the Gaussians: means, quats, scales, normal residuals, harmonics and
    /// filters in space. The light of their scene stays where it is, so mirrors reflect another
    /// part of it; ambient transfer, the light that reaches a physical material, is not computed
    /// again.
    pub fn transform(&self, gaussians: &mut Gaussians<Vec<f32>>, range: Range<usize>) {
        let layout = gaussians.layout;
        let (turn, quat) = (sh_turn::turn(self.rows()), DQuat::from_mat3(&self.rotation));
        let (start, count) = (layout.sh_start(), layout.sh_count());
        for gaussian in range {
            gaussians.set(gaussian, MEAN, self.point(gaussians.get(gaussian, MEAN)));
            let [w, x, y, z] = gaussians.get::<4>(gaussian, QUAT).map(f64::from);
            let turned = (quat * DQuat::from_xyzw(x, y, z, w)).as_quat();
            gaussians.set(gaussian, QUAT, [turned.w, turned.x, turned.y, turned.z]);
            let log_scales = gaussians.get::<3>(gaussian, LOG_SCALE);
            gaussians.set(gaussian, LOG_SCALE, log_scales.map(|log_scale| log_scale + self.scale.ln() as f32));
            if layout.is_shaded() {
                for plane in [NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2] {
                    gaussians.set(gaussian, plane, self.direction(gaussians.get(gaussian, plane)));
                }
            }
            if let Some(plane) = layout.filter_plane() {
                let [deviation] = gaussians.get(gaussian, plane);
                gaussians.set(gaussian, plane, [deviation * self.scale as f32]);
            }
            let mut harmonics = [[0.0; 3]; MAX_COUNT];
            (0..count).for_each(|k| harmonics[k] = gaussians.get(gaussian, start + 3 * k));
            let harmonics = sh_turn::turned(&turn, &harmonics);
            (0..count).for_each(|k| gaussians.set(gaussian, start + 3 * k, harmonics[k]));
        }
    }

    fn rows(&self) -> [[f64; 3]; 3] {
        self.rotation.transpose().to_cols_array_2d()
    }
}
