//! Viewing distance of Gaussians.

use glam::Vec3;
use specula_core::scene::{Gaussians, MEAN};

/// Horizontal field of view of cameras in an orbit, in radians: that of NeRF Synthetic.
pub(crate) const FIELD_OF_VIEW_RAD: f32 = 0.691_111_2;

/// Centre of Gaussians, and the distance from which a camera sees all of them, but not a few that
/// are far away.
pub(crate) fn framing(gaussians: &Gaussians<Vec<f32>>) -> (Vec3, f32) {
    /// Share of the means that are seen, as far as [`FARTHEST`] radii.
    const SHARE: f32 = 0.998;
    const FARTHEST: f32 = 1.6;
    let (centre, radius) = extent(gaussians);
    let seen = quantile(distances(gaussians, centre), SHARE).clamp(1.2 * radius, FARTHEST * radius);
    (centre, seen / (0.5 * FIELD_OF_VIEW_RAD).sin())
}

/// Centre of the box of the means, and the 0.95 quantile of their distances from it; 1 if that is
/// 0. The box leaves out a twentieth of the means on each side.
pub(crate) fn extent(gaussians: &Gaussians<Vec<f32>>) -> (Vec3, f32) {
    const SHARE: f32 = 0.95;
    let middle = |plane: usize| {
        let [low, high] = [1.0 - SHARE, SHARE].map(|share| quantile(gaussians.plane(plane).collect(), share));
        low.midpoint(high)
    };
    let centre = Vec3::new(middle(MEAN), middle(MEAN + 1), middle(MEAN + 2));
    let radius = quantile(distances(gaussians, centre), SHARE);
    (centre, if radius > 0.0 { radius } else { 1.0 })
}

/// Distances of the means from a point.
fn distances(gaussians: &Gaussians<Vec<f32>>, from: Vec3) -> Vec<f32> {
    (0..gaussians.count).map(|index| Vec3::from(gaussians.get::<3>(index, MEAN)).distance(from)).collect()
}

fn quantile(mut numbers: Vec<f32>, share: f32) -> f32 {
    let Some(last) = numbers.len().checked_sub(1) else { return 0.0 };
    let index = (share * last as f32) as usize;
    *numbers.select_nth_unstable_by(index, f32::total_cmp).1
}
