//! Ambient transfer of a surface ([`specula_core::physical`]): the unoccluded share of the
//! irradiance along its normal, plus the interreflected light.
//!
//! With cosine-weighted directions ω_k of a vertex, the radiance L of the sky and L_o of the
//! surface that a ray hits, at the nearest corner of its triangle ([`crate::sight`]),
//!
//! ```text
//! transfer = Σ_k (L(ω_k) if ω_k meets nothing, else L_o) / Σ_k L(ω_k)
//! ```
//!
//! channel by channel. Errors due to the small number of rays mostly cancel between numerator and
//! denominator.

use crate::{
    sight::{RAYS, rays},
    sky::Sky,
    surface::Surface,
};
use glam::Vec3;
use rayon::prelude::*;
use specula_core::{
    near_field::{NearField, vertex_surface},
    shade::reflect,
    vector::{Vec3 as Real3, normalize_or},
};

/// Largest transfer: interreflected light is seldom brighter than the sky.
const TRANSFER_MAX: f32 = 4.0;
/// Sum of radiances below which the transfer is one.
const DARK: f32 = 1e-6;

/// Transfers of the vertices of a near field, and the share of their rays that hit it.
#[derive(Clone, Debug, PartialEq)]
pub struct Ambient {
    /// Red, green and blue of each vertex.
    pub transfers: Vec<[f32; 3]>,
    /// Share of all rays that hit the surface, from 0 to 1.
    pub met: f64,
}

impl Ambient {
    /// Transfers of every vertex under a sky. Vertices without a normal are unoccluded.
    pub fn new(surface: &Surface, sky: &Sky) -> Self {
        let found: Vec<([f32; 3], usize)> = (0..surface.vertex_count)
            .into_par_iter()
            .map(|vertex| transfer(surface, surface.sight().of_vertex(vertex), sky, vertex))
            .collect();
        let met: usize = found.iter().map(|(_, met)| met).sum();
        let rays = (RAYS * found.len()).max(1);
        Self { transfers: found.into_iter().map(|(transfer, _)| transfer).collect(), met: met as f64 / rays as f64 }
    }
}

/// Transfer of a vertex that sees others, and the number of its rays that hit the surface.
fn transfer(
    near_field: &NearField<Vec<f32>>,
    seen: impl Iterator<Item = Option<usize>>,
    sky: &Sky,
    vertex: usize,
) -> ([f32; 3], usize) {
    let (mut open, mut reached, mut met) = (Vec3::ZERO, Vec3::ZERO, 0);
    for ((_, direction), seen) in rays(near_field, vertex).zip(seen) {
        let radiance = sky.radiance(direction);
        open += radiance;
        match seen {
            None => reached += radiance,
            Some(other) => {
                let surface = vertex_surface(near_field.vertex(other));
                let mirrored = reflect(Real3::from(-direction), normalize_or(surface.normal, Real3::from(-direction)));
                let sky_radiance = sky.radiance(mirrored.into());
                reached += Vec3::from(surface.base).max(Vec3::ZERO) + Vec3::from(surface.tint) * sky_radiance;
                met += 1;
            }
        }
    }
    if met == 0 {
        return ([1.0; 3], 0);
    }
    let share = |k: usize| if open[k] > DARK { (reached[k] / open[k]).clamp(0.0, TRANSFER_MAX) } else { 1.0 };
    ([0, 1, 2].map(share), met)
}
