//! Real spherical harmonics up to degree 3, with the usual signs and constants.

use crate::{
    color::COLOR_MAX,
    each,
    real::Real,
    vector::{Vec3, vec3},
};

/// Harmonics of degree 0 to 3.
pub const MAX_COUNT: usize = 16;

/// Y₀.
pub const Y0: f32 = 0.282_094_8;
const Y1: f32 = 0.488_602_52;
const Y2: [f32; 3] = [1.092_548_5, 0.315_391_57, 0.546_274_24];
const Y3: [f32; 5] = [0.590_043_6, 2.890_611_4, 0.457_045_8, 0.373_176_34, 1.445_305_7];

/// The first `count` = 1, 4, 9 or 16 harmonics at a unit direction; the rest is zero.
#[inline(always)]
pub fn basis<R: Real>(direction: Vec3<R>, count: usize) -> [R; MAX_COUNT] {
    let Vec3 { x, y, z } = direction;
    let mut basis = [x.zero(); MAX_COUNT];
    basis[0] = x.constant(Y0);
    if count > 1 {
        basis[1] = y * -Y1;
        basis[2] = z * Y1;
        basis[3] = x * -Y1;
    }
    if count > 4 {
        let (xx, yy, zz) = (x * x, y * y, z * z);
        basis[4] = x * y * Y2[0];
        basis[5] = y * z * -Y2[0];
        basis[6] = (zz + zz - xx - yy) * Y2[1];
        basis[7] = x * z * -Y2[0];
        basis[8] = (xx - yy) * Y2[2];
        if count > 9 {
            basis[9] = y * (xx * 3.0 - yy) * -Y3[0];
            basis[10] = x * y * z * Y3[1];
            basis[11] = y * (zz * 4.0 - xx - yy) * -Y3[2];
            basis[12] = z * (zz * 2.0 - (xx + yy) * 3.0) * Y3[3];
            basis[13] = x * (zz * 4.0 - xx - yy) * -Y3[2];
            basis[14] = z * (xx - yy) * Y3[4];
            basis[15] = x * (xx - yy * 3.0) * -Y3[0];
        }
    }
    basis
}

/// Gradient of [`basis`] with respect to the direction, as if its components were independent.
#[inline(always)]
pub fn basis_vjp<R: Real>(direction: Vec3<R>, count: usize, grad: &[R; MAX_COUNT]) -> Vec3<R> {
    let Vec3 { x, y, z } = direction;
    let mut out = Vec3::zero(x);
    if count > 1 {
        out = vec3(grad[3] * -Y1, grad[1] * -Y1, grad[2] * Y1);
    }
    if count > 4 {
        let [g4, g5, g6] = [grad[4] * Y2[0], grad[5] * -Y2[0], grad[6] * (2.0 * Y2[1])];
        let [g7, g8] = [grad[7] * -Y2[0], grad[8] * (2.0 * Y2[2])];
        out = out
            + vec3(
                y * g4 - x * g6 + z * g7 + x * g8,
                x * g4 + z * g5 - y * g6 - y * g8,
                y * g5 + z * g6 * 2.0 + x * g7,
            );
    }
    if count > 9 {
        let (xx, yy, zz) = (x * x, y * y, z * z);
        let g9 = grad[9] * -Y3[0];
        let g10 = grad[10] * Y3[1];
        let g11 = grad[11] * -Y3[2];
        let g12 = grad[12] * Y3[3];
        let g13 = grad[13] * -Y3[2];
        let g14 = grad[14] * Y3[4];
        let g15 = grad[15] * -Y3[0];
        let (xy, xz, yz) = (x * y, x * z, y * z);
        out = out
            + vec3(
                xy * g9 * 6.0 + yz * g10 - xy * g11 * 2.0 - xz * g12 * 6.0
                    + (zz * 4.0 - xx * 3.0 - yy) * g13
                    + xz * g14 * 2.0
                    + (xx - yy) * g15 * 3.0,
                (xx - yy) * g9 * 3.0 + xz * g10 + (zz * 4.0 - xx - yy * 3.0) * g11
                    - yz * g12 * 6.0
                    - xy * g13 * 2.0
                    - yz * g14 * 2.0
                    - xy * g15 * 6.0,
                xy * g10 + yz * g11 * 8.0 + (zz * 2.0 - xx - yy) * g12 * 3.0 + xz * g13 * 8.0 + (xx - yy) * g14,
            );
    }
    out
}

/// Colour of plain Gaussian splatting from the sum of its harmonics: sum + ½, at least zero
/// (INRIA's convention) and at most [`COLOR_MAX`].
#[inline(always)]
pub fn radiance<R: Real>(sum: Vec3<R>) -> Vec3<R> {
    each!(sum, x => (x + 0.5).clamp(0.0, COLOR_MAX))
}

/// Gradient of [`radiance`]; zero where the colour was clamped.
#[inline(always)]
pub fn radiance_vjp<R: Real>(sum: Vec3<R>, grad: Vec3<R>) -> Vec3<R> {
    let [lowest, highest] = [grad.x.constant(-0.5), grad.x.constant(COLOR_MAX)];
    vec3(
        grad.x.keep(lowest.less(sum.x) & sum.x.less(highest)),
        grad.y.keep(lowest.less(sum.y) & sum.y.less(highest)),
        grad.z.keep(lowest.less(sum.z) & sum.z.less(highest)),
    )
}
