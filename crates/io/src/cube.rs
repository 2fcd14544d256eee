//! Cube-map lookup, continuous across edges and corners.

use specula_core::cubemap::{FACE_COUNT, apron_sources, face_of, padded_index, padded_len, texel_index};

/// A cube map whose faces are padded with texels of their neighbours.
pub(crate) struct Cube {
    resolution: usize,
    padded: Vec<[f32; 3]>,
}

impl Cube {
    /// Pads six faces of resolution² RGB texels.
    pub(crate) fn new(values: &[f32], resolution: usize) -> Self {
        assert_eq!(values.len(), 18 * resolution * resolution, "six faces of resolution² texels");
        let mut padded = vec![[0.0; 3]; padded_len(resolution)];
        let texel = |index: usize| [values[3 * index], values[3 * index + 1], values[3 * index + 2]];
        let inside = 0..resolution as isize;
        for (face, row, column) in padded_texels(resolution) {
            padded[padded_index(face, column, row, resolution)] = if inside.contains(&row) && inside.contains(&column) {
                texel(texel_index(face, column as usize, row as usize, resolution))
            } else {
                let apron = apron_sources(face, column, row, resolution);
                mean(apron.texels.iter().take(apron.count).map(|index| texel(*index)))
            };
        }
        Self { resolution, padded }
    }

    /// Bilinear lookup along a direction of any length.
    pub(crate) fn sample(&self, direction: [f64; 3]) -> [f32; 3] {
        let (face, x, y) = face_of(direction);
        let (column, across) = floor_and_rest((0.5 * x + 0.5) * self.resolution as f64 - 0.5);
        let (row, down) = floor_and_rest((0.5 * y + 0.5) * self.resolution as f64 - 0.5);
        let last = self.resolution as isize - 1;
        let texel = |column: isize, row: isize| self.padded[padded_index(face, column, row, self.resolution)];
        let (column, row) = (column.clamp(-1, last), row.clamp(-1, last));
        let upper = mix(texel(column, row), texel(column + 1, row), across);
        let lower = mix(texel(column, row + 1), texel(column + 1, row + 1), across);
        mix(upper, lower, down)
    }
}

/// Face, row and column of every texel, including the padding.
fn padded_texels(resolution: usize) -> impl Iterator<Item = (usize, isize, isize)> {
    let line = -1..=resolution as isize;
    let rows = (0..FACE_COUNT).flat_map(move |face| (-1..=resolution as isize).map(move |row| (face, row)));
    rows.flat_map(move |(face, row)| line.clone().map(move |column| (face, row, column)))
}

/// Integer and fractional part of a texel coordinate.
pub(crate) fn floor_and_rest(x: f64) -> (isize, f32) {
    (x.floor() as isize, (x - x.floor()) as f32)
}

/// Linear interpolation from `a` to `b`.
pub(crate) fn mix(a: [f32; 3], b: [f32; 3], share_of_b: f32) -> [f32; 3] {
    core::array::from_fn(|k| a[k] * (1.0 - share_of_b) + b[k] * share_of_b)
}

fn mean(colors: impl ExactSizeIterator<Item = [f32; 3]>) -> [f32; 3] {
    let share = 1.0 / colors.len() as f32;
    colors.fold([0.0; 3], |sum, color| core::array::from_fn(|k| sum[k] + share * color[k]))
}
