//! Looking light up: footprints from core, texels from memory.
//!
//! A texel is read as one small vector, and its colours are mixed there; sixteen mixtures then
//! become lanes. So a texel is one load, where gathering each colour into lanes would take three.

use crate::{
    buffer::Buffer,
    lanes::Lanes,
    stages::prefilter::{Light, LightGrad, Texel},
};
use core::ops::Sub;
use fearless_simd::{Simd, f32x4, prelude::*};
use rayon::prelude::*;
use specula_core::{
    cubemap::{
        BilinearSample, FacePoint, TexelColor, bilinear_sample, bilinear_vjp, bilinear_weights, footprint, project,
    },
    light_view::{LightFootprint, LightLookup, MapFootprint, levels_around},
    real::Real,
    scene::BLOCK,
    split_sum::{RESOLUTION, TablePosition, table_position},
    vector::{Vec3, vec3},
};
use specula_prefilter::SPLIT_SUM;

/// Position of a lookup.
type Footprints<S> = LightFootprint<Lanes<S>, Places>;

/// Places of the texels of each lane.
#[derive(Clone, Copy)]
pub(crate) struct Places {
    /// Upper left texel, and how many texels a row has.
    first: [u32; BLOCK],
    width: [u32; BLOCK],
}

impl Places {
    /// The four texels of a lane. NaN gives the last texel.
    #[inline(always)]
    fn texel_indices(&self, lane: usize, count: usize) -> [usize; 4] {
        let (first, width) = (self.first[lane] as usize, self.width[lane] as usize);
        let last = count - 1;
        [first.min(last), (first + 1).min(last), (first + width).min(last), (first + width + 1).min(last)]
    }

    #[inline(always)]
    fn read<S: Simd>(&self, simd: S, texels: &[Texel], lane: usize) -> [Color<S>; 4] {
        let [a, b, c, d] = self.texel_indices(lane, texels.len());
        let at = |index: usize| Color(f32x4::simd_from(simd, texels[index]));
        [at(a), at(b), at(c), at(d)]
    }
}

/// Colour of one texel, and padding.
#[derive(Clone, Copy)]
struct Color<S: Simd>(f32x4<S>);

impl<S: Simd> Sub for Color<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}

impl<S: Simd> TexelColor<f32> for Color<S> {
    #[inline(always)]
    fn add_scaled(self, factor: f32, other: Self) -> Self {
        Self(other.0.mul_add(f32x4::splat(self.0.simd, factor), self.0))
    }
}

#[inline(always)]
fn footprints<S: Simd>(simd: S, light: &Light, direction: Vec3<Lanes<S>>, roughness: Lanes<S>) -> Footprints<S> {
    let point = project(direction);
    let [sharp, share] = levels_around(roughness, light.levels());
    LightFootprint {
        sharp: footprint_in(simd, light, &point, sharp),
        blurred: footprint_in(simd, light, &point, sharp + 1.0),
        share,
        point,
    }
}

/// Footprint in a map for each lane.
#[inline(always)]
fn footprint_in<S: Simd>(
    simd: S,
    light: &Light,
    point: &FacePoint<Lanes<S>>,
    maps: Lanes<S>,
) -> MapFootprint<Lanes<S>, Places> {
    let maps = maps.to_array();
    let (mut sizes, mut first, mut width) = ([0.0; BLOCK], [0; BLOCK], [0; BLOCK]);
    for lane in 0..BLOCK {
        let map = light.maps()[maps[lane] as usize];
        sizes[lane] = map.resolution as f32;
        width[lane] = map.resolution as u32 + 2;
        first[lane] = map.first as u32;
    }
    let resolution = Lanes::from_array(simd, sizes);
    let footprint = footprint(point, resolution);
    let texel = footprint.texel.to_array();
    for lane in 0..BLOCK {
        first[lane] = first[lane].saturating_add(texel[lane] as u32);
    }
    MapFootprint { resolution, footprint, place: Places { first, width } }
}

/// Radiance of sixteen footprints in one map, a texel at a time.
#[inline(always)]
fn sample<S: Simd>(simd: S, light: &Light, at: &MapFootprint<Lanes<S>, Places>) -> BilinearSample<Vec3<Lanes<S>>> {
    let (right, lower) = (at.footprint.right.to_array(), at.footprint.lower.to_array());
    let (mut mean, mut to_right, mut downwards) = ([[0.0; 4]; BLOCK], [[0.0; 4]; BLOCK], [[0.0; 4]; BLOCK]);
    for lane in 0..BLOCK {
        let sample = bilinear_sample(at.place.read(simd, &light.texels, lane), right[lane], lower[lane]);
        mean[lane] = sample.mean.0.into();
        to_right[lane] = sample.to_right.0.into();
        downwards[lane] = sample.downwards.0.into();
    }
    BilinearSample {
        mean: colors_to_lanes(simd, &mean),
        to_right: colors_to_lanes(simd, &to_right),
        downwards: colors_to_lanes(simd, &downwards),
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
    let at = footprints(simd, light, direction, roughness);
    let [sharp, blurred] = at.weights();
    let mut mixed = [[0.0; 4]; BLOCK];
    let (sharp, blurred) = (arrays(sharp), arrays(blurred));
    for lane in 0..BLOCK {
        let near = at.sharp.place.read(simd, &light.texels, lane);
        let far = at.blurred.place.read(simd, &light.texels, lane);
        let mut sum = Color(f32x4::splat(simd, 0.0));
        for k in 0..4 {
            sum = sum.add_scaled(sharp[k][lane], near[k]);
            sum = sum.add_scaled(blurred[k][lane], far[k]);
        }
        mixed[lane] = sum.0.into();
    }
    colors_to_lanes(simd, &mixed)
}

/// The lanes of four numbers as arrays.
#[inline(always)]
fn arrays<S: Simd>([a, b, c, d]: [Lanes<S>; 4]) -> [[f32; BLOCK]; 4] {
    [a.to_array(), b.to_array(), c.to_array(), d.to_array()]
}

/// Light from one direction at one roughness, with what its gradient needs.
pub(crate) type Lookup<S> = LightLookup<Lanes<S>, Places>;

/// Light in the maps of a footprint.
#[inline(always)]
fn look_up_at<S: Simd>(simd: S, light: &Light, at: Footprints<S>) -> Lookup<S> {
    LightLookup { sharp: sample(simd, light, &at.sharp), blurred: sample(simd, light, &at.blurred), at }
}

/// Light along a direction at a roughness.
#[inline(always)]
pub(crate) fn look_up<S: Simd>(simd: S, light: &Light, direction: Vec3<Lanes<S>>, roughness: Lanes<S>) -> Lookup<S> {
    look_up_at(simd, light, footprints(simd, light, direction, roughness))
}

/// Irradiance / π along a normal, from the last map: that behind the levels, or the level of
/// roughness 1, whose lobe is the cosine.
#[inline(always)]
pub(crate) fn look_up_irradiance<S: Simd>(simd: S, light: &Light, normal: Vec3<Lanes<S>>) -> Lookup<S> {
    let point = project(normal);
    let map = footprint_in(simd, light, &point, Lanes::splat(simd, (light.maps().len() - 1) as f32));
    look_up_at(simd, light, LightFootprint { sharp: map, blurred: map, share: normal.x.zero(), point })
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
    let [sharp, blurred] = lookup.map_grads(grad);
    add_to_texels(simd, &lookup.at.sharp, sharp, light_grad);
    add_to_texels(simd, &lookup.at.blurred, blurred, light_grad);
    lookup.vjp(roughness, light.levels(), grad)
}

/// Gives each of a footprint's texels its share of the gradient, lane after lane.
#[inline(always)]
fn add_to_texels<S: Simd>(
    simd: S,
    at: &MapFootprint<Lanes<S>, Places>,
    grad: Vec3<Lanes<S>>,
    light_grad: &mut [Texel],
) {
    let weights = arrays(at.weights());
    let grads = lanes_to_colors(grad);
    for lane in 0..BLOCK {
        if grads[lane] == [0.0; 4] {
            continue;
        }
        let grad = f32x4::simd_from(simd, grads[lane]);
        let indices = at.place.texel_indices(lane, light_grad.len());
        for k in 0..4 {
            let texel = &mut light_grad[indices[k]];
            *texel = grad.mul_add(f32x4::splat(simd, weights[k][lane]), f32x4::simd_from(simd, *texel)).into();
        }
    }
}

/// Four entries of the table and how far between them a point lies.
struct TableFetch<S: Simd> {
    corners: [[Lanes<S>; 2]; 4],
    across: TablePosition<Lanes<S>>,
    down: TablePosition<Lanes<S>>,
}

#[inline(always)]
fn table_fetch<S: Simd>(simd: S, n_dot_v: Lanes<S>, roughness: Lanes<S>) -> TableFetch<S> {
    let (across, down) = (table_position(n_dot_v), table_position(roughness));
    let (column, row) = (across.texel.to_array(), down.texel.to_array());
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
    TableFetch { corners, across, down }
}

/// Places of a cell's corners in the table, from the first one.
const CORNERS: [usize; 4] = [0, 1, RESOLUTION, RESOLUTION + 1];

/// (F_x, F_y) at n·v and roughness.
#[inline(always)]
pub(crate) fn split_sum<S: Simd>(simd: S, n_dot_v: Lanes<S>, roughness: Lanes<S>) -> [Lanes<S>; 2] {
    let fetch = table_fetch(simd, n_dot_v, roughness);
    let weights = bilinear_weights(fetch.across.share, fetch.down.share);
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
    let TableFetch { corners: [a, b, c, d], across, down } = table_fetch(simd, n_dot_v, roughness);
    let zero = n_dot_v.zero();
    let texels = [vec3(a[0], a[1], zero), vec3(b[0], b[1], zero), vec3(c[0], c[1], zero), vec3(d[0], d[1], zero)];
    let (right, lower) = bilinear_vjp(texels, across.share, down.share, vec3(grad[0], grad[1], zero));
    [right * RESOLUTION as f32 * across.is_free, lower * RESOLUTION as f32 * down.is_free]
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
