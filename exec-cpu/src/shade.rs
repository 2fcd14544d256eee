//! Splats to channels, and the gradients of Gaussians, sixteen at a time.

use crate::{
    CpuExecutor,
    blend::{CHANNELS_MAX, GEOMETRY, SplatGrads},
    block::{BlockGrads, BlockPlanes},
    buffer::Buffer,
    lanes::{LaneMask, Lanes},
    light::{Lookup, look_up, look_up_irradiance, look_up_vjp, split_sum, split_sum_vjp},
    machine::Machine,
    optimise::{StepSize, adam_chunk},
    prefilter::{Light, LightGrad, Texel},
    project::{BLOCKS_AT_ONCE, Splats},
};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    attributes::{
        AttributePlanes, GaussianShading, LayerChannels, LightSample, LookupGrad, PoseGrad, ShadedGaussian, shape_vjp,
    },
    camera::{Camera, CameraOf},
    each,
    executor::TrainingStep,
    loss::{LossWeights, residual_vjp, sparse_vjp},
    real::Real,
    rules::{Channels, channel},
    scene::{BLOCK, Gaussians, Layout, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY},
    shade::{ShadingForm, Terms},
    splat::SplatGrad,
    state::AdamMoments,
    vector::Vec3,
};

/// The channels of each Gaussian, side by side.
#[derive(Clone, Debug, PartialEq)]
pub struct Colors {
    /// How many numbers a Gaussian has.
    pub channels: usize,
    /// The numbers.
    pub(crate) values: Buffer<f32>,
}

impl Colors {
    /// The channels of one Gaussian; whatever, if it is not drawn.
    pub fn of(&self, gaussian: usize) -> &[f32] {
        &self.values[gaussian * self.channels..(gaussian + 1) * self.channels]
    }
}

/// What shading needs beside the Gaussians.
#[derive(Clone, Copy)]
pub(crate) struct Scene<'a> {
    pub(crate) shading: GaussianShading,
    pub(crate) light: Option<&'a Light>,
}

impl Scene<'_> {
    /// The light, if Gaussians look it up.
    fn own_light(&self) -> Option<&Light> {
        self.light.filter(|_| !self.shading.rules.is_deferred(self.shading.layout))
    }
}

/// The channels of what is drawn; what has a colour that is not finite is not drawn any more.
pub(crate) fn shade_all(
    machine: &Machine,
    gaussians: &Gaussians<Vec<f32>>,
    camera: &Camera,
    splats: &mut Splats,
    scene: Scene<'_>,
) -> Colors {
    let channels = scene.shading.channels().count();
    let mut values = machine.numbers.take(gaussians.count * channels);
    let block_len = gaussians.block_len();
    let chunks = gaussians.values.par_chunks(BLOCKS_AT_ONCE * block_len);
    chunks.zip(values.par_chunks_mut(BLOCKS_AT_ONCE * BLOCK * channels)).zip(splats.par_chunks_mut()).for_each(
        |((blocks, out), mut splats)| {
            dispatch!(machine.level, simd => {
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

/// Writes the channels of a block, and says whose attributes are finite, of those that were read.
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

/// The channels of each Gaussian side by side, of those that are blended.
fn interleave<S: Simd>(channels: &LayerChannels<Lanes<S>>, blended: Channels, out: &mut [f32]) {
    for (c, lanes) in channels.0.iter().enumerate() {
        let Some(place) = blended.index_of(c) else { continue };
        let lanes = lanes.to_array();
        for (gaussian, value) in out.chunks_exact_mut(blended.count()).zip(lanes) {
            gaussian[place] = value;
        }
    }
}

/// A block under its light.
struct Lit<S: Simd> {
    shaded: ShadedGaussian<Lanes<S>>,
    specular: Option<Lookup<S>>,
    ambient: Option<Lookup<S>>,
    terms: Terms<Lanes<S>>,
}

impl<S: Simd> Lit<S> {
    #[inline(always)]
    fn new(simd: S, planes: &BlockPlanes<'_, S>, camera: &CameraOf<Lanes<S>>, scene: Scene<'_>) -> Self {
        let shaded = scene.shading.shaded(planes, camera.position);
        let surface = &shaded.surface;
        #[expect(clippy::manual_map, reason = "a closure is compiled without the machine's vector features")]
        let specular = match scene.own_light() {
            Some(light) => Some(look_up(simd, light, surface.reflection_dir, surface.roughness)),
            None => None,
        };
        let is_official = scene.shading.rules.shading.form == ShadingForm::Official;
        let ambient = match scene.light {
            Some(light) if is_official => Some(look_up_irradiance(simd, light, surface.facing.normal)),
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

/// The light that was looked up, if any was.
#[inline(always)]
fn radiance_of<S: Simd>(lookup: &Option<Lookup<S>>, like: Lanes<S>) -> Vec3<Lanes<S>> {
    match lookup {
        Some(lookup) => lookup.radiance(),
        None => Vec3::zero(like),
    }
}

/// Parts into which Gaussians or pixels are divided while they add to the light's gradient. The number is fixed, so the
/// sum's order is the same on any number of threads.
pub(crate) const LIGHT_PARTS: usize = 8;

pub(crate) fn gaussians_vjp(
    machine: &Machine,
    gaussians: &Gaussians<Vec<f32>>,
    camera: &Camera,
    splats: &Splats,
    scene: Scene<'_>,
    weights: &LossWeights,
    grads: &SplatGrads,
) -> (Gaussians<Vec<f32>>, Option<LightGrad>) {
    let mut out = machine.numbers.take(gaussians.values.len());
    let from = Backwards { splats, scene, weights, grads, count: gaussians.count };
    let block_len = gaussians.block_len();
    let parts = from.parts(gaussians.values.len() / block_len);
    let mut texels = from.texels(machine);
    gaussians
        .values
        .par_chunks(parts.blocks * block_len)
        .zip(out.par_chunks_mut(parts.blocks * block_len))
        .zip(texels.par_chunks_mut(from.texel_count().max(1)))
        .enumerate()
        .for_each(|(part, ((blocks, out), light_grad))| {
            light_grad.fill([0.0; 4]);
            dispatch!(machine.level, simd => {
                let camera = camera.lift(Lanes::splat(simd, 0.0));
                let blocks = blocks.chunks_exact(block_len).zip(out.chunks_exact_mut(block_len));
                for (number, (block, out)) in (part * parts.blocks..).zip(blocks) {
                    from.block(simd, &camera, number, block, out, light_grad);
                }
            });
        });
    let grad = Gaussians { count: gaussians.count, layout: gaussians.layout, values: out.into_vec() };
    (grad, scene.own_light().map(|_| sum_parts(texels, from.texel_count(), parts.count)))
}

/// [`gaussians_vjp`] and Adam's step, block by block: a gradient is used where it was made.
pub(crate) fn update(
    machine: &Machine,
    gaussians: &mut Gaussians<Vec<f32>>,
    moments: &mut AdamMoments<Vec<f32>>,
    step: &TrainingStep<'_, CpuExecutor>,
    splats: &Splats,
    scene: Scene<'_>,
    grads: &SplatGrads,
    size: &StepSize,
) -> (usize, Option<LightGrad>) {
    let count = gaussians.count;
    let from = Backwards { splats, scene, weights: step.weights, grads, count };
    let block_len = gaussians.block_len();
    let parts = from.parts(gaussians.values.len() / block_len);
    let mut texels = from.texels(machine);
    let chunk = parts.blocks * block_len;
    let nonfinite = gaussians
        .values
        .par_chunks_mut(chunk)
        .zip(moments.mean.par_chunks_mut(chunk).zip(moments.square.par_chunks_mut(chunk)))
        .zip(texels.par_chunks_mut(from.texel_count().max(1)))
        .enumerate()
        .map(|(part, ((blocks, (mean, square)), light_grad))| {
            light_grad.fill([0.0; 4]);
            dispatch!(machine.level, simd => {
                let camera = step.camera.lift(Lanes::splat(simd, 0.0));
                let mut grad = [0.0; BLOCK * PLANES_MAX];
                let grad = &mut grad[..block_len];
                let moments = mean.chunks_exact_mut(block_len).zip(square.chunks_exact_mut(block_len));
                let mut nonfinite = 0;
                for (number, (block, (mean, square))) in (part * parts.blocks..).zip(blocks.chunks_exact_mut(block_len).zip(moments)) {
                    from.block(simd, &camera, number, block, grad, light_grad);
                    nonfinite += adam_chunk(simd, block, mean, square, grad, size);
                }
                nonfinite
            })
        })
        .sum();
    (nonfinite, scene.own_light().map(|_| sum_parts(texels, from.texel_count(), parts.count)))
}

/// The most planes that a cloud can have.
const PLANES_MAX: usize = Layout::shaded(Some(3)).plane_count();

/// How blocks are divided among tasks.
struct BlockParts {
    /// Blocks of a part.
    blocks: usize,
    /// Parts that have any.
    count: usize,
}

/// What the way back through shading and projection reads.
struct Backwards<'a> {
    splats: &'a Splats,
    scene: Scene<'a>,
    weights: &'a LossWeights,
    grads: &'a SplatGrads,
    /// Gaussians.
    count: usize,
}

impl Backwards<'_> {
    /// As many parts as add to the light's gradient, or more if none do.
    fn part_count(&self) -> usize {
        const MANY: usize = 64;
        if self.scene.own_light().is_some() { LIGHT_PARTS } else { MANY }
    }
    fn parts(&self, block_count: usize) -> BlockParts {
        let blocks = block_count.div_ceil(self.part_count()).max(1);
        BlockParts { blocks, count: block_count.div_ceil(blocks) }
    }
    fn texel_count(&self) -> usize {
        self.scene.own_light().map_or(0, |light| light.texels.len())
    }
    /// Memory for the light's gradients of all parts.
    fn texels(&self, machine: &Machine) -> Buffer<Texel> {
        machine.texels.take(self.part_count() * self.texel_count().max(1))
    }
    /// The gradient of one block; adds to the light's.
    #[inline(always)]
    fn block<S: Simd>(
        &self,
        simd: S,
        camera: &CameraOf<Lanes<S>>,
        number: usize,
        block: &[f32],
        out: &mut [f32],
        light_grad: &mut [Texel],
    ) {
        out.fill(0.0);
        if self.splats.block_is_drawn(number) {
            let grads = SplatGradLanes::new(simd, self.grads, number);
            block_vjp(simd, block, camera, self.scene, &grads, out, light_grad);
        }
        attribute_losses_vjp(simd, block, self.scene, self.weights, self.count, out);
    }
}

/// The sum of lights' gradients, in the order of the parts.
pub(crate) fn sum_parts(mut texels: Buffer<Texel>, texel_count: usize, part_count: usize) -> LightGrad {
    const TEXELS_AT_ONCE: usize = 4096;
    let (sum, others) = texels.split_at_mut(texel_count);
    if part_count == 0 {
        sum.fill([0.0; 4]);
    }
    let others = &others[..part_count.saturating_sub(1) * texel_count];
    sum.par_chunks_mut(TEXELS_AT_ONCE).enumerate().for_each(|(chunk, sum)| {
        for part in others.chunks_exact(texel_count) {
            let own = &part[chunk * TEXELS_AT_ONCE..][..sum.len()];
            sum.iter_mut().zip(own).for_each(|(sum, texel)| {
                sum.iter_mut().zip(texel).for_each(|(sum, x)| *sum += x);
            });
        }
    });
    texels.truncate(texel_count);
    LightGrad { texels }
}

/// Gradients of a block's splats as lanes; zero for what is not there or not drawn.
struct SplatGradLanes<S: Simd> {
    geometry: [Lanes<S>; GEOMETRY],
    channels: LayerChannels<Lanes<S>>,
    /// Where any gradient is not zero.
    is_touched: <Lanes<S> as Real>::Mask,
}

impl<S: Simd> SplatGradLanes<S> {
    #[inline(always)]
    fn new(simd: S, grads: &SplatGrads, block: usize) -> Self {
        let planes = grads.block(block);
        let zero = Lanes::splat(simd, 0.0);
        let load = |plane: usize| Lanes::load(simd, &planes[plane * BLOCK..]);
        // What is not a number is not zero.
        let is_zero = |lanes: Lanes<S>| zero.less_or_equal(lanes) & lanes.less_or_equal(zero);
        let mut are_zero = is_zero(load(0));
        for plane in 1..planes.len() / BLOCK {
            are_zero = are_zero & is_zero(load(plane));
        }
        let (mut geometry, mut channels) = ([zero; GEOMETRY], LayerChannels([zero; CHANNELS_MAX]));
        for k in 0..GEOMETRY {
            geometry[k] = load(k);
        }
        let blended = Channels::of_count(grads.channels);
        for (k, lanes) in channels.0.iter_mut().enumerate() {
            if let Some(place) = blended.index_of(k) {
                *lanes = load(GEOMETRY + place);
            }
        }
        Self { geometry, channels, is_touched: !are_zero }
    }
}

#[inline(always)]
fn block_vjp<S: Simd>(
    simd: S,
    block: &[f32],
    camera: &CameraOf<Lanes<S>>,
    scene: Scene<'_>,
    grads: &SplatGradLanes<S>,
    out: &mut [f32],
    light_grad: &mut [Texel],
) {
    let is_touched = grads.is_touched;
    if is_touched.bits() == 0 {
        return;
    }
    let planes = BlockPlanes { simd, values: block };
    let mut out = BlockGrads { values: out, is_touched };
    let pose = if scene.shading.layout.is_shaded() {
        lit_vjp(simd, &planes, camera, scene, grads, &mut out, light_grad)
    } else {
        scene.shading.radiance_vjp(&planes, camera.position, &grads.channels, &mut out)
    };
    let g = grads.geometry;
    let splat_grad = SplatGrad {
        mean2d: [g[0], g[1]],
        root_conic: [g[2], g[3], g[4]],
        depth: grads.channels.0[channel::DEPTH],
        opacity: g[5],
    };
    shape_vjp(&planes.shape(), camera, &splat_grad, &pose, &mut out);
}

/// Writes the gradients of the shading attributes and adds those of the light.
#[inline(always)]
fn lit_vjp<S: Simd>(
    simd: S,
    planes: &BlockPlanes<'_, S>,
    camera: &CameraOf<Lanes<S>>,
    scene: Scene<'_>,
    grads: &SplatGradLanes<S>,
    out: &mut BlockGrads<'_, S>,
    light_grad: &mut [Texel],
) -> PoseGrad<Lanes<S>> {
    let lit = Lit::new(simd, planes, camera, scene);
    let grad = scene.shading.terms_vjp(&lit.terms, &grads.channels);
    let surface = &lit.shaded.surface;
    let mut lookup = LookupGrad { specular: None, ambient: None };
    if let (Some(found), Some(light)) = (&lit.specular, scene.own_light()) {
        let of_light = each!(grad.specular_light, g => g.keep(out.is_touched));
        lookup.specular = Some(look_up_vjp(simd, light, found, surface.roughness, of_light, light_grad));
    }
    if let (Some(found), Some(light)) = (&lit.ambient, scene.light) {
        let of_light = each!(grad.ambient_light, g => g.keep(out.is_touched));
        let (normal, _) = look_up_vjp(simd, light, found, surface.roughness, of_light, light_grad);
        lookup.ambient = Some((normal, split_sum_vjp(simd, surface.n_dot_v, surface.roughness, grad.split_sum)));
    }
    scene.shading.surface_vjp(planes, camera.position, &lit.shaded, &grad, &grads.channels, &lookup, out)
}

/// Adds the losses that look at attributes, not at pictures: sparse opacities and small normal residuals.
#[inline(always)]
fn attribute_losses_vjp<S: Simd>(
    simd: S,
    block: &[f32],
    scene: Scene<'_>,
    weights: &LossWeights,
    count: usize,
    out: &mut [f32],
) {
    let share = 1.0 / count as f32;
    let mut add = |plane: usize, grad: Lanes<S>| {
        let slot = &mut out[plane * BLOCK..];
        (Lanes::load(simd, slot) + grad).store(slot);
    };
    if weights.sparse != 0.0 {
        let logit = Lanes::load(simd, &block[OPACITY * BLOCK..]);
        add(OPACITY, sparse_vjp(logit, logit.constant(weights.sparse * share)));
    }
    if weights.residual != 0.0 && scene.shading.layout.is_shaded() {
        for plane in NORMAL_RESIDUAL_1..NORMAL_RESIDUAL_2 + 3 {
            let number = Lanes::load(simd, &block[plane * BLOCK..]);
            add(plane, residual_vjp(number, number.constant(2.0 * weights.residual * share)));
        }
    }
}
