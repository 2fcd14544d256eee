//! Tiles of the screen that a splat touches.

use crate::{
    cutoffs::Cutoffs,
    real::Real,
    splat::{Footprint, Outline, Splat},
};

/// Pixels along an edge of a tile.
pub const TILE_SIZE: u32 = 16;

/// Footprint of a splat; `reach` is −1 if it is too faint, too near, or not a number.
#[inline(always)]
pub fn footprint<R: Real>(splat: &Splat<R>) -> Footprint<R> {
    footprint_within(splat, &Cutoffs::DEFAULT)
}

/// [`footprint`] with another least alpha.
#[inline(always)]
pub fn footprint_within<R: Real>(splat: &Splat<R>, cutoffs: &Cutoffs) -> Footprint<R> {
    let like = splat.depth;
    let ratio = splat.opacity * (1.0 / cutoffs.alpha_min());
    let reach = (ratio.max(like.constant(1.0)).ln() * 2.0).sqrt();
    // Comparisons are false for NaN, and finite sums rule out infinity.
    let sum = splat.mean2d[0].abs() + splat.mean2d[1].abs() + splat.variance[0] + splat.variance[1];
    let is_drawn = like.zero().less(splat.depth)
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

/// Mask of splats whose box, half its extent to either side of the centre, touches a picture of
/// this size, all in pixels.
#[inline(always)]
pub(crate) fn touches_picture<R: Real>(center: [R; 2], half_extent: [R; 2], size: [R; 2]) -> R::Mask {
    let touches = |axis: usize| {
        let (center, half) = (center[axis], half_extent[axis]);
        center.zero().less_or_equal(center + half) & (center - half).less_or_equal(size[axis])
    };
    touches(0) & touches(1)
}

/// Outline of a drawn footprint.
#[inline(always)]
pub fn outline<R: Real>(footprint: &Footprint<R>) -> Outline<R> {
    let [xx, yx, yy] = footprint.root_conic;
    let (a, b, c) = (xx * xx + yx * yx, yx * yy, yy * yy);
    let per_a = a.recip();
    // a c − b² without its cancellation.
    let determinant = xx * xx * c;
    let reach_squared = footprint.reach * footprint.reach;
    Outline {
        center: footprint.mean2d,
        slope: -b * per_a,
        half_width: [reach_squared * per_a, determinant * per_a * per_a],
        extreme_y: -b / c * (reach_squared * c / determinant).sqrt(),
        reach_y: (reach_squared * a / determinant).sqrt(),
    }
}

impl<R: Real> Outline<R> {
    #[inline(always)]
    fn half_width_at(&self, y: R) -> R {
        let squared = self.half_width[0] - self.half_width[1] * y * y;
        squared.max(squared.zero()).sqrt()
    }
}

/// Leftmost and rightmost x, in pixels, of an outline within the band of y from `top` to `bottom`;
/// the second is smaller than the first if the outline misses the band. An outline that is not an
/// ellipse covers every x.
#[inline(always)]
pub fn span_in_rows<R: Real>(outline: &Outline<R>, top: R, bottom: R) -> [R; 2] {
    let [x, y] = outline.center;
    let (low, high) = (top - y, bottom - y);
    // If an extreme point lies outside the band, the extreme is at the nearer edge of the band.
    let leftmost = (-outline.extreme_y).max(low).min(high);
    let rightmost = outline.extreme_y.max(low).min(high);
    let left = x + outline.slope * leftmost - outline.half_width_at(leftmost);
    let right = x + outline.slope * rightmost + outline.half_width_at(rightmost);

    let misses = outline.reach_y.less(low) | high.less(-outline.reach_y);
    let is_ellipse = outline.reach_y.less(x.constant(f32::MAX));
    let choose = |end: R, if_missed: f32, if_everywhere: f32| {
        R::select(is_ellipse, R::select(misses, x.constant(if_missed), end), x.constant(if_everywhere))
    };
    [choose(left, 1.0, -f32::MAX), choose(right, -1.0, f32::MAX)]
}

/// First and past-the-last tile, of those from `tiles[0]` to before `tiles[1]` along an axis, that
/// the interval from `low` to `high`, in pixels, touches.
#[inline(always)]
pub fn tile_range<R: Real>(low: R, high: R, tiles: [R; 2]) -> [R; 2] {
    let [start, end] = tiles;
    let before = start - 1.0;
    let first = (low / TILE_SIZE as f32).floor().max(before).min(end);
    let last = (high / TILE_SIZE as f32).floor().max(before).min(end);
    let is_interval = low.less_or_equal(high);
    [first.max(start).keep(is_interval), (last + 1.0).min(end).keep(is_interval)]
}

/// Number of tiles along an edge of this many pixels.
pub const fn tile_count(pixels: u32) -> u32 {
    pixels.div_ceil(TILE_SIZE)
}
