//! Plain Gaussian splatting in INRIA's conventions, in `f64`: an independent renderer that shares no formula with
//! core. Written from the published constants of the reference rasteriser (Kerbl et al. 2023): covariance by matrix
//! products, conic by the adjugate, no tiles; a splat reaches as far as its alpha is at least 1/255.
//!
//! One difference is meant: the reference leaves a splat out beyond three standard deviations, rounded up to whole
//! pixels and tiles; here, as in an exact picture, only its alpha decides.

use specula_core::scene::{Gaussians, LOG_SCALE, MEAN, OPACITY, QUAT};

/// Gaussians nearer than this are not drawn.
const NEAR: f64 = 0.2;
/// Added to both variances on the screen, in px².
const LOW_PASS: f64 = 0.3;
/// Beyond this share of the half field of view the Jacobian is taken at its limit.
const FRUSTUM_MARGIN: f64 = 1.3;
const ALPHA_MAX: f64 = 0.99;
const ALPHA_MIN: f64 = 1.0 / 255.0;
const TRANSMITTANCE_MIN: f64 = 1e-4;

/// A Gaussian after activation.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaussian {
    /// Centre, in world space.
    pub mean: [f64; 3],
    /// Standard deviations along its axes.
    pub scales: [f64; 3],
    /// Orientation (w, x, y, z), of any length but zero.
    pub quat: [f64; 4],
    /// Opacity, in (0, 1).
    pub opacity: f64,
    /// Its colour.
    pub color: Color,
}

/// Where a Gaussian's colour comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Color {
    /// Coefficients of 1, 4, 9 or 16 spherical harmonics, RGB each.
    Harmonics(Vec<[f64; 3]>),
    /// The same from everywhere.
    Constant([f64; 3]),
}

/// A pinhole camera that looks along +z, y down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Rows of the rotation from world to camera.
    pub rotation: [[f64; 3]; 3],
    /// The camera's centre, in world space.
    pub position: [f64; 3],
    /// Focal lengths, in pixels.
    pub focal: [f64; 2],
    /// Principal point, in pixels from the upper left corner.
    pub principal: [f64; 2],
}

/// A Gaussian on the screen.
struct Blot {
    depth: f64,
    center: [f64; 2],
    conic: [f64; 3],
    opacity: f64,
    color: [f64; 3],
    /// Half width and half height of its box, in pixels.
    extent: [f64; 2],
}

/// The picture, row by row.
pub fn render(
    gaussians: &[Gaussian],
    camera: &Camera,
    width: usize,
    height: usize,
    background: [f64; 3],
) -> Vec<[f64; 3]> {
    let mut blots: Vec<Blot> = gaussians.iter().filter_map(|g| blot(g, camera, width, height)).collect();
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

fn blot(gaussian: &Gaussian, camera: &Camera, width: usize, height: usize) -> Option<Blot> {
    let from_eye = sub(gaussian.mean, camera.position);
    let [x, y, z] = multiply_vector(&camera.rotation, from_eye);
    if z <= NEAR || gaussian.opacity < ALPHA_MIN {
        return None;
    }
    let [fx, fy] = camera.focal;
    let limit = |axis: usize, size: usize| {
        let half = camera.principal[axis].max(size as f64 - camera.principal[axis]);
        FRUSTUM_MARGIN * half / camera.focal[axis]
    };
    let (limit_x, limit_y) = (limit(0, width), limit(1, height));
    let (tx, ty) = ((x / z).clamp(-limit_x, limit_x) * z, (y / z).clamp(-limit_y, limit_y) * z);
    let jacobian = [[fx / z, 0.0, -fx * tx / (z * z)], [0.0, fy / z, -fy * ty / (z * z)], [0.0; 3]];

    let to_screen = multiply(&jacobian, &camera.rotation);
    let covariance = multiply(&multiply(&to_screen, &covariance(gaussian)), &transpose(&to_screen));
    let (a, b, c) = (covariance[0][0] + LOW_PASS, covariance[0][1], covariance[1][1] + LOW_PASS);
    let determinant = a * c - b * b;
    if determinant.is_nan() || determinant <= 0.0 {
        return None;
    }
    let reach = (2.0 * (gaussian.opacity / ALPHA_MIN).ln()).sqrt();
    Some(Blot {
        depth: z,
        center: [fx * x / z + camera.principal[0], fy * y / z + camera.principal[1]],
        conic: [c / determinant, -b / determinant, a / determinant],
        opacity: gaussian.opacity,
        color: color(&gaussian.color, from_eye),
        extent: [reach * a.sqrt(), reach * c.sqrt()],
    })
}

/// R diag(s²) Rᵀ.
fn covariance(gaussian: &Gaussian) -> [[f64; 3]; 3] {
    let length = gaussian.quat.iter().map(|c| c * c).sum::<f64>().sqrt();
    let [w, x, y, z] = gaussian.quat.map(|c| c / length);
    let rotation = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let scaled = rotation.map(|row| core::array::from_fn(|k| row[k] * gaussian.scales[k].powi(2)));
    multiply(&scaled, &transpose(&rotation))
}

/// Colour along a ray from the eye: the harmonics' sum plus one half, at least zero.
fn color(color: &Color, ray: [f64; 3]) -> [f64; 3] {
    let coefficients = match color {
        Color::Constant(color) => return *color,
        Color::Harmonics(coefficients) => coefficients,
    };
    let length = ray.iter().map(|c| c * c).sum::<f64>().sqrt();
    let [x, y, z] = ray.map(|c| c / length);
    let basis = [
        0.28209479177387814,
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (2.0 * z * z - x * x - y * y),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (x * x - y * y),
        -0.5900435899266435 * y * (3.0 * x * x - y * y),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4.0 * z * z - x * x - y * y),
        0.3731763325901154 * z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y),
        -0.4570457994644658 * x * (4.0 * z * z - x * x - y * y),
        1.445305721320277 * z * (x * x - y * y),
        -0.5900435899266435 * x * (x * x - 3.0 * y * y),
    ];
    let sum = |c: usize| coefficients.iter().zip(basis).map(|(rgb, value)| rgb[c] * value).sum::<f64>();
    [0, 1, 2].map(|c| (sum(c) + 0.5).max(0.0))
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn multiply(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    core::array::from_fn(|i| core::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

fn multiply_vector(a: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|i| (0..3).map(|k| a[i][k] * v[k]).sum())
}

fn transpose(a: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    core::array::from_fn(|i| core::array::from_fn(|j| a[j][i]))
}

/// The renderer's Gaussians of a plain cloud.
pub fn gaussians(gaussians: &Gaussians<Vec<f32>>) -> Vec<Gaussian> {
    let of = |index: usize| {
        let wide = |numbers: [f32; 3]| numbers.map(f64::from);
        let harmonics = (0..gaussians.layout.sh_count())
            .map(|k| wide(gaussians.get::<3>(index, gaussians.layout.sh_start() + 3 * k)))
            .collect();
        Gaussian {
            mean: wide(gaussians.get(index, MEAN)),
            scales: wide(gaussians.get(index, LOG_SCALE)).map(f64::exp),
            quat: gaussians.get::<4>(index, QUAT).map(f64::from),
            opacity: gaussians.get::<1>(index, OPACITY).map(|x| 1.0 / (1.0 + (-f64::from(x)).exp()))[0],
            color: Color::Harmonics(harmonics),
        }
    };
    (0..gaussians.count).map(of).collect()
}

/// The renderer's camera of one of core's.
pub fn camera(camera: &specula_core::camera::Camera) -> Camera {
    Camera {
        rotation: [0, 1, 2].map(|row| camera.camera_from_world.row(row).to_array().map(f64::from)),
        position: camera.position.to_array().map(f64::from),
        focal: camera.focal_px.map(f64::from),
        principal: camera.principal_px.map(f64::from),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::assert_close;

    const CAMERA: Camera = Camera {
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        position: [0.0; 3],
        focal: [100.0, 100.0],
        principal: [10.5, 10.5],
    };

    fn ball(depth: f64, opacity: f64, color: [f64; 3]) -> Gaussian {
        Gaussian {
            mean: [0.0, 0.0, depth],
            scales: [0.05; 3],
            quat: [2.0, 0.0, 0.0, 0.0],
            opacity,
            color: Color::Constant(color),
        }
    }

    #[test]
    fn the_middle_of_a_splat_shows_its_colour_over_the_background() {
        let picture = render(&[ball(2.0, 0.6, [1.0, 0.5, 0.0])], &CAMERA, 21, 21, [0.0, 0.0, 1.0]);
        for (actual, expected) in picture[10 * 21 + 10].into_iter().zip([0.6, 0.3, 0.4]) {
            assert_close(actual, expected, 1e-12);
        }
    }

    #[test]
    fn a_nearer_splat_hides_a_farther_one_in_either_order() {
        let (near, far) = (ball(2.0, 0.9, [1.0, 0.0, 0.0]), ball(3.0, 0.9, [0.0, 1.0, 0.0]));
        let one = render(&[near.clone(), far.clone()], &CAMERA, 21, 21, [0.0; 3]);
        let other = render(&[far, near], &CAMERA, 21, 21, [0.0; 3]);
        assert_eq!(one, other, "depth decides, not the order of the list");
        assert_close(one[10 * 21 + 10][0], 0.9, 1e-12);
        assert_close(one[10 * 21 + 10][1], 0.09, 1e-12);
    }

    #[test]
    fn a_round_splat_falls_off_with_its_blurred_variance() {
        let picture = render(&[ball(2.0, 0.5, [1.0; 3])], &CAMERA, 21, 21, [0.0; 3]);
        let variance = (100.0_f64 * 0.05 / 2.0).powi(2) + LOW_PASS;
        assert_close(picture[10 * 21 + 13][0], 0.5 * (-0.5 * 9.0 / variance).exp(), 1e-12);
        assert_close(picture[0][0], 0.0, 0.0);
    }

    #[test]
    fn what_lies_behind_or_too_near_is_not_drawn() {
        let hidden = [ball(-2.0, 0.9, [1.0; 3]), ball(0.1, 0.9, [1.0; 3])];
        let picture = render(&hidden, &CAMERA, 21, 21, [0.25; 3]);
        assert!(picture.iter().all(|pixel| *pixel == [0.25; 3]), "only the background shows");
    }
}
