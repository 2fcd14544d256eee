//! Gradients of Gaussians from those of their splats and channels, sixteen at a time.

use crate::{
    block::{AddedBlockGrads, BlockGrads, BlockPlanes},
    buffer::Buffer,
    context::Context,
    lanes::Lanes,
    stages::{
        blend::CHANNELS_MAX,
        blend_vjp::{GEOMETRY, SplatGrads},
        lookup::{LIGHT_PARTS, look_up_vjp, split_sum_vjp, sum_parts},
        optimise::{StepSize, adam_chunk},
        prefilter::{LightGrad, Texel},
        project::Splats,
        shade::{Lit, Scene},
    },
};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    attributes::{AttributeLosses, AttributePlanes, LayerChannels, LookupGrad, PoseGrad, camera_vjp, shape_vjp},
    camera::{Camera, CameraGrad, CameraOf},
    double::Double,
    each,
    loss::LossWeights,
    real::Real,
    rules::{Channels, channel},
    scene::{BLOCK, Gaussians, Layout, OPACITY},
    splat::SplatGrad,
    state::AdamMoments,
    vector::vec3,
};

/// Gradients of Gaussians, of the light that they look up, and of the camera, if it is wanted.
pub(crate) fn gaussians_vjp(
    context: &Context,
    gaussians: &Gaussians<Vec<f32>>,
    camera: &Camera,
    splats: &Splats,
    scene: Scene<'_>,
    weights: &LossWeights,
    grads: &SplatGrads,
    moves_camera: bool,
) -> (Gaussians<Vec<f32>>, Option<LightGrad>, CameraGrad<Double>) {
    let mut out = context.take::<f32>(gaussians.values.len());
    let from = Backwards { splats, scene, weights, grads, count: gaussians.count, moves_shape: true };
    let mut camera_sums = [CameraSum::default(); MANY_PARTS];
    let block_len = gaussians.block_len();
    let parts = from.parts(gaussians.values.len() / block_len);
    let mut texels = from.texels(context);
    gaussians
        .values
        .par_chunks(parts.blocks * block_len)
        .zip(out.par_chunks_mut(parts.blocks * block_len))
        .zip(texels.par_chunks_mut(from.texel_count().max(1)))
        .zip(&mut camera_sums)
        .enumerate()
        .for_each(|(part, (((blocks, out), light_grad), camera_sum))| {
            light_grad.fill([0.0; 4]);
            dispatch!(context.level, simd => {
                let camera = camera.lift(Lanes::splat(simd, 0.0));
                let blocks = blocks.chunks_exact(block_len).zip(out.chunks_exact_mut(block_len));
                for (number, (block, out)) in (part * parts.blocks..).zip(blocks) {
                    let camera_sum = if moves_camera { Some(&mut *camera_sum) } else { None };
                    from.block(simd, &camera, number, block, out, light_grad, camera_sum);
                }
            });
        });
    let grad = Gaussians { count: gaussians.count, layout: gaussians.layout, values: out.into_vec() };
    let light_grad = scene.gaussian_light().map(|_| sum_parts(texels, from.texel_count(), parts.count));
    (grad, light_grad, CameraSum::total(&camera_sums))
}

/// Sums of the gradient of a camera: the rows of its rotation, then its centre.
#[derive(Clone, Copy, Default)]
struct CameraSum([[f64; 3]; 4]);

impl CameraSum {
    /// Adds the gradients through a block, lane by lane.
    #[inline(always)]
    fn add<S: Simd>(&mut self, grad: CameraGrad<Lanes<S>>) {
        for (sum, row) in self.0.iter_mut().zip(grad.rows()) {
            for (sum, lanes) in sum.iter_mut().zip(row.to_array()) {
                for lane in lanes.to_array() {
                    *sum += f64::from(lane);
                }
            }
        }
    }
    /// The sum of all parts, in their order.
    fn total(parts: &[Self]) -> CameraGrad<Double> {
        let mut total = [[0.0; 3]; 4];
        for Self(part) in parts {
            total.as_flattened_mut().iter_mut().zip(part.as_flattened()).for_each(|(sum, x)| *sum += x);
        }
        CameraGrad::from_rows(total.map(|[x, y, z]| vec3(Double(x), Double(y), Double(z))))
    }
}

/// [`gaussians_vjp`] and Adam's step, block by block: gradients are never stored.
pub(crate) fn update(
    context: &Context,
    gaussians: &mut Gaussians<Vec<f32>>,
    moments: &mut AdamMoments<Vec<f32>>,
    camera: &Camera,
    splats: &Splats,
    scene: Scene<'_>,
    weights: &LossWeights,
    grads: &SplatGrads,
    size: &StepSize,
) -> (usize, Option<LightGrad>) {
    let count = gaussians.count;
    let from = Backwards { splats, scene, weights, grads, count, moves_shape: size.moves_any(0..=OPACITY) };
    let block_len = gaussians.block_len();
    let parts = from.parts(gaussians.values.len() / block_len);
    let mut texels = from.texels(context);
    let chunk = parts.blocks * block_len;
    let nonfinite = gaussians
        .values
        .par_chunks_mut(chunk)
        .zip(moments.mean.par_chunks_mut(chunk).zip(moments.square.par_chunks_mut(chunk)))
        .zip(texels.par_chunks_mut(from.texel_count().max(1)))
        .enumerate()
        .map(|(part, ((blocks, (mean, square)), light_grad))| {
            light_grad.fill([0.0; 4]);
            dispatch!(context.level, simd => {
                let camera = camera.lift(Lanes::splat(simd, 0.0));
                let mut grad = [0.0; BLOCK * PLANES_MAX];
                let grad = &mut grad[..block_len];
                let moments = mean.chunks_exact_mut(block_len).zip(square.chunks_exact_mut(block_len));
                let mut nonfinite = 0;
                for (number, (block, (mean, square))) in (part * parts.blocks..).zip(blocks.chunks_exact_mut(block_len).zip(moments)) {
                    from.block(simd, &camera, number, block, grad, light_grad, None);
                    nonfinite += adam_chunk(simd, block, mean, square, grad, size);
                }
                nonfinite
            })
        })
        .sum();
    (nonfinite, scene.gaussian_light().map(|_| sum_parts(texels, from.texel_count(), parts.count)))
}

/// Maximum number of planes.
const PLANES_MAX: usize = Layout::shaded(Some(3)).physical().antialiased().plane_count();

/// Parts of Gaussians that add to no light.
const MANY_PARTS: usize = 64;
const _: () = assert!(LIGHT_PARTS <= MANY_PARTS, "each part has a sum of the camera's gradient");

/// Division of blocks among tasks.
struct BlockParts {
    /// Blocks of a part.
    blocks: usize,
    /// Number of non-empty parts.
    count: usize,
}

/// Inputs of the backward pass through shading and projection.
struct Backwards<'a> {
    splats: &'a Splats,
    scene: Scene<'a>,
    weights: &'a LossWeights,
    grads: &'a SplatGrads,
    /// Gaussians.
    count: usize,
    /// True if gradients of shapes are used; steps of materials do not change shapes.
    moves_shape: bool,
}

impl Backwards<'_> {
    /// Number of parts: [`LIGHT_PARTS`] if they add to the light's gradient, else more.
    fn part_count(&self) -> usize {
        if self.scene.gaussian_light().is_some() { LIGHT_PARTS } else { MANY_PARTS }
    }
    fn parts(&self, block_count: usize) -> BlockParts {
        let blocks = block_count.div_ceil(self.part_count()).max(1);
        BlockParts { blocks, count: block_count.div_ceil(blocks) }
    }
    fn texel_count(&self) -> usize {
        self.scene.gaussian_light().map_or(0, |light| light.texels.len())
    }
    /// Memory for the light's gradients of all parts.
    fn texels(&self, context: &Context) -> Buffer<Texel> {
        context.take::<Texel>(self.part_count() * self.texel_count().max(1))
    }
    /// The gradient of one block; adds to the light's, and to the camera's if there is a sum of
    /// it.
    #[inline(always)]
    fn block<S: Simd>(
        &self,
        simd: S,
        camera: &CameraOf<Lanes<S>>,
        number: usize,
        block: &[f32],
        out: &mut [f32],
        light_grad: &mut [Texel],
        camera_sum: Option<&mut CameraSum>,
    ) {
        out.fill(0.0);
        if self.splats.block_is_drawn(number) {
            let grads = SplatGradLanes::new(simd, self.grads, number);
            block_vjp(simd, block, camera, self, &grads, out, light_grad, camera_sum);
        }
        add_attribute_losses(simd, block, self.scene.shading.layout, self.weights, self.count, out);
    }
}

/// Gradients of a block's splats as lanes; zero for splats that are not drawn.
struct SplatGradLanes<S: Simd> {
    geometry: [Lanes<S>; GEOMETRY],
    channels: LayerChannels<Lanes<S>>,
    /// Mask of Gaussians with a nonzero gradient.
    is_touched: <Lanes<S> as Real>::Mask,
}

impl<S: Simd> SplatGradLanes<S> {
    #[inline(always)]
    fn new(simd: S, grads: &SplatGrads, block: usize) -> Self {
        let planes = grads.block(block);
        let zero = Lanes::splat(simd, 0.0);
        let load = |plane: usize| Lanes::load(simd, &planes[plane * BLOCK..]);
        // NaN is not zero.
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
            if let Some(channel) = blended.index_of(k) {
                *lanes = load(GEOMETRY + channel);
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
    from: &Backwards<'_>,
    grads: &SplatGradLanes<S>,
    out: &mut [f32],
    light_grad: &mut [Texel],
    camera_sum: Option<&mut CameraSum>,
) {
    let scene = from.scene;
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
    if !from.moves_shape {
        return;
    }
    let g = grads.geometry;
    let splat_grad = SplatGrad {
        mean2d: [g[0], g[1]],
        root_conic: [g[2], g[3], g[4]],
        depth: grads.channels.0[channel::DEPTH],
        opacity: g[5],
    };
    let shape = planes.shape(scene.shading.layout);
    shape_vjp(&shape, camera, &splat_grad, &pose, &mut out);
    if let Some(sum) = camera_sum {
        sum.add(camera_vjp(&shape, camera, &splat_grad, &pose).keep(is_touched));
    }
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
    if let (Some(found), Some(light)) = (&lit.specular, scene.gaussian_light()) {
        let grad_light = each!(grad.specular_light, g => g.keep(out.is_touched));
        let (direction, roughness) = look_up_vjp(simd, light, found, surface.roughness, grad_light, light_grad);
        lookup.specular = Some((camera.light.to_light_vjp(direction), roughness));
    }
    if let (Some(found), Some(light)) = (&lit.ambient, scene.light) {
        let grad_light = each!(grad.ambient_light, g => g.keep(out.is_touched));
        let (normal, _) = look_up_vjp(simd, light, found, surface.roughness, grad_light, light_grad);
        let normal = camera.light.to_light_vjp(normal);
        lookup.ambient = Some((normal, split_sum_vjp(simd, surface.n_dot_v, surface.roughness, grad.split_sum)));
    }
    scene.shading.surface_vjp(planes, camera.position, &lit.shaded, &grad, &grads.channels, &lookup, out)
}

/// Adds the gradients of the losses on attributes.
#[inline(always)]
fn add_attribute_losses<S: Simd>(
    simd: S,
    block: &[f32],
    layout: Layout,
    weights: &LossWeights,
    count: usize,
    out: &mut [f32],
) {
    let planes = BlockPlanes { simd, values: block };
    let factors = AttributeLosses::factors(weights, count).map(|factor| Lanes::splat(simd, factor));
    AttributeLosses::new(weights, layout).loss_vjp(&planes, factors, &mut AddedBlockGrads { simd, values: out });
}
