//! The split-sum table, interpolated.

use crate::number::Number;
use specula_core::{
    cubemap::{bilinear, bilinear_vjp},
    split_sum::{RESOLUTION, TablePosition, integrate, table_position},
    vector::{Vec3, vec3},
};

/// Points of each entry: as many as the executors' table has.
const SAMPLES: u32 = 1024;

/// Entries around a point of the table.
struct Cell<R> {
    entries: [Vec3<R>; 4],
    across: TablePosition<R>,
    down: TablePosition<R>,
}

impl<R: Number> Cell<R> {
    fn new(n_dot_v: R, roughness: R) -> Self {
        let (across, down) = (table_position(n_dot_v), table_position(roughness));
        let entry = |dx: f64, dy: f64| {
            let centre = |texel: f64| (texel + 0.5) / RESOLUTION as f64;
            let (n_dot_v, roughness) = (centre(across.texel.value() + dx), centre(down.texel.value() + dy));
            let [scale, bias] = integrate(n_dot_v, roughness, SAMPLES).map(R::of);
            vec3(scale, bias, R::of(0.0))
        };
        Self { entries: [entry(0.0, 0.0), entry(1.0, 0.0), entry(0.0, 1.0), entry(1.0, 1.0)], across, down }
    }
}

/// (F_x, F_y) at n·v and roughness.
pub(crate) fn split_sum<R: Number>(n_dot_v: R, roughness: R) -> [R; 2] {
    let cell = Cell::new(n_dot_v, roughness);
    let sums = bilinear(cell.entries, cell.across.share, cell.down.share);
    [sums.x, sums.y]
}

/// Gradient of [`split_sum`] with respect to n·v and roughness.
pub(crate) fn split_sum_vjp<R: Number>(n_dot_v: R, roughness: R, [scale, bias]: [R; 2]) -> [R; 2] {
    let Cell { entries, across, down } = Cell::new(n_dot_v, roughness);
    let (right, lower) = bilinear_vjp(entries, across.share, down.share, vec3(scale, bias, R::of(0.0)));
    [right * RESOLUTION as f32 * across.is_free, lower * RESOLUTION as f32 * down.is_free]
}
