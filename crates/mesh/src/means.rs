//! Means over views of numbers of the pixels that show the points of a surface.

use crate::view::View;
use glam::Vec3;
use rayon::prelude::*;
use specula_core::{camera::Camera, scene::Image};

/// Distance behind the depth of a view up to which it sees a point, in voxels.
const VISIBLE_BEHIND: f32 = 2.0;
/// Distance before that depth, in voxels: depths are means over what shines through a surface.
const VISIBLE_BEFORE: f32 = 8.0;

/// Points of a surface, and sums of the numbers of pixels.
#[derive(Clone, Debug)]
pub struct PointMeans<'a, const N: usize> {
    positions: &'a [[f32; 3]],
    normals: &'a [[f32; 3]],
    voxel_size: f32,
    sums: Vec<WeightedSum<N>>,
}

impl<'a, const N: usize> PointMeans<'a, N> {
    /// Points with unit normals, without views. Views see a point that lies up to eight voxels
    /// before their depths, or two behind.
    pub fn new(positions: &'a [[f32; 3]], normals: &'a [[f32; 3]], voxel_size: f32) -> Self {
        Self { positions, normals, voxel_size, sums: vec![WeightedSum::NONE; positions.len()] }
    }

    /// Adds a view, its channels premultiplied; `numbers` returns those of a pixel with its
    /// coverage. Views are weighted by the cosine between a point's normal and the camera.
    ///
    /// # Panics
    ///
    /// For images without a channel of depths.
    pub fn add(
        &mut self,
        camera: &Camera,
        image: &Image<Vec<f32>>,
        numbers: impl Fn(&Image<Vec<f32>>, usize, f32) -> [f32; N] + Sync,
    ) {
        let Self { positions, normals, voxel_size, sums } = self;
        let visible = [-VISIBLE_BEFORE, VISIBLE_BEHIND].map(|voxels| voxels * *voxel_size);
        gather([positions, normals], visible, sums, camera, image, numbers);
    }

    /// Means of each point; `None` for a point that no view shows.
    pub fn means(&self) -> Vec<Option<[f32; N]>> {
        self.sums.iter().map(WeightedSum::mean).collect()
    }
}

/// Sum of weighted numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WeightedSum<const N: usize> {
    sums: [f32; N],
    weight: f32,
}

impl<const N: usize> WeightedSum<N> {
    pub(crate) const NONE: Self = Self { sums: [0.0; N], weight: 0.0 };

    fn add(&mut self, numbers: [f32; N], weight: f32) {
        self.sums.iter_mut().zip(numbers).for_each(|(sum, x)| *sum += weight * x);
        self.weight += weight;
    }

    /// Mean; `None` if nothing was added.
    pub(crate) fn mean(&self) -> Option<[f32; N]> {
        (self.weight > 0.0).then(|| self.sums.map(|sum| sum / self.weight))
    }
}

/// Adds numbers of a view's pixels to the visible points, given by positions and normals, whose
/// distances behind the view's depths are between two; `numbers` returns those of a pixel with its
/// coverage.
pub(crate) fn gather<const N: usize>(
    [positions, normals]: [&[[f32; 3]]; 2],
    [nearest, farthest]: [f32; 2],
    sums: &mut [WeightedSum<N>],
    camera: &Camera,
    image: &Image<Vec<f32>>,
    numbers: impl Fn(&Image<Vec<f32>>, usize, f32) -> [f32; N] + Sync,
) {
    let view = View::new(camera, image);
    let points = positions.par_iter().zip(normals);
    sums.par_iter_mut().zip(points).for_each(|(sum, (position, normal))| {
        let position = Vec3::from(*position);
        let Some((depth, pixel)) = view.pixel(position) else { return };
        let behind = depth - view.depths[pixel];
        let is_visible = nearest < behind && behind < farthest;
        let cosine = Vec3::from(*normal).dot((camera.position - position).normalize_or_zero());
        let weight = cosine.max(0.0) * view.coverage[pixel];
        if is_visible && weight > 0.0 {
            sum.add(numbers(image, pixel, view.coverage[pixel]), weight);
        }
    });
}
