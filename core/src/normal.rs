//! The normal of a Gaussian: its shortest axis, turned to the viewer, plus a learned residual
//! (paper, eq. normal).

use crate::{
    each,
    real::Real,
    vector::{Mat3, Vec3, normalize_or, normalize_or_vjp, vec3},
};

/// Axis of a Gaussian that becomes its normal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AxisRule {
    /// The column of R that belongs to the smallest scale, as the paper says.
    Shortest,
    /// The first row of R with its columns sorted by scale: the authors' code computes it, and its
    /// checkpoints were trained with it.
    SortedRow,
    /// No axis: the normal is only the residual (the paper's ablation "without v").
    None,
}

/// Columns of R picked by rank of their scales: `[k][c]` says, as 1 or 0, whether column c has rank
/// k.
type Ranks<R> = [[R; 3]; 3];

/// Axis of a Gaussian before it is turned to the viewer; of unit length, or zero for
/// [`AxisRule::None`].
///
/// Of equal scales, the earlier axis counts as the shorter.
#[inline(always)]
pub fn axis<R: Real>(rule: AxisRule, rotation: &Mat3<R>, log_scales: Vec3<R>) -> Vec3<R> {
    let ranks = ranks(log_scales);
    let [a, b, c] = rotation.rows;
    match rule {
        AxisRule::Shortest => vec3(pick(a, ranks[0]), pick(b, ranks[0]), pick(c, ranks[0])),
        AxisRule::SortedRow => vec3(pick(a, ranks[0]), pick(a, ranks[1]), pick(a, ranks[2])),
        AxisRule::None => Vec3::zero(a.x),
    }
}

/// Component of a row in the column that is marked.
#[inline(always)]
fn pick<R: Real>(row: Vec3<R>, [x, y, z]: [R; 3]) -> R {
    row.x * x + row.y * y + row.z * z
}

/// Gradient of [`pick`] with respect to the row.
#[inline(always)]
fn pick_vjp<R: Real>([x, y, z]: [R; 3], grad: R) -> Vec3<R> {
    vec3(x * grad, y * grad, z * grad)
}

/// Gradient of [`axis`] with respect to the rotation; the order of the scales is locally constant.
#[inline(always)]
pub fn axis_vjp<R: Real>(rule: AxisRule, log_scales: Vec3<R>, grad: Vec3<R>) -> Mat3<R> {
    let ranks = ranks(log_scales);
    let zero = Vec3::zero(grad.x);
    match rule {
        AxisRule::Shortest => {
            Mat3 { rows: [pick_vjp(ranks[0], grad.x), pick_vjp(ranks[0], grad.y), pick_vjp(ranks[0], grad.z)] }
        }
        AxisRule::SortedRow => {
            let row = pick_vjp(ranks[0], grad.x) + pick_vjp(ranks[1], grad.y) + pick_vjp(ranks[2], grad.z);
            Mat3 { rows: [row, zero, zero] }
        }
        AxisRule::None => Mat3 { rows: [zero; 3] },
    }
}

#[inline(always)]
fn ranks<R: Real>(scales: Vec3<R>) -> Ranks<R> {
    let Vec3 { x, y, z } = scales;
    let one = x.constant(1.0);
    let (xy, xz, yz) = (x.less_or_equal(y), x.less_or_equal(z), y.less_or_equal(z));
    let first = [one.keep(xy & xz), one.keep(!xy & yz), one.keep(!xz & !yz)];
    let last = [one.keep(!xy & !xz), one.keep(xy & !yz), one.keep(xz & yz)];
    let middle = [one - first[0] - last[0], one - first[1] - last[1], one - first[2] - last[2]];
    [first, middle, last]
}

/// Largest magnitude of the numbers of residuals: with larger ones a unit axis is lost in rounding.
pub const RESIDUAL_MAX: f32 = 1e8;

/// A normal that faces the viewer.
#[derive(Clone, Copy, Debug)]
pub struct Facing<R: Real> {
    /// Unit normal.
    pub normal: Vec3<R>,
    /// |Δn|² of the residual that was used.
    pub residual_squared: R,
    sum: Vec3<R>,
    keeps: R::Mask,
    residual: Vec3<R>,
}

/// n = (v + Δn₁) if ω_o · v > 0, else −(v + Δn₂), normalised. If the sum is zero, n is ± v.
///
/// Residuals are clamped to ± [`RESIDUAL_MAX`]. `negate_second` is the paper's sign of Δn₂; the
/// authors' code computes −v + Δn₂ instead.
#[inline(always)]
pub fn facing<R: Real>(axis: Vec3<R>, view_dir: Vec3<R>, residuals: [Vec3<R>; 2], negate_second: bool) -> Facing<R> {
    let along = axis.dot(view_dir);
    let keeps = !along.less(along.zero());
    let turned = Vec3::select(keeps, axis, -axis);
    let second = if negate_second { -residuals[1] } else { residuals[1] };
    let residual = each!(Vec3::select(keeps, residuals[0], second), x => x.clamp(-RESIDUAL_MAX, RESIDUAL_MAX));
    let sum = turned + residual;
    let fallback = Vec3::select(keeps, axis, -axis);
    Facing { normal: normalize_or(sum, fallback), residual_squared: residual.length_squared(), sum, keeps, residual }
}

/// Gradient of [`facing`]: with respect to the axis and both residuals; clamped numbers have none.
/// The choice of side is locally constant.
#[inline(always)]
pub fn facing_vjp<R: Real>(
    facing: &Facing<R>,
    negate_second: bool,
    grad_normal: Vec3<R>,
    grad_residual_squared: R,
) -> (Vec3<R>, [Vec3<R>; 2]) {
    let grad_sum = normalize_or_vjp(facing.sum, grad_normal);
    let zero = Vec3::zero(grad_residual_squared);
    // Zero where a residual was limited.
    let grad_residual =
        grad_sum.add_scaled(grad_residual_squared * 2.0, facing.residual).keep_below(facing.residual, RESIDUAL_MAX);
    let second = if negate_second { -grad_residual } else { grad_residual };
    (
        Vec3::select(facing.keeps, grad_sum, -grad_sum),
        [Vec3::select(facing.keeps, grad_residual, zero), Vec3::select(facing.keeps, zero, second)],
    )
}
