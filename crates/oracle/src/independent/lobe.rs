//! Light under a GGX lobe, by quadrature in `f64`: the integral that prefilters approximate. And a
//! light that is hard to filter.
//!
//! Cube faces, lobe and solid angles are defined here again. Numbers are in arrays of any length,
//! so several lights are integrated at once.

use super::sphere::{Direction, Weights, cross, dot, integrate, length, normalised, sub};
use core::array;

/// Largest width of a cell, as a share of the scale θ + 2α on which the lobe changes at the angle
/// θ. The lobe's nearest pole lies 2α off the real axis, so three points along a cell's edge are
/// accurate to a few parts in a million.
const OPENING: f64 = 0.5;

/// P(r, ρ) = ∫ L(ω) D(θ/2) (cos θ)₊ dω / ∫ D(θ/2) (cos θ)₊ dω with cos θ = ω · r: light in a mirror
/// of perceptual roughness ρ, seen along its normal (paper, eq. L_s, for n = ω_o = r, normalised; D
/// of Walter et al. 2007, eq. 33).
///
/// Calls `radiance` with unit vectors. It may have kinks where a cube map of this resolution has
/// them, between its texels' centres; elsewhere it should be smooth. Roughness is in \[0, 1\]; at 0
/// the light is unchanged.
pub fn filtered<const N: usize>(
    radiance: impl Fn([f64; 3]) -> [f64; N],
    reflection_dir: [f64; 3],
    roughness: f64,
    resolution: usize,
) -> [f64; N] {
    Lobe { reflection_dir, alpha: roughness * roughness, opening: OPENING }.mean(radiance, resolution)
}

struct Lobe {
    reflection_dir: Direction,
    alpha: f64,
    opening: f64,
}

impl Lobe {
    fn mean<const N: usize>(&self, radiance: impl Fn(Direction) -> [f64; N], resolution: usize) -> [f64; N] {
        if self.alpha == 0.0 {
            return radiance(self.reflection_dir);
        }
        let sums = integrate(radiance, self, resolution);
        sums.light[0].map(|sum| sum / sums.whole[0])
    }
}

impl Weights<1> for Lobe {
    /// D(θ/2) (cos θ)₊ up to a factor: α⁴ / (cos⁴(θ/2) (α² + tan²(θ/2))²) · cos θ.
    fn of(&self, light_dir: Direction) -> [f64; 1] {
        let cosine = dot(light_dir, self.reflection_dir);
        let sine = length(cross(light_dir, self.reflection_dir));
        let tan2_half = (sine / (1.0 + cosine)).powi(2);
        let alpha2 = self.alpha * self.alpha;
        [((1.0 + tan2_half) * alpha2 / (alpha2 + tan2_half)).powi(2) * cosine.max(0.0)]
    }

    fn widest(&self, middle: Direction, width: f64) -> f64 {
        let angle = length(sub(middle, self.reflection_dir));
        self.opening * ((angle - width).max(0.0) + 2.0 * self.alpha)
    }

    fn are_zero(&self, light_dir: Direction) -> bool {
        dot(light_dir, self.reflection_dir) <= 0.0
    }
}

/// A cube map, bilinear between the centres of its texels, also across edges; faces are +X −X +Y −Y
/// +Z −Z, rows down, as in OpenGL. At a corner, where three texels meet, their mean replaces the
/// fourth.
#[derive(Clone, Debug)]
pub struct CubeMap<const N: usize> {
    /// Texels along an edge.
    pub resolution: usize,
    /// Texels, row by row, face by face.
    pub texels: Vec<[f64; N]>,
}

impl<const N: usize> CubeMap<N> {
    /// Map with the mean of the light in each texel, over `samples`² points weighted by solid
    /// angle.
    pub fn new(resolution: usize, samples: usize, radiance: impl Fn([f64; 3]) -> [f64; N]) -> Self {
        let along = |index: usize, sample: usize| {
            2.0 * (index as f64 + (sample as f64 + 0.5) / samples as f64) / resolution as f64 - 1.0
        };
        let texel = |face, row, column| {
            let (mut sum, mut total) = ([0.0; N], 0.0);
            for (x, y) in (0..samples * samples).map(|k| (k % samples, k / samples)) {
                let point = point_of_face(face, [along(column, x), along(row, y)]);
                let weight = length(point).powi(-3);
                let light = radiance(normalised(point));
                (0..N).for_each(|k| sum[k] += weight * light[k]);
                total += weight;
            }
            sum.map(|sum| sum / total)
        };
        let texels = (0..6 * resolution * resolution)
            .map(|k| (k / (resolution * resolution), k / resolution % resolution, k % resolution));
        Self { resolution, texels: texels.map(|(face, row, column)| texel(face, row, column)).collect() }
    }

    /// The light from a direction.
    pub fn sample(&self, direction: [f64; 3]) -> [f64; N] {
        let (face, at) = face_of(direction);
        let [x, y] = at.map(|s| 0.5 * (s + 1.0) * self.resolution as f64 - 0.5);
        let (column, row) = (x.floor(), y.floor());
        let (across, down) = (x - column, y - row);
        let corner = |dx: isize, dy: isize| self.texel_around(face, column as isize + dx, row as isize + dy);
        let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
        array::from_fn(|k| {
            let (upper, lower) = (a[k] + across * (b[k] - a[k]), c[k] + across * (d[k] - c[k]));
            upper + down * (lower - upper)
        })
    }

    /// A texel of a face or of its neighbours', one beyond its edges.
    fn texel_around(&self, face: usize, column: isize, row: isize) -> [f64; N] {
        let last = self.resolution as isize - 1;
        let (inner_column, inner_row) = (column.clamp(0, last), row.clamp(0, last));
        if (inner_column, inner_row) == (column, row) {
            return self.texels[(face * self.resolution + row as usize) * self.resolution + column as usize];
        }
        if inner_column != column && inner_row != row {
            let around = [(inner_column, inner_row), (column, inner_row), (inner_column, row)];
            let texels = around.map(|(column, row)| self.texel_around(face, column, row));
            return array::from_fn(|k| (texels[0][k] + texels[1][k] + texels[2][k]) / 3.0);
        }
        // Just beyond the edge, in the middle of the texel's side.
        let beyond = |k: isize| ((2 * k + 1) as f64 / self.resolution as f64 - 1.0).clamp(-1.000_001, 1.000_001);
        let (face, at) = face_of(point_of_face(face, [beyond(column), beyond(row)]));
        let [column, row] = at.map(|s| (0.5 * (s + 1.0) * self.resolution as f64) as isize);
        self.texel_around(face, column.clamp(0, last), row.clamp(0, last))
    }
}

/// Axes of a face: its normal, then the directions of columns and rows, each with a sign.
const FACES: [[(usize, f64); 3]; 6] = [
    [(0, 1.0), (2, -1.0), (1, -1.0)],
    [(0, -1.0), (2, 1.0), (1, -1.0)],
    [(1, 1.0), (0, 1.0), (2, 1.0)],
    [(1, -1.0), (0, 1.0), (2, -1.0)],
    [(2, 1.0), (0, 1.0), (1, -1.0)],
    [(2, -1.0), (0, -1.0), (1, -1.0)],
];

/// The point of a face at (s, t) in [−1, 1]².
fn point_of_face(face: usize, [s, t]: [f64; 2]) -> Direction {
    let mut point = [0.0; 3];
    for ((axis, sign), along) in FACES[face].into_iter().zip([1.0, s, t]) {
        point[axis] = sign * along;
    }
    point
}

/// The face that a direction passes through, and where.
fn face_of(direction: Direction) -> (usize, [f64; 2]) {
    let out = |face: usize| direction[FACES[face][0].0] * FACES[face][0].1;
    let face = (1..6).fold(0, |best, face| if out(face) > out(best) { face } else { best });
    let [_, across, down] = FACES[face].map(|(axis, sign)| sign * direction[axis] / out(face));
    (face, [across, down])
}

/// A light that is hard to filter, z up: a sky that brightens to the horizon, a sun of radius 2.5°,
/// a band of windows with panes, a chequered floor. The first three numbers are clamped to [0, 1]
/// like a display's; the last three have a sun of 200 and windows of 8.
pub fn studio(direction: [f64; 3]) -> [f64; 6] {
    const SUN_DIR: Direction = [0.48, -0.6, 0.64];
    const SUN_COSINE: f64 = 0.999_048_221_581_857_8; // of 2.5°
    const CHECKS: f64 = 1.5;
    let [x, y, z] = direction;
    let turn = y.atan2(x);
    let is_even = |a: f64, b: f64| (a.floor() + b.floor()).rem_euclid(2.0) == 0.0;

    let bright: [f64; 3] = if dot(direction, SUN_DIR) > SUN_COSINE {
        [200.0, 190.0, 170.0]
    } else if z < 0.0 {
        let is_light = is_even(CHECKS * x / -z, CHECKS * y / -z);
        if is_light { [0.6, 0.55, 0.5] } else { [0.1, 0.1, 0.12] }
    } else if (0.1..0.45).contains(&z) && (turn * 3.0 / core::f64::consts::PI).rem_euclid(1.0) < 0.6 {
        let is_pane = is_even(turn * 24.0, z * 20.0);
        if is_pane { [8.0, 7.5, 6.5] } else { [0.2, 0.15, 0.1] }
    } else {
        let haze = (1.0 - z).powi(2);
        [0.15 + 0.55 * haze, 0.3 + 0.45 * haze, 0.65 + 0.2 * haze]
    };
    let shown = bright.map(|number| number.min(1.0));
    array::from_fn(|k| if k < 3 { shown[k] } else { bright[k - 3] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::independent::assert_close;

    /// A few roundings.
    const ROUNDING_F64: f64 = 1e-12;

    /// Error of three points along an edge of a cell: largest where the horizon crosses the wide
    /// cells of a coarse map.
    const QUADRATURE: f64 = 1e-4;
    const ROUGHNESS: [f64; 5] = [1e-3, 0.03, 0.2, 0.6, 1.0];
    const AXIS: Direction = [0.36, -0.48, 0.8];

    #[test]
    fn a_constant_light_is_its_own_mean() {
        for roughness in ROUGHNESS {
            let [mean] = filtered(|_| [3.0], AXIS, roughness, 4);
            assert_close(mean, 3.0, ROUNDING_F64);
        }
    }

    #[test]
    fn a_mirror_shows_the_unchanged_light() {
        assert_eq!(filtered(studio, AXIS, 0.0, 8), studio(AXIS), "nothing is integrated");
    }

    /// The mean of ω · r by the midpoint rule along the angle from r, with D in the textbook's
    /// form.
    fn mean_cosine(roughness: f64) -> f64 {
        const STEPS: usize = 400_000;
        let alpha = roughness * roughness;
        let (mut sum, mut total) = (0.0, 0.0);
        // In u = √θ the steps are dense where lobes are narrow.
        let longest = core::f64::consts::FRAC_PI_2.sqrt();
        for step in 0..STEPS {
            let u = longest * (step as f64 + 0.5) / STEPS as f64;
            let theta = u * u;
            let half = (0.5 * theta).cos().powi(2) * (alpha * alpha - 1.0) + 1.0;
            let weight = theta.cos() * theta.sin() * u / (half * half);
            sum += weight * theta.cos();
            total += weight;
        }
        sum / total
    }

    #[test]
    fn a_linear_light_keeps_its_slope_times_the_mean_cosine() {
        let slope = [0.5, -0.25, 0.7];
        for roughness in [0.05, 0.2, 0.6, 1.0] {
            let [mean] = filtered(|light_dir| [1.0 + dot(slope, light_dir)], AXIS, roughness, 4);
            assert_close(mean, 1.0 + dot(slope, AXIS) * mean_cosine(roughness), QUADRATURE);
        }
        assert_close(mean_cosine(1.0), 2.0 / 3.0, QUADRATURE);
    }

    #[test]
    fn turning_light_and_lobe_together_changes_nothing() {
        let turn = |[x, y, z]: Direction| {
            let (a, b) = (0.6 * x - 0.8 * y, 0.8 * x + 0.6 * y);
            [a, 0.28 * b - 0.96 * z, 0.96 * b + 0.28 * z]
        };
        let back = |[x, y, z]: Direction| {
            let (b, c) = (0.28 * y + 0.96 * z, -0.96 * y + 0.28 * z);
            [0.6 * x + 0.8 * b, -0.8 * x + 0.6 * b, c]
        };
        let light = |[x, y, z]: Direction| [(3.0 * x).sin() + y * y * z, (2.0 * z - x).exp()];
        for roughness in ROUGHNESS {
            let straight = filtered(light, AXIS, roughness, 8);
            let turned = filtered(|light_dir| light(back(light_dir)), turn(AXIS), roughness, 8);
            for (a, b) in straight.into_iter().zip(turned) {
                assert_close(a, b, QUADRATURE);
            }
        }
    }

    #[test]
    fn finer_cells_change_nothing() {
        let map = CubeMap::new(16, 4, studio);
        for roughness in ROUGHNESS {
            let mean = |opening| {
                let lobe = Lobe { reflection_dir: AXIS, alpha: roughness * roughness, opening };
                lobe.mean(|light_dir| map.sample(light_dir), 16)
            };
            for (coarse, fine) in mean(OPENING).into_iter().zip(mean(0.3 * OPENING)) {
                assert_close(coarse / fine, 1.0, QUADRATURE);
            }
        }
    }

    #[test]
    fn texels_of_a_map_are_means_that_sum_to_the_whole_light() {
        let map = CubeMap::new(8, 4, |[x, y, z]| [1.0 + x, 1.0 + y * z]);
        for (index, texel) in map.texels.iter().enumerate() {
            let centre = |k: usize| (2 * (k % 8) + 1) as f64 / 8.0 - 1.0;
            let direction = normalised(point_of_face(index / 64, [centre(index), centre(index / 8)]));
            let found = map.sample(direction);
            assert_close(found[0], texel[0], 1e-12);
            assert_close(texel[0], 1.0 + direction[0], 0.02);
        }
        let [mean] = filtered(|light_dir| [map.sample(light_dir)[0]], [1.0, 0.0, 0.0], 1.0, 8);
        assert_close(mean, 5.0 / 3.0, 0.01);
    }

    #[test]
    fn a_map_is_continuous_across_edges_and_corners() {
        let map = CubeMap::new(8, 4, studio);
        for (a, b) in [([1.0, 0.3, 1.0], 2), ([1.0, -0.7, -1.0], 0), ([-0.2, 1.0, 1.0], 1), ([1.0, 1.0, 0.99], 1)] {
            let (mut before, mut beyond) = (a, a);
            before[b] -= 1e-9;
            beyond[b] += 1e-9;
            let (before, beyond) = (map.sample(normalised(before)), map.sample(normalised(beyond)));
            for (a, b) in before.into_iter().zip(beyond) {
                assert_close(a, b, 1e-5);
            }
        }
    }
}
