//! Plain Gaussian splatting in INRIA's conventions, in `f64`: a renderer that shares no formula
//! with core. Written from the published constants of the reference rasteriser (Kerbl et al. 2023):
//! affine projection, depths of means, covariance by matrix products, conic by the adjugate, no
//! tiles; a splat reaches as far as its alpha is at least 1/255. What Gaussians are, and their
//! colours, it has from [`specula_oracle::independent`], which is exact along rays.
//!
//! One difference is meant: the reference leaves a splat out beyond three standard deviations,
//! rounded up to whole pixels and tiles; here, as in an exact picture, only its alpha decides.

use glam::{DMat3, DVec3};
use specula_oracle::independent::{
    rays::{Gaussian, RayView},
    surface::Look,
};

/// Gaussians nearer than this are not drawn.
const NEAR: f64 = 0.2;
/// Beyond this share of the half field of view the Jacobian is taken at its limit.
const FRUSTUM_MARGIN: f64 = 1.3;
const ALPHA_MAX: f64 = 0.99;
const ALPHA_MIN: f64 = 1.0 / 255.0;
const TRANSMITTANCE_MIN: f64 = 1e-4;

/// A Gaussian on the screen.
struct Blot {
    depth: f64,
    center: [f64; 2],
    conic: [f64; 3],
    opacity: f64,
    color: DVec3,
    /// Half width and half height of its box, in pixels.
    extent: [f64; 2],
}

/// The picture, row by row, of plain Gaussians.
pub fn render(scene: &[(Gaussian, Look)], view: &RayView, background: [f64; 3]) -> Vec<[f64; 3]> {
    let [width, height] = view.size;
    let mut blots: Vec<Blot> = scene.iter().filter_map(|(gaussian, look)| blot(gaussian, look, view)).collect();
    blots.sort_by(|a, b| a.depth.total_cmp(&b.depth));

    let mut picture = vec![([0.0; 3], 1.0_f64, false); width * height];
    for blot in &blots {
        for row in pixels(blot.center[1], blot.extent[1], height) {
            for column in pixels(blot.center[0], blot.extent[0], width) {
                let (color, transmittance, has_ended) = &mut picture[row * width + column];
                let alpha = blot.alpha(column as f64 + 0.5, row as f64 + 0.5);
                if *has_ended || alpha < ALPHA_MIN {
                    continue;
                }
                let behind = *transmittance * (1.0 - alpha);
                if behind < TRANSMITTANCE_MIN {
                    *has_ended = true;
                    continue;
                }
                (0..3).for_each(|c| color[c] += blot.color[c] * alpha * *transmittance);
                *transmittance = behind;
            }
        }
    }
    let over =
        |(color, transmittance, _): ([f64; 3], f64, bool)| [0, 1, 2].map(|c| color[c] + transmittance * background[c]);
    picture.into_iter().map(over).collect()
}

/// Pixels whose centres lie within an interval.
fn pixels(center: f64, extent: f64, count: usize) -> core::ops::Range<usize> {
    let clamp = |x: f64| x.clamp(0.0, count as f64) as usize;
    clamp((center - extent - 0.5).ceil())..clamp((center + extent + 0.5).floor())
}

impl Blot {
    fn alpha(&self, x: f64, y: f64) -> f64 {
        let (dx, dy) = (self.center[0] - x, self.center[1] - y);
        let [a, b, c] = self.conic;
        let power = -0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy;
        if power > 0.0 { 0.0 } else { (self.opacity * power.exp()).min(ALPHA_MAX) }
    }
}

fn blot(gaussian: &Gaussian, look: &Look, view: &RayView) -> Option<Blot> {
    let from_eye = gaussian.mean - view.position;
    let DVec3 { x, y, z } = view.camera_from_world * from_eye;
    if z <= NEAR {
        return None;
    }
    let [fx, fy] = view.focal_px;
    let limit = |axis: usize| {
        let half = view.principal_px[axis].max(view.size[axis] as f64 - view.principal_px[axis]);
        FRUSTUM_MARGIN * half / view.focal_px[axis]
    };
    let (tx, ty) = ((x / z).clamp(-limit(0), limit(0)) * z, (y / z).clamp(-limit(1), limit(1)) * z);
    let depth_column = DVec3::new(-fx * tx / (z * z), -fy * ty / (z * z), 0.0);
    let jacobian = DMat3::from_cols(DVec3::X * (fx / z), DVec3::Y * (fy / z), depth_column);

    let half = jacobian * view.camera_from_world * gaussian.axes;
    let covariance = half * half.transpose();
    let low_pass = gaussian.low_pass.variance;
    let (a, b, c) = (covariance.x_axis.x + low_pass, covariance.x_axis.y, covariance.y_axis.y + low_pass);
    let determinant = a * c - b * b;
    let own = covariance.x_axis.x * covariance.y_axis.y - b * b;
    let kept = if gaussian.low_pass.is_compensated { (own / determinant).max(0.0).sqrt() } else { 1.0 };
    let opacity = gaussian.opacity * kept;
    if determinant.is_nan() || determinant <= 0.0 || opacity < ALPHA_MIN {
        return None;
    }
    let reach = (2.0 * (opacity / ALPHA_MIN).ln()).sqrt();
    Some(Blot {
        depth: z,
        center: [fx * x / z + view.principal_px[0], fy * y / z + view.principal_px[1]],
        conic: [c / determinant, -b / determinant, a / determinant],
        opacity,
        color: look.color(-from_eye.normalize(), &|_, _| DVec3::ZERO),
        extent: [reach * a.sqrt(), reach * c.sqrt()],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::assert_close;
    use specula_oracle::independent::rays::LowPass;

    const VIEW: RayView = RayView {
        camera_from_world: DMat3::IDENTITY,
        position: DVec3::ZERO,
        focal_px: [100.0, 100.0],
        principal_px: [10.5, 10.5],
        near: NEAR,
        size: [21, 21],
    };
    /// The harmonic of degree zero.
    const Y0: f64 = 0.28209479177387814;

    fn ball(depth: f64, opacity: f64, color: [f64; 3]) -> (Gaussian, Look) {
        let axes = DMat3::from_diagonal(DVec3::splat(0.05));
        let harmonic = (DVec3::from_array(color) - 0.5) / Y0;
        (Gaussian { mean: DVec3::Z * depth, axes, opacity, low_pass: LowPass::INRIA }, Look::Radiance(vec![harmonic]))
    }

    #[test]
    fn the_middle_of_a_splat_shows_its_colour_over_the_background() {
        let picture = render(&[ball(2.0, 0.6, [1.0, 0.5, 0.0])], &VIEW, [0.0, 0.0, 1.0]);
        for (actual, expected) in picture[10 * 21 + 10].into_iter().zip([0.6, 0.3, 0.4]) {
            assert_close(actual, expected, 1e-12);
        }
    }

    #[test]
    fn a_nearer_splat_hides_a_farther_one_in_either_order() {
        let (near, far) = (ball(2.0, 0.9, [1.0, 0.0, 0.0]), ball(3.0, 0.9, [0.0, 1.0, 0.0]));
        let one = render(&[near.clone(), far.clone()], &VIEW, [0.0; 3]);
        let other = render(&[far, near], &VIEW, [0.0; 3]);
        assert_eq!(one, other, "depth decides, not the order of the list");
        assert_close(one[10 * 21 + 10][0], 0.9, 1e-12);
        assert_close(one[10 * 21 + 10][1], 0.09, 1e-12);
    }

    #[test]
    fn a_round_splat_falls_off_with_its_blurred_variance() {
        let picture = render(&[ball(2.0, 0.5, [1.0; 3])], &VIEW, [0.0; 3]);
        let variance = (100.0_f64 * 0.05 / 2.0).powi(2) + LowPass::INRIA.variance;
        assert_close(picture[10 * 21 + 13][0], 0.5 * (-0.5 * 9.0 / variance).exp(), 1e-12);
        assert_close(picture[0][0], 0.0, 0.0);
    }

    #[test]
    fn splats_behind_the_eye_or_too_near_are_not_drawn() {
        let hidden = [ball(-2.0, 0.9, [1.0; 3]), ball(0.1, 0.9, [1.0; 3])];
        let picture = render(&hidden, &VIEW, [0.25; 3]);
        assert!(picture.iter().all(|pixel| *pixel == [0.25; 3]), "only the background shows");
    }
}
