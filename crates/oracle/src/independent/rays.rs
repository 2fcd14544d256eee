//! Gaussians along rays, sorted for each pixel.
//!
//! A Gaussian's density along the ray x(t) = t d from the eye is exp(−½ |L⁻¹ (t d − μ)|²) with Σ =
//! L Lᵀ in camera space. With m = L⁻¹ μ and w = L⁻¹ d it is largest at t = m·w / |w|², where q = |m
//! − t w|² is its squared distance from the mean in standard deviations. As d is (x, y, 1), t is a
//! depth.
//!
//! Σ includes the low-pass: a variance of 0.3 px² across and down, or another, in the plane of the
//! screen at the mean's depth. If it is compensated, the opacity is multiplied by the root of the
//! ratio of determinants on the screen, without and with it. L comes from rows of length five, the
//! three axes and two of the low-pass, orthogonalised one after the other (Gram–Schmidt), so discs
//! and needles keep the digits that a covariance would lose.

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use specula_core::{camera::Camera, scene::Image};

/// Largest alpha, rounded to the model's 32 bits.
const ALPHA_MAX: f64 = 0.99_f32 as f64;
/// Smaller alphas are skipped before sorting: the sum of a million of them is a millionth.
const ALPHA_MIN: f64 = 1e-12;

/// Smallest compensation of a low-pass, squared, rounded to the model's 32 bits.
const COMPENSATION_MIN: f64 = 1e-6_f32 as f64;

/// Low-pass on the screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LowPass {
    /// Variance, in px².
    pub variance: f64,
    /// True if opacity compensates for the larger area.
    pub is_compensated: bool,
}

impl LowPass {
    /// INRIA's low-pass, rounded to the model's 32 bits.
    pub const INRIA: Self = Self { variance: 0.3_f32 as f64, is_compensated: false };
}

/// Gaussian with activated numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian {
    /// Centre, in world space.
    pub mean: DVec3,
    /// Its axes as columns, in world space, each as long as its standard deviation.
    pub axes: DMat3,
    /// Opacity, in (0, 1).
    pub opacity: f64,
    /// Low-pass on the screen.
    pub low_pass: LowPass,
}

/// A pinhole camera that looks along +z, y down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayView {
    /// Rotation from world to camera axes.
    pub camera_from_world: DMat3,
    /// The camera's centre, in world space.
    pub position: DVec3,
    /// Focal lengths, in pixels.
    pub focal_px: [f64; 2],
    /// Principal point, in pixels from the upper left corner.
    pub principal_px: [f64; 2],
    /// Near plane, at least zero: only deeper Gaussians are drawn.
    pub near: f64,
    /// Pixels in a row, and rows.
    pub size: [usize; 2],
}

impl RayView {
    /// One of core's cameras.
    pub fn of(camera: &Camera) -> Self {
        Self {
            camera_from_world: camera.camera_from_world.as_dmat3(),
            position: camera.position.as_dvec3(),
            focal_px: camera.focal_px.map(f64::from),
            principal_px: camera.principal_px.map(f64::from),
            near: camera.near.into(),
            size: [camera.width as usize, camera.height as usize],
        }
    }

    /// From the eye through the centre of a pixel, in camera space, with z = 1.
    pub fn ray(&self, pixel: usize) -> DVec3 {
        let position = [pixel % self.size[0], pixel / self.size[0]];
        let slope = |axis: usize| (position[axis] as f64 + 0.5 - self.principal_px[axis]) / self.focal_px[axis];
        DVec3::new(slope(0), slope(1), 1.0)
    }

    /// Number of pixels.
    pub fn pixel_count(&self) -> usize {
        self.size[0] * self.size[1]
    }
}

/// Order of Gaussians along a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Depth of the mean, the same in all pixels, as in common pipelines. A Gaussian is drawn if
    /// its mean is deeper than the near plane; along rays with the maximum behind the eye it has
    /// its strength at the eye.
    Mean,
    /// Distance of the mean from the eye, the same in all pixels and for any rotation of the
    /// camera; otherwise as above.
    Distance,
    /// Depth of the largest response along the ray of each pixel. A Gaussian is skipped in pixels
    /// where that is behind the eye, or not deeper than the near plane.
    Response,
}

/// Channels of Gaussians as a picture: premultiplied planes, then the transmittance behind them.
/// Nothing is tiled, culled or ended early: every Gaussian is evaluated in every pixel. `channels`
/// has a list of one length for each Gaussian; those that are equally deep keep the order in which
/// they come.
pub fn blend(gaussians: &[Gaussian], channels: &[Vec<f64>], view: &RayView, order: Order) -> Image<Vec<f64>> {
    let count = channels.first().map_or(0, Vec::len);
    let in_camera: Vec<GaussianInCamera> =
        gaussians.iter().enumerate().filter_map(|(k, gaussian)| GaussianInCamera::new(k, gaussian, view)).collect();
    let pixel = |pixel: usize| composite(&hits(&in_camera, view.ray(pixel), view.near, order), channels, count);
    let pixels: Vec<Vec<f64>> = (0..view.pixel_count()).into_par_iter().map(pixel).collect();
    let values = (0..=count).flat_map(|plane| pixels.iter().map(move |numbers| numbers[plane])).collect();
    Image { width: view.size[0], height: view.size[1], channels: count + 1, values }
}

/// Gaussian in camera space.
struct GaussianInCamera {
    /// Index of the Gaussian.
    index: usize,
    root: Root,
    /// L⁻¹ μ.
    mean: DVec3,
    depth: f64,
    distance: f64,
    opacity: f64,
    /// Squared distance beyond which alphas are negligible.
    farthest: f64,
}

/// L, lower triangular.
struct Root {
    /// One over its diagonal.
    inverse: DVec3,
    /// Entries below the diagonal: second row, then third.
    below: [f64; 3],
}

/// Gaussian that a ray hits.
struct Hit {
    index: usize,
    /// Nearest first.
    nearness: f64,
    alpha: f64,
}

impl GaussianInCamera {
    /// None for numbers that are not finite.
    fn new(index: usize, gaussian: &Gaussian, view: &RayView) -> Option<Self> {
        let mean = view.camera_from_world * (gaussian.mean - view.position);
        let axes = view.camera_from_world * gaussian.axes;
        let LowPass { variance, is_compensated } = gaussian.low_pass;
        let root = root_of_covariance(axes, mean.z, view.focal_px, variance);
        let compensation = if is_compensated { compensation(axes, mean, view.focal_px, variance) } else { 1.0 };
        let opacity = gaussian.opacity * compensation;
        let in_camera = Self {
            index,
            mean: root.solved(mean),
            root,
            depth: mean.z,
            distance: mean.length(),
            opacity,
            farthest: 2.0 * (opacity / ALPHA_MIN).ln(),
        };
        (in_camera.mean.is_finite() && in_camera.opacity.is_finite()).then_some(in_camera)
    }

    fn hit(&self, ray: DVec3, near: f64, order: Order) -> Option<Hit> {
        let ray = self.root.solved(ray);
        let largest_at = self.mean.dot(ray) / ray.length_squared();
        let (deciding, along, nearness) = match order {
            Order::Mean => (self.depth, largest_at.max(0.0), self.depth),
            Order::Distance => (self.depth, largest_at.max(0.0), self.distance),
            Order::Response => (largest_at, largest_at, largest_at),
        };
        let squared = (self.mean - along * ray).length_squared();
        let is_drawn = deciding > near && squared <= self.farthest;
        let alpha = || (self.opacity * (-0.5 * squared).exp()).min(ALPHA_MAX);
        is_drawn.then(|| Hit { index: self.index, nearness, alpha: alpha() })
    }
}

/// √(det Σ₂ / det(Σ₂ + b I)) of the screen's Σ₂ = Σ u uᵀ over the images u of the axes: without the
/// low-pass its determinant is the sum of the squared areas of their pairs.
fn compensation(axes: DMat3, mean: DVec3, focal_px: [f64; 2], variance: f64) -> f64 {
    let image = |axis: DVec3| {
        let along = |k: usize| focal_px[k] * (axis[k] - mean[k] / mean.z * axis.z) / mean.z;
        DVec2::new(along(0), along(1))
    };
    let [a, b, c] = [0, 1, 2].map(|k| image(axes.col(k)));
    let areas = a.perp_dot(b).powi(2) + b.perp_dot(c).powi(2) + c.perp_dot(a).powi(2);
    let trace = a.length_squared() + b.length_squared() + c.length_squared();
    let blurred = areas + variance * trace + variance * variance;
    (areas / blurred).max(COMPENSATION_MIN).sqrt()
}

/// L of Σ = A Aᵀ + low-pass: rows of (A | low-pass), each orthogonalised against the previous ones.
fn root_of_covariance(axes: DMat3, depth: f64, focal_px: [f64; 2], variance: f64) -> Root {
    let widened = |axis: usize| variance.sqrt() * depth / focal_px[axis];
    let row = |k: usize, across: f64, down: f64| {
        let axes = axes.row(k);
        [axes.x, axes.y, axes.z, across, down]
    };
    let mut rows = [row(0, widened(0), 0.0), row(1, 0.0, widened(1)), row(2, 0.0, 0.0)];
    let mut root = [[0.0; 3]; 3];
    for k in 0..3 {
        root[k][k] = dot(&rows[k], &rows[k]).sqrt();
        let unit = rows[k].map(|x| x / root[k][k]);
        for below in k + 1..3 {
            root[below][k] = dot(&rows[below], &unit);
            (0..5).for_each(|column| rows[below][column] -= root[below][k] * unit[column]);
        }
    }
    let inverse = DVec3::new(root[0][0], root[1][1], root[2][2]).recip();
    Root { inverse, below: [root[1][0], root[2][0], root[2][1]] }
}

fn dot(a: &[f64; 5], b: &[f64; 5]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Root {
    /// y of L y = x.
    fn solved(&self, x: DVec3) -> DVec3 {
        let [second_row, third_row, last] = self.below;
        let first = x.x * self.inverse.x;
        let second = (x.y - second_row * first) * self.inverse.y;
        let third = (x.z - third_row * first - last * second) * self.inverse.z;
        DVec3::new(first, second, third)
    }
}

/// Gaussians along a ray, nearest first.
fn hits(gaussians: &[GaussianInCamera], ray: DVec3, near: f64, order: Order) -> Vec<Hit> {
    let mut hits: Vec<Hit> = gaussians.iter().filter_map(|gaussian| gaussian.hit(ray, near, order)).collect();
    hits.sort_by(|a, b| a.nearness.total_cmp(&b.nearness));
    hits
}

/// Σ α T of each channel, then the remaining T.
fn composite(hits: &[Hit], channels: &[Vec<f64>], count: usize) -> Vec<f64> {
    let mut pixel = vec![0.0; count + 1];
    let mut transmittance = 1.0;
    for hit in hits {
        for (sum, channel) in pixel.iter_mut().zip(&channels[hit.index]) {
            *sum += hit.alpha * transmittance * channel;
        }
        transmittance *= 1.0 - hit.alpha;
    }
    pixel[count] = transmittance;
    pixel
}
