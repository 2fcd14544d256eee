//! The curve γ between linear radiance and the numbers in a picture: sRGB (IEC 61966-2-1).
//!
//! A picture has 8 bits, or also its [`unclipped`](Picture::unclipped) colours: numbers above 1 on
//! the same curve, for radiance above white.
//!
//! A pixel outside of a mask or a lens has the colour [`UNKNOWN`] at alpha zero, so no fifth
//! channel or second array is needed. Losses treat both pictures as black there, so SSIM windows
//! agree, and give such pixels no gradient; measures skip them.

use crate::{each, real::Real, vector::Vec3};
use half::f16;

/// Largest linear value that is encoded by a straight line.
pub const LINEAR_LIMIT: f32 = 0.003_130_8;
const LINEAR_SLOPE: f32 = 12.92;
const POWER: f32 = 1.0 / 2.4;
const SCALE: f32 = 1.055;
const OFFSET: f32 = 0.055;

/// sRGB value of linear radiance. Continued above 1 by the same curve, and below 0 by the same
/// line, so that values outside the range of a picture still have a gradient towards it.
#[inline(always)]
pub fn srgb_from_linear<R: Real>(linear: R) -> R {
    let curved = (linear.max(linear.constant(LINEAR_LIMIT)).log2() * POWER).exp2() * SCALE - OFFSET;
    R::select(linear.constant(LINEAR_LIMIT).less(linear), curved, linear * LINEAR_SLOPE)
}

/// [`srgb_from_linear`] of a colour.
#[inline(always)]
pub(crate) fn srgb_color<R: Real>(linear: Vec3<R>) -> Vec3<R> {
    each!(linear, x => srgb_from_linear(x))
}

/// Gradient of [`srgb_from_linear`] from argument and value.
#[inline(always)]
pub fn srgb_from_linear_vjp<R: Real>(linear: R, srgb: R, grad: R) -> R {
    let is_curved = linear.constant(LINEAR_LIMIT).less(linear);
    let slope = (srgb + OFFSET) * POWER / linear.max(linear.constant(LINEAR_LIMIT));
    grad * R::select(is_curved, slope, linear.constant(LINEAR_SLOPE))
}

/// Gradient of [`srgb_from_linear`] for a colour, from argument and value.
#[inline(always)]
pub(crate) fn srgb_color_vjp<R: Real>(linear: Vec3<R>, srgb: Vec3<R>, grad: Vec3<R>) -> Vec3<R> {
    Vec3 {
        x: srgb_from_linear_vjp(linear.x, srgb.x, grad.x),
        y: srgb_from_linear_vjp(linear.y, srgb.y, grad.y),
        z: srgb_from_linear_vjp(linear.z, srgb.z, grad.z),
    }
}

/// Largest magnitude of residual colours: brighter than any light, but small enough that gradients
/// of losses, which grow with the square of a picture, do not overflow an `f32`.
pub const COLOR_MAX: f32 = 1e6;

/// A colour within ± [`COLOR_MAX`].
#[inline(always)]
pub fn limited<R: Real>(color: Vec3<R>) -> Vec3<R> {
    each!(color, x => x.clamp(-COLOR_MAX, COLOR_MAX))
}

/// Gradient of [`limited`]; zero at the limit and beyond.
#[inline(always)]
pub fn limited_vjp<R: Real>(color: Vec3<R>, grad: Vec3<R>) -> Vec3<R> {
    grad.keep_below(color, COLOR_MAX)
}

/// Linear radiance of an sRGB value, the inverse of [`srgb_from_linear`], for hosts.
pub fn linear_from_srgb(srgb: f32) -> f32 {
    if srgb <= LINEAR_LIMIT * LINEAR_SLOPE {
        srgb / LINEAR_SLOPE
    } else {
        crate::math::pow((srgb + OFFSET) / SCALE, 1.0 / POWER)
    }
}

/// A value of straight alpha over a background, all in \[0, 1\].
#[inline(always)]
pub fn over<R: Real>(value: R, alpha: R, background: R) -> R {
    value * alpha + (-alpha + 1.0) * background
}

/// A byte of a picture as a number in \[0, 1\].
#[inline(always)]
pub fn from_byte<R: Real>(byte: R) -> R {
    byte * (1.0 / 255.0)
}

/// Unknown pixel of a true picture, which losses and measures skip. Colours at an alpha of zero are
/// invisible, so this one is reserved; other transparent pixels get another.
pub const UNKNOWN: [u8; 4] = [254, 1, 254, 0];

/// Whether a pixel of red, green, blue and alpha bytes is [`UNKNOWN`].
#[inline(always)]
pub fn is_unknown(pixel: &[u8]) -> bool {
    pixel == UNKNOWN
}

/// Whether any known pixel of red, green, blue and alpha bytes is not opaque.
pub fn has_alpha(rgba: &[u8]) -> bool {
    rgba.chunks_exact(4).any(|pixel| pixel[3] < u8::MAX && !is_unknown(pixel))
}

/// A picture to compare with: sRGB with straight alpha, rows from the top.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picture<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green, blue and alpha of each pixel; [`UNKNOWN`] for masked pixels.
    pub rgba: &'a [u8],
    /// Red, green and blue of each pixel as [`srgb_from_linear`] of their radiance, at least 0 and
    /// not limited to 1; `None` if those of `rgba` are all that is known.
    pub unclipped: Option<&'a [[f16; 3]]>,
}

impl<'a> Picture<'a> {
    /// A picture of 8 bits.
    pub const fn of_bytes(width: usize, height: usize, rgba: &'a [u8]) -> Self {
        Self { width, height, rgba, unclipped: None }
    }

    /// Expected and actual length of an array that does not fit the size.
    pub fn wrong_len(&self) -> Option<[usize; 2]> {
        let count = self.width.saturating_mul(self.height);
        let unclipped = self.unclipped.map(|colors| [3 * count, 3 * colors.len()]);
        let lens = [Some([4 * count, self.rgba.len()]), unclipped];
        lens.into_iter().flatten().find(|[expected, found]| expected != found)
    }
}

/// Blended colour over a visible background: C + T · background.
#[inline(always)]
pub fn composite<R: Real>(color: R, transmittance: R, background: R) -> R {
    transmittance.mul_add(background, color)
}

/// Gradient of [`composite`] with respect to the transmittance, added to `sum`; that of the colour
/// is `grad` itself.
#[inline(always)]
pub fn composite_vjp<R: Real>(background: R, grad: R, sum: R) -> R {
    grad.mul_add(background, sum)
}
