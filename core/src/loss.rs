//! Losses of training: colour, structure, normals, sparsity, size of residuals (paper, section
//! 3.4).

use crate::{
    activation::{sigmoid, sigmoid_vjp, softplus},
    depth_normal::{Cross, normal, normal_vjp},
    normal::RESIDUAL_MAX,
    real::Real,
    shade::ShadingForm,
    vector::{Mat3, Vec3},
};

/// Pixels along an edge of the window of SSIM.
pub const SSIM_WINDOW: usize = 11;
/// Standard deviation of the window of SSIM, in pixels.
const SSIM_SIGMA: f32 = 1.5;
const SSIM_C1: f32 = 0.01 * 0.01;
const SSIM_C2: f32 = 0.03 * 0.03;

/// Weights of one row of SSIM's window, summing to one: a Gaussian at −5…5 pixels.
pub fn ssim_window() -> [f32; SSIM_WINDOW] {
    let middle = (SSIM_WINDOW / 2) as f64;
    let sigma = f64::from(SSIM_SIGMA);
    let at = |k: usize| crate::math::exp64(-(k as f64 - middle) * (k as f64 - middle) / (2.0 * sigma * sigma));
    let sum: f64 = (0..SSIM_WINDOW).map(at).sum();
    core::array::from_fn(|k| (at(k) / sum) as f32)
}

/// The window's weights times the numbers at its taps. The window is symmetric: taps at the same
/// distance from its middle are added first.
#[inline(always)]
pub fn window_mean<R: Real>(window: &[R; SSIM_WINDOW], tap: impl Fn(usize) -> R) -> R {
    const REACH: usize = SSIM_WINDOW / 2;
    let mut sum = tap(REACH) * window[REACH];
    for k in 0..REACH {
        sum = (tap(k) + tap(SSIM_WINDOW - 1 - k)).mul_add(window[k], sum);
    }
    sum
}

/// |x − y|.
#[inline(always)]
pub fn absolute<R: Real>(x: R, y: R) -> R {
    (x - y).abs()
}

/// Gradient of [`absolute`] with respect to `x`; zero where both are equal.
#[inline(always)]
pub fn absolute_vjp<R: Real>(x: R, y: R, grad: R) -> R {
    R::select(y.less(x), grad, (-grad).keep(x.less(y)))
}

/// (x − y)².
#[inline(always)]
pub fn squared<R: Real>(x: R, y: R) -> R {
    (x - y).squared()
}

/// Gradient of [`squared`] with respect to `x`.
#[inline(always)]
pub fn squared_vjp<R: Real>(x: R, y: R, grad: R) -> R {
    (x - y) * grad * 2.0
}

/// Smallest number of a true picture that counts as white: it rounds to the largest byte.
const WHITE_MIN: f32 = 254.5 / 255.0;

/// Rendered number as recorded in a picture, for a true number in a pixel of this alpha, both over
/// the background: min(x, 1) if the true number is white and its pixel opaque.
///
/// A picture records no radiance above white, so any larger rendered radiance agrees with it. If
/// the true pixel is darker, or shows the background, the rendered number is unchanged.
#[inline(always)]
pub fn recorded<R: Real>(rendered: R, truth: R, alpha: R) -> R {
    let least = rendered.constant(WHITE_MIN);
    let is_white = least.less_or_equal(truth) & least.less_or_equal(alpha);
    R::select(is_white, rendered.min(rendered.constant(1.0)), rendered)
}

/// Gradient of [`recorded`], from its value and the true number: zero if both are white.
#[inline(always)]
pub fn recorded_vjp<R: Real>(recorded: R, truth: R, grad: R) -> R {
    let white = recorded.constant(1.0);
    let differs = recorded.less(white) | white.less(recorded);
    grad.keep(differs | truth.less(truth.constant(WHITE_MIN)))
}

/// Scale by which losses compare the numbers of a picture without a limit at white, and by which
/// the gradient of the rendered one is multiplied: 1 / max(y, 1) for a true number y, so that
/// differences above white are relative. Highlights would outweigh all else otherwise.
#[inline(always)]
pub fn unclipped_scale<R: Real>(truth: R) -> R {
    truth.max(truth.constant(1.0)).recip()
}

/// Meaning of white in a true picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum White {
    /// A number like any other.
    Exact,
    /// Any radiance from white on ([`recorded`]).
    Saturated,
    /// A number below brighter ones ([`unclipped_scale`]).
    Unclipped,
}

impl White {
    /// Rendered and true number as losses compare them, for a true number in a pixel of this alpha,
    /// both over the background.
    #[inline(always)]
    pub fn compared<R: Real>(self, rendered: R, truth: R, alpha: R) -> [R; 2] {
        match self {
            Self::Exact => [rendered, truth],
            Self::Saturated => [recorded(rendered, truth, alpha), truth],
            Self::Unclipped => [rendered, truth].map(|number| number * unclipped_scale(truth)),
        }
    }
}

/// Windowed means for SSIM.
#[derive(Clone, Copy, Debug)]
pub struct SsimMoments<R> {
    /// E\[x\].
    pub x: R,
    /// E\[y\].
    pub y: R,
    /// E\[x²\].
    pub xx: R,
    /// E\[y²\].
    pub yy: R,
    /// E\[xy\].
    pub xy: R,
}

impl<R: Real> SsimMoments<R> {
    /// Quantities with windowed means in SSIM: x, y, x² + y², xy. Only the sum of the squares is
    /// needed.
    #[inline(always)]
    pub fn products(x: R, y: R) -> [R; 4] {
        [x, y, x.mul_add(x, y * y), x * y]
    }
    /// Moments from the means of [`SsimMoments::products`]; all squares are in `xx`.
    #[inline(always)]
    pub fn of_means([x, y, squares, xy]: [R; 4]) -> Self {
        Self { x, y, xx: squares, yy: x.zero(), xy }
    }
}

/// Structural similarity of two windows (Wang et al. 2004, eq. 13), in \[−1, 1\]; 1 for equal
/// windows.
#[inline(always)]
pub fn ssim<R: Real>(m: &SsimMoments<R>) -> R {
    let (luminance, contrast) = ssim_parts(m);
    (luminance[0] * contrast[0]) / (luminance[1] * contrast[1])
}

/// Gradient of [`ssim`] with respect to E\[x\], E\[x²\] and E\[xy\].
#[inline(always)]
pub fn ssim_vjp<R: Real>(m: &SsimMoments<R>, grad: R) -> [R; 3] {
    let (luminance, contrast) = ssim_parts(m);
    let below = (luminance[1] * contrast[1]).recip();
    let value = luminance[0] * contrast[0] * below;

    let grad_xy = grad * luminance[0] * below * 2.0;
    let grad_xx = -grad * value / contrast[1];
    let through_mean = (m.y * contrast[0] * below - m.x * value / luminance[1]) * 2.0 * grad;
    [through_mean - grad_xy * m.y - grad_xx * m.x * 2.0, grad_xx, grad_xy]
}

/// Gradient with respect to x of one pixel, from the gradients of E\[x\], E\[x²\] and E\[xy\] of
/// all windows that contain it, each times the pixel's weight.
#[inline(always)]
pub fn ssim_pixel_vjp<R: Real>(x: R, y: R, [grad_x, grad_xx, grad_xy]: [R; 3]) -> R {
    let through_squares = x * 2.0 * grad_xx + y * grad_xy;
    grad_x + through_squares
}

/// Numerator and denominator of the luminance term and of the contrast and structure term.
#[inline(always)]
fn ssim_parts<R: Real>(m: &SsimMoments<R>) -> ([R; 2], [R; 2]) {
    let covariance = m.xy - m.x * m.y;
    let variances = (m.xx - m.x * m.x) + (m.yy - m.y * m.y);
    ([m.x * m.y * 2.0 + SSIM_C1, m.x * m.x + m.y * m.y + SSIM_C1], [covariance * 2.0 + SSIM_C2, variances + SSIM_C2])
}

/// |n̄ − n̂|²: rendered normal against the geometry's (paper, eq. L_normal).
#[inline(always)]
pub fn normal_distance<R: Real>(rendered: Vec3<R>, geometric: Vec3<R>) -> R {
    (rendered - geometric).length_squared()
}

/// Gradient of [`normal_distance`] with respect to the rendered normal; that of the geometric one
/// is its negative.
#[inline(always)]
pub fn normal_distance_vjp<R: Real>(rendered: Vec3<R>, geometric: Vec3<R>, grad: R) -> Vec3<R> {
    (rendered - geometric) * (grad * 2.0)
}

/// 1 − n̄ · n̂: the authors' code's form of the normal loss.
#[inline(always)]
pub fn normal_cosine<R: Real>(rendered: Vec3<R>, geometric: Vec3<R>) -> R {
    -rendered.dot(geometric) + 1.0
}

/// Gradient of [`normal_cosine`] with respect to the rendered normal and the geometric one.
#[inline(always)]
pub fn normal_cosine_vjp<R: Real>(rendered: Vec3<R>, geometric: Vec3<R>, grad: R) -> (Vec3<R>, Vec3<R>) {
    (geometric * -grad, rendered * -grad)
}

/// ln o + ln(1 − o) of an opacity o = σ(x), from its logit x: −softplus(−x) − softplus(x) (paper,
/// eq. L_sparse). Finite for every finite x.
#[inline(always)]
pub fn sparse<R: Real>(opacity_logit: R) -> R {
    -(softplus(opacity_logit) + softplus(-opacity_logit))
}

/// Gradient of [`sparse`]: 1 − 2σ(x); zero for numbers that are not finite.
#[inline(always)]
pub fn sparse_vjp<R: Real>(opacity_logit: R, grad: R) -> R {
    (grad * (sigmoid(opacity_logit) * -2.0 + 1.0)).keep(opacity_logit.is_finite())
}

/// Gradient of the square of a number of a normal residual, times half of `grad`: x g, with x
/// within ± [`RESIDUAL_MAX`]; zero for numbers that are not finite.
#[inline(always)]
pub fn residual_vjp<R: Real>(number: R, grad: R) -> R {
    (number.clamp(-RESIDUAL_MAX, RESIDUAL_MAX) * grad).keep(number.is_finite())
}

/// (m − g)² of a metalness m = σ(x), from its logit x, and the share g of metal suggested by other
/// attributes ([`crate::physical::metal_share`]), which is held fixed.
#[inline(always)]
pub fn metalness<R: Real>(logit: R, suggested: R) -> R {
    let apart = sigmoid(logit) - suggested;
    apart * apart
}

/// Gradient of [`metalness`] with respect to the logit: 2 (m − g) m (1 − m); zero where a number is
/// not finite.
#[inline(always)]
pub fn metalness_vjp<R: Real>(logit: R, suggested: R, grad: R) -> R {
    let value = sigmoid(logit);
    let slope = sigmoid_vjp(value, (value - suggested) * 2.0 * grad);
    slope.keep(logit.is_finite() & suggested.is_finite())
}

/// Coverage is kept this far from 0 and 1 in [`sparse_coverage`].
const COVERAGE_MARGIN: f32 = 1e-3;

/// ln A + ln(1 − A) of a pixel's coverage, limited: the authors' code's form of the sparse loss.
#[inline(always)]
pub fn sparse_coverage<R: Real>(coverage: R) -> R {
    let a = coverage.clamp(COVERAGE_MARGIN, 1.0 - COVERAGE_MARGIN);
    a.ln() + (-a + 1.0).ln()
}

/// Gradient of [`sparse_coverage`]; zero where the coverage was limited.
#[inline(always)]
pub fn sparse_coverage_vjp<R: Real>(coverage: R, grad: R) -> R {
    let a = coverage.clamp(COVERAGE_MARGIN, 1.0 - COVERAGE_MARGIN);
    let is_free =
        coverage.constant(COVERAGE_MARGIN).less(coverage) & coverage.less(coverage.constant(1.0 - COVERAGE_MARGIN));
    (grad * (a.recip() - (-a + 1.0).recip())).keep(is_free)
}

/// Distance between rendered and geometric normals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NormalForm {
    /// [`normal_distance`], with gradients to the normals and to the depth (the paper).
    Distance,
    /// [`normal_cosine`], with the geometric normal held fixed (the authors' code).
    CosineDetached,
    /// [`normal_cosine`], with gradients to both.
    Cosine,
}

/// Inputs of the normal loss at a pixel.
#[derive(Clone, Copy, Debug)]
pub struct NormalPatch<R> {
    /// Camera-space rays through the four neighbours, with z = 1.
    pub rays: Cross<Vec3<R>>,
    /// Expected depths of the neighbours.
    pub depths: Cross<R>,
    /// The rendered normal in world space, premultiplied by coverage.
    pub rendered: Vec3<R>,
    /// The pixel's coverage.
    pub coverage: R,
}

/// Value of the normal loss and its gradients with respect to the rendered normal and the
/// neighbours' depths.
#[inline(always)]
pub fn normal_loss<R: Real>(
    form: NormalForm,
    camera_from_world: &Mat3<R>,
    patch: &NormalPatch<R>,
    grad: R,
) -> (R, Vec3<R>, Cross<R>) {
    let NormalPatch { rays, depths, rendered, coverage } = patch;
    let geometric = camera_from_world.transform_transposed(normal(rays, depths));
    let (value, grad_rendered, grad_geometric) =
        compare_normals(form, *rendered, geometric * *coverage, *coverage, grad);
    let grad_depths = normal_vjp(rays, depths, camera_from_world.transform(grad_geometric * *coverage));
    (value, grad_rendered, grad_depths)
}

/// Value of the normal loss and its gradients with respect to the rendered normal and the geometric
/// one, both premultiplied by coverage.
#[inline(always)]
fn compare_normals<R: Real>(
    form: NormalForm,
    rendered: Vec3<R>,
    geometric: Vec3<R>,
    coverage: R,
    grad: R,
) -> (R, Vec3<R>, Vec3<R>) {
    match form {
        NormalForm::Distance => {
            let grad_rendered = normal_distance_vjp(rendered, geometric, grad);
            (normal_distance(rendered, geometric), grad_rendered, -grad_rendered)
        }
        NormalForm::Cosine | NormalForm::CosineDetached => {
            let unit = geometric / coverage;
            let (grad_rendered, grad_unit) = normal_cosine_vjp(rendered, unit, grad);
            let kept = if form == NormalForm::Cosine { grad_unit / coverage } else { Vec3::zero(grad) };
            (normal_cosine(rendered, unit), grad_rendered, kept)
        }
    }
}

/// Weight of each loss; those up to the coverage are means over the pixels of a picture, the others
/// over the Gaussians.
#[derive(Clone, Copy, PartialEq)]
pub struct LossWeights {
    /// Weight of |C − C_gt|.
    pub absolute: f32,
    /// Weight of (C − C_gt)².
    pub squared: f32,
    /// Weight of 1 − SSIM.
    pub dssim: f32,
    /// Weight of the normal loss, which is weighted by coverage.
    pub normal: f32,
    /// Form of the normal loss.
    pub normal_form: NormalForm,
    /// Weight of the smoothness of normals ([`mod@crate::smoothness`]); zero for physical materials
    /// ([`LossWeights::of_form`]).
    pub smoothness: f32,
    /// Weight of the sparse loss on the rendered coverage.
    pub sparse_coverage: f32,
    /// Weight of the blended |Δn|², which is weighted by coverage.
    pub residual_image: f32,
    /// Weight of |A − A_gt|, if pictures have an alpha channel.
    pub coverage: f32,
    /// Weight of the sparse loss.
    pub sparse: f32,
    /// Weight of |Δn₁|² + |Δn₂|².
    pub residual: f32,
    /// Weight of [`metalness`], if Gaussians have one.
    pub metalness: f32,
    /// Mean linear radiance of the light, for [`Self::metalness`].
    pub mean_light: f32,
    /// True if true pictures that are clipped saturate at white: losses of colour compare
    /// [`recorded`] numbers.
    pub saturates: bool,
}

/// Prints the losses of metalness and of smoothness only if they have a weight, and saturation only
/// if it is on: checkpoints contain the text of their settings.
impl core::fmt::Debug for LossWeights {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let mut text = out.debug_struct("LossWeights");
        text.field("absolute", &self.absolute).field("squared", &self.squared).field("dssim", &self.dssim);
        text.field("normal", &self.normal).field("normal_form", &self.normal_form);
        text.field("sparse_coverage", &self.sparse_coverage).field("residual_image", &self.residual_image);
        text.field("coverage", &self.coverage).field("sparse", &self.sparse).field("residual", &self.residual);
        if self.smoothness != 0.0 {
            text.field("smoothness", &self.smoothness);
        }
        if self.metalness != 0.0 {
            text.field("metalness", &self.metalness).field("mean_light", &self.mean_light);
        }
        if self.saturates {
            text.field("saturates", &self.saturates);
        }
        text.finish()
    }
}

impl LossWeights {
    /// All losses off.
    pub const NONE: Self = Self {
        absolute: 0.0,
        squared: 0.0,
        dssim: 0.0,
        normal: 0.0,
        normal_form: NormalForm::Distance,
        smoothness: 0.0,
        sparse_coverage: 0.0,
        residual_image: 0.0,
        coverage: 0.0,
        sparse: 0.0,
        residual: 0.0,
        metalness: 0.0,
        mean_light: 0.0,
        saturates: false,
    };

    /// Removes the loss that does not apply to this form: the smoothness of normals for physical
    /// materials, because it is derived from view-dependent colours.
    #[must_use]
    pub fn of_form(self, form: ShadingForm) -> Self {
        Self { smoothness: if form == ShadingForm::Physical { 0.0 } else { self.smoothness }, ..self }
    }

    /// Removes losses without input: the coverage loss unless the true picture has an alpha
    /// channel, the losses of the geometry unless it was blended.
    #[must_use]
    pub fn where_possible(self, has_alpha: bool, has_geometry: bool) -> Self {
        let keep = |weight: f32, is_possible: bool| if is_possible { weight } else { 0.0 };
        Self {
            normal: keep(self.normal, has_geometry),
            smoothness: keep(self.smoothness, has_geometry),
            residual_image: keep(self.residual_image, has_geometry),
            coverage: keep(self.coverage, has_alpha),
            ..self
        }
    }

    /// Meaning of white in a picture that is clipped there or not.
    pub const fn white(&self, is_clipped: bool) -> White {
        match (is_clipped, self.saturates) {
            (false, _) => White::Unclipped,
            (true, true) => White::Saturated,
            (true, false) => White::Exact,
        }
    }
}

/// Values of the losses, as unweighted means.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LossReport {
    /// Weighted sum of the losses below, SSIM as 1 − SSIM.
    pub total: f64,
    /// Mean |C − C_gt|.
    pub absolute: f64,
    /// Mean (C − C_gt)² of the numbers that are compared ([`White`]).
    pub squared: f64,
    /// Mean SSIM.
    pub ssim: f64,
    /// Mean normal loss.
    pub normal: f64,
    /// Mean smoothness loss.
    pub smoothness: f64,
    /// Mean |A − A_gt|.
    pub coverage: f64,
}

impl LossReport {
    /// Sets the total to the weighted sum of the losses.
    #[must_use]
    pub fn with_total(self, weights: &LossWeights) -> Self {
        let total = f64::from(weights.absolute) * self.absolute
            + f64::from(weights.squared) * self.squared
            + f64::from(weights.dssim) * (1.0 - self.ssim)
            + f64::from(weights.normal) * self.normal
            + f64::from(weights.smoothness) * self.smoothness
            + f64::from(weights.coverage) * self.coverage;
        Self { total, ..self }
    }
}
