//! Cube-map lookup, continuous across edges and corners.

use specula_core::{
    cubemap::{face_of, pad, padded_index, padded_len},
    vector::{Vec3, vec3},
};

/// A cube map whose faces are padded with texels of their neighbours.
pub(crate) struct Cube {
    resolution: usize,
    padded: Vec<Vec3<f32>>,
}

impl Cube {
    /// Pads six faces of resolution² RGB texels.
    pub(crate) fn new(values: &[f32], resolution: usize) -> Self {
        assert_eq!(values.len(), 18 * resolution * resolution, "six faces of resolution² texels");
        let mut padded = vec![Vec3::zero(0.0); padded_len(resolution)];
        let texel = |index: usize| vec3(values[3 * index], values[3 * index + 1], values[3 * index + 2]);
        pad(resolution, texel, &mut padded);
        Self { resolution, padded }
    }

    /// Bilinear lookup along a direction of any length.
    pub(crate) fn sample(&self, direction: [f64; 3]) -> [f32; 3] {
        let (face, x, y) = face_of(direction);
        let (column, across) = floor_and_rest((0.5 * x + 0.5) * self.resolution as f64 - 0.5);
        let (row, down) = floor_and_rest((0.5 * y + 0.5) * self.resolution as f64 - 0.5);
        let last = self.resolution as isize - 1;
        let texel =
            |column: isize, row: isize| self.padded[padded_index(face, column, row, self.resolution)].to_array();
        let (column, row) = (column.clamp(-1, last), row.clamp(-1, last));
        let upper = mix(texel(column, row), texel(column + 1, row), across);
        let lower = mix(texel(column, row + 1), texel(column + 1, row + 1), across);
        mix(upper, lower, down)
    }
}

/// Integer and fractional part of a texel coordinate.
pub(crate) fn floor_and_rest(x: f64) -> (isize, f32) {
    (x.floor() as isize, (x - x.floor()) as f32)
}

/// Linear interpolation from `a` to `b`.
pub(crate) fn mix(a: [f32; 3], b: [f32; 3], share_of_b: f32) -> [f32; 3] {
    core::array::from_fn(|k| a[k] * (1.0 - share_of_b) + b[k] * share_of_b)
}
