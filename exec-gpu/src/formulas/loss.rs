//! The formulas of the losses on pictures.

use super::{camera_fields, flat, take_camera};
use crate::formula::{Field, Formula, Inputs, field, variable};
use specula_core::{
    color::{composite, composite_vjp, from_byte, over},
    depth_normal::{Cross, expected_depth, expected_depth_vjp, is_surface, rays_around, surface_weight},
    loss::{
        NormalForm, NormalPatch, SSIM_WINDOW, SsimMoments, absolute, absolute_vjp, normal_loss, sparse_coverage_vjp,
        squared, squared_vjp, ssim, ssim_pixel_vjp, ssim_vjp, ssim_window, window_mean,
    },
    real::Real,
};

/// A weight of the losses, as a share for each number that it is a mean of.
fn share(name: &str) -> Field {
    variable(&format!("settings.{name}"), 1)
}

/// A rendered colour and the true one, both over the background ([`mod@specula_core::color`]).
#[derive(Clone, Copy, Debug)]
pub struct ComparedColors;

impl Formula for ComparedColors {
    fn name(&self) -> String {
        "compared_colors".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![
            field("color", 1),
            field("transmittance", 1),
            field("color_byte", 1),
            field("alpha_byte", 1),
            field("background", 1),
        ]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("pair", 2)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let [color, transmittance, color_byte, alpha_byte, background] = inputs.array();
        let truth = over(from_byte(color_byte), from_byte(alpha_byte), background);
        vec![composite(color, transmittance, background), truth]
    }
}

/// Losses of a colour that look at one pixel alone ([`mod@specula_core::loss`]), and their gradient.
#[derive(Clone, Copy, Debug)]
pub struct ColorLoss;

impl Formula for ColorLoss {
    fn name(&self) -> String {
        "color_loss".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("pair", 2), share("absolute"), share("squared")]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("absolute", 1), field("squared", 1), field("grad", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let [rendered, truth, of_absolute, of_squared] = inputs.array();
        let grad = absolute_vjp(rendered, truth, of_absolute) + squared_vjp(rendered, truth, of_squared);
        vec![absolute(rendered, truth), squared(rendered, truth), grad]
    }
}

/// Gradient of the transmittance through the background ([`specula_core::color::composite_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct WithBackground;

impl Formula for WithBackground {
    fn name(&self) -> String {
        "with_background".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("background", 1), field("grad", 1), field("sum", 1)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("sum", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let [background, grad, sum] = inputs.array();
        vec![composite_vjp(background, grad, sum)]
    }
}

/// Losses on a pixel's coverage and on what is weighted by it ([`mod@specula_core::loss`]), and their gradients.
#[derive(Clone, Copy, Debug)]
pub struct CoverageLoss;

impl Formula for CoverageLoss {
    fn name(&self) -> String {
        "coverage_loss".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![
            field("transmittance", 1),
            field("alpha_byte", 1),
            share("coverage"),
            share("sparse_coverage"),
            share("residual_image"),
        ]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("absolute", 1), field("of_transmittance", 1), field("of_residual", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let [transmittance, alpha_byte, of_absolute, of_sparse, of_residual] = inputs.array();
        let (coverage, alpha) = (-transmittance + 1.0, from_byte(alpha_byte));
        let of_coverage = absolute_vjp(coverage, alpha, of_absolute) + sparse_coverage_vjp(coverage, of_sparse);
        vec![absolute(coverage, alpha), -of_coverage, coverage * of_residual]
    }
}

/// Means of several windows of SSIM in a row, each a step behind the other.
fn window_means<R: Real, const N: usize>(taps: &[[R; N]], window: usize) -> Vec<R> {
    let weights = ssim_window().map(|weight| taps[0][0].constant(weight));
    (0..N).map(|k| window_mean(&weights, |tap| taps[window + tap][k])).collect()
}

fn numbered(name: &str, count: usize, len: usize) -> Vec<Field> {
    (0..count).map(|k| field(&format!("{name}_{k}"), len)).collect()
}

/// What SSIM takes the means of, over eight windows below one another of one column
/// ([`specula_core::loss::SsimMoments::products`]).
#[derive(Clone, Copy, Debug)]
pub struct MomentsDown;

impl MomentsDown {
    /// Windows at once.
    pub const COUNT: usize = 8;
}

impl Formula for MomentsDown {
    fn name(&self) -> String {
        "moments_down".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        numbered("pair", Self::COUNT + SSIM_WINDOW - 1, 2)
    }
    fn results(&self) -> Vec<Field> {
        numbered("mean", Self::COUNT, 4)
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let products = |inputs: &mut Inputs<'_, R>| {
            let [x, y] = inputs.array();
            SsimMoments::products(x, y)
        };
        let taps: Vec<[R; 4]> = (0..Self::COUNT + SSIM_WINDOW - 1).map(|_| products(inputs)).collect();
        (0..Self::COUNT).flat_map(|window| window_means(&taps, window)).collect()
    }
}

/// `N` numbers each over some windows beside one another ([`specula_core::loss::window_mean`]).
#[derive(Clone, Copy, Debug)]
pub struct Windows<const N: usize> {
    /// How many windows.
    pub count: usize,
}

impl<const N: usize> Formula for Windows<N> {
    fn name(&self) -> String {
        format!("windows_{N}_{}", self.count)
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

impl Formula for Structure {
    fn name(&self) -> String {
        "structure_of".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("means", 4), share("structure")]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("similarity", 1), field("grads", 3)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let (means, share) = (inputs.array(), inputs.number());
        let moments = SsimMoments::of_means(means);
        let [of_x, of_xx, of_xy] = ssim_vjp(&moments, share);
        vec![ssim(&moments), of_x, of_xx, of_xy]
    }
}

/// Gradient of a colour through all windows that see it ([`specula_core::loss::ssim_pixel_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct StructureGrad;

impl Formula for StructureGrad {
    fn name(&self) -> String {
        "structure_grad".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("pair", 2), field("grads", 3)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("grad", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let [rendered, truth] = inputs.array();
        vec![ssim_pixel_vjp(rendered, truth, inputs.array())]
    }
}

/// Left, right, above, below.
fn take_cross<R: Real>(inputs: &mut Inputs<'_, R>) -> Cross<R> {
    let [left, right, above, below] = inputs.array();
    Cross { left, right, above, below }
}

fn covered<R: Real>(transmittances: &Cross<R>) -> Cross<R> {
    let Cross { left, right, above, below } = *transmittances;
    Cross { left: -left + 1.0, right: -right + 1.0, above: -above + 1.0, below: -below + 1.0 }
}

/// The weight of a pixel's normal ([`specula_core::depth_normal::surface_weight`]).
#[derive(Clone, Copy, Debug)]
pub struct NormalWeight;

impl Formula for NormalWeight {
    fn name(&self) -> String {
        "normal_weight".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("transmittance", 1), field("around", 4)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("weight", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let (transmittance, around) = (inputs.number(), take_cross(inputs));
        vec![surface_weight(-transmittance + 1.0, &covered(&around))]
    }
}

/// The normal loss of a pixel that has a weight, its coverage ([`specula_core::loss::normal_loss`]), and its gradients.
#[derive(Clone, Copy, Debug)]
pub struct NormalLoss {
    /// Which.
    pub form: NormalForm,
}

impl Formula for NormalLoss {
    fn name(&self) -> String {
        "normal_loss".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        let mut fields = vec![
            field("point", 2),
            field("weight", 1),
            field("rendered", 3),
            field("around", 4),
            field("depths", 4),
            share("normal"),
        ];
        fields.extend(camera_fields());
        fields
    }
    fn results(&self) -> Vec<Field> {
        vec![field("value", 1), field("of_rendered", 3), field("of_depths", 4)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
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
        let (value, of_rendered, of_depths) = normal_loss(self.form, &camera.camera_from_world, &patch, weight * share);
        let mut numbers = vec![value * weight];
        numbers.extend(flat(of_rendered));
        numbers.extend([of_depths.left, of_depths.right, of_depths.above, of_depths.below]);
        numbers
    }
}

/// Gradient of a pixel's expected depth to what was blended ([`specula_core::depth_normal::expected_depth_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct DepthGrad;

impl Formula for DepthGrad {
    fn name(&self) -> String {
        "depth_grad".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("blended_depth", 1), field("transmittance", 1), field("grad", 1)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("of_blended", 1), field("of_transmittance", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let [blended, transmittance, grad] = inputs.array();
        let coverage = -transmittance + 1.0;
        let (of_blended, of_coverage) = expected_depth_vjp(expected_depth(blended, coverage), coverage, grad);
        vec![of_blended.keep(is_surface(coverage)), (-of_coverage).keep(is_surface(coverage))]
    }
}
