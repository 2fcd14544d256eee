//! Which tiles of the screen a splat touches.

use crate::{
    project::{NEAR, Splat},
    real::Real,
};

/// Pixels along an edge of a tile.
pub const TILE_SIZE: u32 = 16;
/// A splat is not drawn where its alpha is below this: half a step of an 8-bit picture (INRIA's value).
pub const ALPHA_MIN: f32 = 1.0 / 255.0;

/// Where a splat's alpha reaches [`ALPHA_MIN`]: the ellipse |W δ| ≤ `reach` around its mean.
#[derive(Clone, Copy, Debug)]
pub struct Footprint<R> {
    /// Centre, in pixels.
    pub mean2d: [R; 2],
    /// Root of the conic.
    pub root_conic: [R; 3],
    /// √(2 ln(opacity / ALPHA_MIN)); negative where nothing is to be drawn.
    pub reach: R,
}

/// The footprint of a splat; `reach` is −1 for one that is too faint, too near, or not a number.
#[inline(always)]
pub fn footprint<R: Real>(splat: &Splat<R>) -> Footprint<R> {
    let like = splat.depth;
    let ratio = splat.opacity * (1.0 / ALPHA_MIN);
    let reach = (ratio.max(like.constant(1.0)).ln() * 2.0).sqrt();
    // Comparisons are false for NaN, and finite sums rule out infinity.
    let sum = splat.mean2d[0].abs() + splat.mean2d[1].abs() + splat.variance[0] + splat.variance[1];
    let is_drawn = like.constant(NEAR).less(splat.depth)
        & like.constant(1.0).less(ratio)
        & sum.less(like.constant(f32::MAX))
        & splat.root_conic[2].less(like.constant(f32::MAX));
    Footprint {
        mean2d: splat.mean2d,
        root_conic: splat.root_conic,
        reach: R::select(is_drawn, reach, like.constant(-1.0)),
    }
}

/// Half width and half height of a footprint, in pixels: reach · √variance along each axis.
#[inline(always)]
pub fn half_extent<R: Real>(splat: &Splat<R>, reach: R) -> [R; 2] {
    [splat.variance[0].sqrt() * reach, splat.variance[1].sqrt() * reach]
}

/// The outline of a footprint, a x² + 2 b x y + c y² = reach² around its centre, prepared for many bands of y.
#[derive(Clone, Copy, Debug)]
pub struct Outline {
    center: [f32; 2],
    /// −b / a: how the middle of the outline moves along x with y.
    slope: f32,
    /// reach² / a and (a c − b²) / a²: the half width at y is √(first − second · y²).
    half_width: [f32; 2],
    /// y of the rightmost point; that of the leftmost is its negative.
    extreme_y: f32,
    /// Largest y; NaN or infinite where the outline is no ellipse in `f32`.
    reach_y: f32,
}

/// The outline of a footprint that is drawn.
#[inline(always)]
pub fn outline(footprint: &Footprint<f32>) -> Outline {
    let [xx, yx, yy] = footprint.root_conic;
    let (a, b, c) = (xx * xx + yx * yx, yx * yy, yy * yy);
    let per_a = a.recip();
    // a c − b² without its cancellation.
    let determinant = xx * xx * c;
    let reach_squared = footprint.reach * footprint.reach;
    let reach_y = crate::math::sqrt(reach_squared * a / determinant);
    Outline {
        center: footprint.mean2d,
        slope: -b * per_a,
        half_width: [reach_squared * per_a, determinant * per_a * per_a],
        extreme_y: -b / c * crate::math::sqrt(reach_squared * c / determinant),
        reach_y,
    }
}

/// Leftmost and rightmost x, in pixels, of an outline within the band of y from `top` to `bottom`; the second is
/// smaller than the first where the outline misses the band.
#[inline(always)]
pub fn span_in_rows(outline: &Outline, top: f32, bottom: f32) -> [f32; 2] {
    const NOTHING: [f32; 2] = [1.0, -1.0];
    let [x, y] = outline.center;
    let (low, high) = (top - y, bottom - y);
    if !(outline.reach_y < f32::INFINITY) {
        return [f32::NEG_INFINITY, f32::INFINITY];
    }
    if low > outline.reach_y || high < -outline.reach_y {
        return NOTHING;
    }
    // Where an extreme point lies outside the band, its nearer edge has the extreme.
    let half_width = |y: f32| crate::math::sqrt((outline.half_width[0] - outline.half_width[1] * y * y).max(0.0));
    let (leftmost, rightmost) = ((-outline.extreme_y).clamp(low, high), outline.extreme_y.clamp(low, high));
    [x + outline.slope * leftmost - half_width(leftmost), x + outline.slope * rightmost + half_width(rightmost)]
}

/// First and past-the-last tile along an axis that the interval from `low` to `high`, in pixels, touches.
#[inline(always)]
pub fn tile_range(low: f32, high: f32, tile_count: u32) -> [u32; 2] {
    if !(low <= high) {
        return [0, 0];
    }
    let size = TILE_SIZE as f32;
    let tile = |x: f32| (crate::math::floor(x / size)).clamp(-1.0, tile_count as f32);
    [tile(low).max(0.0) as u32, (tile(high) + 1.0).min(tile_count as f32) as u32]
}

/// Tiles along an edge of so many pixels.
pub const fn tile_count(pixels: u32) -> u32 {
    pixels.div_ceil(TILE_SIZE)
}
