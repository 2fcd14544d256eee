//! The split-sum table of the authors' shading: how much a GGX surface reflects, as scale and bias
//! of its tint.

use crate::math;

/// Texels along each side of the table: n·v across, roughness down.
pub const RESOLUTION: usize = 256;

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
    let alpha_ggx = (roughness * roughness).max(1e-6);
    let view = [math::sqrt64(1.0 - n_dot_v * n_dot_v), n_dot_v];
    let mut sum = [0.0; 2];
    for k in 0..samples {
        let t = (f64::from(k) + 0.5) / f64::from(samples);
        let u = 1.0 - t * t;
        let phi = core::f64::consts::TAU * (f64::from(k.reverse_bits()) + 0.5) / 4_294_967_296.0;
        let cos2 = t * t / (1.0 + (alpha_ggx * alpha_ggx - 1.0) * u);
        let (n_dot_h, sine) = (math::sqrt64(cos2), math::sqrt64(1.0 - cos2));
        let v_dot_h = (view[0] * sine * math::cos64(phi) + view[1] * n_dot_h).max(0.0);
        let n_dot_l = 2.0 * v_dot_h * n_dot_h - n_dot_v;
        if n_dot_l > 0.0 {
            let visible = masking_shadowing(n_dot_v, n_dot_l, alpha_ggx);
            let weight = 2.0 * t * visible * v_dot_h / (n_dot_h * n_dot_v);
            let fresnel = math::pow64(1.0 - v_dot_h, 5.0);
            sum[0] += (1.0 - fresnel) * weight;
            sum[1] += fresnel * weight;
        }
    }
    sum.map(|s| s / f64::from(samples))
}

/// Height-correlated Smith G of two directions: 1 / (1 + Λ(v) + Λ(l)).
fn masking_shadowing(n_dot_v: f64, n_dot_l: f64, alpha_ggx: f64) -> f64 {
    let lambda = |c: f64| (math::sqrt64(1.0 + alpha_ggx * alpha_ggx * (1.0 - c * c) / (c * c)) - 1.0) * 0.5;
    1.0 / (1.0 + lambda(n_dot_v) + lambda(n_dot_l))
}
