//! A mesh of a scene: depths and colours are rendered and fused on a grid ([`specula_core::tsdf`]).

use crate::{failure::Failure, progress, scene::Renderer};
use glam::Vec3;
use rayon::prelude::*;
use specula_core::{
    activation::sigmoid,
    camera::Camera,
    cutoffs::ALPHA_MIN,
    rules::{Channels, channel},
    scene::{Gaussians, Image, MEAN, OPACITY},
    tsdf::{CORNERS, Voxel, vertex},
};
use specula_io::mesh::Mesh;
use specula_scene::layer::alpha;

/// Voxels before and behind a surface in which distances are kept.
const TRUNCATION: f32 = 4.0;
/// The share of Gaussians beyond each face of the volume: what floats far away would make voxels large.
const OUTLIERS: f32 = 0.005;
/// How far the volume goes beyond them, as a share of its size.
const MARGIN: f32 = 0.05;
/// Coverage above which a pixel shows a surface, and below which it shows none.
const COVERED: f32 = 0.5;
const EMPTY: f32 = 0.05;
/// Triangles that hang together but are fewer than this share of all are dust.
const DUST: f32 = 0.002;

/// Fuses what cameras see of a scene; the volume is that of its Gaussians, so many voxels along its longest edge.
pub(crate) fn mesh(
    renderer: &mut Renderer,
    gaussians: &Gaussians<Vec<f32>>,
    cameras: &[Camera],
    voxels: u16,
) -> Result<Mesh, Failure> {
    let mut volume = Volume::around(gaussians, voxels);
    let work = progress::work("fusing", cameras.len() as u64);
    for (done, camera) in cameras.iter().enumerate() {
        volume.see(&View::of(camera, &renderer.view(camera)?));
        work.done(done as u64 + 1, String::new);
    }
    work.finish();
    Ok(without_dust(volume.surface()))
}

/// What a camera sees: of each pixel the depth, the colour and the coverage.
struct View<'a> {
    camera: &'a Camera,
    depths: Vec<f32>,
    colors: Vec<[f32; 3]>,
    coverage: Vec<f32>,
}

impl<'a> View<'a> {
    fn of(camera: &'a Camera, image: &Image<Vec<f32>>) -> Self {
        let coverage = alpha(image);
        let depth = Channels::of_count(image.channels - 1).index_of(channel::DEPTH).expect("depth was asked for");
        let by_coverage = |sum: f32, pixel: usize| sum / coverage[pixel].max(ALPHA_MIN);
        let pixels = || 0..image.pixel_count();
        Self {
            camera,
            depths: pixels().map(|pixel| by_coverage(image.plane(depth)[pixel], pixel)).collect(),
            colors: pixels().map(|pixel| image.rgb(pixel).map(|sum| by_coverage(sum, pixel).clamp(0.0, 1.0))).collect(),
            coverage,
        }
    }

    /// The depth of a point, and the pixel that shows it, if one does.
    fn pixel(&self, point: Vec3) -> Option<(f32, usize)> {
        let Camera { camera_from_world, position, focal_px, principal_px, near, width, height } = *self.camera;
        let seen = camera_from_world * (point - position);
        if !(seen.z > near) {
            return None;
        }
        let place = |axis: usize| (focal_px[axis] * seen[axis] / seen.z + principal_px[axis]).floor();
        let (x, y) = (place(0), place(1));
        let is_inside = x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32;
        is_inside.then(|| (seen.z, y as usize * width as usize + x as usize))
    }
}

/// A grid of voxels, x fastest.
struct Volume {
    least: Vec3,
    /// Edge of a voxel.
    step: f32,
    size: [usize; 3],
    voxels: Vec<Voxel>,
}

impl Volume {
    /// Around the Gaussians that are more opaque than not, outliers left out.
    fn around(gaussians: &Gaussians<Vec<f32>>, voxels: u16) -> Self {
        let is_solid: Vec<bool> = gaussians.plane(OPACITY).map(|logit| sigmoid(logit) >= COVERED).collect();
        let all_are_thin = !is_solid.contains(&true);
        let bounds = |axis: usize| {
            let of_solid = gaussians.plane(MEAN + axis).zip(&is_solid).filter(|(_, solid)| **solid || all_are_thin);
            let mut places: Vec<f32> = of_solid.map(|(x, _)| x).collect();
            places.sort_unstable_by(f32::total_cmp);
            let outside = (OUTLIERS * places.len() as f32) as usize;
            [places[outside], places[places.len() - 1 - outside]]
        };
        let bounds = [bounds(0), bounds(1), bounds(2)];
        let least = Vec3::from(bounds.map(|[least, _]| least));
        let extent = Vec3::from(bounds.map(|[_, most]| most)) - least;
        let margin = (MARGIN * extent.max_element()).max(f32::MIN_POSITIVE);
        let (least, extent) = (least - margin, extent + 2.0 * margin);
        let step = extent.max_element() / f32::from(voxels);
        let size = extent.to_array().map(|edge| (edge / step).ceil() as usize + 1);
        Self { least, step, size, voxels: vec![Voxel::default(); size.iter().product()] }
    }

    fn point(&self, [x, y, z]: [usize; 3]) -> Vec3 {
        self.least + self.step * Vec3::new(x as f32, y as f32, z as f32)
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size[1] + y) * self.size[0] + x
    }

    /// Every voxel learns what a picture says of it.
    fn see(&mut self, view: &View<'_>) {
        let [width, height, _] = self.size;
        let mut voxels = core::mem::take(&mut self.voxels);
        voxels.par_chunks_mut(width).enumerate().for_each(|(row, voxels)| {
            for (x, voxel) in voxels.iter_mut().enumerate() {
                if let Some((depth, pixel)) = view.pixel(self.point([x, row % height, row / height])) {
                    *voxel = match view.coverage[pixel] {
                        coverage if coverage >= COVERED => {
                            let distance = (view.depths[pixel] - depth) / (TRUNCATION * self.step);
                            voxel.seen(distance, view.colors[pixel], coverage)
                        }
                        coverage if coverage < EMPTY => voxel.seen(f32::INFINITY, [0.0; 3], 1.0),
                        _ => *voxel,
                    };
                }
            }
        });
        self.voxels = voxels;
    }

    /// Where distances change their sign: a vertex in each cell that is wholly known, and two triangles across each edge
    /// of the grid between four such cells.
    fn surface(&self) -> Mesh {
        let mut mesh = Mesh::default();
        let mut vertex_of = vec![u32::MAX; self.voxels.len()];
        for cell in cells(self.size.map(|size| size - 1)) {
            if let Some((position, normal, color)) = self.vertex(cell) {
                vertex_of[self.index(cell)] = mesh.positions.len() as u32;
                mesh.positions.push(position.to_array());
                mesh.normals.push(normal);
                mesh.colors.push(color);
            }
        }
        for (cell, axis) in cells(self.size.map(|size| size - 1)).flat_map(|cell| (0..3).map(move |axis| (cell, axis)))
        {
            if let Some(quad) = self.quad(cell, axis).and_then(|cells| known(cells.map(|cell| vertex_of[cell]))) {
                let [a, b, c, d] = quad;
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        mesh
    }

    fn vertex(&self, cell: [usize; 3]) -> Option<(Vec3, [f32; 3], [f32; 3])> {
        let corners: [Voxel; CORNERS] = core::array::from_fn(|corner| {
            self.voxels[self.index(core::array::from_fn(|k| cell[k] + (corner >> k & 1)))]
        });
        if corners.iter().any(|voxel| voxel.weight == 0.0) {
            return None;
        }
        let (place, normal) = vertex(&corners.map(|voxel| voxel.distance))?;
        let weight: f32 = corners.iter().map(|voxel| voxel.color_weight).sum();
        let color = |c: usize| corners.iter().map(|voxel| voxel.color_weight * voxel.color[c]).sum::<f32>();
        let color = core::array::from_fn(|c| if weight > 0.0 { color(c) / weight } else { 0.0 });
        Some((self.point(cell) + self.step * Vec3::from(place), normal, color))
    }

    /// The four cells around the edge of the grid that leaves a corner along an axis, counterclockwise to who looks from
    /// outside, if the surface crosses it.
    fn quad(&self, corner: [usize; 3], axis: usize) -> Option<[usize; 4]> {
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        if corner[b] == 0 || corner[c] == 0 {
            return None;
        }
        let stepped = |by: [usize; 2]| {
            let mut cell = corner;
            cell[b] -= by[0];
            cell[c] -= by[1];
            self.index(cell)
        };
        let mut end = corner;
        end[axis] += 1;
        let is_behind = [corner, end].map(|place| self.voxels[self.index(place)].distance < 0.0);
        let around = [[0, 0], [1, 0], [1, 1], [0, 1]].map(stepped);
        match is_behind {
            [true, false] => Some(around),
            [false, true] => Some([around[3], around[2], around[1], around[0]]),
            _ => None,
        }
    }
}

/// All cells of a grid, x fastest.
fn cells([width, height, depth]: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..depth).flat_map(move |z| (0..height).flat_map(move |y| (0..width).map(move |x| [x, y, z])))
}

fn known(vertices: [u32; 4]) -> Option<[u32; 4]> {
    (!vertices.contains(&u32::MAX)).then_some(vertices)
}

/// The mesh without pieces of few triangles, and without vertices that no triangle has.
fn without_dust(mesh: Mesh) -> Mesh {
    let mut piece: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    for [a, b, c] in &mesh.triangles {
        for (one, other) in [(a, b), (b, c)] {
            let (one, other) = (root(&mut piece, *one), root(&mut piece, *other));
            piece[one.max(other) as usize] = one.min(other);
        }
    }
    let mut sizes = vec![0_usize; piece.len()];
    mesh.triangles.iter().for_each(|[a, ..]| sizes[root(&mut piece, *a) as usize] += 1);
    let least = (DUST * mesh.triangles.len() as f32) as usize;
    let is_kept = |piece: &mut [u32], vertex: u32| sizes[root(piece, vertex) as usize] > least;

    let mut kept = Mesh::default();
    let mut place = vec![u32::MAX; piece.len()];
    for vertex in 0..piece.len() {
        if is_kept(&mut piece, vertex as u32) {
            place[vertex] = kept.positions.len() as u32;
            kept.positions.push(mesh.positions[vertex]);
            kept.normals.push(mesh.normals[vertex]);
            kept.colors.push(mesh.colors[vertex]);
        }
    }
    let triangles = mesh.triangles.iter().map(|triangle| triangle.map(|vertex| place[vertex as usize]));
    kept.triangles = triangles.filter(|triangle| triangle[0] != u32::MAX).collect();
    kept
}

/// The first vertex of the piece that a vertex belongs to; ways there become shorter.
fn root(piece: &mut [u32], mut vertex: u32) -> u32 {
    while piece[vertex as usize] != vertex {
        piece[vertex as usize] = piece[piece[vertex as usize] as usize];
        vertex = piece[vertex as usize];
    }
    vertex
}
