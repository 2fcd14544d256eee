//! One compositing step: a splat over a pixel (paper, eq. C).
//!
//! C = Σ cᵢ αᵢ Tᵢ with Tᵢ = Π_{j<i} (1 − αⱼ), front to back. A pixel ends before the splat that
//! would reduce its transmittance below [`crate::cutoffs::TRANSMITTANCE_MIN`]: the splats behind
//! have no weight, and the previous transmittance is used for the background.
//!
//! All channels are composited in one pass: colour, normal, depth and |Δn|² (8 channels; 12 with
//! tint and roughness, for light per pixel), or all layers of a picture (24). Pictures of only
//! colours blend the inputs of the light lookup (10 channels, without depth and |Δn|²), or only
//! colours (3). The backward pass replays splats front to back with the product of the pixel's
//! gradient and all splats behind, so a channel costs two multiply-adds.
//!
//! A pixel of two splats, the nearer first. Callers skip splats whose depth is −1
//! ([`crate::splat::Splat`]); the splats of a pixel are those that [`mod@crate::bin`] finds.
//!
//! ```
//! use specula_core::{
//!     blend::{self, PixelState},
//!     splat::Splat2d,
//! };
//!
//! // Round splats with a standard deviation of 2 px: centre, opacity, grey.
//! let splats = [([5.0_f32, 4.5], 0.5_f32, 1.0), ([4.5, 4.5], 0.8, 0.25)];
//! let pixel = [4.5, 4.5];
//! let (mut state, mut color) = (PixelState::open(1.0), 0.0);
//! for (mean2d, opacity, grey) in splats {
//!     let splat = Splat2d::new(mean2d, [0.5, 0.0, 0.5], opacity.log2());
//!     let falloff = blend::falloff(&splat, pixel[0] - mean2d[0], pixel[1] - mean2d[1]);
//!     let step = blend::step(blend::alpha(falloff.log2_strength), state);
//!     color += step.weight * grey;
//!     state = step.behind;
//! }
//! let front = 0.5 * (-0.5_f32 * 0.25 * 0.25).exp();
//! assert!((color - (front + (1.0 - front) * 0.8 * 0.25)).abs() < 1e-6);
//! assert!((state.final_transmittance - (1.0 - front) * 0.2).abs() < 1e-6);
//! ```

use crate::{
    cutoffs::Cutoffs,
    real::Real,
    splat::{ROOT_SCALE, Splat2d, SplatGrad},
};

/// Largest alpha of a splat, so that the light behind it, and its gradient, can be recovered.
pub const MAX_ALPHA: f32 = 0.99;

/// log₂ of [`MAX_ALPHA`].
const LOG2_MAX_ALPHA: f32 = -0.014_499_57;

/// Splat at one pixel.
#[derive(Clone, Copy, Debug)]
pub struct Falloff<R> {
    /// Scaled W δ.
    pub offset: [R; 2],
    /// log₂ of the strength, opacity · exp(−½ |W δ|²), before it is clamped.
    pub log2_strength: R,
}

/// Strength of a splat at the offset δ = pixel centre − mean.
#[inline(always)]
pub fn falloff<R: Real>(splat: &Splat2d<R>, dx: R, dy: R) -> Falloff<R> {
    let offset = scaled_offset(splat, dx, dy);
    Falloff { offset, log2_strength: log2_strength(splat.log2_opacity, offset) }
}

/// Scaled W δ.
#[inline(always)]
pub fn scaled_offset<R: Real>(splat: &Splat2d<R>, dx: R, dy: R) -> [R; 2] {
    let [xx, yx, yy] = splat.root;
    [xx * dx, yx.mul_add(dx, yy * dy)]
}

/// Scaled W δ of the origin of pixel coordinates, −W mean.
#[inline(always)]
pub fn offset_of_origin<R: Real>(splat: &Splat2d<R>) -> [R; 2] {
    let [x, y] = splat.mean2d;
    scaled_offset(splat, -x, -y)
}

/// Scaled W δ of a pixel: it is linear in the pixel, so W p is added to the origin's.
#[inline(always)]
pub fn offset_from<R: Real>(at_origin: [R; 2], [xx, yx, yy]: [R; 3], [x, y]: [R; 2]) -> [R; 2] {
    [xx.mul_add(x, at_origin[0]), yx.mul_add(x, yy.mul_add(y, at_origin[1]))]
}

/// log₂ (opacity · 2^(−|W δ|²)) at a scaled offset; opacities are at most one.
#[inline(always)]
pub fn log2_strength<R: Real>(log2_opacity: R, [u, w]: [R; 2]) -> R {
    (-w).mul_add(w, (-u).mul_add(u, log2_opacity))
}

/// Alpha test of a splat's log₂ strength ([`Cutoffs::passes_alpha_test`]).
#[inline(always)]
pub fn passes_alpha_test<R: Real>(log2_strength: R) -> R::Mask {
    Cutoffs::DEFAULT.passes_alpha_test(log2_strength)
}

/// Conservative overlap test of a splat with a box of offsets from its mean, `dx[0]` ≤ δx ≤ `dx[1]`
/// and likewise δy. A negative answer is certain: |W δ| is bounded by the box around the image of
/// the box.
#[inline(always)]
pub fn may_overlap<R: Real>(splat: &Splat2d<R>, dx: [R; 2], dy: [R; 2]) -> R::Mask {
    Cutoffs::DEFAULT.may_overlap_column(splat, &column_of(splat, dx), dy)
}

/// Bounds of a splat in a column of boxes, between the same bounds of δx.
#[derive(Clone, Copy, Debug)]
pub struct Column<R> {
    /// log₂ of the largest strength in the column, bounded by u.
    most: R,
    /// Bounds of the contribution of δx to w.
    slant: [R; 2],
}

/// A splat between two bounds of δx; see [`Cutoffs::may_overlap_column`].
#[inline(always)]
pub fn column_of<R: Real>(splat: &Splat2d<R>, dx: [R; 2]) -> Column<R> {
    let [xx, yx, _] = splat.root;
    let slant = [yx * dx[0], yx * dx[1]];
    let u = distance_to_zero(xx * dx[0], xx * dx[1]);
    Column { most: (-u).mul_add(u, splat.log2_opacity), slant: [slant[0].min(slant[1]), slant[0].max(slant[1])] }
}

/// Lower bound of the scaled |W δ|² in a box of offsets.
#[inline(always)]
pub(crate) fn least_squared<R: Real>(splat: &Splat2d<R>, dx: [R; 2], dy: [R; 2]) -> R {
    let [xx, yx, yy] = splat.root;
    let slant = [yx * dx[0], yx * dx[1]];
    let u = distance_to_zero(xx * dx[0], xx * dx[1]);
    let (low, high) = (slant[0].min(slant[1]), slant[0].max(slant[1]));
    let w = distance_to_zero(yy.mul_add(dy[0], low), yy.mul_add(dy[1], high));
    u.mul_add(u, w * w)
}

/// Smallest |x| between two numbers.
#[inline(always)]
fn distance_to_zero<R: Real>(low: R, high: R) -> R {
    low.max(-high).max(low.zero())
}

/// Alpha of a splat in a pixel: its strength, at most [`MAX_ALPHA`]; zero below 1/255.
#[inline(always)]
pub fn alpha<R: Real>(log2_strength: R) -> R {
    Cutoffs::DEFAULT.alpha(log2_strength)
}

/// State of a pixel between two splats, front to back.
#[derive(Clone, Copy, Debug)]
pub struct PixelState<R> {
    /// Transmittance in front of the next splat. It decreases monotonically: below
    /// [`crate::cutoffs::TRANSMITTANCE_MIN`] the pixel has ended.
    pub transmittance: R,
    /// Transmittance of the picture: that of an active pixel, and the last one of a pixel that has
    /// ended.
    pub final_transmittance: R,
}

impl<R: Real> PixelState<R> {
    /// State before the first splat.
    #[inline(always)]
    pub fn open(like: R) -> Self {
        Self { transmittance: like.constant(1.0), final_transmittance: like.constant(1.0) }
    }
}

/// Tests whether a pixel with this transmittance takes further splats.
#[inline(always)]
pub fn is_active<R: Real>(transmittance: R) -> R::Mask {
    Cutoffs::DEFAULT.is_active(transmittance)
}

/// Tests whether a splat has the median depth of a pixel: in front of it passes more than half of
/// the light, and behind it half or less. Unlike the mean depth it is that of a splat, and not
/// between two surfaces.
#[inline(always)]
pub fn is_median<R: Real>(in_front: R, behind: R) -> R::Mask {
    let half = in_front.constant(0.5);
    half.less(in_front) & behind.less_or_equal(half)
}

/// Contribution of one splat to a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Composite<R> {
    /// α T: the splat's weight; zero if the pixel ends here or has ended.
    pub weight: R,
    /// State of the pixel behind the splat.
    pub behind: PixelState<R>,
}

/// Composites one splat over a pixel.
#[inline(always)]
pub fn step<R: Real>(alpha: R, front: PixelState<R>) -> Composite<R> {
    Cutoffs::DEFAULT.step(alpha, front)
}

/// Formulas that depend on the cutoffs.
impl Cutoffs {
    /// [`may_overlap`] in a box of a column.
    #[inline(always)]
    pub fn may_overlap_column<R: Real>(&self, splat: &Splat2d<R>, column: &Column<R>, dy: [R; 2]) -> R::Mask {
        let [_, _, yy] = splat.root;
        let w = distance_to_zero(yy.mul_add(dy[0], column.slant[0]), yy.mul_add(dy[1], column.slant[1]));
        self.may_pass_alpha_test((-w).mul_add(w, column.most))
    }
    /// Alpha of a splat in a pixel: its strength, at most [`MAX_ALPHA`]; zero if it fails the alpha
    /// test, which uses the logarithm and so does not wait for its power.
    #[inline(always)]
    pub fn alpha<R: Real>(&self, log2_strength: R) -> R {
        let strength = log2_strength.exp2_of_small();
        strength.min(strength.constant(MAX_ALPHA)).keep(self.passes_alpha_test(log2_strength))
    }
    /// Composites one splat over a pixel.
    #[inline(always)]
    pub fn step<R: Real>(&self, alpha: R, front: PixelState<R>) -> Composite<R> {
        let transmittance = transmittance_behind(alpha, front.transmittance);
        let is_active = self.is_active(transmittance);
        Composite {
            weight: (alpha * front.transmittance).keep(is_active),
            behind: PixelState {
                transmittance,
                final_transmittance: R::select(is_active, transmittance, front.final_transmittance),
            },
        }
    }
}

/// (1 − α) T, in one operation: the dependency chain of a pixel from one splat to the next.
#[inline(always)]
fn transmittance_behind<R: Real>(alpha: R, transmittance: R) -> R {
    (-alpha).mul_add(transmittance, transmittance)
}

/// State of a pixel in the backward pass, which replays its splats front to back.
#[derive(Clone, Copy, Debug)]
pub struct Replay<R> {
    /// Transmittance in front of the splat; zero once the pixel has ended.
    pub transmittance: R,
    /// Σ_{k ≥ i} wₖ (cₖ · g) + T_final g_T: the gradient's product with the remaining splats.
    pub remaining: R,
}

/// Gradient of one splat at a pixel.
#[derive(Clone, Copy, Debug)]
pub struct StepGrad<R> {
    /// Gradient of the logarithm of the splat's strength.
    pub log_strength: R,
    /// The splat's weight, as in [`Composite`]: times the pixel's gradient, it is that of the
    /// splat's channels.
    pub weight: R,
    /// The pixel behind it.
    pub behind: Replay<R>,
}

/// Gradient of one step.
///
/// `color_dot_grad` is the splat's channels times the pixel's gradients. Of ∂C/∂αᵢ = Tᵢ cᵢ −
/// Σ_{k>i} wₖ cₖ / (1 − αᵢ) only the product with the gradient is needed, so channels cost nothing
/// here. If alpha is clamped, the strength has no effect and the gradient is zero.
#[inline(always)]
pub fn step_vjp<R: Real>(log2_strength: R, front: Replay<R>, color_dot_grad: R) -> StepGrad<R> {
    let alpha = alpha(log2_strength);
    let transmittance = transmittance_behind(alpha, front.transmittance);
    let is_active = is_active(transmittance);
    let weight = (alpha * front.transmittance).keep(is_active);
    let transmittance = transmittance.keep(is_active);
    let remaining = (-weight).mul_add(color_dot_grad, front.remaining);
    let grad_alpha = front.transmittance * color_dot_grad - remaining / (-alpha + 1.0);
    let is_free = log2_strength.less(log2_strength.constant(LOG2_MAX_ALPHA)) & weight.zero().less(weight);
    StepGrad { log_strength: (grad_alpha * alpha).keep(is_free), weight, behind: Replay { transmittance, remaining } }
}

/// Sums over the pixels of a splat, from which its gradient follows. `h` is the gradient of ln
/// strength, (u, w) the scaled offset.
#[derive(Clone, Copy, Debug)]
pub struct OffsetMoments<R> {
    /// Σ h u, Σ h w.
    pub first: [R; 2],
    /// Σ h u², Σ h u w, Σ h w².
    pub second: [R; 3],
    /// Σ h.
    pub sum: R,
}

impl<R: Real> OffsetMoments<R> {
    /// Moments over no pixels.
    #[inline(always)]
    pub fn zero(like: R) -> Self {
        let zero = like.zero();
        Self { first: [zero; 2], second: [zero; 3], sum: zero }
    }
    /// Adds one more pixel.
    #[must_use]
    #[inline(always)]
    pub fn with(self, h: R, [u, w]: [R; 2]) -> Self {
        let (hu, hw) = (h * u, h * w);
        Self {
            first: [self.first[0] + hu, self.first[1] + hw],
            second: [hu.mul_add(u, self.second[0]), hw.mul_add(u, self.second[1]), hw.mul_add(w, self.second[2])],
            sum: self.sum + h,
        }
    }
}

/// The gradient of a splat's centre from its first moments, over all pixels or in one.
#[inline(always)]
pub fn center_vjp<R: Real>(splat: &Splat2d<R>, [u, w]: [R; 2]) -> [R; 2] {
    let [xx, yx, yy] = splat.root;
    let twice_ln_2 = u.constant(4.0).ln();
    [(xx * u + yx * w) * twice_ln_2, yy * w * twice_ln_2]
}

/// The gradient of a splat from its moments; offsets follow from δx = u / W_xx and δy = (w − W_yx
/// δx) / W_yy. The depth has no gradient: compositing does not read it.
#[inline(always)]
pub fn moments_vjp<R: Real>(splat: &Splat2d<R>, opacity: R, moments: &OffsetMoments<R>) -> SplatGrad<R> {
    let [xx, yx, yy] = splat.root;
    let [uu, uw, ww] = moments.second;
    let w_dx = uw / xx;
    let scale = uu.constant(4.0).ln() * -ROOT_SCALE;
    SplatGrad {
        mean2d: center_vjp(splat, moments.first),
        root_conic: [uu / xx * scale, w_dx * scale, (ww - yx * w_dx) / yy * scale],
        depth: uu.zero(),
        opacity: moments.sum / opacity,
    }
}
