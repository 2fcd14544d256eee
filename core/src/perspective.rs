//! Perspective within a splat, which the local affine projection omits.
//!
//! Let a Gaussian have the mean μ and the covariance Σ in camera space, and let δ be the offset of
//! a pixel from the image of μ. Along the ray through the pixel its largest response, in front of
//! the eye, is exp(−½ q) with
//!
//! ```text
//! q = |W δ|² / (u² + κ |W δ|²),    u = max(1 + l·δ, 0),    κ = 1 / (μᵀ Σ⁻¹ μ),
//! l·δ = (d − d₀)ᵀ Σ⁻¹ μ / (d₀ᵀ Σ⁻¹ μ)
//! ```
//!
//! where d is the ray, d₀ that through the mean, and W the root of the conic of the affine
//! projection, evaluated at the mean, however far off the axis it is. It follows from q = |(μ ×
//! d)|²_Σ / |d|²_adj Σ (the cofactors of Cauchy and Binet). The affine projection is l = 0 and κ =
//! 0; the projection onto the plane that touches the unit sphere in the direction of the mean is κ
//! = 0 and l·δ = d₀·(d − d₀) / |d₀|². So the error of each is known: to first order the error of
//! alpha is at most opacity · (1.16 |W⁻ᵀ l| + 1.08 κ), the largest values of r³ exp(−½ r²) and of ½
//! r⁴ exp(−½ r²).
//!
//! Σ holds the low-pass ([`crate::antialias::LowPass`]), in the plane of the screen at the mean's
//! depth; its compensation is that of the affine projection at the mean, and is included in the
//! opacity.

use crate::{
    blend::least_squared,
    camera::CameraOf,
    covariance::rotation,
    cutoffs::{Cutoffs, ProjectionModel},
    each,
    project::{EXTENT_MAX, Shape, root_of_conic},
    real::Real,
    splat::{Footprint, ROOT_SCALE, Splat, Splat2d},
    vector::{Vec3, vec3},
};

/// The perspective inside of a splat.
#[derive(Clone, Copy, Debug)]
pub struct Perspective<R> {
    /// l, in 1/px: how much of the ray's scale at the mean changes with a pixel.
    pub slope: [R; 2],
    /// κ: one over the squared distance of the eye from the mean, in standard deviations.
    pub curvature: R,
}

/// Largest r³ exp(−½ r²): 3√3 exp(−3/2).
const OFF_BY_SLOPE: f32 = 1.159_4;
/// Largest ½ r⁴ exp(−½ r²): 8 exp(−2).
const OFF_BY_CURVATURE: f32 = 1.082_7;
/// Limit of a footprint's squared eccentricity, and of the eye's closeness to it; beyond it the
/// footprint counts as unbounded.
const ELLIPSE_MAX: f32 = 0.99;

/// Perspective of a Gaussian's splat under a projection model.
#[inline(always)]
pub fn perspective<R: Real>(
    projection: ProjectionModel,
    shape: &Shape<R>,
    splat: &Splat<R>,
    camera: &CameraOf<R>,
) -> Perspective<R> {
    let zero = splat.depth.zero();
    let none = Perspective { slope: [zero; 2], curvature: zero };
    match projection {
        ProjectionModel::Affine => none,
        ProjectionModel::Tangent => along_tangent(shape, camera),
        ProjectionModel::Ray => along_ray(shape, camera),
        ProjectionModel::Within(alpha) => {
            let exact = along_ray(shape, camera);
            let matters = zero.constant(alpha).less(affine_error(splat, &exact));
            let keep = |x: R| x.keep(matters);
            Perspective { slope: [keep(exact.slope[0]), keep(exact.slope[1])], curvature: keep(exact.curvature) }
        }
    }
}

/// Upper bound of the affine projection's error of alpha, to first order.
#[inline(always)]
pub fn affine_error<R: Real>(splat: &Splat<R>, exact: &Perspective<R>) -> R {
    let [x, y] = slope_in_deviations(splat, exact.slope);
    let slope = x.mul_add(x, y * y).sqrt();
    splat.opacity * (slope * OFF_BY_SLOPE + exact.curvature * OFF_BY_CURVATURE)
}

/// W⁻ᵀ l.
#[inline(always)]
fn slope_in_deviations<R: Real>(splat: &Splat<R>, [x, y]: [R; 2]) -> [R; 2] {
    let [xx, yx, yy] = splat.root_conic;
    let second = y / yy;
    [(x - yx * second) / xx, second]
}

/// Mean in camera space, no nearer than the near plane.
#[inline(always)]
fn mean_in_camera<R: Real>(shape: &Shape<R>, camera: &CameraOf<R>) -> Vec3<R> {
    let mean = camera.to_camera(shape.mean);
    vec3(mean.x, mean.y, mean.z.max(camera.near))
}

#[inline(always)]
fn along_tangent<R: Real>(shape: &Shape<R>, camera: &CameraOf<R>) -> Perspective<R> {
    let mean = mean_in_camera(shape, camera);
    let scale = (mean * mean.z.recip()).length_squared().recip() * mean.z.recip();
    let [fx, fy] = camera.focal_px;
    Perspective { slope: [mean.x * scale / fx, mean.y * scale / fy], curvature: mean.z.zero() }
}

/// All numbers are sums of squares, by Cauchy and Binet over the axes of the Gaussian and the two
/// of the low-pass, so nothing cancels.
#[inline(always)]
fn along_ray<R: Real>(shape: &Shape<R>, camera: &CameraOf<R>) -> Perspective<R> {
    let mean = mean_in_camera(shape, camera);
    let Axes { axes: [a, b, c], unit } = axes_in_pixels(shape, mean.z, camera);
    let mean = in_pixels(mean, mean.z, camera);
    let blur = unit * unit.constant(shape.low_pass.variance()).sqrt();
    let zero = blur.zero();
    let pairs = [a.cross(b), b.cross(c), c.cross(a)];
    let across = |axis: Vec3<R>| vec3(zero, axis.z, -axis.y) * blur;
    let down = |axis: Vec3<R>| vec3(-axis.z, zero, axis.x) * blur;
    let screen = vec3(zero, zero, blur * blur);

    // adj Σ μ = Σ k (k·μ), k being the products of all pairs of axes.
    let of = |sum: Vec3<R>, pair: Vec3<R>| sum.add_scaled(pair.dot(mean), pair);
    let own = of(of(of(screen * (screen.z * mean.z), pairs[0]), pairs[1]), pairs[2]);
    let with_a = of(of(own, across(a)), down(a));
    let with_b = of(of(with_a, across(b)), down(b));
    let adjugate = of(of(with_b, across(c)), down(c));
    let along = adjugate.dot(mean);

    let blurred = |pair: Vec3<R>| pair.x.mul_add(pair.x, pair.y * pair.y);
    let areas = blurred(pairs[0]) + blurred(pairs[1]) + blurred(pairs[2]);
    let depth = vec3(a.z, b.z, c.z).length_squared() * screen.z;
    let determinant = pairs[0].dot(c).squared() + (areas + depth) * screen.z;
    Perspective { slope: [adjugate.x / along, adjugate.y / along], curvature: determinant / along / unit.squared() }
}

/// A Gaussian's axes, each as long as its scale, in pixels at its mean.
struct Axes<R> {
    /// Axes in units in which none is longer than about one.
    axes: [Vec3<R>; 3],
    /// A pixel in these units.
    unit: R,
}

#[inline(always)]
fn axes_in_pixels<R: Real>(shape: &Shape<R>, depth: R, camera: &CameraOf<R>) -> Axes<R> {
    let world_from_local = rotation(shape.quat);
    let scales = shape.scales_and_opacity().0.to_array();
    let most = depth.constant(EXTENT_MAX);
    let mut longest = depth.constant(1.0);
    let mut axes = [Vec3::zero(depth); 3];
    for k in 0..3 {
        let turned = camera.camera_from_world.transform(world_from_local.column(k));
        let axis = in_pixels(turned * scales[k], depth, camera);
        axes[k] = each!(axis, x => x.max(-most).min(most));
        longest = longest.max(axes[k].x.abs()).max(axes[k].y.abs()).max(axes[k].z.abs());
    }
    let unit = longest.recip();
    Axes { axes: [axes[0] * unit, axes[1] * unit, axes[2] * unit], unit }
}

/// Vector of camera space in pixels at a depth, with the same scale along the axis as across.
#[inline(always)]
fn in_pixels<R: Real>(v: Vec3<R>, depth: R, camera: &CameraOf<R>) -> Vec3<R> {
    let [fx, fy] = camera.focal_px;
    vec3(v.x * fx, v.y * fy, v.z * fx) * depth.recip()
}

/// Footprint of a splat in perspective, and its variances along x and y, in px².
///
/// q ≤ reach² is |y| ≤ ρ (1 + λ·y) with y = W δ, ρ² = reach² / (1 − κ reach²) and λ = W⁻ᵀ l: an
/// ellipse with one focus at the mean and the eccentricity ρ |λ|, if that is below one. Otherwise,
/// or if the eye is within reach, the footprint is unbounded: its root is zero and its variances
/// are infinite.
#[inline(always)]
pub fn footprint_in_perspective<R: Real>(
    splat: &Splat<R>,
    perspective: &Perspective<R>,
    reach: R,
) -> (Footprint<R>, [R; 2]) {
    let [xx, yx, yy] = splat.root_conic;
    let (a, b, c) = (splat.variance[0], -yx / (xx.squared() * yy), splat.variance[1]);
    let [lx, ly] = perspective.slope;
    let to_center = [a.mul_add(lx, b * ly), b.mul_add(lx, c * ly)];
    let reach_squared = reach.squared();
    let eye = perspective.curvature * reach_squared;
    let limit = eye.constant(ELLIPSE_MAX);
    let outside = -eye.min(limit) + 1.0;
    let reached = reach_squared / outside;
    let eccentric = reached * lx.mul_add(to_center[0], ly * to_center[1]);
    let is_ellipse = eye.less(limit) & eccentric.less(limit);
    let round = -eccentric.min(limit) + 1.0;

    let (scale, longer) = ((outside * round).recip(), reached / round);
    let widened = |own: R, i: usize, j: usize| (to_center[i] * to_center[j]).mul_add(longer, own) * scale;
    let (a, b, c) = (widened(a, 0, 0), widened(b, 0, 1), widened(c, 1, 1));
    let determinant = scale.squared() / (xx * yy).squared() / round;
    let (xx, yx, yy) = root_of_conic(a, b, determinant);
    let infinite = eye.constant(f32::INFINITY);
    let mean = |axis: usize| to_center[axis].mul_add(longer, splat.mean2d[axis]);
    let footprint = Footprint {
        mean2d: [R::select(is_ellipse, mean(0), splat.mean2d[0]), R::select(is_ellipse, mean(1), splat.mean2d[1])],
        root_conic: [xx.keep(is_ellipse), yx.keep(is_ellipse), yy.keep(is_ellipse)],
        reach,
    };
    (footprint, [R::select(is_ellipse, a, infinite), R::select(is_ellipse, c, infinite)])
}

/// κ in the units of scaled offsets.
#[inline(always)]
pub fn scaled_curvature<R: Real>(curvature: R) -> R {
    curvature * (1.0 / (ROOT_SCALE * ROOT_SCALE))
}

/// 1 + l·δ at the origin of pixel coordinates.
#[inline(always)]
pub fn ray_scale_of_origin<R: Real>(mean2d: [R; 2], slope: [R; 2]) -> R {
    (-slope[0]).mul_add(mean2d[0], (-slope[1]).mul_add(mean2d[1], mean2d[0].constant(1.0)))
}

/// 1 + l·δ of a pixel: it is linear, so the origin's is added.
#[inline(always)]
pub fn ray_scale<R: Real>(at_origin: R, slope: [R; 2], [x, y]: [R; 2]) -> R {
    slope[0].mul_add(x, slope[1].mul_add(y, at_origin))
}

/// log₂ of a splat's strength from the scaled |W δ|² and 1 + l·δ.
#[inline(always)]
pub fn log2_strength<R: Real>(log2_opacity: R, squared: R, ray_scale: R, scaled_curvature: R) -> R {
    let scale = ray_scale.max(ray_scale.zero());
    log2_opacity - squared / scaled_curvature.mul_add(squared, scale * scale)
}

/// Returns whether a splat in perspective may overlap a box of offsets from its mean; false only if
/// it certainly does not.
#[inline(always)]
pub fn may_overlap<R: Real>(
    cutoffs: &Cutoffs,
    splat: &Splat2d<R>,
    perspective: &Perspective<R>,
    dx: [R; 2],
    dy: [R; 2],
) -> R::Mask {
    let [lx, ly] = perspective.slope;
    let most = (lx * dx[0]).max(lx * dx[1]) + (ly * dy[0]).max(ly * dy[1]) + 1.0;
    let curvature = scaled_curvature(perspective.curvature);
    cutoffs.may_pass_alpha_test(log2_strength(splat.log2_opacity, least_squared(splat, dx, dy), most, curvature))
}
