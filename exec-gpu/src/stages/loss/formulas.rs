//! Losses on images.

use crate::{
    codegen::formula::{Field, Formula, Inputs, field, formula, variable},
    stages::camera::{camera_fields, take_camera},
};
use specula_core::{
    color::{composite, composite_vjp, from_byte, over},
    depth_normal::{Cross, expected_depth, expected_depth_vjp, is_surface, rays_around, surface_weight},
    loss::{
        NormalForm, NormalPatch, SSIM_WINDOW, SsimMoments, White, absolute, absolute_vjp, normal_loss, recorded_vjp,
        sparse_coverage_vjp, squared, squared_vjp, ssim, ssim_pixel_vjp, ssim_vjp, ssim_window, unclipped_scale,
        window_mean,
    },
    real::Real,
    shade_pixels::unlit_pixel_color,
    smoothness::{Line, bending, bending_vjp, blurred_normal, evenness, gloss, unit_normal, unit_normal_vjp},
};

/// Weight of a loss divided by the number of values of its mean.
fn share(name: &str) -> [Field; 1] {
    [variable(&format!("settings.{name}"), 1)]
}

/// Rendered and true colour, both over the background ([`mod@specula_core::color`]).
#[derive(Clone, Copy, Debug)]
pub struct ComparedColors {
    /// Meaning of white in the true picture.
    pub white: White,
}

formula!(ComparedColors, |this, inputs| compared_colors(
    color: 1, transmittance: 1, color_byte: 1, alpha_byte: 1, background: 1
) -> (pair: 2) {
    let [color, transmittance, color_byte, alpha_byte, background] = inputs.array();
    let alpha = from_byte(alpha_byte);
    let truth = over(from_byte(color_byte), alpha, background);
    let rendered = composite(color, transmittance, background);
    this.white.compared(rendered, truth, alpha)
});

/// Scale of the gradient of a colour that is not clipped ([`specula_core::loss::unclipped_scale`]).
#[derive(Clone, Copy, Debug)]
pub struct UnclippedScale;

formula!(UnclippedScale, |_, inputs| unclipped_scale(color_byte: 1, alpha_byte: 1, background: 1) -> (scale: 1) {
    let [color_byte, alpha_byte, background] = inputs.array();
    [unclipped_scale(over(from_byte(color_byte), from_byte(alpha_byte), background))]
});

/// L1 and L2 losses of a colour ([`mod@specula_core::loss`]), and their gradient.
#[derive(Clone, Copy, Debug)]
pub struct ColorLoss;

formula!(ColorLoss, |_, inputs| color_loss(pair: 2, ..share("absolute"), ..share("squared")) -> (
    absolute: 1, squared: 1, grad: 1
) {
    let [rendered, truth, share_absolute, share_squared] = inputs.array();
    let grad = absolute_vjp(rendered, truth, share_absolute) + squared_vjp(rendered, truth, share_squared);
    [absolute(rendered, truth), squared(rendered, truth), grad]
});

/// Gradient of the transmittance through the background ([`specula_core::color::composite_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct WithBackground;

formula!(WithBackground, |_, inputs| with_background(background: 1, grad: 1, sum: 1) -> (sum: 1) {
    let [background, grad, sum] = inputs.array();
    [composite_vjp(background, grad, sum)]
});

/// Losses on a pixel's coverage and on values weighted by it ([`mod@specula_core::loss`]), and
/// their gradients.
#[derive(Clone, Copy, Debug)]
pub struct CoverageLoss;

formula!(CoverageLoss, |_, inputs| coverage_loss(
    transmittance: 1, alpha_byte: 1, ..share("coverage"), ..share("sparse_coverage"), ..share("residual_image")
) -> (
    absolute: 1, of_transmittance: 1, of_residual: 1
) {
    let [transmittance, alpha_byte, share_absolute, share_sparse, share_residual] = inputs.array();
    let (coverage, alpha) = (-transmittance + 1.0, from_byte(alpha_byte));
    let grad_coverage = absolute_vjp(coverage, alpha, share_absolute) + sparse_coverage_vjp(coverage, share_sparse);
    [absolute(coverage, alpha), -grad_coverage, coverage * share_residual]
});

/// Means of several consecutive windows of SSIM, from window `first` on.
fn window_means<R: Real, const N: usize>(taps: &[[R; N]], first: usize) -> Vec<R> {
    let weights = ssim_window().map(|weight| taps[0][0].constant(weight));
    (0..N).map(|k| window_mean(&weights, |tap| taps[first + tap][k])).collect()
}

/// Numbered parameters or results.
fn numbered(name: &str, count: usize, len: usize) -> Vec<Field> {
    (0..count).map(|k| field(&format!("{name}_{k}"), len)).collect()
}

/// Vertical means of SSIM's products over eight consecutive windows of a column
/// ([`specula_core::loss::SsimMoments::products`]).
#[derive(Clone, Copy, Debug)]
pub struct MomentsDown;

impl MomentsDown {
    /// Number of windows.
    pub const COUNT: usize = 8;
}

formula!(MomentsDown, |_, inputs| means_down(..numbered("pair", Self::COUNT + SSIM_WINDOW - 1, 2)) -> (
    ..numbered("mean", Self::COUNT, 4)
) {
    let products = |inputs: &mut Inputs<'_, R>| {
        let [x, y] = inputs.array();
        SsimMoments::products(x, y)
    };
    let taps: Vec<[R; 4]> = (0..Self::COUNT + SSIM_WINDOW - 1).map(|_| products(inputs)).collect();
    (0..Self::COUNT).flat_map(|window| window_means(&taps, window)).collect::<Vec<R>>()
});

/// Means of `N` numbers over several consecutive windows ([`specula_core::loss::window_mean`]).
#[derive(Clone, Copy, Debug)]
pub struct Windows<const N: usize> {
    /// Name of the function.
    pub name: &'static str,
    /// Number of windows.
    pub count: usize,
}

/// Written out, because its name is a parameter.
impl<const N: usize> Formula for Windows<N> {
    fn name(&self) -> String {
        self.name.to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        numbered("tap", self.count + SSIM_WINDOW - 1, N)
    }
    fn results(&self) -> Vec<Field> {
        numbered("mean", self.count, N)
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let taps: Vec<[R; N]> = (0..self.count + SSIM_WINDOW - 1).map(|_| inputs.array()).collect();
        (0..self.count).flat_map(|window| window_means(&taps, window)).collect()
    }
}

/// SSIM of a window, and its gradient with respect to the means ([`mod@specula_core::loss`]).
#[derive(Clone, Copy, Debug)]
pub struct Structure;

formula!(Structure, |_, inputs| structure_of(means: 4, ..share("structure")) -> (similarity: 1, grads: 3) {
    let (means, share) = (inputs.array(), inputs.number());
    let moments = SsimMoments::of_means(means);
    let grads = ssim_vjp(&moments, share);
    ([ssim(&moments)], grads)
});

/// Gradient of a colour through all windows around it ([`specula_core::loss::ssim_pixel_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct StructureGrad {
    /// Meaning of white in the true picture.
    pub white: White,
}

formula!(StructureGrad, |this, inputs| structure_grad(pair: 2, grads: 3) -> (grad: 1) {
    let [rendered, truth] = inputs.array();
    let grad = ssim_pixel_vjp(rendered, truth, inputs.array());
    [if this.white == White::Saturated { recorded_vjp(rendered, truth, grad) } else { grad }]
});

/// Reads the values of a pixel's neighbours: left, right, above, below.
fn take_cross<R: Real>(inputs: &mut Inputs<'_, R>) -> Cross<R> {
    let [left, right, above, below] = inputs.array();
    Cross { left, right, above, below }
}

/// Coverages from transmittances.
fn covered<R: Real>(transmittances: &Cross<R>) -> Cross<R> {
    let Cross { left, right, above, below } = *transmittances;
    Cross { left: -left + 1.0, right: -right + 1.0, above: -above + 1.0, below: -below + 1.0 }
}

/// Weight of a pixel's normal ([`specula_core::depth_normal::surface_weight`]).
#[derive(Clone, Copy, Debug)]
pub struct NormalWeight;

formula!(NormalWeight, |_, inputs| normal_weight(transmittance: 1, around: 4) -> (weight: 1) {
    let (transmittance, around) = (inputs.number(), take_cross(inputs));
    [surface_weight(-transmittance + 1.0, &covered(&around))]
});

/// Normal loss of a pixel, weighted by its coverage ([`specula_core::loss::normal_loss`]), and its
/// gradients.
#[derive(Clone, Copy, Debug)]
pub struct NormalLoss {
    /// Form of the loss.
    pub form: NormalForm,
}

formula!(NormalLoss, |this, inputs| normal_loss(
    point: 2, weight: 1, rendered: 3, around: 4, depths: 4, ..share("normal"), ..camera_fields()
) -> (
    value: 1, of_rendered: 3, of_depths: 4
) {
    let ([x, y], weight, rendered) = (inputs.array(), inputs.number(), inputs.vec3());
    let (around, blended, share) = (covered(&take_cross(inputs)), take_cross(inputs), inputs.number());
    let camera = take_camera(inputs);
    let depths = Cross {
        left: expected_depth(blended.left, around.left),
        right: expected_depth(blended.right, around.right),
        above: expected_depth(blended.above, around.above),
        below: expected_depth(blended.below, around.below),
    };
    let patch = NormalPatch { rays: rays_around(&camera, x, y), depths, rendered, coverage: weight };
    let (value, grad_rendered, grad_depths) = normal_loss(this.form, &camera.camera_from_world, &patch, weight * share);
    ([value * weight], grad_rendered, [grad_depths.left, grad_depths.right, grad_depths.above, grad_depths.below])
});

/// Gradient of the blended channels from that of a pixel's expected depth
/// ([`specula_core::depth_normal::expected_depth_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct DepthGrad;

formula!(DepthGrad, |_, inputs| depth_grad(blended_depth: 1, transmittance: 1, grad: 1) -> (
    of_blended: 1, of_transmittance: 1
) {
    let [blended, transmittance, grad] = inputs.array();
    let coverage = -transmittance + 1.0;
    let (grad_blended, grad_coverage) = expected_depth_vjp(expected_depth(blended, coverage), coverage, grad);
    [grad_blended.keep(is_surface(coverage)), (-grad_coverage).keep(is_surface(coverage))]
});

/// Unit normal of a pixel with a surface ([`specula_core::smoothness::unit_normal`]).
#[derive(Clone, Copy, Debug)]
pub struct UnitNormal;

formula!(UnitNormal, |_, inputs| unit_normal(blended: 3, transmittance: 1) -> (normal: 3) {
    let (blended, transmittance) = (inputs.vec3(), inputs.number());
    unit_normal(blended, is_surface(-transmittance + 1.0))
});

/// Gradient of [`UnitNormal`] with respect to the blended normal.
#[derive(Clone, Copy, Debug)]
pub struct UnitNormalVjp;

formula!(UnitNormalVjp, |_, inputs| unit_normal_vjp(blended: 3, transmittance: 1, grad: 3) -> (grad: 3) {
    let (blended, transmittance, grad) = (inputs.vec3(), inputs.number(), inputs.vec3());
    unit_normal_vjp(blended, is_surface(-transmittance + 1.0), grad)
});

/// Blurred normal from the sum of normals ([`specula_core::smoothness::blurred_normal`]).
#[derive(Clone, Copy, Debug)]
pub struct BlurredNormal;

formula!(BlurredNormal, |_, inputs| blurred_normal(sum: 3) -> (normal: 3) { blurred_normal(inputs.vec3()) });

/// Reads the normals of a line: before, at and after its middle.
fn take_line<R: Real>(inputs: &mut Inputs<'_, R>) -> Line<R> {
    Line { before: inputs.vec3(), at: inputs.vec3(), after: inputs.vec3() }
}

/// Weight of a pixel from the blurred normals around it ([`specula_core::smoothness::evenness`]).
#[derive(Clone, Copy, Debug)]
pub struct Evenness;

formula!(Evenness, |_, inputs| evenness(
    left: 3, right: 3, above: 3, below: 3, at: 3, point: 2, ..camera_fields()
) -> (weight: 1) {
    let [left, right, above, below, at] = [inputs.vec3(), inputs.vec3(), inputs.vec3(), inputs.vec3(), inputs.vec3()];
    let [x, y] = inputs.array();
    let view_dir = take_camera(inputs).view_dir(x, y);
    let (row, column) = (Line { before: left, at, after: right }, Line { before: above, at, after: below });
    [evenness(&row, &column, view_dir)]
});

/// Weight of a pixel by its gloss ([`specula_core::smoothness::gloss`]).
#[derive(Clone, Copy, Debug)]
pub struct Gloss;

formula!(Gloss, |_, inputs| gloss(lit: 3, base: 3, roughness: 1, transmittance: 1) -> (weight: 1) {
    let (lit, base, [roughness, transmittance]) = (inputs.vec3(), inputs.vec3(), inputs.array());
    let coverage = -transmittance + 1.0;
    [gloss(lit, unlit_pixel_color(base, coverage), roughness, coverage)]
});

/// Loss of a line ([`specula_core::smoothness::bending`]).
#[derive(Clone, Copy, Debug)]
pub struct Bending;

formula!(Bending, |_, inputs| bending(
    before: 3, at: 3, after: 3, point: 2, weight: 1, ..camera_fields()
) -> (value: 1) {
    let (line, [x, y], weight) = (take_line(inputs), inputs.array(), inputs.number());
    [bending(&line, take_camera(inputs).view_dir(x, y), weight)]
});

/// Gradient of [`Bending`] with respect to the normal of an end.
#[derive(Clone, Copy, Debug)]
pub struct BendingVjp;

formula!(BendingVjp, |_, inputs| bending_vjp(
    before: 3, at: 3, after: 3, point: 2, weight: 1, ..share("smoothness"), ..camera_fields()
) -> (slope: 3) {
    let (line, [x, y], weight) = (take_line(inputs), inputs.array(), inputs.number());
    let share = inputs.number();
    bending_vjp(&line, take_camera(inputs).view_dir(x, y), weight, share)
});
