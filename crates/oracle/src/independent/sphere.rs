//! Integrals over all directions, on the faces of a cube, in adaptive cells.
//!
//! Numbers are in arrays of any length, so several lights and several weights are integrated at
//! once.

use core::array;

/// A unit vector.
pub(super) type Direction = [f64; 3];

/// Gauss–Legendre points of order three on [−1, 1], and their weights.
const GAUSS: [(f64, f64); 3] =
    [(-0.774_596_669_241_483_4, 5.0 / 9.0), (0.0, 8.0 / 9.0), (0.774_596_669_241_483_4, 5.0 / 9.0)];

/// Weight of light.
pub(super) trait Weights<const M: usize> {
    /// The weights of light from a direction.
    fn of(&self, light_dir: Direction) -> [f64; M];
    /// Largest width of a cell around a direction, given its current width.
    fn widest(&self, middle: Direction, width: f64) -> f64;
    /// True if all weights are zero in a direction. If so at all corners of a cell, the whole cell
    /// is skipped.
    fn are_zero(&self, light_dir: Direction) -> bool;
}

/// ∫ w L dω for `M` weights w and `N` lights L, and ∫ w dω.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sums<const M: usize, const N: usize> {
    pub(super) light: [[f64; N]; M],
    pub(super) whole: [f64; M],
}

/// Integrates. Light may have kinks where a cube map of this resolution has them, between its
/// texels' centres; elsewhere it should be smooth.
pub(super) fn integrate<const M: usize, const N: usize>(
    radiance: impl Fn(Direction) -> [f64; N],
    weights: &impl Weights<M>,
    resolution: usize,
) -> Sums<M, N> {
    let lines = lines_of(resolution);
    let mut sums = Sums { light: [[0.0; N]; M], whole: [0.0; M] };
    for (axis, side) in (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]) {
        for across in lines.windows(2) {
            for down in lines.windows(2) {
                let middle = |line: &[f64]| 0.5 * (line[0] + line[1]);
                let half = |line: &[f64]| 0.5 * (line[1] - line[0]);
                let (centre, half) = ([middle(across), middle(down)], [half(across), half(down)]);
                Cell { axis, side, centre, half }.add_to(&mut sums, &radiance, weights);
            }
        }
    }
    sums
}

/// Bounds of the bilinear pieces of a face: its edges, and the centres of its texels.
fn lines_of(resolution: usize) -> Vec<f64> {
    let centres = (0..resolution).map(|k| (2 * k + 1) as f64 / resolution as f64 - 1.0);
    core::iter::once(-1.0).chain(centres).chain([1.0]).collect()
}

/// A rectangle on a face of the cube.
#[derive(Clone, Copy)]
struct Cell {
    /// Axis of the face's normal, and its sign.
    axis: usize,
    side: f64,
    /// Its middle.
    centre: [f64; 2],
    /// Half of its width and height.
    half: [f64; 2],
}

impl Cell {
    fn add_to<const M: usize, const N: usize>(
        self,
        sums: &mut Sums<M, N>,
        radiance: &impl Fn(Direction) -> [f64; N],
        weights: &impl Weights<M>,
    ) {
        if self.corners().into_iter().all(|corner| weights.are_zero(normalised(corner))) {
            return;
        }
        let width = 2.0 * self.half[0].max(self.half[1]);
        if width > weights.widest(normalised(self.point([0.0; 2])), width) {
            return self.quarters().into_iter().for_each(|quarter| quarter.add_to(sums, radiance, weights));
        }
        for (x, weight_x) in GAUSS {
            for (y, weight_y) in GAUSS {
                let point = self.point([x, y]);
                let area = self.half[0] * self.half[1] * weight_x * weight_y * length(point).powi(-3);
                let light_dir = normalised(point);
                sums.add(area, &weights.of(light_dir), &radiance(light_dir));
            }
        }
    }

    /// A point of it, from coordinates in [−1, 1]².
    fn point(&self, [x, y]: [f64; 2]) -> Direction {
        let mut point = [0.0; 3];
        point[self.axis] = self.side;
        point[(self.axis + 1) % 3] = self.centre[0] + x * self.half[0];
        point[(self.axis + 2) % 3] = self.centre[1] + y * self.half[1];
        point
    }

    fn corners(&self) -> [Direction; 4] {
        [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]].map(|corner| self.point(corner))
    }

    fn quarters(&self) -> [Self; 4] {
        [[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]].map(|[x, y]| Self {
            centre: [self.centre[0] + x * self.half[0], self.centre[1] + y * self.half[1]],
            half: self.half.map(|half| 0.5 * half),
            ..*self
        })
    }
}

impl<const M: usize, const N: usize> Sums<M, N> {
    fn add(&mut self, area: f64, weights: &[f64; M], light: &[f64; N]) {
        for m in 0..M {
            let weight = area * weights[m];
            self.whole[m] += weight;
            (0..N).for_each(|k| self.light[m][k] += weight * light[k]);
        }
    }
}

pub(super) fn dot(a: Direction, b: Direction) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: Direction, b: Direction) -> Direction {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn add(a: Direction, b: Direction) -> Direction {
    array::from_fn(|k| a[k] + b[k])
}

pub(super) fn sub(a: Direction, b: Direction) -> Direction {
    array::from_fn(|k| a[k] - b[k])
}

pub(super) fn length(a: Direction) -> f64 {
    dot(a, a).sqrt()
}

pub(super) fn normalised(a: Direction) -> Direction {
    a.map(|c| c / length(a))
}
