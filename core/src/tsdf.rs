//! Surface from depth maps: truncated signed distances on a grid, as running means.
//!
//! Curless and Levoy 1996, "A Volumetric Method for Building Complex Models from Range Images":
//! every picture measures the distance of a voxel from the surface along the view; the mean over
//! all pictures changes its sign at the surface.

use crate::math;

/// State of a voxel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Voxel {
    /// Distance to the surface in truncation lengths, in \[−1, 1\]: positive in front of it,
    /// negative behind.
    pub distance: f32,
    /// Sum of the weights of all pictures that saw it; zero if none did.
    pub weight: f32,
    /// Mean colour of surfaces seen near it, sRGB-encoded.
    pub color: [f32; 3],
    /// Sum of the weights of those colours.
    pub color_weight: f32,
}

impl Voxel {
    /// Voxel after one more picture with the surface `distance` truncation lengths behind it in
    /// this colour. A voxel more than one such length behind a surface is hidden and unchanged.
    /// Colours count within one length of the surface.
    #[must_use]
    pub fn seen(self, distance: f32, color: [f32; 3], weight: f32) -> Self {
        if !(distance >= -1.0 && weight > 0.0) {
            return self;
        }
        let total = self.weight + weight;
        let mean = |before: f32, now: f32, share: f32| before + (now - before) * share;
        let seen = Self { distance: mean(self.distance, distance.min(1.0), weight / total), weight: total, ..self };
        if distance > 1.0 {
            return seen;
        }
        let color_weight = self.color_weight + weight;
        let share = weight / color_weight;
        Self { color: core::array::from_fn(|c| mean(self.color[c], color[c], share)), color_weight, ..seen }
    }
}

/// Corners of a cell, x fastest: bit k of the number is the step along axis k.
pub const CORNERS: usize = 8;

/// Surface vertex of a cell, from the distances at its corners: the mean of the points at which the
/// surface crosses the edges, in cells from the corner 0, and the unit normal towards growing
/// distances. `None` if all corners lie on one side.
///
/// Gibson 1998, "Constrained Elastic Surface Nets", without the elastic part ("naive surface
/// nets").
pub fn vertex(distances: &[f32; CORNERS]) -> Option<([f32; 3], [f32; 3])> {
    let (mut sum, mut crossings) = ([0.0; 3], 0.0);
    for (from, axis) in (0..CORNERS).flat_map(|from| (0..3).map(move |axis| (from, axis))) {
        let to = from | 1 << axis;
        if to != from && (distances[from] < 0.0) != (distances[to] < 0.0) {
            let share = distances[from] / (distances[from] - distances[to]);
            for (k, sum) in sum.iter_mut().enumerate() {
                *sum += if k == axis { share } else { (from >> k & 1) as f32 };
            }
            crossings += 1.0;
        }
    }
    (crossings > 0.0).then(|| {
        let vertex = sum.map(|sum: f32| sum / crossings);
        (vertex, normal(distances, vertex))
    })
}

/// Normalised gradient of the trilinear distance at a point of a cell; zero if it vanishes.
fn normal(distances: &[f32; CORNERS], vertex: [f32; 3]) -> [f32; 3] {
    let share = |corner: usize, axis: usize| match corner >> axis & 1 {
        0 => 1.0 - vertex[axis],
        _ => vertex[axis],
    };
    let slope = |axis: usize| {
        let others = [(axis + 1) % 3, (axis + 2) % 3];
        let term = |corner: usize| {
            let sign = if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
            sign * distances[corner] * share(corner, others[0]) * share(corner, others[1])
        };
        (0..CORNERS).map(term).sum::<f32>()
    };
    let gradient = [slope(0), slope(1), slope(2)];
    let length = math::sqrt(gradient.iter().map(|x| x * x).sum());
    if length > 0.0 { gradient.map(|x| x / length) } else { [0.0; 3] }
}
