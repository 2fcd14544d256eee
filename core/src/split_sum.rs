//! The split-sum table of the authors' shading: how much a GGX surface reflects, as scale and bias
//! of its tint.

use crate::{math, real::Real};

/// Texels along each side of the table: n·v across, roughness down.
pub const RESOLUTION: usize = 256;

/// Position of a coordinate among the centres of the table's texels.
#[derive(Clone, Copy, Debug)]
pub struct TablePosition<R> {
    /// The texel before it, so that there is another behind it: a whole number.
    pub texel: R,
    /// Weight of the other, in \[0, 1\].
    pub share: R,
    /// 1 where the coordinate lies between two centres, 0 where it is clamped.
    pub is_free: R,
}

/// Position of n·v or of a roughness in the table.
#[inline(always)]
pub fn table_position<R: Real>(x: R) -> TablePosition<R> {
    let size = RESOLUTION as f32;
    let last = size - 1.0;
    let free = x * size - 0.5;
    let inside = free.zero().less(free) & free.less(free.constant(last));
    let limited = free.clamp(0.0, last);
    let texel = limited.floor().min(limited.constant(last - 1.0));
    TablePosition { texel, share: limited - texel, is_free: free.constant(1.0).keep(inside) }
}

/// (F_x, F_y) at one n·v in (0, 1] and one roughness in \[0, 1\] (Karis 2013; height-correlated
/// Smith shadowing as in Heitz 2014, eq. 99; Schlick's Fresnel):
///
/// ```text
/// F_x = E[(1 − f) G v·h / (n·h n·v)],  F_y = E[f G v·h / (n·h n·v)],  f = (1 − v·h)⁵
/// ```
///
/// over half vectors drawn from D(h) n·h; here a Hammersley set of `samples` points. F_x + F_y ≤ 1.
///
/// The common variable of that draw, u, leaves a pole 1/√(1 − u) at grazing half vectors; t = √(1 −
/// u) has none, and 1024 points then come within 2e-4 of the integral, where they were 1e-2 away.
pub fn integrate(n_dot_v: f64, roughness: f64, samples: u32) -> [f64; 2] {
    integrate_over((0..samples).map(|k| HalfVector::of_sample(k, roughness, samples)), n_dot_v, roughness)
}

/// Half vector of a set, in the plane of the normal and the view direction; the same for every n·v.
#[derive(Clone, Copy, Debug)]
pub struct HalfVector {
    /// n·h.
    pub n_dot_h: f64,
    /// Component perpendicular to the normal, towards the view direction.
    pub across: f64,
    /// Share of the set, with what does not depend on n·v: 4 t / (`samples` n·h).
    pub weight: f64,
}

impl HalfVector {
    /// The k-th of `samples` half vectors of a roughness.
    pub fn of_sample(k: u32, roughness: f64, samples: u32) -> Self {
        let alpha2 = alpha2_ggx(roughness);
        let t = (f64::from(k) + 0.5) / f64::from(samples);
        let phi = core::f64::consts::TAU * (f64::from(k.reverse_bits()) + 0.5) / 4_294_967_296.0;
        let cos2 = t * t / (1.0 + (alpha2 - 1.0) * (1.0 - t * t));
        let n_dot_h = math::sqrt64(cos2);
        let across = math::sqrt64(1.0 - cos2) * math::cos64(phi);
        Self { n_dot_h, across, weight: 4.0 * t / (f64::from(samples) * n_dot_h) }
    }
}

/// [`integrate`] over the half vectors of a roughness, which tables compute once for all n·v.
#[inline]
pub fn integrate_over(half_vectors: impl Iterator<Item = HalfVector>, n_dot_v: f64, roughness: f64) -> [f64; 2] {
    let alpha2 = alpha2_ggx(roughness);
    let slant = |cosine: f64| math::sqrt64(cosine * cosine + alpha2 * (1.0 - cosine * cosine));
    let (sine, slant_of_view) = (math::sqrt64(1.0 - n_dot_v * n_dot_v), slant(n_dot_v));
    let mut sum = [0.0; 2];
    for HalfVector { n_dot_h, across, weight } in half_vectors {
        let v_dot_h = (sine * across + n_dot_v * n_dot_h).max(0.0);
        let n_dot_l = (2.0 * v_dot_h * n_dot_h - n_dot_v).max(0.0);
        // G / (n·v) without its pole: 2 n·l / (n·l slant(v) + n·v slant(l)).
        let reflected = weight * v_dot_h * n_dot_l / (n_dot_l * slant_of_view + n_dot_v * slant(n_dot_l));
        let squared = (1.0 - v_dot_h) * (1.0 - v_dot_h);
        let fresnel = squared * squared * (1.0 - v_dot_h);
        sum[0] += (1.0 - fresnel) * reflected;
        sum[1] += fresnel * reflected;
    }
    sum
}

/// Squared width of the lobe; that of a mirror is not zero.
fn alpha2_ggx(roughness: f64) -> f64 {
    let alpha_ggx = (roughness * roughness).max(1e-6);
    alpha_ggx * alpha_ggx
}
