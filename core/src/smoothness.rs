//! Smoothness of rendered normals between creases.
//!
//! A mirror's normal is constrained only where an edge of the light passes through its reflection
//! in some picture; elsewhere normals are noise with a scale of a few pixels. This loss makes them
//! vary evenly along rows and columns of the picture:
//!
//! ```text
//! b = (n₋ − 2 n₀ + n₊)⊥                      n at REACHES pixels to either side of a pixel
//! L = Σ w (1 + c² / g²)⁻² |b|² / (1 + |b|² / ε²)   over rows, columns and reaches, by their number
//! w = s / (s + s₀) (1 − r)²                  s of the pixel's colour reflected, at roughness r
//! ```
//!
//! ⊥ is the part across the line of sight. It is linear in the picture position for the unit normal
//! of a plane, a sphere or a cylinder, up to the outline, so the loss does not deform them. Bends
//! beyond ε are not noise, and saturate (Geman and McClure 1987); c, the largest |b| of blurred
//! normals, exempts creases that noise hides. w exempts surfaces without reflections, because their
//! texture determines their shape; without light per pixel w = 1. c and w are held fixed.

use crate::{
    real::Real,
    vector::{Vec3, normalize_or, normalize_or_vjp},
};

/// Distances in pixels of the neighbours in the comparison of normals.
pub const REACHES: [usize; 2] = [2, 4];
/// Distance in pixels of the neighbours for detecting creases.
pub const CREASE_REACH: usize = 4;
/// Radius in pixels of the blur of normals.
pub const BLUR_REACH: usize = 2;
/// 1 / ε²: |b| above ε = 0.025, 1.4°, saturates.
const INVERSE_SQUARED_LIMIT: f32 = 1600.0;
/// 1 / g²: a crease turns blurred normals by |b| of g = 0.03 and more.
const INVERSE_SQUARED_CREASE: f32 = 1111.0;
/// s₀: a pixel that is brighter by this much through reflection, in sRGB, has half of the largest
/// weight.
pub const REFLECTED_HALF: f32 = 0.1;
/// Length below which a blended normal has no direction.
pub const LENGTH_MIN: f32 = 0.25;
/// Threshold of the squared length that separates unit normals from zero.
const PRESENT: f32 = 0.5;

/// Unit normal of a pixel from its blended normal; zero without a surface, or if the blended normal
/// is shorter than [`LENGTH_MIN`].
#[inline(always)]
pub fn unit_normal<R: Real>(blended: Vec3<R>, is_surface: R::Mask) -> Vec3<R> {
    let none = Vec3::zero(blended.x);
    Vec3::select(is_surface & has_direction(blended), normalize_or(blended, none), none)
}

/// Gradient of [`unit_normal`] with respect to the blended normal.
#[inline(always)]
pub fn unit_normal_vjp<R: Real>(blended: Vec3<R>, is_surface: R::Mask, grad: Vec3<R>) -> Vec3<R> {
    let none = Vec3::zero(blended.x);
    Vec3::select(is_surface & has_direction(blended), normalize_or_vjp(blended, grad), none)
}

#[inline(always)]
fn has_direction<R: Real>(blended: Vec3<R>) -> R::Mask {
    blended.x.constant(LENGTH_MIN * LENGTH_MIN).less(blended.length_squared())
}

/// Unit mean of normals from their sum; zero without any.
#[inline(always)]
pub fn blurred_normal<R: Real>(sum: Vec3<R>) -> Vec3<R> {
    normalize_or(sum, Vec3::zero(sum.x))
}

/// Unit normals of three pixels at equal distances along a row or a column, zero where there is no
/// surface.
#[derive(Clone, Copy, Debug)]
pub struct Line<R> {
    /// To the left, or above.
    pub before: Vec3<R>,
    /// In the middle.
    pub at: Vec3<R>,
    /// To the right, or below.
    pub after: Vec3<R>,
}

impl<R: Real> Line<R> {
    /// Mask of lines with a surface in all pixels.
    #[inline(always)]
    pub fn is_whole(&self) -> R::Mask {
        let least = self.before.length_squared().min(self.at.length_squared()).min(self.after.length_squared());
        least.constant(PRESENT).less(least)
    }

    /// (n₋ − 2 n₀ + n₊)⊥, seen along −`view_dir`, a unit vector to the eye.
    #[inline(always)]
    pub fn bend(&self, view_dir: Vec3<R>) -> Vec3<R> {
        let second = (self.before - self.at) + (self.after - self.at);
        second - view_dir * view_dir.dot(second)
    }
}

/// Weight (1 + c² / g²)⁻² of a pixel, from the blurred normals of its row and its column at
/// [`CREASE_REACH`]; zero if one of them is incomplete.
#[inline(always)]
pub fn evenness<R: Real>(row: &Line<R>, column: &Line<R>, view_dir: Vec3<R>) -> R {
    let largest = row.bend(view_dir).length_squared().max(column.bend(view_dir).length_squared());
    let falloff = (largest * INVERSE_SQUARED_CREASE + 1.0).recip();
    (falloff * falloff).keep(row.is_whole() & column.is_whole())
}

/// Weight s / (s + s₀) (1 − r)² of a pixel, from 0 for matte surfaces to nearly 1 for mirrors: from
/// its colour under the light and without any, both sRGB-encoded, and its roughness, all
/// premultiplied by its coverage, which also scales s and 1 − r. s is the mean difference of the
/// colours, and zero if light reduces the colour.
#[inline(always)]
pub fn gloss<R: Real>(lit: Vec3<R>, unlit: Vec3<R>, roughness: R, coverage: R) -> R {
    let more = lit - unlit;
    let reflected = ((more.x + more.y + more.z) * (1.0 / 3.0)).max(coverage.zero());
    let smooth = (coverage - roughness).max(coverage.zero());
    // 1 − 1 / (s / s₀ + 1), which is 1 even for infinite s.
    let share = -((reflected * REFLECTED_HALF.recip() + 1.0).recip()) + 1.0;
    share * (smooth * smooth)
}

/// |b|² / (1 + |b|² / ε²) of a line, times the weight of its middle; zero where it is not whole.
#[inline(always)]
pub fn bending<R: Real>(line: &Line<R>, view_dir: Vec3<R>, weight: R) -> R {
    let squared = line.bend(view_dir).length_squared();
    (squared * weight / (squared * INVERSE_SQUARED_LIMIT + 1.0)).keep(line.is_whole())
}

/// Gradient g of [`bending`] with respect to the normals: g of the outer ones, −2 g of the middle.
#[inline(always)]
pub fn bending_vjp<R: Real>(line: &Line<R>, view_dir: Vec3<R>, weight: R, grad: R) -> Vec3<R> {
    let bend = line.bend(view_dir);
    let falloff = (bend.length_squared() * INVERSE_SQUARED_LIMIT + 1.0).recip();
    let slope = bend * (falloff * falloff * weight * grad * 2.0);
    Vec3::select(line.is_whole(), slope, Vec3::zero(grad))
}
