//! Surfaces of another renderer in front of splats.
//!
//! An *occlusion* has one number for each pixel, row by row: the depth of an opaque surface, z in
//! camera space, in units of the scene; infinite where there is none. In a pixel, a splat is hidden
//! if its depth is not less than that of the surface. The depth of a splat is that of its mean, or
//! that of its largest response along the pixel's ray if pixels have an order of their own
//! ([`crate::order`]). What is left of the transmittance belongs to the surface.

use crate::real::Real;

/// Mask of splats that a surface hides: s ≥ d, for the depths s of the splat and d of the surface.
/// NaN hides nothing.
#[inline(always)]
pub fn is_hidden<R: Real>(splat: R, surface: R) -> R::Mask {
    surface.less_or_equal(splat)
}

/// Depth buffer of a perspective projection: its values v = a + b / z for the depth z in camera
/// space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthRange {
    /// Value at infinite depth.
    pub offset: f32,
    /// Product of the depth and its difference from that value.
    pub scale: f32,
}

impl DepthRange {
    /// Values from 0 at the near plane to 1 at the far plane: v = f / (f − n) (1 − n / z).
    ///
    /// Both planes are positive, and `far` is larger than `near`; an infinite `far` is allowed.
    pub fn forward(near: f32, far: f32) -> Self {
        // 1 / (1 − n/f), which has a limit for infinite f.
        let offset = 1.0 / (1.0 - near / far);
        Self { offset, scale: -near * offset }
    }

    /// Values from 1 at the near plane to 0 at the far plane: v = n / (f − n) (f / z − 1).
    ///
    /// Both planes are positive, and `far` is larger than `near`; an infinite `far` is allowed.
    pub fn reversed(near: f32, far: f32) -> Self {
        let ratio = near / far;
        Self { offset: -ratio / (1.0 - ratio), scale: near / (1.0 - ratio) }
    }

    /// Depth z = b / (v − a) of a value in \[0, 1\]; `f32::MAX` at and beyond the far plane.
    pub fn depth(&self, value: f32) -> f32 {
        depth_of_value(value, self.offset, self.scale)
    }
}

/// [`DepthRange::depth`] in any number type. Buffers are cleared to the value of the far plane: 1,
/// or 0 if values decrease with depth.
#[inline(always)]
pub fn depth_of_value<R: Real>(value: R, offset: R, scale: R) -> R {
    let (zero, one, most) = (value.zero(), value.constant(1.0), value.constant(f32::MAX));
    let nearness = (value - offset) / scale;
    let is_cleared = (scale.less(zero) & one.less_or_equal(value)) | (zero.less(scale) & value.less_or_equal(zero));
    R::select(is_cleared | nearness.less_or_equal(zero), most, nearness.recip().min(most))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_come_back_from_every_kind_of_buffer() {
        let (near, far) = (0.1_f32, 500.0_f32);
        let forward = |z: f32| far / (far - near) * (1.0 - near / z);
        let reversed = |z: f32| near / (far - near) * (far / z - 1.0);
        for z in [0.1, 0.35, 2.0, 40.0] {
            for (range, value) in [
                (DepthRange::forward(near, far), forward(z)),
                (DepthRange::forward(near, f32::INFINITY), 1.0 - near / z),
                (DepthRange::reversed(near, far), reversed(z)),
                (DepthRange::reversed(near, f32::INFINITY), near / z),
            ] {
                // A forward buffer of 24 bits has steps of z² / n · 2⁻²⁴.
                let step = z * z / near * 2e-7 + z * 1e-6;
                assert!((range.depth(value) - z).abs() <= step, "{z} became {} by {range:?}", range.depth(value));
            }
        }
    }

    #[test]
    fn a_cleared_buffer_has_no_surface() {
        for far in [100.0, f32::INFINITY] {
            assert_eq!(DepthRange::forward(0.1, far).depth(1.0), f32::MAX);
            assert_eq!(DepthRange::reversed(0.1, far).depth(0.0), f32::MAX);
        }
    }

    #[test]
    fn a_surface_hides_what_is_not_before_it() {
        for (splat, surface, hidden) in
            [(1.0, 2.0, false), (2.0, 2.0, true), (3.0, 2.0, true), (3.0, f32::INFINITY, false), (3.0, f32::NAN, false)]
        {
            assert_eq!(is_hidden(splat, surface), hidden, "{splat} behind {surface}");
        }
    }
}
