//! One step of compositing: a splat over what is already in a pixel (paper, eq. C).
//!
//! C = Σ cᵢ αᵢ Tᵢ with Tᵢ = Π_{j<i} (1 − αⱼ), front to back. A pixel ends before the splat that would bring its
//! transmittance below [`TRANSMITTANCE_MIN`]: for the splats behind, its transmittance is zero, and what it had is kept
//! apart, for the background.

use crate::{bin::ALPHA_MIN, project::SplatGrad, real::Real};

/// No splat is more opaque than this, so that the light behind it, and its gradient, can be recovered.
pub const MAX_ALPHA: f32 = 0.99;
/// (1 − MAX_ALPHA)²: two opaque splats end a pixel.
pub const TRANSMITTANCE_MIN: f32 = 1e-4;

/// Less than log₂ of [`ALPHA_MIN`], −7.9943, by more than rounding can make out.
const LOG2_ALPHA_MARGIN: f32 = -8.0;
/// √(½ log₂ e): scales the root of the conic so that the falloff is a power of two.
pub const ROOT_SCALE: f32 = 0.849_321_8;

/// A splat as compositing reads it.
#[derive(Clone, Copy, Debug)]
pub struct Stamp<R> {
    /// Centre, in pixels.
    pub mean2d: [R; 2],
    /// Root of the conic, scaled for powers of two.
    pub root: [R; 3],
    /// Logarithm of the opacity to base two.
    pub log2_opacity: R,
}

/// The stamp of a splat with this centre, root of the conic and logarithm of the opacity to base two.
#[inline(always)]
pub fn stamp<R: Real>(mean2d: [R; 2], root_conic: [R; 3], log2_opacity: R) -> Stamp<R> {
    let [xx, yx, yy] = root_conic;
    Stamp { mean2d, root: [xx * ROOT_SCALE, yx * ROOT_SCALE, yy * ROOT_SCALE], log2_opacity }
}

/// A splat at one pixel.
#[derive(Clone, Copy, Debug)]
pub struct Falloff<R> {
    /// Scaled W δ.
    pub offset: [R; 2],
    /// opacity · exp(−½ |W δ|²), before it is limited.
    pub strength: R,
}

/// A splat's strength at the offset δ = pixel centre − mean.
#[inline(always)]
pub fn falloff<R: Real>(stamp: &Stamp<R>, dx: R, dy: R) -> Falloff<R> {
    let offset = scaled_offset(stamp, dx, dy);
    Falloff { offset, strength: strength(stamp.log2_opacity, offset) }
}

/// Scaled W δ. It is linear in δ, so the offset of one pixel and the step to another add up.
#[inline(always)]
pub fn scaled_offset<R: Real>(stamp: &Stamp<R>, dx: R, dy: R) -> [R; 2] {
    let [xx, yx, yy] = stamp.root;
    [xx * dx, yx.mul_add(dx, yy * dy)]
}

/// opacity · 2^(−|W δ|²) at a scaled offset; opacities are at most one.
#[inline(always)]
pub fn strength<R: Real>(log2_opacity: R, [u, w]: [R; 2]) -> R {
    (-w).mul_add(w, (-u).mul_add(u, log2_opacity)).exp2_of_negative()
}

/// Whether a splat may be seen somewhere in a box of offsets from its mean, `dx[0]` ≤ δx ≤ `dx[1]` and so for δy. It
/// is for sure where this says no: |W δ| is bounded by the box around the image of the box.
#[inline(always)]
pub fn may_be_seen<R: Real>(stamp: &Stamp<R>, dx: [R; 2], dy: [R; 2]) -> R::Mask {
    let [xx, yx, yy] = stamp.root;
    let slant = [yx * dx[0], yx * dx[1]];
    let u = distance_to_zero(xx * dx[0], xx * dx[1]);
    let w = distance_to_zero(yy.mul_add(dy[0], slant[0].min(slant[1])), yy.mul_add(dy[1], slant[0].max(slant[1])));
    let power = (-w).mul_add(w, (-u).mul_add(u, stamp.log2_opacity));
    power.constant(LOG2_ALPHA_MARGIN).less_or_equal(power)
}

/// Smallest |x| between two numbers.
#[inline(always)]
fn distance_to_zero<R: Real>(low: R, high: R) -> R {
    low.max(-high).max(low.zero())
}

/// Alpha of a splat in a pixel: its strength, at most [`MAX_ALPHA`]; zero below 1/255.
#[inline(always)]
pub fn alpha<R: Real>(strength: R) -> R {
    let is_seen = strength.constant(ALPHA_MIN).less_or_equal(strength);
    strength.min(strength.constant(MAX_ALPHA)).keep(is_seen)
}

/// What one splat does to a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Step<R> {
    /// α T: the splat's weight; zero if the pixel ends here or has ended.
    pub weight: R,
    /// Transmittance for the next splat; zero if there is none.
    pub transmittance: R,
    /// Transmittance of a pixel that ends here; else zero.
    pub ended: R,
}

/// One splat over a pixel.
#[inline(always)]
pub fn step<R: Real>(alpha: R, transmittance: R) -> Step<R> {
    let weight = alpha * transmittance;
    let behind = transmittance - weight;
    let goes_on = behind.constant(TRANSMITTANCE_MIN).less_or_equal(behind);
    Step {
        weight: weight.keep(goes_on),
        transmittance: behind.keep(goes_on),
        ended: R::select(goes_on, behind.zero(), transmittance),
    }
}

/// What a pixel knows while its splats are replayed front to back.
#[derive(Clone, Copy, Debug)]
pub struct Replay<R> {
    /// Transmittance in front of the splat; zero once the pixel has ended.
    pub transmittance: R,
    /// Σ_{k ≥ i} wₖ (cₖ · g) + T_final g_T: the gradient's product with all that is still to come.
    pub remaining: R,
}

/// Gradient of one step with respect to the logarithm of the splat's strength, and the pixel behind it.
///
/// `color_dot_grad` is the splat's channels times the pixel's gradients. Of ∂C/∂αᵢ = Tᵢ cᵢ − Σ_{k>i} wₖ cₖ / (1 − αᵢ)
/// only the product with the gradient is needed, so channels cost nothing here. Where alpha was limited the strength
/// has no influence, and the gradient is zero.
#[inline(always)]
pub fn step_vjp<R: Real>(strength: R, replay: Replay<R>, color_dot_grad: R) -> (R, Step<R>, Replay<R>) {
    let alpha = alpha(strength);
    let step = step(alpha, replay.transmittance);
    let remaining = replay.remaining - step.weight * color_dot_grad;
    let grad_alpha = replay.transmittance * color_dot_grad - remaining / (-alpha + 1.0);
    let is_free = strength.less(strength.constant(MAX_ALPHA)) & strength.zero().less(step.weight);
    ((grad_alpha * alpha).keep(is_free), step, Replay { transmittance: step.transmittance, remaining })
}

/// Sums over the pixels of a splat, from which its gradient follows. `h` is the gradient of ln strength, (u, w) the
/// scaled offset.
#[derive(Clone, Copy, Debug)]
pub struct Moments<R> {
    /// Σ h u, Σ h w.
    pub first: [R; 2],
    /// Σ h u², Σ h u w, Σ h w².
    pub second: [R; 3],
    /// Σ h.
    pub sum: R,
}

impl<R: Real> Moments<R> {
    /// No pixels.
    #[inline(always)]
    pub fn zero(like: R) -> Self {
        let zero = like.zero();
        Self { first: [zero; 2], second: [zero; 3], sum: zero }
    }
    /// With one more pixel.
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

/// The gradient of a splat from its moments; offsets follow from δx = u / W_xx and δy = (w − W_yx δx) / W_yy. The depth
/// gets none: compositing does not read it.
#[inline(always)]
pub fn moments_vjp<R: Real>(stamp: &Stamp<R>, opacity: R, moments: &Moments<R>) -> SplatGrad<R> {
    let [xx, yx, yy] = stamp.root;
    let ([u, w], [uu, uw, ww]) = (moments.first, moments.second);
    let twice_ln_2 = u.constant(4.0).ln();
    let w_dx = uw / xx;
    let scale = twice_ln_2 * -ROOT_SCALE;
    SplatGrad {
        mean2d: [(xx * u + yx * w) * twice_ln_2, yy * w * twice_ln_2],
        root_conic: [uu / xx * scale, w_dx * scale, (ww - yx * w_dx) / yy * scale],
        depth: u.zero(),
        opacity: moments.sum / opacity,
    }
}
