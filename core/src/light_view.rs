//! Lookups of a filtered light: bilinear in two neighbouring levels, linear between them.
//!
//! [`LightFootprint`] and [`LightLookup`] hold the arithmetic of a lookup and of its gradient, for
//! any number; executors read the texels. [`LightView`] reads them from host memory:
//!
//! ```
//! use specula_core::{
//!     cubemap::{pad, padded_len},
//!     light_view::{LightView, TexelMap},
//!     prefilter::Level,
//!     vector::{Vec3, vec3},
//! };
//!
//! // Two levels of one texel a face, the second blurred to a mean.
//! let levels = [0.0, 1.0].map(|roughness| Level { roughness, resolution: 1 });
//! let maps = [0, padded_len(1)].map(|first| TexelMap { first, resolution: 1 });
//! let mut texels = [Vec3::splat(3.0_f32); 2 * padded_len(1)];
//! let faces = [1.0, 5.0, 3.0, 3.0, 3.0, 3.0].map(Vec3::splat);
//! pad(1, |face| faces[face], &mut texels[..padded_len(1)]);
//! let light = LightView { levels: &levels, maps: &maps, texels: &texels };
//! assert_eq!(light.radiance(vec3(1.0, 0.0, 0.0), 0.0), Vec3::splat(1.0), "the face +x");
//! assert_eq!(light.radiance(vec3(1.0, 0.0, 0.0), 0.5), Vec3::splat(2.0), "half of each level");
//! assert_eq!(light.irradiance(vec3(0.6, 0.0, 0.8)), Vec3::splat(3.0), "the last map");
//! ```

use crate::{
    cubemap::{
        BilinearSample, FacePoint, TexelFootprint, bilinear_sample, bilinear_weights, footprint, padded_len, project,
        project_vjp,
    },
    prefilter::{Level, level_of_roughness, level_of_roughness_vjp},
    real::Real,
    vector::Vec3,
};

/// Footprint in a map. `P` is the place of its texels in memory.
#[derive(Clone, Copy, Debug)]
pub struct MapFootprint<R, P> {
    /// Texels along an edge of a face.
    pub resolution: R,
    /// Texels, and how far between them the point lies.
    pub footprint: TexelFootprint<R>,
    /// Place of the texels.
    pub place: P,
}

impl<R: Real, P> MapFootprint<R, P> {
    /// Weights of the four texels ([`bilinear_weights`]).
    #[inline(always)]
    pub fn weights(&self) -> [R; 4] {
        bilinear_weights(self.footprint.right, self.footprint.lower)
    }
}

/// Position of a lookup: between two maps, at the same point of the cube.
#[derive(Clone, Copy, Debug)]
pub struct LightFootprint<R: Real, P> {
    /// Point of the cube.
    pub point: FacePoint<R>,
    /// Footprint in the sharper map.
    pub sharp: MapFootprint<R, P>,
    /// Footprint in the more blurred map.
    pub blurred: MapFootprint<R, P>,
    /// Share of the more blurred map, in \[0, 1\].
    pub share: R,
}

/// Sharper of the two levels that a roughness lies between, and the share of the other.
#[inline(always)]
pub fn levels_around<R: Real>(roughness: R, levels: &[Level]) -> [R; 2] {
    let position = level_of_roughness(roughness, levels);
    let sharp = position.floor().clamp(0.0, (levels.len() - 2) as f32);
    [sharp, position - sharp]
}

impl<R: Real, P> LightFootprint<R, P> {
    /// Weights of the texels in both maps.
    #[inline(always)]
    pub fn weights(&self) -> [[R; 4]; 2] {
        let ([a, b, c, d], sharp) = (self.sharp.weights(), -self.share + 1.0);
        let ([e, f, g, h], blurred) = (self.blurred.weights(), self.share);
        [[a * sharp, b * sharp, c * sharp, d * sharp], [e * blurred, f * blurred, g * blurred, h * blurred]]
    }
}

/// Light that was looked up, with what its gradient needs.
#[derive(Clone, Copy, Debug)]
pub struct LightLookup<R: Real, P> {
    /// Position of the lookup.
    pub at: LightFootprint<R, P>,
    /// Radiance in the sharper map.
    pub sharp: BilinearSample<Vec3<R>>,
    /// Radiance in the more blurred map.
    pub blurred: BilinearSample<Vec3<R>>,
}

impl<R: Real, P> LightLookup<R, P> {
    /// The radiance.
    #[inline(always)]
    pub fn radiance(&self) -> Vec3<R> {
        self.sharp.mean.add_scaled(self.at.share, self.blurred.mean - self.sharp.mean)
    }
    /// Gradients of the radiance in both maps. Each texel gets its weight of them
    /// ([`MapFootprint::weights`]).
    #[inline(always)]
    pub fn map_grads(&self, grad: Vec3<R>) -> [Vec3<R>; 2] {
        [grad * (-self.at.share + 1.0), grad * self.at.share]
    }
    /// Gradient of the radiance with respect to the direction, and to the roughness among the
    /// levels.
    #[inline(always)]
    pub fn vjp(&self, roughness: R, levels: &[Level], grad: Vec3<R>) -> (Vec3<R>, R) {
        let Self { at, sharp, blurred } = self;
        let [grad_sharp, grad_blurred] = self.map_grads(grad);
        let (half, half_blurred) = (at.sharp.resolution * 0.5, at.blurred.resolution * 0.5);
        let u = sharp.to_right.dot(grad_sharp) * half + blurred.to_right.dot(grad_blurred) * half_blurred;
        let v = sharp.downwards.dot(grad_sharp) * half + blurred.downwards.dot(grad_blurred) * half_blurred;
        let grad_position = grad.dot(blurred.mean - sharp.mean);
        (project_vjp(&at.point, u, v), level_of_roughness_vjp(roughness, levels, grad_position))
    }
}

/// A map among the texels of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TexelMap {
    /// First of its texels.
    pub first: usize,
    /// Texels along an edge of a face, without the apron ([`mod@crate::cubemap`]).
    pub resolution: usize,
}

impl TexelMap {
    /// Maps of these resolutions, one after the other.
    pub fn side_by_side(resolutions: impl Iterator<Item = usize>) -> impl Iterator<Item = Self> {
        resolutions.scan(0, |end, resolution| {
            let map = Self { first: *end, resolution };
            *end = map.end();
            Some(map)
        })
    }
    /// One past the last of its texels.
    pub const fn end(self) -> usize {
        self.first + padded_len(self.resolution)
    }
}

/// A filtered light in host memory.
#[derive(Clone, Copy, Debug)]
pub struct LightView<'a, R> {
    /// Levels, sharpest first; two or more.
    pub levels: &'a [Level],
    /// Map of each level; behind them that of irradiance / π, if there is one. Otherwise it is the
    /// last level's, whose lobe is the cosine.
    pub maps: &'a [TexelMap],
    /// Linear radiance of all texels, each map with its apron, in the order of
    /// [`crate::cubemap::padded_index`].
    pub texels: &'a [Vec3<R>],
}

impl<R: Real<Mask = bool> + Into<f64>> LightView<'_, R> {
    /// Radiance along a direction, not zero, at a perceptual roughness.
    pub fn radiance(&self, direction: Vec3<R>, roughness: R) -> Vec3<R> {
        self.look_up(direction, roughness).radiance()
    }
    /// Irradiance / π along a normal.
    pub fn irradiance(&self, normal: Vec3<R>) -> Vec3<R> {
        self.look_up_irradiance(normal).radiance()
    }

    /// [`LightView::radiance`], with what its gradient needs.
    pub fn look_up(&self, direction: Vec3<R>, roughness: R) -> LightLookup<R, TexelMap> {
        let [sharp, share] = levels_around(roughness, self.levels);
        let level: f64 = sharp.into();
        self.look_up_between([level as usize, level as usize + 1], share, direction)
    }
    /// [`LightView::irradiance`], with what its gradient needs.
    pub fn look_up_irradiance(&self, normal: Vec3<R>) -> LightLookup<R, TexelMap> {
        let last = self.maps.len() - 1;
        self.look_up_between([last; 2], normal.x.zero(), normal)
    }
    fn look_up_between(&self, maps: [usize; 2], share: R, direction: Vec3<R>) -> LightLookup<R, TexelMap> {
        let point = project(direction);
        let [sharp, blurred] = maps.map(|map| {
            let place = self.maps[map];
            let resolution = share.constant(place.resolution as f32);
            MapFootprint { resolution, footprint: footprint(&point, resolution), place }
        });
        let sample = |at: &MapFootprint<R, TexelMap>| {
            let texels = Self::texels_of(at).map(|texel| self.texels[texel]);
            bilinear_sample(texels, at.footprint.right, at.footprint.lower)
        };
        let (near, far) = (sample(&sharp), sample(&blurred));
        LightLookup { at: LightFootprint { point, sharp, blurred, share }, sharp: near, blurred: far }
    }
    /// Texels of a footprint.
    fn texels_of(at: &MapFootprint<R, TexelMap>) -> [usize; 4] {
        let texel: f64 = at.footprint.texel.into();
        let (first, width) = (at.place.first + texel as usize, at.place.resolution + 2);
        [first, first + 1, first + width, first + width + 1]
    }
    /// Gradient of a lookup with respect to direction and roughness; adds to that of the texels.
    pub fn look_up_vjp(
        &self,
        lookup: &LightLookup<R, TexelMap>,
        roughness: R,
        grad: Vec3<R>,
        texels_grad: &mut [Vec3<R>],
    ) -> (Vec3<R>, R) {
        for (at, grad) in [&lookup.at.sharp, &lookup.at.blurred].into_iter().zip(lookup.map_grads(grad)) {
            for (texel, weight) in Self::texels_of(at).into_iter().zip(at.weights()) {
                texels_grad[texel] = texels_grad[texel].add_scaled(weight, grad);
            }
        }
        lookup.vjp(roughness, self.levels, grad)
    }
}
