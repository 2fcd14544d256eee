//! Shape of a Gaussian: rotation from a quat, scales from their logarithms, Σ = R S Sᵀ Rᵀ (paper,
//! section 3.1).

use crate::{
    each,
    real::{Real, divisor_scale},
    vector::{Mat3, Vec3, vec3},
};

/// A quat (w, x, y, z).
pub type Quat<R> = [R; 4];

/// Quats with all components smaller than this count as the identity.
pub const QUAT_MIN: f32 = 1e-12;
/// Logarithms of scales are clamped to [−LOG_SCALE_LIMIT, LOG_SCALE_LIMIT]: e^40 squared is still
/// an `f32`.
pub const LOG_SCALE_LIMIT: f32 = 40.0;

/// Rotation of a quat, after normalisation. A quat of length zero is the identity.
#[inline(always)]
pub fn rotation<R: Real>(quat: Quat<R>) -> Mat3<R> {
    rotation_of_unit(normalize_quat(quat).0)
}

/// Gradient of [`rotation`] with respect to the quat, of a gradient by columns; zero for a quat of
/// length zero.
#[inline(always)]
pub fn rotation_vjp<R: Real>(quat: Quat<R>, grad: &Mat3<R>) -> Quat<R> {
    let ([w, x, y, z], inverse_length) = normalize_quat(quat);
    let [g0, g1, g2] = grad.rows;
    let unit_grad = [
        ((g1.x - g0.y) * z + (g0.z - g2.x) * y + (g2.y - g1.z) * x) * 2.0,
        (g0.y * y + g0.z * z + g1.x * y + g2.x * z + (g2.y - g1.z) * w - (g1.y + g2.z) * x * 2.0) * 2.0,
        (g0.y * x + g1.x * x + g1.z * z + g2.y * z + (g0.z - g2.x) * w - (g0.x + g2.z) * y * 2.0) * 2.0,
        (g0.z * x + g2.x * x + g1.z * y + g2.y * y + (g1.x - g0.y) * w - (g0.x + g1.y) * z * 2.0) * 2.0,
    ];
    let along = unit_grad[0] * w + unit_grad[1] * x + unit_grad[2] * y + unit_grad[3] * z;
    [
        (unit_grad[0] - w * along) * inverse_length,
        (unit_grad[1] - x * along) * inverse_length,
        (unit_grad[2] - y * along) * inverse_length,
        (unit_grad[3] - z * along) * inverse_length,
    ]
}

/// The scales: e^x of their logarithms, clamped to ± [`LOG_SCALE_LIMIT`].
#[inline(always)]
pub fn scales<R: Real>(log_scales: Vec3<R>) -> Vec3<R> {
    each!(log_scales, x => x.clamp(-LOG_SCALE_LIMIT, LOG_SCALE_LIMIT).exp())
}

/// Gradient of [`scales`] with respect to the logarithms; zero where they were clamped.
#[inline(always)]
pub fn scales_vjp<R: Real>(log_scales: Vec3<R>, scales: Vec3<R>, grad: Vec3<R>) -> Vec3<R> {
    let gate = |x: R, g: R| g.keep(x.abs().less(x.constant(LOG_SCALE_LIMIT)));
    let grad = grad.times(scales);
    vec3(gate(log_scales.x, grad.x), gate(log_scales.y, grad.y), gate(log_scales.z, grad.z))
}

/// The covariance (xx, xy, xz, yy, yz, zz) of a Gaussian.
pub fn covariance<R: Real>(quat: Quat<R>, log_scales: Vec3<R>) -> [R; 6] {
    let rotation = rotation(quat);
    let scales = scales(log_scales);
    let [a, b, c] = rotation.rows;
    let (a, b, c) = (a.times(scales), b.times(scales), c.times(scales));
    [a.dot(a), a.dot(b), a.dot(c), b.dot(b), b.dot(c), c.dot(c)]
}

/// The unit quat and 1 / length; the identity and 0 for a quat of length zero.
#[inline(always)]
fn normalize_quat<R: Real>([w, x, y, z]: Quat<R>) -> (Quat<R>, R) {
    // The largest component is divided out first, so that neither 1e-30 nor 1e30 leaves the range
    // of f32.
    let largest = w.abs().max(x.abs()).max(y.abs().max(z.abs()));
    let is_rotation = w.constant(QUAT_MIN).less(largest);
    let scale = divisor_scale(largest);
    let [w, x, y, z, largest] = [w, x, y, z, largest].map(|number| number * scale);
    let largest = R::select(is_rotation, largest, w.constant(1.0));
    let (w, x, y, z) = (w / largest, x / largest, y / largest, z / largest);
    let length_squared = w * w + x * x + y * y + z * z;
    let inverse = R::select(is_rotation, length_squared, w.constant(1.0)).sqrt().recip();
    let unit = [
        R::select(is_rotation, w * inverse, w.constant(1.0)),
        (x * inverse).keep(is_rotation),
        (y * inverse).keep(is_rotation),
        (z * inverse).keep(is_rotation),
    ];
    (unit, (inverse / largest * scale).keep(is_rotation))
}

#[inline(always)]
fn rotation_of_unit<R: Real>([w, x, y, z]: Quat<R>) -> Mat3<R> {
    let twice = |a: R| a + a;
    Mat3 {
        rows: [
            vec3(-twice(y * y + z * z) + 1.0, twice(x * y - w * z), twice(x * z + w * y)),
            vec3(twice(x * y + w * z), -twice(x * x + z * z) + 1.0, twice(y * z - w * x)),
            vec3(twice(x * z - w * y), twice(y * z + w * x), -twice(x * x + y * y) + 1.0),
        ],
    }
}
