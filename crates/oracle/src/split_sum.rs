//! The split-sum table, interpolated.

use crate::number::Number;
use specula_core::{
    cubemap::{bilinear, bilinear_vjp},
    split_sum::{RESOLUTION, integrate},
    vector::{Vec3, vec3},
};

/// Points of each entry, the same number as in the executors' table.
const SAMPLES: u32 = 1024;

/// Entries around a point of the table.
struct Cell<R> {
    entries: [Vec3<R>; 4],
    right: R,
    lower: R,
    /// Whether a coordinate lies inside the table.
    is_free: [bool; 2],
}

impl<R: Number> Cell<R> {
    fn new(n_dot_v: R, roughness: R) -> Self {
        let last = (RESOLUTION - 1) as f64;
        let along = |x: R| {
            let free = x * RESOLUTION as f32 - 0.5;
            let is_free = free.value() > 0.0 && free.value() < last;
            let limited = if is_free { free } else { R::of(free.value().clamp(0.0, last)) };
            let cell = limited.value().floor().min(last - 1.0);
            (cell, limited - R::of(cell), is_free)
        };
        let ((column, right, is_free_x), (row, lower, is_free_y)) = (along(n_dot_v), along(roughness));
        let entry = |dx: f64, dy: f64| {
            let centre = |cell: f64| (cell + 0.5) / RESOLUTION as f64;
            let [scale, bias] = integrate(centre(column + dx), centre(row + dy), SAMPLES).map(R::of);
            vec3(scale, bias, R::of(0.0))
        };
        let entries = [entry(0.0, 0.0), entry(1.0, 0.0), entry(0.0, 1.0), entry(1.0, 1.0)];
        Self { entries, right, lower, is_free: [is_free_x, is_free_y] }
    }
}

/// (F_x, F_y) at n·v and roughness.
pub(crate) fn split_sum<R: Number>(n_dot_v: R, roughness: R) -> [R; 2] {
    let cell = Cell::new(n_dot_v, roughness);
    let sums = bilinear(cell.entries, cell.right, cell.lower);
    [sums.x, sums.y]
}

/// Gradient of [`split_sum`] with respect to n·v and roughness.
pub(crate) fn split_sum_vjp<R: Number>(n_dot_v: R, roughness: R, [scale, bias]: [R; 2]) -> [R; 2] {
    let cell = Cell::new(n_dot_v, roughness);
    let (right, lower) = bilinear_vjp(cell.entries, cell.right, cell.lower, vec3(scale, bias, R::of(0.0)));
    let within = |slope: R, is_free: bool| if is_free { slope * RESOLUTION as f32 } else { R::of(0.0) };
    [within(right, cell.is_free[0]), within(lower, cell.is_free[1])]
}
