//! Splats to channels, and the gradients of Gaussians, sixteen at a time.

use crate::{
    CpuExecutor,
    blend::{CHANNELS_MAX, GEOMETRY, SplatGrads},
    buffer::Buffer,
    lanes::{LaneMask, Lanes, store3},
    light::{Lookup, look_up, look_up_irradiance, look_up_vjp, split_sum, split_sum_vjp},
    machine::Machine,
    optimise::{StepSize, adam_chunk},
    prefilter::{Light, LightGrad, Texel},
    project::{BLOCKS_AT_ONCE, Splats, load_shape, project_block_vjp},
};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    camera::{Camera, CameraOf},
    each,
    executor::TrainingStep,
    loss::{LossWeights, residual_vjp, sparse_vjp},
    real::Real,
    rules::{Channels, RenderRules, channel},
    scene::{BLOCK, DIFFUSE, Gaussians, Layout, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY, ROUGHNESS, TINT},
    sh,
    shade::{
        Material, ShadingForm, Surface, SurfaceGrad, Terms, diffuse, shade, shade_vjp, surface, surface_vjp, view_dir,
        view_dir_vjp,
    },
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
    pub(crate) layout: Layout,
    pub(crate) light: Option<&'a Light>,
    pub(crate) rules: &'a RenderRules,
}

impl Scene<'_> {
    /// The channels that a Gaussian has.
    fn channels(&self) -> Channels {
        self.rules.blended(self.layout)
    }
    /// The light, if Gaussians look it up.
    fn own_light(&self) -> Option<&Light> {
        self.light.filter(|_| !self.rules.is_deferred(self.layout))
    }
    /// Harmonics that are in use.
    fn sh_count(&self) -> usize {
        match (self.rules.sh_degree, self.layout.sh_degree) {
            (Some(wanted), Some(present)) => (usize::from(wanted.min(present)) + 1).pow(2),
            _ => 0,
        }
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
    let channels = scene.channels().count();
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

/// The channels of a block, as lanes.
type BlockChannels<S> = [Lanes<S>; CHANNELS_MAX];

/// Writes the channels of a block, and says whose attributes are finite, of those that were read.
#[inline(always)]
fn shade_block<S: Simd>(
    simd: S,
    block: &[f32],
    camera: &CameraOf<Lanes<S>>,
    scene: Scene<'_>,
    out: &mut [f32],
) -> LaneMask<S> {
    let shape = load_shape(simd, block);
    let mut channels = [Lanes::splat(simd, 0.0); CHANNELS_MAX];
    channels[channel::DEPTH] = camera.to_camera(shape.mean).z;
    let is_finite;
    if scene.layout.is_shaded() && scene.rules.is_color_alone(scene.layout) {
        let color;
        (color, is_finite) = unlit_color(simd, block, camera, scene);
        put(&mut channels, channel::COLOR, color);
    } else if scene.layout.is_shaded() {
        let shaded = Shaded::new(simd, block, camera, scene);
        let color = shade(scene.rules.shading.form, &shaded.terms);
        put(&mut channels, channel::COLOR, color);
        put(&mut channels, channel::NORMAL, shaded.surface.facing.normal);
        channels[channel::RESIDUAL_SIZE] = shaded.surface.facing.residual_squared;
        put(&mut channels, channel::TINT, shaded.terms.tint);
        channels[channel::ROUGHNESS] = shaded.surface.roughness;
        if scene.channels() == Channels::Layers {
            put_layers(&mut channels, &shaded, scene.rules.shading.form);
        }
        is_finite = shaded.material.is_finite() & shaded.terms.residual.is_finite();
    } else {
        let seen = Harmonics::new(simd, block, camera, scene);
        put(&mut channels, channel::COLOR, sh::radiance(seen.sum));
        let axis = plain_normal(simd, block, camera);
        put(&mut channels, channel::NORMAL, axis);
        is_finite = seen.sum.is_finite();
    }
    interleave(&channels, scene.channels(), out);
    is_finite
}

/// The channels of each Gaussian side by side, of those that are blended.
fn interleave<S: Simd>(channels: &BlockChannels<S>, blended: Channels, out: &mut [f32]) {
    for (c, lanes) in channels.iter().enumerate() {
        let Some(place) = blended.index_of(c) else { continue };
        let lanes = lanes.to_array();
        for (gaussian, value) in out.chunks_exact_mut(blended.count()).zip(lanes) {
            gaussian[place] = value;
        }
    }
}

/// The colour of a block that no light reaches, and whose is finite: of all that shading knows it takes the diffuse colour
/// and the residual.
#[inline(always)]
fn unlit_color<S: Simd>(
    simd: S,
    block: &[f32],
    camera: &CameraOf<Lanes<S>>,
    scene: Scene<'_>,
) -> (Vec3<Lanes<S>>, LaneMask<S>) {
    let rules = scene.rules.shading;
    let residual = Harmonics::new(simd, block, camera, scene).sum;
    let raw = Lanes::load3(simd, block, DIFFUSE);
    (shade(rules.form, &Terms::unlit(diffuse(raw, rules), residual)), raw.is_finite() & residual.is_finite())
}

#[inline(always)]
fn put<S: Simd>(channels: &mut BlockChannels<S>, first: usize, v: Vec3<Lanes<S>>) {
    channels[first..first + 3].copy_from_slice(&v.to_array());
}

#[inline(always)]
fn put_layers<S: Simd>(channels: &mut BlockChannels<S>, shaded: &Shaded<S>, form: ShadingForm) {
    let terms = &shaded.terms;
    let specular = match form {
        ShadingForm::Paper | ShadingForm::Deferred => terms.tint.times(terms.specular_light),
        ShadingForm::Official => shade(
            form,
            &Terms {
                diffuse: terms.diffuse * terms.diffuse.x.zero(),
                residual: terms.residual * terms.diffuse.x.zero(),
                ..*terms
            },
        ),
    };
    put(channels, channel::DIFFUSE, terms.diffuse);
    put(channels, channel::SPECULAR, specular);
    put(channels, channel::RESIDUAL, terms.residual);
    put(channels, channel::LIGHT, terms.specular_light);
}

/// The shortest axis of a plain Gaussian, turned to the viewer: what its normal layer shows.
#[inline(always)]
fn plain_normal<S: Simd>(simd: S, block: &[f32], camera: &CameraOf<Lanes<S>>) -> Vec3<Lanes<S>> {
    use specula_core::{
        covariance::rotation,
        normal::{AxisRule, axis, facing},
    };
    let shape = load_shape(simd, block);
    let axis = axis(AxisRule::Shortest, &rotation(shape.quat), shape.log_scales);
    let none = Vec3::zero(shape.opacity_logit);
    facing(axis, view_dir(shape.mean, camera.position), [none; 2], true).normal
}

/// Spherical harmonics of a block towards the camera, and what their gradient needs.
struct Harmonics<S: Simd> {
    count: usize,
    ray_dir: Vec3<Lanes<S>>,
    basis: [Lanes<S>; sh::MAX_COUNT],
    sum: Vec3<Lanes<S>>,
}

impl<S: Simd> Harmonics<S> {
    #[inline(always)]
    fn new(simd: S, block: &[f32], camera: &CameraOf<Lanes<S>>, scene: Scene<'_>) -> Self {
        let shape = load_shape(simd, block);
        let ray_dir = -view_dir(shape.mean, camera.position);
        let count = scene.sh_count();
        let basis = sh::basis(ray_dir, count);
        let mut sum = Vec3::zero(shape.opacity_logit);
        for k in 0..count {
            sum = sum.add_scaled(basis[k], Lanes::load3(simd, block, scene.layout.sh_start() + 3 * k));
        }
        Self { count, ray_dir, basis, sum }
    }

    /// Writes the coefficients' gradients, zero for Gaussians that are not touched, and returns the gradient of the
    /// direction to the eye.
    #[inline(always)]
    fn vjp(
        &self,
        simd: S,
        block: &[f32],
        first_plane: usize,
        grad: Vec3<Lanes<S>>,
        is_touched: <Lanes<S> as Real>::Mask,
        out: &mut [f32],
    ) -> Vec3<Lanes<S>> {
        let mut grad_basis = [Lanes::splat(simd, 0.0); sh::MAX_COUNT];
        for k in 0..self.count {
            let plane = first_plane + 3 * k;
            store3(each!(grad * self.basis[k], x => x.keep(is_touched)), out, plane);
            grad_basis[k] = grad.dot(Lanes::load3(simd, block, plane));
        }
        -sh::basis_vjp(self.ray_dir, self.count, &grad_basis)
    }
}

/// A block with its light.
struct Shaded<S: Simd> {
    material: Material<Lanes<S>>,
    surface: Surface<Lanes<S>>,
    harmonics: Harmonics<S>,
    specular: Option<Lookup<S>>,
    ambient: Option<Lookup<S>>,
    terms: Terms<Lanes<S>>,
}

impl<S: Simd> Shaded<S> {
    #[inline(always)]
    fn new(simd: S, block: &[f32], camera: &CameraOf<Lanes<S>>, scene: Scene<'_>) -> Self {
        let material = load_material(simd, block, scene.rules);
        let surface = surface(&material, camera.position, scene.rules.shading);
        let harmonics = Harmonics::new(simd, block, camera, scene);
        #[expect(clippy::manual_map, reason = "a closure is compiled without the machine's vector features")]
        let specular = match scene.own_light() {
            Some(light) => Some(look_up(simd, light, surface.reflection_dir, surface.roughness)),
            None => None,
        };
        let is_official = scene.rules.shading.form == ShadingForm::Official;
        let ambient = match scene.light {
            Some(light) if is_official => Some(look_up_irradiance(simd, light, surface.facing.normal)),
            _ => None,
        };
        let terms = Terms {
            diffuse: surface.diffuse,
            tint: surface.tint,
            specular_light: radiance_of(&specular, surface.roughness),
            residual: harmonics.sum,
            ambient_light: radiance_of(&ambient, surface.roughness),
            split_sum: if is_official {
                split_sum(simd, surface.n_dot_v, surface.roughness)
            } else {
                [surface.roughness.zero(); 2]
            },
        };
        Self { material, surface, harmonics, specular, ambient, terms }
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

#[inline(always)]
fn load_material<S: Simd>(simd: S, block: &[f32], rules: &RenderRules) -> Material<Lanes<S>> {
    let shape = load_shape(simd, block);
    let load3 = |plane: usize| Lanes::load3(simd, block, plane);
    let load_residual =
        |plane: usize| if rules.normal_residuals { load3(plane) } else { Vec3::zero(shape.opacity_logit) };
    Material {
        mean: shape.mean,
        quat: shape.quat,
        log_scales: shape.log_scales,
        diffuse: load3(DIFFUSE),
        tint: load3(TINT),
        roughness: Lanes::load(simd, &block[ROUGHNESS * BLOCK..]),
        normal_residuals: [load_residual(NORMAL_RESIDUAL_1), load_residual(NORMAL_RESIDUAL_2)],
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
            let grads = BlockGrads::new(simd, self.grads, number);
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
struct BlockGrads<S: Simd> {
    geometry: [Lanes<S>; GEOMETRY],
    channels: BlockChannels<S>,
    /// Where any gradient is not zero.
    is_touched: <Lanes<S> as Real>::Mask,
}

impl<S: Simd> BlockGrads<S> {
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
        let (mut geometry, mut channels) = ([zero; GEOMETRY], [zero; CHANNELS_MAX]);
        for k in 0..GEOMETRY {
            geometry[k] = load(k);
        }
        let blended = Channels::of_count(grads.channels);
        for (k, lanes) in channels.iter_mut().enumerate() {
            if let Some(place) = blended.index_of(k) {
                *lanes = load(GEOMETRY + place);
            }
        }
        Self { geometry, channels, is_touched: !are_zero }
    }
}

#[inline(always)]
fn take3<S: Simd>(channels: &BlockChannels<S>, first: usize) -> Vec3<Lanes<S>> {
    Vec3 { x: channels[first], y: channels[first + 1], z: channels[first + 2] }
}

#[inline(always)]
fn block_vjp<S: Simd>(
    simd: S,
    block: &[f32],
    camera: &CameraOf<Lanes<S>>,
    scene: Scene<'_>,
    grads: &BlockGrads<S>,
    out: &mut [f32],
    light_grad: &mut [Texel],
) {
    let is_touched = grads.is_touched;
    if is_touched.bits() == 0 {
        return;
    }
    let shape = load_shape(simd, block);
    let grad_color = take3(&grads.channels, channel::COLOR);
    let (grad_mean, grad_quat) = if scene.layout.is_shaded() {
        shaded_vjp(simd, block, camera, scene, grads, is_touched, out, light_grad)
    } else {
        let seen = Harmonics::new(simd, block, camera, scene);
        let grad_sum = sh::radiance_vjp(seen.sum, grad_color);
        let grad_view = seen.vjp(simd, block, scene.layout.sh_start(), grad_sum, is_touched, out);
        (view_dir_vjp(shape.mean, camera.position, grad_view), [shape.opacity_logit.zero(); 4])
    };
    let g = grads.geometry;
    let splat_grad = SplatGrad {
        mean2d: [g[0], g[1]],
        root_conic: [g[2], g[3], g[4]],
        depth: grads.channels[channel::DEPTH],
        opacity: g[5],
    };
    project_block_vjp(&shape, camera, &splat_grad, grad_mean, grad_quat, is_touched, out);
}

/// Writes the gradients of the shading attributes, and returns those of means and quats.
#[inline(always)]
fn shaded_vjp<S: Simd>(
    simd: S,
    block: &[f32],
    camera: &CameraOf<Lanes<S>>,
    scene: Scene<'_>,
    grads: &BlockGrads<S>,
    is_touched: <Lanes<S> as Real>::Mask,
    out: &mut [f32],
    light_grad: &mut [Texel],
) -> (Vec3<Lanes<S>>, [Lanes<S>; 4]) {
    let shaded = Shaded::new(simd, block, camera, scene);
    let rules = scene.rules.shading;
    let grad = shade_vjp(rules.form, &shaded.terms, take3(&grads.channels, channel::COLOR));
    let grad = Terms { specular_light: each!(grad.specular_light, g => g.keep(is_touched)), ..grad };

    let zero = shaded.surface.roughness.zero();
    let mut grad_surface = SurfaceGrad {
        normal: take3(&grads.channels, channel::NORMAL),
        residual_squared: grads.channels[channel::RESIDUAL_SIZE],
        reflection_dir: Vec3::splat(zero),
        view_dir: shaded.harmonics.vjp(simd, block, scene.layout.sh_start(), grad.residual, is_touched, out),
        n_dot_v: zero,
        diffuse: grad.diffuse,
        tint: grad.tint + take3(&grads.channels, channel::TINT),
        roughness: grads.channels[channel::ROUGHNESS],
    };
    if let (Some(lookup), Some(light)) = (&shaded.specular, scene.own_light()) {
        let (direction, roughness) =
            look_up_vjp(simd, light, lookup, shaded.surface.roughness, grad.specular_light, light_grad);
        grad_surface.reflection_dir = direction;
        grad_surface.roughness = grad_surface.roughness + roughness;
    }
    if let (Some(lookup), Some(light)) = (&shaded.ambient, scene.light) {
        let ambient = each!(grad.ambient_light, g => g.keep(is_touched));
        let (direction, _) = look_up_vjp(simd, light, lookup, shaded.surface.roughness, ambient, light_grad);
        grad_surface.normal = grad_surface.normal + direction;
        let [n_dot_v, roughness] =
            split_sum_vjp(simd, shaded.surface.n_dot_v, shaded.surface.roughness, grad.split_sum);
        grad_surface.n_dot_v = n_dot_v;
        grad_surface.roughness = grad_surface.roughness + roughness;
    }

    let grad = surface_vjp(&shaded.material, camera.position, rules, &shaded.surface, &grad_surface);
    let keep = |v: Vec3<Lanes<S>>| each!(v, x => x.keep(is_touched));
    store3(keep(grad.diffuse), out, DIFFUSE);
    store3(keep(grad.tint), out, TINT);
    grad.roughness.keep(is_touched).store(&mut out[ROUGHNESS * BLOCK..]);
    store3(keep(grad.normal_residuals[0]), out, NORMAL_RESIDUAL_1);
    store3(keep(grad.normal_residuals[1]), out, NORMAL_RESIDUAL_2);
    (grad.mean, grad.quat)
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
    if weights.residual != 0.0 && scene.layout.is_shaded() {
        for plane in NORMAL_RESIDUAL_1..NORMAL_RESIDUAL_2 + 3 {
            let number = Lanes::load(simd, &block[plane * BLOCK..]);
            add(plane, residual_vjp(number, number.constant(2.0 * weights.residual * share)));
        }
    }
}
