//! From a Gaussian in the world to a splat on the screen: the local affine (EWA) projection of
//! Zwicker et al. 2001.

use crate::{
    activation::{sigmoid, sigmoid_vjp},
    camera::CameraOf,
    covariance::{Quat, rotation, rotation_vjp, scales, scales_vjp},
    each,
    real::Real,
    splat::{Splat, SplatGrad},
    vector::{Mat3, Vec3, vec3},
};

/// Variance, in px², that every splat is widened by, so that none is smaller than a pixel (INRIA's
/// low-pass).
pub const BLUR: f32 = 0.3;

/// Standard deviations along a Gaussian's axes count as no longer than this on the screen, in px:
/// longer ones look the same in any picture, and the determinant of such a splat still is an `f32`.
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
}

impl<R: Real> Shape<R> {
    /// Mask of Gaussians whose numbers are all finite: no others are drawn.
    #[inline(always)]
    pub fn is_finite(&self) -> R::Mask {
        let [w, x, y, z] = self.quat;
        let of_quat = w.is_finite() & x.is_finite() & y.is_finite() & z.is_finite();
        self.mean.is_finite() & self.log_scales.is_finite() & of_quat & self.opacity_logit.is_finite()
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
        }
    }
}

/// Intermediate values of [`project`] and [`project_vjp`].
#[derive(Clone, Copy, Debug)]
struct EwaProjection<R> {
    mean_in_camera: Vec3<R>,
    inverse_depth: R,
    slope: [R; 2],
    /// −1 < unclamped slope / limit < 1, as 1 or 0.
    slope_is_free: [R; 2],
    camera_from_local: Mat3<R>,
    scales: Vec3<R>,
    /// Rows of J · (camera from world) · R · S: the half matrix whose square is cov2d.
    half: [Vec3<R>; 2],
    normal: Vec3<R>,
    variance_x: R,
    covariance_xy: R,
    determinant: R,
}

/// The splat of a Gaussian. Gaussians nearer than [`CameraOf::near`] lie behind the eye, and so do
/// those with a number that is not finite: they must not be drawn. What else their splat holds
/// means nothing.
///
/// cov2d = V Vᵀ + 0.3 I with V = J · R_camera · R · S. Its determinant comes from the two rows of V
/// by Cauchy and Binet, |v₁ × v₂|² + λ(|v₁|² + |v₂|²) + λ²: every term is positive, so needles of
/// 10⁵ px keep their digits.
#[inline(always)]
pub fn project<R: Real>(shape: &Shape<R>, camera: &CameraOf<R>) -> Splat<R> {
    let p = projection(shape, camera);
    let (xx, yx, yy) = root_of_conic(p.variance_x, p.covariance_xy, p.determinant);
    let x = p.mean_in_camera.x * p.inverse_depth;
    let y = p.mean_in_camera.y * p.inverse_depth;
    let is_drawn = shape.is_finite() & camera.near.less(p.mean_in_camera.z);
    Splat {
        mean2d: [
            camera.focal_px[0].mul_add(x, camera.principal_px[0]),
            camera.focal_px[1].mul_add(y, camera.principal_px[1]),
        ],
        root_conic: [xx, yx, yy],
        depth: R::select(is_drawn, p.mean_in_camera.z, p.inverse_depth.constant(-1.0)),
        opacity: sigmoid(shape.opacity_logit),
        variance: [p.variance_x, p.half[1].length_squared() + BLUR],
    }
}

/// Gradient of [`project`]. Beyond the slope limit the Jacobian is constant in the slope, and so is
/// its gradient. A Gaussian that is not finite has none.
#[inline(always)]
pub fn project_vjp<R: Real>(shape: &Shape<R>, camera: &CameraOf<R>, grad: &SplatGrad<R>) -> Shape<R> {
    let p = projection(shape, camera);
    let [grad_first, grad_second] = half_grad(&p, grad.root_conic);

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
    let m = p.mean_in_camera * p.inverse_depth;
    let grad_mean_in_camera = vec3(
        along_x * p.inverse_depth,
        along_y * p.inverse_depth,
        grad.depth - (along_x * m.x + along_y * m.y + grad_half_times_half) * p.inverse_depth,
    );

    let turn = |k: usize| camera.camera_from_world.transform_transposed(grad_columns[k]);
    let grad_scales = vec3(grad_scales[0], grad_scales[1], grad_scales[2]);
    let grad = Shape {
        mean: camera.camera_from_world.transform_transposed(grad_mean_in_camera),
        log_scales: scales_vjp(shape.log_scales, p.scales, grad_scales),
        quat: rotation_vjp(shape.quat, &Mat3::from_columns([turn(0), turn(1), turn(2)])),
        opacity_logit: sigmoid_vjp(sigmoid(shape.opacity_logit), grad.opacity),
    };
    grad.keep(shape.is_finite())
}

#[inline(always)]
fn projection<R: Real>(shape: &Shape<R>, camera: &CameraOf<R>) -> EwaProjection<R> {
    let mean_in_camera = camera.to_camera(shape.mean);
    let one = mean_in_camera.z.constant(1.0);
    let depth = R::select(camera.near.less(mean_in_camera.z), mean_in_camera.z, one);
    let inverse_depth = depth.recip();

    let free_slope = [mean_in_camera.x * inverse_depth, mean_in_camera.y * inverse_depth];
    let limit = camera.slope_limit;
    let limited = |i: usize| free_slope[i].max(-limit[i]).min(limit[i]);
    let is_free = |i: usize| one.keep(free_slope[i].abs().less(limit[i]));
    let (slope, slope_is_free) = ([limited(0), limited(1)], [is_free(0), is_free(1)]);

    let world_from_local = rotation(shape.quat);
    let turn = |k: usize| camera.camera_from_world.transform(world_from_local.column(k));
    let camera_from_local = Mat3::from_columns([turn(0), turn(1), turn(2)]);
    let scales = scales(shape.log_scales);
    let [x, y, z] = camera_from_local.rows;
    let half = [
        (x - z * slope[0]).times(scales) * (camera.focal_px[0] * inverse_depth),
        (y - z * slope[1]).times(scales) * (camera.focal_px[1] * inverse_depth),
    ];
    let half = [bounded(half[0]), bounded(half[1])];

    let normal = half[0].cross(half[1]);
    let (first, second) = (half[0].length_squared(), half[1].length_squared());
    EwaProjection {
        mean_in_camera,
        inverse_depth,
        slope,
        slope_is_free,
        camera_from_local,
        scales,
        half,
        normal,
        variance_x: first + BLUR,
        covariance_xy: half[0].dot(half[1]),
        determinant: normal.length_squared() + (first + second) * BLUR + BLUR * BLUR,
    }
}

/// W of the conic of [[a, b], [b, ·]] with this determinant: the inverse of its Cholesky factor.
#[inline(always)]
pub(crate) fn root_of_conic<R: Real>(a: R, b: R, determinant: R) -> (R, R, R) {
    let yy = (a / determinant).sqrt();
    (a.sqrt().recip(), -(b / a) * yy, yy)
}

/// Gradient of both rows of the half matrix, from that of the root of the conic; zero where they
/// were bounded.
#[inline(always)]
fn half_grad<R: Real>(p: &EwaProjection<R>, [grad_xx, grad_yx, grad_yy]: [R; 3]) -> [Vec3<R>; 2] {
    let (a, b, determinant) = (p.variance_x, p.covariance_xy, p.determinant);
    let (xx, yx, yy) = root_of_conic(a, b, determinant);
    let grad_yy = grad_yy - grad_yx * (b / a);
    let grad_b = -grad_yx * yy / a;
    let grad_a = (grad_yy * yy - grad_xx * xx) * 0.5 / a - grad_yx * yx / a;
    let grad_determinant = -grad_yy * yy * 0.5 / determinant;

    let blurred = (grad_a + grad_determinant * BLUR) * 2.0;
    let first = (p.half[0] * blurred).add_scaled(grad_b, p.half[1]);
    let second = (p.half[1] * (grad_determinant * (2.0 * BLUR))).add_scaled(grad_b, p.half[0]);
    let grad_normal = p.normal * (grad_determinant * 2.0);
    [
        bounded_vjp(p.half[0], first + p.half[1].cross(grad_normal)),
        bounded_vjp(p.half[1], second + grad_normal.cross(p.half[0])),
    ]
}

/// A row of the half matrix, its numbers no larger than [`EXTENT_MAX`]. What is not a number stays
/// so.
#[inline(always)]
fn bounded<R: Real>(row: Vec3<R>) -> Vec3<R> {
    let most = row.x.constant(EXTENT_MAX);
    each!(row, extent => R::select(most.less(extent), most, R::select(extent.less(-most), -most, extent)))
}

/// Gradient of [`bounded`].
#[inline(always)]
fn bounded_vjp<R: Real>(row: Vec3<R>, grad: Vec3<R>) -> Vec3<R> {
    let limit = row.x.constant(EXTENT_MAX);
    vec3(
        grad.x.keep(row.x.abs().less(limit)),
        grad.y.keep(row.y.abs().less(limit)),
        grad.z.keep(row.z.abs().less(limit)),
    )
}
