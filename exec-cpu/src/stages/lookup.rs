//! Looking light up: footprints from core, texels from memory.
//!
//! A texel is read as one small vector, and its colours are mixed there; sixteen mixtures then
//! become lanes. So a texel is one load, where gathering each colour into lanes would take three.

use crate::{
    buffer::Buffer,
    lanes::Lanes,
    stages::prefilter::{Light, LightGrad, Texel},
};
use fearless_simd::{Simd, f32x4, prelude::*};
use rayon::prelude::*;
use specula_core::{
    cubemap::{FacePoint, TexelFootprint, bilinear_vjp, bilinear_weights, footprint, project, project_vjp},
    prefilter::{level_of_roughness, level_of_roughness_vjp},
    real::Real,
    scene::BLOCK,
    split_sum::RESOLUTION,
    vector::{Vec3, vec3},
};
use specula_prefilter::SPLIT_SUM;

/// Position of a lookup: between two levels, at the same point of the cube.
struct Footprints<S: Simd> {
    point: FacePoint<Lanes<S>>,
    sharp: Corners<S>,
    blurred: Corners<S>,
    /// Share of the blurred level.
    share: Lanes<S>,
}

impl<S: Simd> Footprints<S> {
    #[inline(always)]
    fn new(simd: S, light: &Light, direction: Vec3<Lanes<S>>, roughness: Lanes<S>) -> Self {
        let point = project(direction);
        let position = level_of_roughness(roughness, light.levels());
        let lower = position.floor().clamp(0.0, (light.levels().len() - 2) as f32);
        Self {
            sharp: Corners::new(simd, light, &point, lower),
            blurred: Corners::new(simd, light, &point, lower + 1.0),
            share: position - lower,
            point,
        }
    }
}

/// Four neighbouring texels of one level for each lane.
struct Corners<S: Simd> {
    resolution: Lanes<S>,
    footprint: TexelFootprint<Lanes<S>>,
    /// Upper left texel, and how many texels a row has.
    first: [u32; BLOCK],
    width: [u32; BLOCK],
}

impl<S: Simd> Corners<S> {
    #[inline(always)]
    fn new(simd: S, light: &Light, point: &FacePoint<Lanes<S>>, levels: Lanes<S>) -> Self {
        let levels = levels.to_array();
        let (mut sizes, mut first, mut width) = ([0.0; BLOCK], [0; BLOCK], [0; BLOCK]);
        for lane in 0..BLOCK {
            let level = levels[lane] as usize;
            let resolution = light.resolution(level) as u32;
            sizes[lane] = resolution as f32;
            width[lane] = resolution + 2;
            first[lane] = light.offsets()[level] as u32;
        }
        let resolution = Lanes::from_array(simd, sizes);
        let footprint = footprint(point, resolution);
        let texel = footprint.texel.to_array();
        for lane in 0..BLOCK {
            first[lane] = first[lane].saturating_add(texel[lane] as u32);
        }
        Self { resolution, footprint, first, width }
    }

    /// The four texels of a lane. NaN gives the last texel.
    #[inline(always)]
    fn texel_indices(&self, lane: usize, count: usize) -> [usize; 4] {
        let (first, width) = (self.first[lane] as usize, self.width[lane] as usize);
        let last = count - 1;
        [first.min(last), (first + 1).min(last), (first + width).min(last), (first + width + 1).min(last)]
    }

    #[inline(always)]
    fn read(&self, simd: S, texels: &[Texel], lane: usize) -> [f32x4<S>; 4] {
        let [a, b, c, d] = self.texel_indices(lane, texels.len());
        let at = |index: usize| f32x4::simd_from(simd, texels[index]);
        [at(a), at(b), at(c), at(d)]
    }

    /// Weights of the four texels, times a share, of each lane.
    #[inline(always)]
    fn weights(&self, share: Lanes<S>) -> [[f32; BLOCK]; 4] {
        let [a, b, c, d] = bilinear_weights(self.footprint.right, self.footprint.lower);
        [(a * share).to_array(), (b * share).to_array(), (c * share).to_array(), (d * share).to_array()]
    }
}

/// Radiance of sixteen footprints in one level, and how it changes to the right and downwards.
struct Sampled<S: Simd> {
    radiance: Vec3<Lanes<S>>,
    to_right: Vec3<Lanes<S>>,
    downwards: Vec3<Lanes<S>>,
}

impl<S: Simd> Sampled<S> {
    /// [`specula_core::cubemap::bilinear`] and its slopes, a texel at a time.
    #[inline(always)]
    fn new(simd: S, light: &Light, corners: &Corners<S>) -> Self {
        let (right, lower) = (corners.footprint.right.to_array(), corners.footprint.lower.to_array());
        let (mut radiance, mut to_right, mut downwards) = ([[0.0; 4]; BLOCK], [[0.0; 4]; BLOCK], [[0.0; 4]; BLOCK]);
        for lane in 0..BLOCK {
            let [a, b, c, d] = corners.read(simd, &light.texels, lane);
            let (right, lower) = (f32x4::splat(simd, right[lane]), f32x4::splat(simd, lower[lane]));
            let (top, bottom) = (b - a, d - c);
            let upper = top.mul_add(right, a);
            let down = bottom.mul_add(right, c) - upper;
            radiance[lane] = down.mul_add(lower, upper).into();
            to_right[lane] = (bottom - top).mul_add(lower, top).into();
            downwards[lane] = down.into();
        }
        Self {
            radiance: colors_to_lanes(simd, &radiance),
            to_right: colors_to_lanes(simd, &to_right),
            downwards: colors_to_lanes(simd, &downwards),
        }
    }
}

/// The colours of sixteen texels, each colour in the lanes of one number.
#[inline(always)]
fn colors_to_lanes<S: Simd>(simd: S, texels: &[Texel; BLOCK]) -> Vec3<Lanes<S>> {
    let flat = texels.as_flattened();
    let at = |k: usize| Lanes::load(simd, &flat[k * BLOCK..]).0;
    let (a, b, c, d) = (at(0), at(1), at(2), at(3));
    let (red_blue, red_blue_rest) = (a.unzip_low(b), c.unzip_low(d));
    let (green, green_rest) = (a.unzip_high(b), c.unzip_high(d));
    vec3(
        Lanes(red_blue.unzip_low(red_blue_rest)),
        Lanes(green.unzip_low(green_rest)),
        Lanes(red_blue.unzip_high(red_blue_rest)),
    )
}

/// Inverse of [`colors_to_lanes`]: lanes to sixteen texels.
#[inline(always)]
fn lanes_to_colors<S: Simd>(color: Vec3<Lanes<S>>) -> [Texel; BLOCK] {
    let (red, green, blue, none) = (color.x.0, color.y.0, color.z.0, color.x.zero().0);
    let (red_blue, red_blue_rest) = (red.zip_low(blue), red.zip_high(blue));
    let (green, green_rest) = (green.zip_low(none), green.zip_high(none));
    let mut texels = [[0.0; 4]; BLOCK];
    let flat = texels.as_flattened_mut();
    Lanes(red_blue.zip_low(green)).store(flat);
    Lanes(red_blue.zip_high(green)).store(&mut flat[BLOCK..]);
    Lanes(red_blue_rest.zip_low(green_rest)).store(&mut flat[2 * BLOCK..]);
    Lanes(red_blue_rest.zip_high(green_rest)).store(&mut flat[3 * BLOCK..]);
    texels
}

/// Light along a direction at a roughness, without the inputs of a gradient.
#[inline(always)]
pub(crate) fn radiance<S: Simd>(
    simd: S,
    light: &Light,
    direction: Vec3<Lanes<S>>,
    roughness: Lanes<S>,
) -> Vec3<Lanes<S>> {
    let footprints = Footprints::new(simd, light, direction, roughness);
    let sharp = footprints.sharp.weights(-footprints.share + 1.0);
    let blurred = footprints.blurred.weights(footprints.share);
    let mut mixed = [[0.0; 4]; BLOCK];
    for lane in 0..BLOCK {
        let (near, far) =
            (footprints.sharp.read(simd, &light.texels, lane), footprints.blurred.read(simd, &light.texels, lane));
        let mut sum = f32x4::splat(simd, 0.0);
        for k in 0..4 {
            sum = near[k].mul_add(f32x4::splat(simd, sharp[k][lane]), sum);
            sum = far[k].mul_add(f32x4::splat(simd, blurred[k][lane]), sum);
        }
        mixed[lane] = sum.into();
    }
    colors_to_lanes(simd, &mixed)
}

/// Light from one direction at one roughness, with what its gradient needs.
pub(crate) struct Lookup<S: Simd> {
    footprints: Footprints<S>,
    sharp: Sampled<S>,
    blurred: Sampled<S>,
}

impl<S: Simd> Lookup<S> {
    #[inline(always)]
    fn at(simd: S, light: &Light, footprints: Footprints<S>) -> Self {
        let sharp = Sampled::new(simd, light, &footprints.sharp);
        let blurred = Sampled::new(simd, light, &footprints.blurred);
        Self { footprints, sharp, blurred }
    }
    #[inline(always)]
    pub(crate) fn radiance(&self) -> Vec3<Lanes<S>> {
        self.sharp.radiance.add_scaled(self.footprints.share, self.blurred.radiance - self.sharp.radiance)
    }
}

/// Light along a direction at a roughness.
#[inline(always)]
pub(crate) fn look_up<S: Simd>(simd: S, light: &Light, direction: Vec3<Lanes<S>>, roughness: Lanes<S>) -> Lookup<S> {
    Lookup::at(simd, light, Footprints::new(simd, light, direction, roughness))
}

/// Irradiance / π along a normal, from the last map: that behind the levels, or the level of
/// roughness 1, whose lobe is the cosine.
#[inline(always)]
pub(crate) fn look_up_irradiance<S: Simd>(simd: S, light: &Light, normal: Vec3<Lanes<S>>) -> Lookup<S> {
    let point = project(normal);
    let map = Lanes::splat(simd, light.irradiance_map() as f32);
    let footprints = Footprints {
        sharp: Corners::new(simd, light, &point, map),
        blurred: Corners::new(simd, light, &point, map),
        share: normal.x.zero(),
        point,
    };
    Lookup::at(simd, light, footprints)
}

/// Gradient of [`look_up`], or of [`look_up_irradiance`], which has none in the roughness: with
/// respect to direction and roughness; adds to the light's.
#[inline(always)]
pub(crate) fn look_up_vjp<S: Simd>(
    simd: S,
    light: &Light,
    lookup: &Lookup<S>,
    roughness: Lanes<S>,
    grad: Vec3<Lanes<S>>,
    light_grad: &mut [Texel],
) -> (Vec3<Lanes<S>>, Lanes<S>) {
    let Lookup { footprints, sharp, blurred } = lookup;
    let (grad_sharp, grad_blurred) = (grad * (-footprints.share + 1.0), grad * footprints.share);
    add_to_texels(simd, &footprints.sharp, grad_sharp, light_grad);
    add_to_texels(simd, &footprints.blurred, grad_blurred, light_grad);
    let (half, half_blurred) = (footprints.sharp.resolution * 0.5, footprints.blurred.resolution * 0.5);
    let u = sharp.to_right.dot(grad_sharp) * half + blurred.to_right.dot(grad_blurred) * half_blurred;
    let v = sharp.downwards.dot(grad_sharp) * half + blurred.downwards.dot(grad_blurred) * half_blurred;
    let grad_position = grad.dot(blurred.radiance - sharp.radiance);
    (project_vjp(&footprints.point, u, v), level_of_roughness_vjp(roughness, light.levels(), grad_position))
}

/// Gives each of a footprint's texels its share of the gradient, lane after lane.
#[inline(always)]
fn add_to_texels<S: Simd>(simd: S, corners: &Corners<S>, grad: Vec3<Lanes<S>>, light_grad: &mut [Texel]) {
    let [a, b, c, d] = bilinear_weights(corners.footprint.right, corners.footprint.lower);
    let weights = [a.to_array(), b.to_array(), c.to_array(), d.to_array()];
    let grads = lanes_to_colors(grad);
    for lane in 0..BLOCK {
        if grads[lane] == [0.0; 4] {
            continue;
        }
        let grad = f32x4::simd_from(simd, grads[lane]);
        let indices = corners.texel_indices(lane, light_grad.len());
        for k in 0..4 {
            let texel = &mut light_grad[indices[k]];
            *texel = grad.mul_add(f32x4::splat(simd, weights[k][lane]), f32x4::simd_from(simd, *texel)).into();
        }
    }
}

/// Four entries of the table and how far between them a point lies.
struct TableFetch<S: Simd> {
    corners: [[Lanes<S>; 2]; 4],
    right: Lanes<S>,
    lower: Lanes<S>,
    /// 1 where a coordinate lies inside the table, 0 where it was clamped.
    is_free: [Lanes<S>; 2],
}

#[inline(always)]
fn table_fetch<S: Simd>(simd: S, n_dot_v: Lanes<S>, roughness: Lanes<S>) -> TableFetch<S> {
    let ((column, right, free_x), (row, lower, free_y)) = (table_cell(n_dot_v), table_cell(roughness));
    let (column, row) = (column.to_array(), row.to_array());
    let mut entries = [[[0.0; BLOCK]; 2]; 4];
    for lane in 0..BLOCK {
        let first = row[lane] as usize * RESOLUTION + column[lane] as usize;
        for (entry, offset) in entries.iter_mut().zip(CORNERS) {
            [entry[0][lane], entry[1][lane]] = SPLIT_SUM[first + offset];
        }
    }
    let mut corners = [[n_dot_v.zero(); 2]; 4];
    for k in 0..4 {
        corners[k] = [Lanes::from_array(simd, entries[k][0]), Lanes::from_array(simd, entries[k][1])];
    }
    TableFetch { corners, right, lower, is_free: [free_x, free_y] }
}

/// Places of a cell's corners in the table, from the first one.
const CORNERS: [usize; 4] = [0, 1, RESOLUTION, RESOLUTION + 1];

/// Cell of the table in which a coordinate lies, how far, and 1 where it is not clamped.
#[inline(always)]
fn table_cell<S: Simd>(x: Lanes<S>) -> (Lanes<S>, Lanes<S>, Lanes<S>) {
    let size = RESOLUTION as f32;
    let last = size - 1.0;
    let free = x * size - 0.5;
    let inside = free.zero().less(free) & free.less(free.constant(last));
    let limited = free.clamp(0.0, last);
    let cell = limited.floor().min(limited.constant(last - 1.0));
    (cell, limited - cell, free.constant(1.0).keep(inside))
}

/// (F_x, F_y) at n·v and roughness.
#[inline(always)]
pub(crate) fn split_sum<S: Simd>(simd: S, n_dot_v: Lanes<S>, roughness: Lanes<S>) -> [Lanes<S>; 2] {
    let fetch = table_fetch(simd, n_dot_v, roughness);
    let weights = bilinear_weights(fetch.right, fetch.lower);
    let mut sums = [n_dot_v.zero(); 2];
    for (weight, [scale, bias]) in weights.into_iter().zip(fetch.corners) {
        sums = [weight.mul_add(scale, sums[0]), weight.mul_add(bias, sums[1])];
    }
    sums
}

/// Gradient of [`split_sum`] with respect to n·v and roughness.
#[inline(always)]
pub(crate) fn split_sum_vjp<S: Simd>(
    simd: S,
    n_dot_v: Lanes<S>,
    roughness: Lanes<S>,
    grad: [Lanes<S>; 2],
) -> [Lanes<S>; 2] {
    let fetch = table_fetch(simd, n_dot_v, roughness);
    let zero = n_dot_v.zero();
    let [a, b, c, d] = fetch.corners;
    let texels = [vec3(a[0], a[1], zero), vec3(b[0], b[1], zero), vec3(c[0], c[1], zero), vec3(d[0], d[1], zero)];
    let (right, lower) = bilinear_vjp(texels, fetch.right, fetch.lower, vec3(grad[0], grad[1], zero));
    [right * RESOLUTION as f32 * fetch.is_free[0], lower * RESOLUTION as f32 * fetch.is_free[1]]
}

/// Parts into which Gaussians or pixels are divided while they add to the light's gradient. The
/// number is fixed, so the sum's order is the same on any number of threads.
pub(crate) const LIGHT_PARTS: usize = 8;

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
            let texels = &part[chunk * TEXELS_AT_ONCE..][..sum.len()];
            let numbers = sum.as_flattened_mut().iter_mut().zip(texels.as_flattened());
            numbers.for_each(|(sum, x)| *sum += x);
        }
    });
    texels.truncate(texel_count);
    LightGrad { texels }
}
