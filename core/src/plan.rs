//! What a scene needs, and so what a run can do without.

use crate::{
    activation::sigmoid,
    scene::{Gaussians, NORMAL_RESIDUAL_1, OPACITY, ROUGHNESS, TINT},
};

/// What the Gaussians of a scene make use of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Needs {
    /// Largest opacity · tint of any Gaussian: how much specular light can matter.
    pub specular: f32,
    /// Smallest and largest roughness; the first exceeds the second if there are no shaded Gaussians.
    pub roughness: [f32; 2],
    /// Largest component of any normal residual.
    pub normal_residual: f32,
    /// Largest coefficient in each band of the spherical harmonics.
    pub harmonics: [f32; 4],
}

impl Needs {
    /// What a scene without Gaussians needs.
    pub const NOTHING: Self = Self { specular: 0.0, roughness: [1.0, 0.0], normal_residual: 0.0, harmonics: [0.0; 4] };

    /// Looks at every Gaussian once.
    pub fn of<A: AsRef<[f32]>>(gaussians: &Gaussians<A>) -> Self {
        (0..gaussians.count).fold(Self::NOTHING, |needs, index| needs.and(gaussians, index))
    }

    /// Highest band with a coefficient above `threshold`, if any.
    pub fn sh_degree(&self, threshold: f32) -> Option<u8> {
        (0..4_u8).rev().find(|band| self.harmonics[usize::from(*band)] > threshold)
    }

    fn and<A: AsRef<[f32]>>(mut self, gaussians: &Gaussians<A>, index: usize) -> Self {
        let largest = |numbers: &[f32]| numbers.iter().fold(0.0_f32, |max, x| max.max(x.abs()));
        if gaussians.layout.is_shaded() {
            let [opacity] = gaussians.get::<1>(index, OPACITY).map(sigmoid);
            let tint = gaussians.get::<3>(index, TINT).map(sigmoid);
            let [roughness] = gaussians.get::<1>(index, ROUGHNESS).map(sigmoid);
            self.specular = self.specular.max(opacity * largest(&tint));
            self.roughness = [self.roughness[0].min(roughness), self.roughness[1].max(roughness)];
            let residuals = gaussians.get::<6>(index, NORMAL_RESIDUAL_1);
            self.normal_residual = self.normal_residual.max(largest(&residuals));
        }
        for k in 0..gaussians.layout.sh_count() {
            let band = crate::math::sqrt(k as f32) as usize;
            let coefficients = gaussians.get::<3>(index, gaussians.layout.sh_start() + 3 * k);
            self.harmonics[band] = self.harmonics[band].max(largest(&coefficients));
        }
        self
    }
}

/// What is blended into a picture, in one pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Channels {
    /// Colour alone: 3 channels.
    Color,
    /// Colour, normal, depth and |Δn|²: 8 channels, what the losses read.
    Training,
    /// Those of training, then tint and roughness: 12 channels, what light is added to pixel by pixel.
    Surface,
    /// Those of a surface, then diffuse, specular, residual and light: 24 channels.
    Layers,
}

impl Channels {
    /// How many numbers a Gaussian brings to a pixel.
    pub const fn count(self) -> usize {
        match self {
            Self::Color => 3,
            Self::Training => 8,
            Self::Surface => 12,
            Self::Layers => 24,
        }
    }
}

/// First channel of each layer in a blended picture.
pub mod channel {
    /// Colour, sRGB-encoded.
    pub const COLOR: usize = 0;
    /// World-space normal.
    pub const NORMAL: usize = 3;
    /// Depth along the optical axis.
    pub const DEPTH: usize = 6;
    /// |Δn|².
    pub const RESIDUAL_SIZE: usize = 7;
    /// Specular tint.
    pub const TINT: usize = 8;
    /// Perceptual roughness.
    pub const ROUGHNESS: usize = 11;
    /// Activated diffuse colour, linear.
    pub const DIFFUSE: usize = 12;
    /// Tint times specular light, linear.
    pub const SPECULAR: usize = 15;
    /// Residual colour, linear.
    pub const RESIDUAL: usize = 18;
    /// Prefiltered light that reaches the surface, linear.
    pub const LIGHT: usize = 21;
}
