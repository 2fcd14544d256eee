//! Splats to channels, and the gradients of Gaussians, sixteen at a time.

use crate::{
    block::BlockPlanes,
    buffer::Buffer,
    context::Context,
    lanes::{LaneMask, Lanes},
    stages::{
        lookup::{Lookup, look_up, look_up_irradiance, split_sum},
        prefilter::Light,
        project::{BLOCKS_AT_ONCE, Splats},
    },
};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    attributes::{GaussianShading, LayerChannels, LightSample, ShadedGaussian},
    camera::{Camera, CameraOf},
    real::Real,
    rules::Channels,
    scene::{BLOCK, Gaussians},
    shade::{ShadingForm, Terms},
    vector::Vec3,
};

/// The channels of each Gaussian, side by side.
#[derive(Clone, Debug, PartialEq)]
pub struct Colors {
    /// Number of channels of a Gaussian.
    pub channels: usize,
    /// The numbers.
    pub(crate) values: Buffer<f32>,
}

impl Colors {
    /// Channels of one Gaussian; unspecified if it is not drawn.
    pub fn of(&self, gaussian: usize) -> &[f32] {
        &self.values[gaussian * self.channels..(gaussian + 1) * self.channels]
    }
}

/// Inputs of shading other than the Gaussians.
#[derive(Clone, Copy)]
pub(crate) struct Scene<'a> {
    pub(crate) shading: GaussianShading,
    pub(crate) light: Option<&'a Light>,
}

impl Scene<'_> {
    /// The light, if Gaussians look it up.
    pub(crate) fn gaussian_light(&self) -> Option<&Light> {
        self.light.filter(|_| !self.shading.rules.is_deferred(self.shading.layout))
    }
}

/// Shades the drawn splats; culls those with a colour that is not finite.
pub(crate) fn shade_all(
    context: &Context,
    gaussians: &Gaussians<Vec<f32>>,
    camera: &Camera,
    splats: &mut Splats,
    scene: Scene<'_>,
) -> Colors {
    let channels = scene.shading.channels().count();
    let mut values = context.take::<f32>(gaussians.count * channels);
    let block_len = gaussians.block_len();
    let chunks = gaussians.values.par_chunks(BLOCKS_AT_ONCE * block_len);
    chunks.zip(values.par_chunks_mut(BLOCKS_AT_ONCE * BLOCK * channels)).zip(splats.par_chunks_mut()).for_each(
        |((blocks, out), mut splats)| {
            dispatch!(context.level, simd => {
                let camera = camera.lift(Lanes::splat(simd, 0.0));
                for (index, (block, out)) in blocks.chunks_exact(block_len).zip(out.chunks_mut(BLOCK * channels)).enumerate() {
                    if splats.block_is_drawn(index) {
                        let is_finite = shade_block(simd, block, &camera, scene, out);
                        splats.leave_out(index, !is_finite.bits() as u16);
                    }
                }
            });
        },
    );
    Colors { channels, values }
}

/// Writes the channels of a block; returns the mask of Gaussians with finite attributes, among
/// those that were read.
#[inline(always)]
fn shade_block<S: Simd>(
    simd: S,
    block: &[f32],
    camera: &CameraOf<Lanes<S>>,
    scene: Scene<'_>,
    out: &mut [f32],
) -> LaneMask<S> {
    let planes = BlockPlanes { simd, values: block };
    let (channels, is_finite) = if scene.shading.reads_surface() {
        let lit = Lit::new(simd, &planes, camera, scene);
        (scene.shading.surface_channels(&lit.shaded, &lit.terms, camera), lit.shaded.is_finite())
    } else {
        scene.shading.color_channels(&planes, camera)
    };
    interleave(&channels, scene.shading.channels(), out);
    is_finite
}

/// The blended channels of each Gaussian, side by side.
fn interleave<S: Simd>(channels: &LayerChannels<Lanes<S>>, blended: Channels, out: &mut [f32]) {
    for (c, lanes) in channels.0.iter().enumerate() {
        let Some(channel) = blended.index_of(c) else { continue };
        let lanes = lanes.to_array();
        for (gaussian, value) in out.chunks_exact_mut(blended.count()).zip(lanes) {
            gaussian[channel] = value;
        }
    }
}

/// A block under its light.
pub(crate) struct Lit<S: Simd> {
    pub(crate) shaded: ShadedGaussian<Lanes<S>>,
    pub(crate) specular: Option<Lookup<S>>,
    pub(crate) ambient: Option<Lookup<S>>,
    pub(crate) terms: Terms<Lanes<S>>,
}

impl<S: Simd> Lit<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S, planes: &BlockPlanes<'_, S>, camera: &CameraOf<Lanes<S>>, scene: Scene<'_>) -> Self {
        let shaded = scene.shading.shaded(planes, camera.position);
        let surface = &shaded.surface;
        #[expect(clippy::manual_map, reason = "a closure is compiled without the context's vector features")]
        let specular = match scene.gaussian_light() {
            Some(light) => Some(look_up(simd, light, camera.light.to_light(surface.reflection_dir), surface.roughness)),
            None => None,
        };
        let is_official = scene.shading.rules.shading.form == ShadingForm::Official;
        let ambient = match scene.light {
            Some(light) if is_official => {
                Some(look_up_irradiance(simd, light, camera.light.to_light(surface.facing.normal)))
            }
            _ => None,
        };
        let light = LightSample {
            specular: radiance_of(&specular, surface.roughness),
            ambient: radiance_of(&ambient, surface.roughness),
            split_sum: if is_official {
                split_sum(simd, surface.n_dot_v, surface.roughness)
            } else {
                [surface.roughness.zero(); 2]
            },
        };
        let terms = shaded.terms(&light);
        Self { shaded, specular, ambient, terms }
    }
}

/// The light, if it was looked up.
#[inline(always)]
fn radiance_of<S: Simd>(lookup: &Option<Lookup<S>>, like: Lanes<S>) -> Vec3<Lanes<S>> {
    match lookup {
        Some(lookup) => lookup.radiance(),
        None => Vec3::zero(like),
    }
}
