//! One step of compositing: a splat over what is already in a pixel (paper, eq. C).
//!
//! C = Σ cᵢ αᵢ Tᵢ with Tᵢ = Π_{j<i} (1 − αⱼ), front to back. A pixel ends before the splat that would bring its
//! transmittance below [`TRANSMITTANCE_MIN`]; it then keeps its transmittance with a minus sign, so that one number
//! holds both.

use crate::{bin::ALPHA_MIN, project::SplatGrad, real::Real};

/// No splat is more opaque than this, so that the light behind it, and its gradient, can be recovered.
pub const MAX_ALPHA: f32 = 0.99;
/// (1 − MAX_ALPHA)²: two opaque splats end a pixel.
pub const TRANSMITTANCE_MIN: f32 = 1e-4;

/// Less than log₂ of [`ALPHA_MIN`], −7.9943, by more than rounding can make out.
const LOG2_ALPHA_MARGIN: f32 = -8.0;
/// √(½ log₂ e): scales the root of the conic so that the falloff is a power of two.
const ROOT_SCALE: f32 = 0.849_321_8;

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
    let [xx, yx, yy] = stamp.root;
    let u = xx * dx;
    let w = yx.mul_add(dx, yy * dy);
    let power = (-w).mul_add(w, (-u).mul_add(u, stamp.log2_opacity));
    Falloff { offset: [u, w], strength: power.exp2() }
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

/// Alpha of a splat in a pixel: its strength, at most [`MAX_ALPHA`]; zero below 1/255 and in a finished pixel.
#[inline(always)]
pub fn alpha<R: Real>(strength: R, transmittance: R) -> R {
    let is_seen = strength.constant(ALPHA_MIN).less_or_equal(strength) & strength.zero().less(transmittance);
    strength.min(strength.constant(MAX_ALPHA)).keep(is_seen)
}

/// Weight of a splat in a pixel, and the pixel's transmittance behind it.
#[derive(Clone, Copy, Debug)]
pub struct Step<R> {
    /// α T; zero if the pixel ends here.
    pub weight: R,
    /// Transmittance for the next splat; negative once the pixel has ended.
    pub transmittance: R,
}

/// One splat over a pixel.
#[inline(always)]
pub fn step<R: Real>(alpha: R, transmittance: R) -> Step<R> {
    let weight = alpha * transmittance;
    let behind = transmittance - weight;
    let ends = behind.less(behind.constant(TRANSMITTANCE_MIN)) & behind.zero().less(alpha);
    Step { weight: R::select(ends, behind.zero(), weight), transmittance: R::select(ends, -transmittance, behind) }
}

/// What a pixel knows while its splats are replayed front to back.
#[derive(Clone, Copy, Debug)]
pub struct Replay<R> {
    /// Transmittance in front of the splat; negative once the pixel has ended.
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
    let alpha = alpha(strength, replay.transmittance);
    let step = step(alpha, replay.transmittance);
    let remaining = replay.remaining - step.weight * color_dot_grad;
    let grad_alpha = replay.transmittance * color_dot_grad - remaining / (-alpha + 1.0);
    let is_free = strength.less(strength.constant(MAX_ALPHA)) & strength.zero().less(step.weight);
    ((grad_alpha * alpha).keep(is_free), step, Replay { transmittance: step.transmittance, remaining })
}

/// Sums over the pixels of a splat, from which its gradient follows. `h` is the gradient of ln strength.
#[derive(Clone, Copy, Debug)]
pub struct Moments<R> {
    /// Σ h u, Σ h w, with (u, w) the scaled offset.
    pub offset: [R; 2],
    /// Σ h u δx, Σ h w δx, Σ h w δy.
    pub root: [R; 3],
    /// Σ h.
    pub strength: R,
}

/// The gradient of a splat from its moments. The depth gets none: compositing does not read it.
#[inline(always)]
pub fn moments_vjp<R: Real>(stamp: &Stamp<R>, opacity: R, moments: &Moments<R>) -> SplatGrad<R> {
    let [xx, yx, yy] = stamp.root;
    let [u, w] = moments.offset;
    let twice_ln_2 = u.constant(4.0).ln();
    SplatGrad {
        mean2d: [(xx * u + yx * w) * twice_ln_2, yy * w * twice_ln_2],
        root_conic: moments.root.map(|sum| sum * -ROOT_SCALE * twice_ln_2),
        depth: u.zero(),
        opacity: moments.strength / opacity,
    }
}
