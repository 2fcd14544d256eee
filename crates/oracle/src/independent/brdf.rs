//! Light under a complete microfacet reflectance, by quadrature in `f64`; the paper's lobe is one
//! of its factors.
//!
//! ```text
//! L_o(v) = ∫ L(l) f(v, l) (n·l)₊ dl,    f = F(v·h) D(h) G(v, l) / (4 n·v n·l),
//!     h = (v + l) / |v + l|
//! ```
//!
//! D is GGX (Walter et al. 2007, eq. 33), G the masking of Smith with correlated heights, 1 / (1 +
//! Λ(v) + Λ(l)) (Heitz 2014, eqs. 72 and 99), F that of Schlick 1994, F₀ + (1 − F₀) (1 − v·h)⁵.
//! Light that is reflected several times between facets is lost, as in any such model. The paper's
//! L_s keeps only one lobe around the mirrored direction, that of D seen from the normal, and
//! scales it by a tint instead of F and G.

use super::sphere::{Direction, Weights, add, cross, dot, integrate, length, normalised, sub};
use core::f64::consts::PI;

/// Largest width of a cell, as a share of the scale on which D changes.
const OPENING: f64 = 0.35;
/// Maximum width of cells at the horizon, where reflection ends in a kink, as a share of the
/// opening.
const HORIZON: f64 = 0.05;

/// Light from a surface to the eye, before its reflectance at normal incidence is applied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflected<const N: usize> {
    /// Integral multiplied by F₀: ∫ L D G / (4 n·v) (1 − (1 − v·h)⁵) dl.
    pub scale: [f64; N],
    /// Remaining integral, independent of F₀: ∫ L D G / (4 n·v) (1 − v·h)⁵ dl.
    pub rest: [f64; N],
}

impl<const N: usize> Reflected<N> {
    /// L_o of one of the lights for a reflectance at normal incidence.
    pub fn of(&self, light: usize, f0: f64) -> f64 {
        f0 * self.scale[light] + self.rest[light]
    }
}

/// L_o of a surface with a normal, seen from a direction on its side; both unit vectors.
///
/// `radiance` may have kinks as [`super::lobe::filtered`] says. Roughness is perceptual, in \[0,
/// 1\]; at 0 the surface is a mirror. `n·v` should be more than a hundredth.
pub fn reflected<const N: usize>(
    radiance: impl Fn([f64; 3]) -> [f64; N],
    normal: [f64; 3],
    to_eye: [f64; 3],
    roughness: f64,
    resolution: usize,
) -> Reflected<N> {
    Facets { normal, to_eye, alpha: roughness * roughness, opening: OPENING }.reflected(radiance, resolution)
}

/// f(v, l) of a light direction on the surface's side, in 1/sr.
pub fn brdf(normal: [f64; 3], to_eye: [f64; 3], light_dir: [f64; 3], roughness: f64, f0: f64) -> f64 {
    let facets = Facets { normal, to_eye, alpha: roughness * roughness, opening: OPENING };
    let [scale, rest] = facets.of(light_dir);
    (f0 * scale + rest) / dot(normal, light_dir)
}

/// A rough surface and its viewing direction.
struct Facets {
    normal: Direction,
    to_eye: Direction,
    alpha: f64,
    opening: f64,
}

impl Facets {
    fn reflected<const N: usize>(&self, radiance: impl Fn(Direction) -> [f64; N], resolution: usize) -> Reflected<N> {
        let n_dot_v = dot(self.normal, self.to_eye);
        if self.alpha == 0.0 {
            let mirrored = sub(self.normal.map(|c| 2.0 * n_dot_v * c), self.to_eye);
            let (light, rest) = (radiance(mirrored), (1.0 - n_dot_v).powi(5));
            return Reflected { scale: light.map(|light| light * (1.0 - rest)), rest: light.map(|light| light * rest) };
        }
        let [scale, rest] = integrate(radiance, self, resolution).light;
        Reflected { scale, rest }
    }

    /// D(h) = α² / (π (α² cos² + sin²)²), its sine from a cross product.
    fn distribution(&self, half: Direction) -> f64 {
        let (cosine, sine) = (dot(self.normal, half), length(cross(self.normal, half)));
        let alpha2 = self.alpha * self.alpha;
        if cosine > 0.0 { alpha2 / (PI * (alpha2 * cosine * cosine + sine * sine).powi(2)) } else { 0.0 }
    }

    /// Λ of a direction on the surface's side: (−1 + √(1 + α² tan²)) / 2.
    fn lambda(&self, direction: Direction) -> f64 {
        let tangent = length(cross(self.normal, direction)) / dot(self.normal, direction);
        0.5 * ((self.alpha * tangent).hypot(1.0) - 1.0)
    }
}

impl Weights<2> for Facets {
    /// D G / (4 n·v) times 1 − (1 − v·h)⁵, and times (1 − v·h)⁵.
    fn of(&self, light_dir: Direction) -> [f64; 2] {
        if self.are_zero(light_dir) {
            return [0.0; 2];
        }
        let half = normalised(add(self.to_eye, light_dir));
        let seen = 1.0 / (1.0 + self.lambda(self.to_eye) + self.lambda(light_dir));
        let weight = self.distribution(half) * seen / (4.0 * dot(self.normal, self.to_eye));
        let rest = (1.0 - dot(self.to_eye, half)).powi(5);
        [weight * (1.0 - rest), weight * rest]
    }

    /// h moves at most 1 / (2 v·h) times as far as l, and D changes on the scale of the angle
    /// between h and the normal, or α.
    fn widest(&self, middle: Direction, width: f64) -> f64 {
        let half = normalised(add(self.to_eye, middle));
        let slowness = 2.0 * dot(self.to_eye, half).max(0.5 * dot(self.normal, self.to_eye));
        let from_normal = (length(sub(half, self.normal)) - width / slowness).max(0.0);
        let from_horizon = (dot(self.normal, middle).abs() - width).max(0.0);
        self.opening * (slowness * (from_normal + self.alpha)).min(from_horizon + HORIZON)
    }

    fn are_zero(&self, light_dir: Direction) -> bool {
        dot(light_dir, self.normal) <= 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::independent::assert_close;

    /// Error of three points along an edge of a cell.
    const QUADRATURE: f64 = 2e-4;
    const ROUGHNESS: [f64; 5] = [0.02, 0.1, 0.3, 0.6, 1.0];
    const NORMAL: Direction = [0.36, -0.48, 0.8];
    /// A unit vector across the normal.
    const ACROSS: Direction = [0.8, 0.6, 0.0];

    fn at(n_dot_v: f64) -> Direction {
        let sine = (1.0 - n_dot_v * n_dot_v).sqrt();
        core::array::from_fn(|k| n_dot_v * NORMAL[k] + sine * ACROSS[k])
    }

    /// Uniform light of one, reflected completely by each facet.
    fn albedo(roughness: f64, n_dot_v: f64) -> f64 {
        reflected(|_| [1.0], NORMAL, at(n_dot_v), roughness, 1).of(0, 1.0)
    }

    /// The weak white furnace of Heitz 2014: no light is lost without masking, if it may go below
    /// the horizon.
    struct WeakFurnace(Facets);

    impl Weights<1> for WeakFurnace {
        fn of(&self, light_dir: Direction) -> [f64; 1] {
            let Self(facets) = self;
            let half = normalised(add(facets.to_eye, light_dir));
            let seen = 1.0 / (1.0 + facets.lambda(facets.to_eye));
            [facets.distribution(half) * seen / (4.0 * dot(facets.normal, facets.to_eye))]
        }
        fn widest(&self, middle: Direction, width: f64) -> f64 {
            // Opposite of the eye the facet is undefined.
            let opposite = length(add(self.0.to_eye, middle));
            self.0.widest(middle, width).min(self.0.opening * ((opposite - width).max(0.0) + 0.01))
        }
        fn are_zero(&self, _: Direction) -> bool {
            false
        }
    }

    #[test]
    fn visible_facets_cover_the_whole_surface() {
        for (roughness, n_dot_v) in ROUGHNESS.into_iter().flat_map(|r| [1.0, 0.7, 0.2].map(|c| (r, c))) {
            let facets = Facets { normal: NORMAL, to_eye: at(n_dot_v), alpha: roughness * roughness, opening: OPENING };
            let sums = integrate(|_| [1.0], &WeakFurnace(facets), 1);
            assert_close(sums.whole[0], 1.0, 1e-3);
        }
    }

    #[test]
    fn the_albedo_is_at_most_one_and_is_one_without_roughness() {
        for n_dot_v in [1.0, 0.7, 0.2] {
            let albedos = ROUGHNESS.map(|roughness| albedo(roughness, n_dot_v));
            assert!(albedos.iter().all(|albedo| *albedo < 1.0 + QUADRATURE), "{albedos:?}");
            assert_close(albedos[0], 1.0, 1e-3);
            assert!(albedos[4] < 0.7, "roughness loses light: {albedos:?}");
        }
        assert_eq!(albedo(0.0, 0.4), 1.0, "a mirror");
    }

    #[test]
    fn an_almost_smooth_surface_is_a_mirror_with_the_reflectance_of_schlick() {
        let light = |light_dir: Direction| [2.0 + light_dir[0] * light_dir[1], (2.0 * light_dir[2]).exp()];
        for n_dot_v in [0.9, 0.3] {
            let [rough, mirror] = [0.01, 0.0].map(|roughness| reflected(light, NORMAL, at(n_dot_v), roughness, 4));
            let schlick = 0.04 + 0.96 * (1.0 - n_dot_v).powi(5);
            let towards = sub(NORMAL.map(|c| 2.0 * n_dot_v * c), at(n_dot_v));
            for k in 0..2 {
                assert_close(mirror.of(k, 0.04), schlick * light(towards)[k], 1e-12);
                assert_close(rough.of(k, 0.04) / mirror.of(k, 0.04), 1.0, 1e-3);
            }
        }
    }

    #[test]
    fn the_brdf_is_reciprocal() {
        let dir = |n: f64, turn: f64| {
            let (sine, (a, b)) = ((1.0 - n * n).sqrt(), turn.sin_cos());
            let third = cross(NORMAL, ACROSS);
            core::array::from_fn(|k| n * NORMAL[k] + sine * (b * ACROSS[k] + a * third[k]))
        };
        for roughness in ROUGHNESS {
            for (one, other) in [(dir(0.9, 0.1), dir(0.2, 2.0)), (dir(0.5, -1.0), dir(0.51, 2.1))] {
                let there = brdf(NORMAL, one, other, roughness, 0.3);
                let back = brdf(NORMAL, other, one, roughness, 0.3);
                assert!(there > 0.0, "light is reflected");
                assert_close(there / back, 1.0, 1e-12);
            }
        }
    }

    /// The albedo by the midpoint rule over half vectors, with D and G in the textbook's form.
    fn albedo_over_facets(roughness: f64, n_dot_v: f64) -> f64 {
        const STEPS: usize = 1200;
        let alpha2 = roughness.powi(4);
        let sine_v = (1.0 - n_dot_v * n_dot_v).sqrt();
        let lambda = |cosine: f64| 0.5 * ((1.0 + alpha2 * (1.0 / (cosine * cosine) - 1.0)).sqrt() - 1.0);
        let mut sum = 0.0;
        for step in 0..STEPS {
            // D n·h dh is constant in equal steps of this variable.
            let share = (step as f64 + 0.5) / STEPS as f64;
            let cosine_h = ((1.0 - share) / (share * (alpha2 - 1.0) + 1.0)).sqrt();
            let sine_h = (1.0 - cosine_h * cosine_h).sqrt();
            for turn in 0..STEPS {
                let turn = 2.0 * PI * (turn as f64 + 0.5) / STEPS as f64;
                let v_dot_h = n_dot_v * cosine_h + sine_v * sine_h * turn.cos();
                let n_dot_l = 2.0 * v_dot_h * cosine_h - n_dot_v;
                if v_dot_h > 0.0 && n_dot_l > 0.0 {
                    let seen = 1.0 / (1.0 + lambda(n_dot_v) + lambda(n_dot_l));
                    sum += seen * v_dot_h / (n_dot_v * cosine_h);
                }
            }
        }
        sum / (STEPS * STEPS) as f64
    }

    #[test]
    fn integrals_over_light_and_over_facets_agree() {
        for (roughness, n_dot_v) in [(0.1, 0.7), (0.3, 0.2), (0.6, 0.9), (1.0, 0.4)] {
            assert_close(albedo(roughness, n_dot_v), albedo_over_facets(roughness, n_dot_v), 1e-3);
        }
    }

    #[test]
    fn finer_cells_change_nothing() {
        let light = |light_dir: Direction| [(3.0 * light_dir[0]).sin() + 2.0, 1.0];
        for (roughness, n_dot_v) in ROUGHNESS.into_iter().flat_map(|r| [0.95, 0.4, 0.1].map(|c| (r, c))) {
            let of = |opening| {
                let facets = Facets { normal: NORMAL, to_eye: at(n_dot_v), alpha: roughness * roughness, opening };
                facets.reflected(light, 4)
            };
            let (coarse, fine) = (of(OPENING), of(0.3 * OPENING));
            for (k, f0) in [(0, 0.04), (1, 0.04), (0, 1.0), (1, 1.0)] {
                assert_close(coarse.of(k, f0) / fine.of(k, f0), 1.0, QUADRATURE);
            }
        }
    }
}
