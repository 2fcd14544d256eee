//! Surfaces of a blended tile, sixteen pixels at a time.

use crate::{
    frame::{PIXEL_X, PIXEL_Y, QUADS, Quad, at, quad_origin},
    lanes::Lanes,
};
use fearless_simd::Simd;
use specula_core::{
    camera::CameraOf,
    pixel_light::{BlendedGrads, BlendedPixel},
    rules::Channels,
    vector::Vec3,
};

/// The numbers of a quad of a tile, or their gradients.
#[derive(Clone, Copy)]
pub(crate) struct BlendedQuad<S, T> {
    simd: S,
    tile: T,
    quad: usize,
    channels: Channels,
}

impl<S: Simd, T: AsRef<[Quad]>> BlendedQuad<S, T> {
    #[inline(always)]
    pub(crate) fn new(simd: S, tile: T, quad: usize) -> Self {
        let channels = Channels::of_count(tile.as_ref().len() / QUADS - 1);
        Self { simd, tile, quad, channels }
    }
    #[inline(always)]
    fn load(&self, index: usize) -> Lanes<S> {
        Lanes::load(self.simd, &self.tile.as_ref()[at(self.channels.count(), self.quad, index)])
    }
}

impl<S: Simd, T: AsRef<[Quad]>> BlendedPixel<Lanes<S>> for BlendedQuad<S, T> {
    #[inline(always)]
    fn channel(&self, channel: usize) -> Lanes<S> {
        match self.channels.index_of(channel) {
            Some(index) => self.load(index),
            None => Lanes::splat(self.simd, 0.0),
        }
    }
    #[inline(always)]
    fn transmittance(&self) -> Lanes<S> {
        self.load(self.channels.count())
    }
}

impl<S: Simd, T: AsRef<[Quad]> + AsMut<[Quad]>> BlendedGrads<Lanes<S>> for BlendedQuad<S, T> {
    #[inline(always)]
    fn set(&mut self, channel: usize, grad: Lanes<S>) {
        if let Some(index) = self.channels.index_of(channel) {
            grad.store(&mut self.tile.as_mut()[at(self.channels.count(), self.quad, index)]);
        }
    }
    #[inline(always)]
    fn set_transmittance(&mut self, grad: Lanes<S>) {
        let count = self.channels.count();
        grad.store(&mut self.tile.as_mut()[at(count, self.quad, count)]);
    }
}

/// The numbers of a quad that is covered, and its view directions.
pub(crate) struct SurfaceQuad<'a, S: Simd> {
    pub(crate) blended: BlendedQuad<S, &'a [Quad]>,
    pub(crate) view_dir: Vec3<Lanes<S>>,
}

impl<'a, S: Simd> SurfaceQuad<'a, S> {
    /// A quad of a tile; `None` if nothing covers it.
    #[inline(always)]
    pub(crate) fn new(
        simd: S,
        tile: &'a [Quad],
        quad: usize,
        origin: [f32; 2],
        camera: &CameraOf<Lanes<S>>,
    ) -> Option<Self> {
        let blended = BlendedQuad::new(simd, tile, quad);
        if !blended.coverage().any_positive() {
            return None;
        }
        let [x, y] = quad_origin(quad);
        let x = Lanes::from_array(simd, PIXEL_X) + (origin[0] + x as f32);
        let y = Lanes::from_array(simd, PIXEL_Y) + (origin[1] + y as f32);
        Some(Self { blended, view_dir: camera.view_dir(x, y) })
    }
}
