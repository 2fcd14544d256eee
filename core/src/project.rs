//! From a Gaussian in the world to a splat on the screen: the local affine (EWA) projection of
//! Zwicker et al. 2001.

use crate::{
    activation::{sigmoid, sigmoid_vjp},
    antialias::{COMPENSATION_MIN, LowPass, smoothed, smoothed_vjp},
    camera::{CameraGrad, CameraOf},
    covariance::{Quat, rotation, rotation_vjp, scales, scales_vjp},
    each,
    real::{Real, divisor_scale},
    splat::{Splat, SplatGrad},
    vector::{Mat3, Vec3, vec3},
};

/// Largest standard deviation along a Gaussian's axes on the screen, in px: longer ones look the
/// same in any picture, and the determinant of such a splat does not overflow.
pub const EXTENT_MAX: f32 = 1e9;

/// Attributes of a Gaussian that determine its splat.
#[derive(Clone, Copy, Debug)]
pub struct Shape<R> {
    /// Centre, in world space.
    pub mean: Vec3<R>,
    /// Logarithms of the scales.
    pub log_scales: Vec3<R>,
    /// Orientation, of any length but zero.
    pub quat: Quat<R>,
    /// Opacity before the sigmoid.
    pub opacity_logit: R,
    /// Low-pass of its splat.
    pub low_pass: LowPass,
    /// Deviation of its filter in space, in world units ([`crate::antialias`]), if it has one.
    pub filter: Option<R>,
}

impl<R: Real> Shape<R> {
    /// Scales and opacity after activation, under the filter in space.
    #[inline(always)]
    pub fn scales_and_opacity(&self) -> (Vec3<R>, R) {
        let (scales, opacity) = (scales(self.log_scales), sigmoid(self.opacity_logit));
        match self.filter {
            Some(filter) => smoothed(scales, opacity, filter),
            None => (scales, opacity),
        }
    }
    /// Gradients of the logarithms of the scales and of the opacity's logit, from those of
    /// [`Shape::scales_and_opacity`].
    #[inline(always)]
    pub fn scales_and_opacity_vjp(&self, grad_scales: Vec3<R>, grad_opacity: R) -> (Vec3<R>, R) {
        let (scales, opacity) = (scales(self.log_scales), sigmoid(self.opacity_logit));
        let (grad_scales, grad_opacity) = match self.filter {
            Some(filter) => smoothed_vjp(scales, opacity, filter, grad_scales, grad_opacity),
            None => (grad_scales, grad_opacity),
        };
        (scales_vjp(self.log_scales, scales, grad_scales), sigmoid_vjp(opacity, grad_opacity))
    }
    /// Mask of Gaussians with only finite numbers; others are not drawn.
    #[inline(always)]
    pub fn is_finite(&self) -> R::Mask {
        let [w, x, y, z] = self.quat;
        let is_quat_finite = w.is_finite() & x.is_finite() & y.is_finite() & z.is_finite();
        let are_attributes_finite =
            self.mean.is_finite() & self.log_scales.is_finite() & is_quat_finite & self.opacity_logit.is_finite();
        self.filter.map_or(are_attributes_finite, |filter| are_attributes_finite & filter.is_finite())
    }
    /// The same where the mask holds, zero elsewhere.
    #[inline(always)]
    fn keep(self, mask: R::Mask) -> Self {
        let [w, x, y, z] = self.quat;
        Self {
            mean: each!(self.mean, x => x.keep(mask)),
            log_scales: each!(self.log_scales, x => x.keep(mask)),
            quat: [w.keep(mask), x.keep(mask), y.keep(mask), z.keep(mask)],
            opacity_logit: self.opacity_logit.keep(mask),
            ..self
        }
    }
}

/// Intermediate values of [`project`] and of its gradients.
#[derive(Clone, Copy, Debug)]
struct EwaProjection<R> {
    mean_in_camera: Vec3<R>,
    inverse_depth: R,
    /// The mean, divided by its depth.
    free_slope: [R; 2],
    /// Slope within the limits of the camera.
    slope: [R; 2],
    /// −1 < unclamped slope / limit < 1, as 1 or 0.
    slope_is_free: [R; 2],
    camera_from_local: Mat3<R>,
    scales: Vec3<R>,
    /// Opacity, without the compensation of the low-pass.
    opacity: R,
    /// Rows of J · (camera from world) · R · S: the half matrix whose square is cov2d.
    half: [Vec3<R>; 2],
    normal: Vec3<R>,
    variance_x: R,
    variance_y: R,
    covariance_xy: R,
    determinant: R,
    /// Variance of the low-pass, in px².
    blur: f32,
    /// Factor of the opacity, if the low-pass is compensated.
    compensation: Option<Compensation<R>>,
}

impl<R: Real> EwaProjection<R> {
    /// An opacity, or its gradient, times the factor of the compensation, if there is one.
    #[inline(always)]
    fn compensated(&self, opacity: R) -> R {
        match &self.compensation {
            Some(compensation) => opacity * compensation.factor,
            None => opacity,
        }
    }
}

/// Compensation of a splat's opacity for its low-pass: √(det Σ₂ / det(Σ₂ + b I)), no less than the
/// root of [`COMPENSATION_MIN`].
#[derive(Clone, Copy, Debug)]
struct Compensation<R> {
    factor: R,
    /// Share of det(Σ₂ + b I) that the low-pass adds; zero at the floor, where the factor is
    /// constant.
    added: R,
    /// 1 / det Σ₂; zero at the floor.
    inverse: R,
}

impl<R: Real> Compensation<R> {
    /// Compensation from det Σ₂, det(Σ₂ + b I) − det Σ₂ and det(Σ₂ + b I).
    #[inline(always)]
    fn new(unblurred: R, added: R, blurred: R) -> Self {
        let ratio = unblurred / blurred;
        let floor = ratio.constant(COMPENSATION_MIN);
        let is_free = floor.less(ratio);
        let one = ratio.constant(1.0);
        Self {
            factor: ratio.max(floor).sqrt(),
            added: (added / blurred).keep(is_free),
            inverse: R::select(is_free, unblurred, one).recip().keep(is_free),
        }
    }
}

/// Projects a Gaussian to a splat. Gaussians nearer than [`CameraOf::near`], or with a number that
/// is not finite, get a depth behind the eye: they must not be drawn, and the rest of their splat
/// is unspecified.
///
/// cov2d = V Vᵀ + b I with b of the [`LowPass`] and V = J · R_camera · R · S. Its determinant comes
/// from the two rows of V by Cauchy and Binet, |v₁ × v₂|² + b(|v₁|² + |v₂|²) + b²: every term is
/// positive, so needles of 10⁵ px keep their digits, as does |v₁ × v₂|², the determinant without
/// the low-pass, in the compensation.
#[inline(always)]
pub fn project<R: Real>(shape: &Shape<R>, camera: &CameraOf<R>) -> Splat<R> {
    let p = projection(shape, camera);
    let (xx, yx, yy) = root_of_conic(p.variance_x, p.covariance_xy, p.determinant);
    let [x, y] = p.free_slope;
    let is_drawn = shape.is_finite() & camera.near.less(p.mean_in_camera.z);
    Splat {
        mean2d: [
            camera.focal_px[0].mul_add(x, camera.principal_px[0]),
            camera.focal_px[1].mul_add(y, camera.principal_px[1]),
        ],
        root_conic: [xx, yx, yy],
        depth: R::select(is_drawn, p.mean_in_camera.z, p.inverse_depth.constant(-1.0)),
        opacity: p.compensated(p.opacity),
        variance: [p.variance_x, p.variance_y],
    }
}

/// Gradient of [`project`] with respect to the Gaussian. Beyond the slope limit the Jacobian is
/// constant in the slope, and so is its gradient. A Gaussian that is not finite has none.
#[inline(always)]
pub fn project_vjp<R: Real>(shape: &Shape<R>, camera: &CameraOf<R>, grad: &SplatGrad<R>) -> Shape<R> {
    let p = projection(shape, camera);
    let EwaGrad { mean_in_camera, axes_in_camera: [x, y, z], scales } = projection_vjp(&p, camera, grad);
    let turned = [
        camera.camera_from_world.transform_transposed(x),
        camera.camera_from_world.transform_transposed(y),
        camera.camera_from_world.transform_transposed(z),
    ];
    let (log_scales, opacity_logit) = shape.scales_and_opacity_vjp(scales, p.compensated(grad.opacity));
    let grad = Shape {
        mean: camera.camera_from_world.transform_transposed(mean_in_camera),
        log_scales,
        quat: rotation_vjp(shape.quat, &Mat3::from_columns(turned)),
        opacity_logit,
        low_pass: shape.low_pass,
        filter: None,
    };
    grad.keep(shape.is_finite())
}

/// Gradient of [`project`] with respect to the pose of the camera, as if the nine numbers of its
/// rotation R were independent; near plane, intrinsics and limits of the slopes have none.
///
/// The mean in the camera is R (m − c), and the Gaussian's axes are R a: with their gradients g and
/// gₐ, R has g (m − c)ᵀ + Σ gₐ aᵀ, and the centre c has −Rᵀ g.
#[inline(always)]
pub fn project_camera_vjp<R: Real>(shape: &Shape<R>, camera: &CameraOf<R>, grad: &SplatGrad<R>) -> CameraGrad<R> {
    let p = projection(shape, camera);
    let grad = projection_vjp(&p, camera, grad);
    let from_center = shape.mean - camera.position;
    let [x, y, z] = rotation(shape.quat).columns();
    let row = |mean: R, of_x: R, of_y: R, of_z: R| {
        (from_center * mean).add_scaled(of_x, x).add_scaled(of_y, y).add_scaled(of_z, z)
    };
    let (mean, [of_x, of_y, of_z]) = (grad.mean_in_camera, grad.axes_in_camera);
    let camera_from_world = Mat3 {
        rows: [
            row(mean.x, of_x.x, of_y.x, of_z.x),
            row(mean.y, of_x.y, of_y.y, of_z.y),
            row(mean.z, of_x.z, of_y.z, of_z.z),
        ],
    };
    let position = -camera.camera_from_world.transform_transposed(mean);
    CameraGrad { camera_from_world, position }.keep(shape.is_finite())
}

/// Gradient of [`project`] with respect to the Gaussian in camera space.
struct EwaGrad<R> {
    mean_in_camera: Vec3<R>,
    /// Gradients of the columns of [`EwaProjection::camera_from_local`].
    axes_in_camera: [Vec3<R>; 3],
    scales: Vec3<R>,
}

#[inline(always)]
fn projection_vjp<R: Real>(p: &EwaProjection<R>, camera: &CameraOf<R>, grad: &SplatGrad<R>) -> EwaGrad<R> {
    let [grad_first, grad_second] = half_grad(p, grad.root_conic, grad.opacity);

    // V = [f s (c.x − slope c.z) / z] by axis: back to the local axes c, the scales s, the slopes
    // and the depth.
    let (fx, fy) = (camera.focal_px[0] * p.inverse_depth, camera.focal_px[1] * p.inverse_depth);
    let columns = p.camera_from_local.columns();
    let scale_of = p.scales.to_array();
    let mut grad_scales = [p.inverse_depth.zero(); 3];
    let mut grad_columns = columns;
    let mut grad_slope = [p.inverse_depth.zero(); 2];
    for k in 0..3 {
        let (gx, gy) = (grad_first.to_array()[k] * fx, grad_second.to_array()[k] * fy);
        let column = columns[k];
        grad_scales[k] = gx * (column.x - p.slope[0] * column.z) + gy * (column.y - p.slope[1] * column.z);
        let (gx, gy) = (gx * scale_of[k], gy * scale_of[k]);
        grad_columns[k] = vec3(gx, gy, -(gx * p.slope[0] + gy * p.slope[1]));
        grad_slope[0] = grad_slope[0] - gx * column.z;
        grad_slope[1] = grad_slope[1] - gy * column.z;
    }
    let grad_half_times_half = grad_first.dot(p.half[0]) + grad_second.dot(p.half[1]);

    // mean2d and both slopes are functions of x/z and y/z.
    let along_x = camera.focal_px[0] * grad.mean2d[0] + grad_slope[0] * p.slope_is_free[0];
    let along_y = camera.focal_px[1] * grad.mean2d[1] + grad_slope[1] * p.slope_is_free[1];
    let [x, y] = p.free_slope;
    EwaGrad {
        mean_in_camera: vec3(
            along_x * p.inverse_depth,
            along_y * p.inverse_depth,
            grad.depth - (along_x * x + along_y * y + grad_half_times_half) * p.inverse_depth,
        ),
        axes_in_camera: grad_columns,
        scales: vec3(grad_scales[0], grad_scales[1], grad_scales[2]),
    }
}

#[inline(always)]
fn projection<R: Real>(shape: &Shape<R>, camera: &CameraOf<R>) -> EwaProjection<R> {
    let mean_in_camera = camera.to_camera(shape.mean);
    let one = mean_in_camera.z.constant(1.0);
    let depth = R::select(camera.near.less(mean_in_camera.z), mean_in_camera.z, one);
    // Gaussians at depths too large for a division have small splats, because scales are at most
    // e⁴⁰.
    let scale = divisor_scale(depth);
    let inverse = (depth * scale).recip();
    let inverse_depth = inverse * scale;

    let free_slope = [mean_in_camera.x * scale * inverse, mean_in_camera.y * scale * inverse];
    let limit = camera.slope_limit;
    let (mut slope, mut slope_is_free) = (free_slope, [one; 2]);
    for i in 0..2 {
        slope[i] = free_slope[i].max(-limit[i]).min(limit[i]);
        slope_is_free[i] = one.keep(free_slope[i].abs().less(limit[i]));
    }

    let [x, y, z] = rotation(shape.quat).columns();
    let camera_from_local = Mat3::from_columns([
        camera.camera_from_world.transform(x),
        camera.camera_from_world.transform(y),
        camera.camera_from_world.transform(z),
    ]);
    let (scales, opacity) = shape.scales_and_opacity();
    let [x, y, z] = camera_from_local.rows;
    let half = [
        (x - z * slope[0]).times(scales) * (camera.focal_px[0] * inverse_depth),
        (y - z * slope[1]).times(scales) * (camera.focal_px[1] * inverse_depth),
    ];
    let half = [bounded(half[0]), bounded(half[1])];

    let normal = half[0].cross(half[1]);
    let (first, second) = (half[0].length_squared(), half[1].length_squared());
    let blur = shape.low_pass.variance();
    let unblurred = normal.length_squared();
    let determinant = unblurred + (first + second) * blur + blur * blur;
    let compensation = if shape.low_pass.is_compensated() {
        Some(Compensation::new(unblurred, (first + second) * blur + blur * blur, determinant))
    } else {
        None
    };
    EwaProjection {
        mean_in_camera,
        inverse_depth,
        free_slope,
        slope,
        slope_is_free,
        camera_from_local,
        scales,
        opacity,
        half,
        normal,
        variance_x: first + blur,
        variance_y: second + blur,
        covariance_xy: half[0].dot(half[1]),
        determinant,
        blur,
        compensation,
    }
}

/// W of the conic of [[a, b], [b, ·]] with this determinant: the inverse of its Cholesky factor.
#[inline(always)]
pub(crate) fn root_of_conic<R: Real>(a: R, b: R, determinant: R) -> (R, R, R) {
    let yy = (a / determinant).sqrt();
    (a.sqrt().recip(), -(b / a) * yy, yy)
}

/// Gradient of both rows of the half matrix, from those of the root of the conic and of the
/// compensated opacity; zero where they were clamped.
///
/// With D₀ = |v₁ × v₂|² and D = D₀ + b(|v₁|² + |v₂|²) + b², the logarithm of the compensation has
/// the slopes (D − D₀) / (2 D D₀) along D₀ and −b / (2 D) along |v₁|² and |v₂|².
#[inline(always)]
fn half_grad<R: Real>(p: &EwaProjection<R>, [grad_xx, grad_yx, grad_yy]: [R; 3], grad_opacity: R) -> [Vec3<R>; 2] {
    let (a, b, determinant) = (p.variance_x, p.covariance_xy, p.determinant);
    let (xx, yx, yy) = root_of_conic(a, b, determinant);
    let grad_yy = grad_yy - grad_yx * (b / a);
    let grad_b = -grad_yx * yy / a;
    let grad_a = (grad_yy * yy - grad_xx * xx) * 0.5 / a - grad_yx * yx / a;
    let grad_determinant = -grad_yy * yy * 0.5 / determinant;

    let blurred = (grad_a + grad_determinant * p.blur) * 2.0;
    let mut first = (p.half[0] * blurred).add_scaled(grad_b, p.half[1]);
    let mut second = (p.half[1] * (grad_determinant * (2.0 * p.blur))).add_scaled(grad_b, p.half[0]);
    let mut grad_normal = p.normal * (grad_determinant * 2.0);
    if let Some(Compensation { factor, added, inverse }) = p.compensation {
        let grad = grad_opacity * p.opacity * factor;
        let along_length = -(grad / determinant * p.blur).keep(inverse.zero().less(inverse));
        first = first.add_scaled(along_length, p.half[0]);
        second = second.add_scaled(along_length, p.half[1]);
        grad_normal = grad_normal.add_scaled(grad * added * inverse, p.normal);
    }
    [
        bounded_vjp(p.half[0], first + p.half[1].cross(grad_normal)),
        bounded_vjp(p.half[1], second + grad_normal.cross(p.half[0])),
    ]
}

/// Row of the half matrix, clamped to ± [`EXTENT_MAX`]. NaN remains NaN.
#[inline(always)]
fn bounded<R: Real>(row: Vec3<R>) -> Vec3<R> {
    let most = row.x.constant(EXTENT_MAX);
    each!(row, extent => R::select(most.less(extent), most, R::select(extent.less(-most), -most, extent)))
}

/// Gradient of [`bounded`].
#[inline(always)]
fn bounded_vjp<R: Real>(row: Vec3<R>, grad: Vec3<R>) -> Vec3<R> {
    grad.keep_below(row, EXTENT_MAX)
}
