//! Two-dimensional splats, the images of Gaussians: for projection, binning and compositing.

use crate::real::Real;

/// Splat, the image of a Gaussian on the screen.
///
/// Instead of the conic Q = cov2d⁻¹ its triangular root W is kept, Q = Wᵀ W: the exponent
/// −½ |W δ|² is then never positive, however W was rounded.
#[derive(Clone, Copy, Debug)]
pub struct Splat<R> {
    /// Centre, in pixels.
    pub mean2d: [R; 2],
    /// W: (xx, yx, yy), in 1/px; W δ = (xx δx, yx δx + yy δy).
    pub root_conic: [R; 3],
    /// Camera-space z of the centre; −1 for a Gaussian that is nearer than the near plane, or not
    /// finite.
    pub depth: R,
    /// Opacity, in (0, 1).
    pub opacity: R,
    /// Variances along x and y, in px².
    pub variance: [R; 2],
}

/// Gradient of a [`Splat`].
#[derive(Clone, Copy, Debug)]
pub struct SplatGrad<R> {
    /// Gradient of the centre.
    pub mean2d: [R; 2],
    /// Gradient of the root of the conic.
    pub root_conic: [R; 3],
    /// Gradient of the depth.
    pub depth: R,
    /// Gradient of the opacity.
    pub opacity: R,
}

/// √(½ log₂ e), the scale of the root of the conic that makes the falloff a power of two.
pub const ROOT_SCALE: f32 = 0.849_321_8;

/// Splat for compositing: its strength at an offset δ is 2^(log₂ opacity − |W' δ|²).
#[derive(Clone, Copy, Debug)]
pub struct Splat2d<R> {
    /// Centre, in pixels.
    pub mean2d: [R; 2],
    /// W' = [`ROOT_SCALE`] · W, in 1/px.
    pub root: [R; 3],
    /// Logarithm of the opacity to base two.
    pub log2_opacity: R,
}

impl<R: Real> Splat2d<R> {
    /// Scales the root of the conic of a splat with this centre and log₂ opacity.
    #[inline(always)]
    pub fn new(mean2d: [R; 2], root_conic: [R; 3], log2_opacity: R) -> Self {
        let [xx, yx, yy] = root_conic;
        Self { mean2d, root: [xx * ROOT_SCALE, yx * ROOT_SCALE, yy * ROOT_SCALE], log2_opacity }
    }
}

/// Footprint of a splat: the ellipse |W δ| ≤ `reach` around its mean, with the smallest drawn alpha
/// at its edge ([`crate::cutoffs`]).
#[derive(Clone, Copy, Debug)]
pub struct Footprint<R> {
    /// Centre, in pixels.
    pub mean2d: [R; 2],
    /// Root of the conic.
    pub root_conic: [R; 3],
    /// √(2 ln(opacity / least alpha)), in standard deviations; negative if nothing is drawn.
    pub reach: R,
}

/// Outline of a footprint, a x² + 2 b x y + c y² = reach² around its centre, prepared for bands
/// of y.
#[derive(Clone, Copy, Debug)]
pub struct Outline<R> {
    /// Centre, in pixels.
    pub center: [R; 2],
    /// −b / a: the shift of the outline's middle along x for each pixel of y.
    pub slope: R,
    /// reach² / a and (a c − b²) / a²: the half width at y is √(first − second · y²).
    pub half_width: [R; 2],
    /// y of the rightmost point; that of the leftmost is its negative.
    pub extreme_y: R,
    /// Largest y; NaN or infinite if the outline is not an ellipse in `f32`.
    pub reach_y: R,
}
