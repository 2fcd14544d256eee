//! Looking light up: footprints from core, texels from memory.

use crate::{
    lanes::Lanes,
    prefilter::{Light, Texel},
};
use fearless_simd::Simd;
use rayon::prelude::*;
use specula_core::{
    cubemap::{FacePoint, Footprint, bilinear, bilinear_vjp, bilinear_weights, footprint, project, project_vjp},
    prefilter::{level_of_roughness, level_of_roughness_vjp},
    real::Real,
    scene::BLOCK,
    split_sum::{RESOLUTION, integrate},
    vector::{Vec3, vec3},
};
use std::sync::LazyLock;

/// Light from one direction at one roughness, between two levels, with what its gradient needs.
pub(crate) struct Lookup<S: Simd> {
    point: FacePoint<Lanes<S>>,
    sharp: Fetch<S>,
    blurred: Fetch<S>,
    /// Share of the blurred level.
    share: Lanes<S>,
}

/// Four texels of one level.
struct Fetch<S: Simd> {
    resolution: Lanes<S>,
    footprint: Footprint<Lanes<S>>,
    first: [usize; BLOCK],
    width: [usize; BLOCK],
    texels: [Vec3<Lanes<S>>; 4],
}

impl<S: Simd> Fetch<S> {
    #[inline(always)]
    fn new(simd: S, light: &Light, point: &FacePoint<Lanes<S>>, levels: [usize; BLOCK]) -> Self {
        let sizes = levels.map(|level| light.resolution(level));
        let resolution = Lanes::from_array(simd, sizes.map(|size| size as f32));
        let footprint = footprint(point, resolution);
        let texel = footprint.texel.to_array();
        let first = core::array::from_fn(|lane| light.offsets()[levels[lane]] + texel[lane] as usize);
        let width = sizes.map(|size| size + 2);
        let corner = |right: usize, lower: usize| {
            gather(simd, &light.texels, core::array::from_fn(|lane| first[lane] + right + lower * width[lane]))
        };
        let texels = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
        Self { resolution, footprint, first, width, texels }
    }

    #[inline(always)]
    fn radiance(&self) -> Vec3<Lanes<S>> {
        bilinear(self.texels, self.footprint.right, self.footprint.lower)
    }

    /// Gradient of u and v; adds to the light's.
    #[inline(always)]
    fn vjp(&self, grad: Vec3<Lanes<S>>, light_grad: &mut [Texel]) -> (Lanes<S>, Lanes<S>) {
        let [a, b, c, d] = bilinear_weights(self.footprint.right, self.footprint.lower);
        let weights = [a.to_array(), b.to_array(), c.to_array(), d.to_array()];
        let (red, green, blue) = (grad.x.to_array(), grad.y.to_array(), grad.z.to_array());
        for lane in 0..BLOCK {
            if red[lane] == 0.0 && green[lane] == 0.0 && blue[lane] == 0.0 {
                continue;
            }
            let offsets = [0, 1, self.width[lane], self.width[lane] + 1];
            for (offset, weight) in offsets.into_iter().zip(&weights) {
                let texel = &mut light_grad[self.first[lane] + offset];
                let grad = [red[lane], green[lane], blue[lane]];
                texel.iter_mut().zip(grad).for_each(|(sum, grad)| *sum += weight[lane] * grad);
            }
        }
        let (right, lower) = bilinear_vjp(self.texels, self.footprint.right, self.footprint.lower, grad);
        let half = self.resolution * 0.5;
        (right * half, lower * half)
    }
}

#[inline(always)]
fn gather<S: Simd>(simd: S, texels: &[Texel], indices: [usize; BLOCK]) -> Vec3<Lanes<S>> {
    let mut planes = [[0.0; BLOCK]; 3];
    for (lane, index) in indices.into_iter().enumerate() {
        let texel = texels[index.min(texels.len() - 1)];
        planes.iter_mut().zip(texel).for_each(|(plane, value)| plane[lane] = value);
    }
    let [x, y, z] = planes;
    vec3(Lanes::from_array(simd, x), Lanes::from_array(simd, y), Lanes::from_array(simd, z))
}

impl<S: Simd> Lookup<S> {
    #[inline(always)]
    pub(crate) fn radiance(&self) -> Vec3<Lanes<S>> {
        let sharp = self.sharp.radiance();
        sharp.add_scaled(self.share, self.blurred.radiance() - sharp)
    }
}

/// Light along a direction at a roughness.
#[inline(always)]
pub(crate) fn look_up<S: Simd>(simd: S, light: &Light, direction: Vec3<Lanes<S>>, roughness: Lanes<S>) -> Lookup<S> {
    let point = project(direction);
    let position = level_of_roughness(roughness, light.levels());
    let last_pair = (light.levels().len() - 2) as f32;
    let lower = position.floor().clamp(0.0, last_pair);
    let sharp = lower.to_array().map(|level| level as usize);
    Lookup {
        sharp: Fetch::new(simd, light, &point, sharp),
        blurred: Fetch::new(simd, light, &point, sharp.map(|level| level + 1)),
        share: position - lower,
        point,
    }
}

/// Irradiance along a normal, from the map behind the last level.
#[inline(always)]
pub(crate) fn look_up_irradiance<S: Simd>(simd: S, light: &Light, normal: Vec3<Lanes<S>>) -> Lookup<S> {
    let point = project(normal);
    let map = [light.levels().len(); BLOCK];
    Lookup {
        sharp: Fetch::new(simd, light, &point, map),
        blurred: Fetch::new(simd, light, &point, map),
        share: normal.x.zero(),
        point,
    }
}

/// Gradient of [`look_up`], or of [`look_up_irradiance`], which has none in the roughness: with respect to direction
/// and roughness; adds to the light's.
#[inline(always)]
pub(crate) fn look_up_vjp<S: Simd>(
    light: &Light,
    lookup: &Lookup<S>,
    roughness: Lanes<S>,
    grad: Vec3<Lanes<S>>,
    light_grad: &mut [Texel],
) -> (Vec3<Lanes<S>>, Lanes<S>) {
    let (u, v) = lookup.sharp.vjp(grad * (-lookup.share + 1.0), light_grad);
    let (u2, v2) = lookup.blurred.vjp(grad * lookup.share, light_grad);
    let grad_position = grad.dot(lookup.blurred.radiance() - lookup.sharp.radiance());
    (project_vjp(&lookup.point, u + u2, v + v2), level_of_roughness_vjp(roughness, light.levels(), grad_position))
}

/// The table of the authors' shading, made at its first use.
static SPLIT_SUM: LazyLock<Vec<[f32; 2]>> = LazyLock::new(|| {
    const SAMPLES: u32 = 1024;
    let centre = |k: usize| (k as f64 + 0.5) / RESOLUTION as f64;
    (0..RESOLUTION * RESOLUTION)
        .into_par_iter()
        .map(|k| integrate(centre(k % RESOLUTION), centre(k / RESOLUTION), SAMPLES).map(|f| f as f32))
        .collect()
});

/// Four entries of the table and how far between them a point lies.
struct TableFetch<S: Simd> {
    corners: [[Lanes<S>; 2]; 4],
    right: Lanes<S>,
    lower: Lanes<S>,
    /// 1 where a coordinate lies inside the table, 0 where it was limited.
    is_free: [Lanes<S>; 2],
}

#[inline(always)]
fn table_fetch<S: Simd>(simd: S, n_dot_v: Lanes<S>, roughness: Lanes<S>) -> TableFetch<S> {
    let size = RESOLUTION as f32;
    let last = size - 1.0;
    let place = |x: Lanes<S>| {
        let free = x * size - 0.5;
        let inside = free.zero().less(free) & free.less(free.constant(last));
        let limited = free.clamp(0.0, last);
        let cell = limited.floor().min(limited.constant(last - 1.0));
        (cell, limited - cell, free.constant(1.0).keep(inside))
    };
    let ((column, right, free_x), (row, lower, free_y)) = (place(n_dot_v), place(roughness));
    let (column, row) = (column.to_array(), row.to_array());
    let corner = |dx: usize, dy: usize| {
        let entry: [[f32; 2]; BLOCK] =
            core::array::from_fn(|k| SPLIT_SUM[(row[k] as usize + dy) * RESOLUTION + column[k] as usize + dx]);
        [0, 1].map(|c| Lanes::from_array(simd, entry.map(|e| e[c])))
    };
    TableFetch {
        corners: [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)],
        right,
        lower,
        is_free: [free_x, free_y],
    }
}

/// (F_x, F_y) at n·v and roughness.
#[inline(always)]
pub(crate) fn split_sum<S: Simd>(simd: S, n_dot_v: Lanes<S>, roughness: Lanes<S>) -> [Lanes<S>; 2] {
    let fetch = table_fetch(simd, n_dot_v, roughness);
    let weights = bilinear_weights(fetch.right, fetch.lower);
    [0, 1].map(|c| (0..4).fold(n_dot_v.zero(), |sum, k| weights[k].mul_add(fetch.corners[k][c], sum)))
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
    let texels = fetch.corners.map(|[x, y]| vec3(x, y, zero));
    let (right, lower) = bilinear_vjp(texels, fetch.right, fetch.lower, vec3(grad[0], grad[1], zero));
    [right * RESOLUTION as f32 * fetch.is_free[0], lower * RESOLUTION as f32 * fetch.is_free[1]]
}
