//! Culling and early-termination thresholds, and the projection model and order of splats.
//!
//! Cutoffs are data: the minimum alpha, the transmittance at which a pixel ends, the reach of
//! splats into tiles, their projection, and their order in a pixel. Training uses only the
//! defaults, because gradients assume them; renderers accept any.

use crate::real::Real;

/// Smallest alpha that is drawn: a step of an 8-bit picture (INRIA's value).
pub const ALPHA_MIN: f32 = 1.0 / 255.0;
/// log₂ of [`ALPHA_MIN`].
pub const LOG2_ALPHA_MIN: f32 = -7.994_353_4;
/// Safety margin of log₂ alpha, larger than its rounding.
const LOG2_ALPHA_MARGIN: f32 = 0.005_646_6;
/// Transmittance at which a pixel ends, (1 − [`MAX_ALPHA`](crate::blend::MAX_ALPHA))²: two opaque
/// splats end a pixel.
pub const TRANSMITTANCE_MIN: f32 = 1e-4;

/// Projection of Gaussians to splats. Training supports only [`ProjectionModel::Affine`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ProjectionModel {
    /// Local affine (EWA, Zwicker et al. 2001), with INRIA's limit of the slope.
    Affine,
    /// Affine onto the plane that touches the unit sphere in the direction of the mean, then
    /// exactly onto the screen.
    Tangent,
    /// Largest response along each pixel's ray ([`crate::perspective`]).
    Ray,
    /// [`ProjectionModel::Ray`] for splats with an error of the affine projection above this alpha,
    /// to first order; affine for the others.
    Within(f32),
}

/// Order of the splats in a pixel; ties keep the order of the tile. Training supports only
/// [`BlendOrder::Mean`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BlendOrder {
    /// Depth of the mean, for all pixels of a picture (3DGS).
    #[default]
    Mean,
    /// Depth of the largest response along the pixel's ray ([`crate::order`]) within a window:
    /// splats that are visible in the pixel enter a buffer of this length, from 1 to
    /// [`WINDOW_MAX`], by the depth of their means, and the nearest is blended whenever the buffer
    /// is full (after Radl et al. 2024, StopThePop). A window of one is [`BlendOrder::Mean`].
    Window(u32),
    /// Depth of the largest response along the pixel's ray: exact.
    Pixel,
}

/// Default number of entries of a window.
pub const WINDOW: u32 = 16;
/// Largest window, which fits the registers of a GPU's invocation.
pub const WINDOW_MAX: u32 = 64;

impl BlendOrder {
    /// Number of splats among which the nearest is blended; `None` for all.
    pub const fn window(self) -> Option<usize> {
        match self {
            Self::Mean => Some(1),
            Self::Window(count) => Some(count as usize),
            Self::Pixel => None,
        }
    }
}

/// Culling and early-termination thresholds. Training and the free functions of [`crate::blend`]
/// and [`mod@crate::bin`] use [`Cutoffs::DEFAULT`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cutoffs {
    alpha_min: f32,
    log2_alpha_min: f32,
    transmittance_min: f32,
    reach_max: f32,
    projection: ProjectionModel,
    order: BlendOrder,
}

/// Floor of the thresholds: logarithms and products of larger ones are normal numbers.
const THRESHOLD_MIN: f32 = 1e-12;

impl Cutoffs {
    /// INRIA's values: 1/255 of alpha, 10⁻⁴ of transmittance; tiles contain each splat to the
    /// extent of its drawn alpha, projection is affine, and splats are sorted by the depth of their
    /// means.
    pub const DEFAULT: Self = Self {
        alpha_min: ALPHA_MIN,
        log2_alpha_min: LOG2_ALPHA_MIN,
        transmittance_min: TRANSMITTANCE_MIN,
        reach_max: f32::INFINITY,
        projection: ProjectionModel::Affine,
        order: BlendOrder::Mean,
    };
    /// Values of the reference renderer: 10⁻¹² of alpha and of transmittance, and projection along
    /// rays.
    pub const REFERENCE: Self = Self {
        alpha_min: THRESHOLD_MIN,
        log2_alpha_min: -39.863_137,
        transmittance_min: THRESHOLD_MIN,
        reach_max: f32::INFINITY,
        projection: ProjectionModel::Ray,
        order: BlendOrder::Mean,
    };

    /// Sets the smallest drawn alpha, in (0, 1); smaller values count as 10⁻¹².
    #[must_use]
    pub fn with_alpha_min(self, alpha_min: f32) -> Self {
        let alpha_min = alpha_min.max(THRESHOLD_MIN);
        let log2_alpha_min = if alpha_min == ALPHA_MIN { LOG2_ALPHA_MIN } else { Real::log2(alpha_min) };
        Self { alpha_min, log2_alpha_min, ..self }
    }
    /// Sets the transmittance at which pixels end, in \[0, 1); smaller values count as 10⁻¹².
    #[must_use]
    pub fn with_transmittance_min(self, transmittance_min: f32) -> Self {
        Self { transmittance_min: transmittance_min.max(THRESHOLD_MIN), ..self }
    }
    /// Sets the largest reach of splats into tiles, in standard deviations; infinity disables the
    /// cutoff. Within a tile, splats are drawn to the extent of their alpha, so cutoffs are visible
    /// at tile borders.
    #[must_use]
    pub fn with_reach_max(self, reach_max: f32) -> Self {
        Self { reach_max, ..self }
    }
    /// Sets the projection model.
    #[must_use]
    pub fn with_projection(self, projection: ProjectionModel) -> Self {
        Self { projection, ..self }
    }
    /// Sets the order of splats in a pixel.
    #[must_use]
    pub fn with_order(self, order: BlendOrder) -> Self {
        Self { order, ..self }
    }

    /// Smallest drawn alpha.
    pub const fn alpha_min(&self) -> f32 {
        self.alpha_min
    }
    /// Transmittance at which pixels end.
    pub const fn transmittance_min(&self) -> f32 {
        self.transmittance_min
    }
    /// Largest reach of splats into tiles, in standard deviations.
    pub const fn reach_max(&self) -> f32 {
        self.reach_max
    }
    /// Projection model.
    pub const fn projection(&self) -> ProjectionModel {
        self.projection
    }
    /// Order of splats in a pixel.
    pub const fn order(&self) -> BlendOrder {
        self.order
    }

    /// Tests log₂ of a splat's strength against the least alpha.
    #[inline(always)]
    pub fn passes_alpha_test<R: Real>(&self, log2_strength: R) -> R::Mask {
        log2_strength.constant(self.log2_alpha_min).less_or_equal(log2_strength)
    }
    /// [`Cutoffs::passes_alpha_test`] of an upper bound of log₂ strength, with a margin for its
    /// rounding.
    #[inline(always)]
    pub(crate) fn may_pass_alpha_test<R: Real>(&self, log2_strength: R) -> R::Mask {
        log2_strength.constant(self.log2_alpha_min - LOG2_ALPHA_MARGIN).less_or_equal(log2_strength)
    }
    /// Tests whether a pixel with this transmittance takes further splats.
    #[inline(always)]
    pub fn is_active<R: Real>(&self, transmittance: R) -> R::Mask {
        transmittance.constant(self.transmittance_min).less_or_equal(transmittance)
    }
}

impl Default for Cutoffs {
    fn default() -> Self {
        Self::DEFAULT
    }
}
