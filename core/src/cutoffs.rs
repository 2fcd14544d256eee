//! Where a picture stops to look further: what is cut off because it hardly shows, and how splats are projected.

use crate::{
    bin::ALPHA_MIN,
    blend::{LOG2_ALPHA_MIN, TRANSMITTANCE_MIN},
    perspective::ProjectionModel,
    real::Real,
};

/// What is cut off, and how exactly splats are projected. Training and the free functions of [`crate::blend`] and [`mod@crate::bin`] know [`Cutoffs::DEFAULT`]
/// alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cutoffs {
    /// A splat is not drawn where its alpha is below this.
    alpha_min: f32,
    pub(crate) log2_alpha_min: f32,
    /// A pixel ends before the splat that would bring its transmittance below this.
    pub(crate) transmittance_min: f32,
    /// So many standard deviations a splat reaches into tiles at most.
    reach_max: f32,
    projection: ProjectionModel,
}

/// Smaller cutoffs are this: their logarithms and products stay normal numbers.
const LEAST: f32 = 1e-12;

impl Cutoffs {
    /// INRIA's: 1/255 of alpha, 10⁻⁴ of transmittance; tiles hold a splat wherever it is drawn, and projection is affine.
    pub const DEFAULT: Self = Self {
        alpha_min: ALPHA_MIN,
        log2_alpha_min: LOG2_ALPHA_MIN,
        transmittance_min: TRANSMITTANCE_MIN,
        reach_max: f32::INFINITY,
        projection: ProjectionModel::Affine,
    };
    /// As good as none: 10⁻¹² of alpha and of transmittance, and projection along rays.
    pub const REFERENCE: Self = Self {
        alpha_min: LEAST,
        log2_alpha_min: -39.863_137,
        transmittance_min: LEAST,
        reach_max: f32::INFINITY,
        projection: ProjectionModel::Ray,
    };

    /// Splats are drawn down to an alpha of `alpha_min`, in (0, 1); smaller ones count as 10⁻¹².
    pub fn with_alpha_min(self, alpha_min: f32) -> Self {
        let alpha_min = alpha_min.max(LEAST);
        let log2_alpha_min = if alpha_min == ALPHA_MIN { LOG2_ALPHA_MIN } else { Real::log2(alpha_min) };
        Self { alpha_min, log2_alpha_min, ..self }
    }
    /// Pixels end at a transmittance of `transmittance_min`, in \[0, 1); smaller ones count as 10⁻¹².
    pub fn with_transmittance_min(self, transmittance_min: f32) -> Self {
        Self { transmittance_min: transmittance_min.max(LEAST), ..self }
    }
    /// Tiles hold splats within so many standard deviations of their means, which is infinite where nothing is cut off.
    /// In a tile that holds it, a splat is drawn as far as its alpha goes: what is missing ends at the seams of tiles.
    pub fn with_reach_max(self, reach_max: f32) -> Self {
        Self { reach_max, ..self }
    }

    /// Splats are projected so.
    pub fn with_projection(self, projection: ProjectionModel) -> Self {
        Self { projection, ..self }
    }

    /// The least alpha that is drawn.
    pub const fn alpha_min(&self) -> f32 {
        self.alpha_min
    }
    /// The transmittance at which pixels end.
    pub const fn transmittance_min(&self) -> f32 {
        self.transmittance_min
    }
    /// How many standard deviations splats reach into tiles at most.
    pub const fn reach_max(&self) -> f32 {
        self.reach_max
    }
    /// How splats are projected.
    pub const fn projection(&self) -> ProjectionModel {
        self.projection
    }
}

impl Default for Cutoffs {
    fn default() -> Self {
        Self::DEFAULT
    }
}
