//! Surfaces of a blended tile, sixteen pixels at a time.

use crate::{
    frame::{PIXEL_X, PIXEL_Y, QUADS, Quad, at, quad_origin},
    lanes::Lanes,
};
use fearless_simd::Simd;
use specula_core::{
    camera::CameraOf,
    rules::{Channels, channel},
    shade_pixels::Pixel,
    vector::{Vec3, vec3},
};

/// The numbers of a quad of a tile, by the channels of all layers.
#[derive(Clone, Copy)]
pub(crate) struct BlendedQuad<'a, S: Simd> {
    simd: S,
    tile: &'a [Quad],
    quad: usize,
    channels: Channels,
}

impl<'a, S: Simd> BlendedQuad<'a, S> {
    #[inline(always)]
    pub(crate) fn new(simd: S, tile: &'a [Quad], quad: usize) -> Self {
        Self { simd, tile, quad, channels: Channels::of_count(tile.len() / QUADS - 1) }
    }
    /// Loads a channel; zero for one that is not blended, because nothing reads it.
    #[inline(always)]
    pub(crate) fn load(&self, channel: usize) -> Lanes<S> {
        match self.channels.index_of(channel) {
            Some(index) => Lanes::load(self.simd, &self.tile[at(self.channels.count(), self.quad, index)]),
            None => Lanes::splat(self.simd, 0.0),
        }
    }
    #[inline(always)]
    pub(crate) fn load3(&self, channel: usize) -> Vec3<Lanes<S>> {
        vec3(self.load(channel), self.load(channel + 1), self.load(channel + 2))
    }
    #[inline(always)]
    pub(crate) fn transmittance(&self) -> Lanes<S> {
        let count = self.channels.count();
        Lanes::load(self.simd, &self.tile[at(count, self.quad, count)])
    }
}

/// Blended surface of a quad, and its view directions.
pub(crate) struct SurfaceQuad<S: Simd> {
    pub(crate) pixel: Pixel<Lanes<S>>,
    pub(crate) view_dir: Vec3<Lanes<S>>,
}

impl<S: Simd> SurfaceQuad<S> {
    /// A quad of a tile; `None` if it is not covered.
    #[inline(always)]
    pub(crate) fn new(
        simd: S,
        tile: &[Quad],
        quad: usize,
        origin: [f32; 2],
        camera: &CameraOf<Lanes<S>>,
    ) -> Option<Self> {
        let blended = BlendedQuad::new(simd, tile, quad);
        let coverage = -blended.transmittance() + 1.0;
        if !coverage.any_positive() {
            return None;
        }
        let pixel = Pixel {
            base: blended.load3(channel::COLOR),
            normal: blended.load3(channel::NORMAL),
            tint: blended.load3(channel::TINT),
            roughness: blended.load(channel::ROUGHNESS),
            coverage,
        };
        let [x, y] = quad_origin(quad);
        let x = Lanes::from_array(simd, PIXEL_X) + (origin[0] + x as f32);
        let y = Lanes::from_array(simd, PIXEL_Y) + (origin[1] + y as f32);
        Some(Self { pixel, view_dir: camera.view_dir(x, y) })
    }
}
