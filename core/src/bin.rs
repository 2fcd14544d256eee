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

/// Leftmost and rightmost x, in pixels, of a footprint within the band of y from `top` to `bottom`; the second is
/// smaller than the first where the footprint misses the band.
#[inline(always)]
pub fn span_in_rows(footprint: &Footprint<f32>, top: f32, bottom: f32) -> [f32; 2] {
    let [xx, yx, yy] = footprint.root_conic;
    let (a, b, c) = (xx * xx + yx * yx, yx * yy, yy * yy);
    let [center_x, center_y] = footprint.mean2d;
    span([a, b, c], footprint.reach, top - center_y, bottom - center_y).map(|x| x + center_x)
}

/// Topmost and lowest y of a footprint within the band of x from `left` to `right`; like [`span_in_rows`].
#[inline(always)]
pub fn span_in_columns(footprint: &Footprint<f32>, left: f32, right: f32) -> [f32; 2] {
    let [xx, yx, yy] = footprint.root_conic;
    let (a, b, c) = (xx * xx + yx * yx, yx * yy, yy * yy);
    let [center_x, center_y] = footprint.mean2d;
    span([c, b, a], footprint.reach, left - center_x, right - center_x).map(|y| y + center_y)
}

/// Extent along s of the ellipse a s² + 2 b s t + c t² ≤ reach², for t between `low` and `high`.
#[inline(always)]
fn span([a, b, c]: [f32; 3], reach: f32, low: f32, high: f32) -> [f32; 2] {
    const NOTHING: [f32; 2] = [1.0, -1.0];
    let determinant = a * c - b * b;
    let reach_squared = reach * reach;
    // The ellipse's own extreme points lie at t = ∓ (b / c) s; the band moves them to its nearer edge.
    let extreme_s = crate::math::sqrt(reach_squared * c / determinant);
    let extreme_t = b / c * extreme_s;
    let reach_t = crate::math::sqrt(reach_squared * a / determinant);
    if !(low <= reach_t && high >= -reach_t) {
        return if determinant > 0.0 { NOTHING } else { [f32::NEG_INFINITY, f32::INFINITY] };
    }
    let at = |t: f32| {
        let root = crate::math::sqrt((reach_squared * a - determinant * t * t).max(0.0));
        [(-b * t - root) / a, (-b * t + root) / a]
    };
    [at(extreme_t.clamp(low, high))[0], at((-extreme_t).clamp(low, high))[1]]
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
