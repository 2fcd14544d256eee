//! Volumetric fusion: depths and colours of views are integrated into a truncated signed distance
//! field ([`specula_core::tsdf`]), whose zero level set becomes triangles.

use crate::{
    Mesh,
    view::{COVERAGE_FREE, COVERAGE_SURFACE, Shown, View},
};
use glam::Vec3;
use rayon::prelude::*;
use specula_core::{
    activation::sigmoid,
    camera::Camera,
    scene::{Gaussians, Image, MEAN, OPACITY},
    tsdf::{CORNERS, Voxel, vertex},
};

/// Truncation distance of the field, in voxels.
const TRUNCATION_VOXELS: f32 = 4.0;
/// Share of Gaussians outside of each face of the volume, because distant outliers would enlarge
/// voxels.
const OUTLIER_SHARE: f32 = 0.005;
/// Margin of the volume around the other Gaussians, relative to its longest edge.
const MARGIN: f32 = 0.05;
/// Views that are integrated at once: a volume exceeds the caches, and passes through memory once
/// for all of them.
const VIEWS_AT_ONCE: usize = 8;
/// Voxels along an edge of a brick, and in it.
const BRICK: usize = 8;
const BRICK_LEN: usize = BRICK * BRICK * BRICK;
/// Share of all triangles up to which a connected component is removed.
const COMPONENT_SHARE_MIN: f32 = 0.002;

/// Surface that grows view by view.
#[derive(Clone, Debug)]
pub struct Fusion {
    volume: Volume,
    /// Views that are not yet integrated.
    waiting: Vec<View>,
}

impl Fusion {
    /// Volume around Gaussians, with `voxels` voxels along its longest edge.
    ///
    /// # Panics
    ///
    /// Without Gaussians.
    pub fn around(gaussians: &Gaussians<Vec<f32>>, voxels: u16) -> Self {
        Self { volume: Volume::around(gaussians, voxels), waiting: Vec::with_capacity(VIEWS_AT_ONCE) }
    }

    /// Adds a view: its channels, those of training or more, premultiplied, then transmittance.
    ///
    /// # Panics
    ///
    /// Without a channel of depths.
    pub fn add(&mut self, camera: &Camera, image: &Image<Vec<f32>>) {
        self.waiting.push(View::new(camera, image));
        if self.waiting.len() == VIEWS_AT_ONCE {
            self.integrate();
        }
    }

    fn integrate(&mut self) {
        self.volume.integrate(&self.waiting);
        self.waiting.clear();
    }

    /// Edge length of a voxel.
    pub fn voxel_size(&self) -> f32 {
        self.volume.step
    }

    /// Surface of all views, without small components.
    pub fn mesh(&mut self) -> Mesh {
        self.mesh_and_omitted().0
    }

    /// Surface of all views, without small components, and the number of these.
    pub fn mesh_and_omitted(&mut self) -> (Mesh, usize) {
        self.integrate();
        without_small_components(&self.volume.surface())
    }
}

/// `voxels` along the longest edge of a scene, at most the number of pixels along the longest edge
/// of these cameras' pictures: if pictures show the whole scene, finer voxels do not resolve more.
pub fn voxels_resolved(voxels: u16, cameras: &[Camera]) -> u16 {
    let pixels = cameras.iter().map(|camera| camera.width.max(camera.height)).max();
    pixels.and_then(|pixels| u16::try_from(pixels).ok()).map_or(voxels, |pixels| voxels.min(pixels.max(1)))
}

/// At most `count_max` items in their order, evenly spaced.
pub fn evenly_spaced<T: Copy>(items: &[T], count_max: usize) -> Vec<T> {
    let count = items.len().min(count_max);
    (0..count).map(|k| items[(2 * k + 1) * items.len() / (2 * count)]).collect()
}

/// Cube of voxels.
#[derive(Clone, Debug)]
enum Brick {
    /// All voxels are the same: no view showed a surface, or all of them are hidden.
    Same(Voxel),
    /// Each voxel, x fastest.
    Each(Box<[Voxel; BRICK_LEN]>),
}

impl Brick {
    /// Adds free space to all voxels.
    fn clear(&mut self) {
        let free = |voxel: &mut Voxel| *voxel = voxel.seen(f32::INFINITY, [0.0; 3], 1.0);
        match self {
            Self::Same(voxel) => free(voxel),
            Self::Each(voxels) => voxels.iter_mut().for_each(free),
        }
    }

    /// Each voxel, in memory of its own from now on.
    fn each(&mut self) -> &mut [Voxel; BRICK_LEN] {
        if let Self::Same(voxel) = *self {
            *self = Self::Each(Box::new([voxel; BRICK_LEN]));
        }
        match self {
            Self::Each(voxels) => voxels,
            Self::Same(_) => unreachable!("it was replaced"),
        }
    }
}

/// Grid of voxels in bricks, x fastest.
#[derive(Clone, Debug)]
struct Volume {
    min: Vec3,
    /// Edge length of a voxel.
    step: f32,
    size: [usize; 3],
    bricks: Vec<Brick>,
}

impl Volume {
    /// Volume of the Gaussians with an opacity of one half or more, without outliers and means that
    /// are not finite.
    fn around(gaussians: &Gaussians<Vec<f32>>, voxels: u16) -> Self {
        let somewhere: Vec<[f32; 4]> = (0..gaussians.count)
            .map(|index| {
                let [x, y, z] = gaussians.get::<3>(index, MEAN);
                [x, y, z, gaussians.get::<1>(index, OPACITY)[0]]
            })
            .filter(|[x, y, z, _]| x.is_finite() && y.is_finite() && z.is_finite())
            .collect();
        let is_solid = |[.., logit]: &[f32; 4]| sigmoid(*logit) >= COVERAGE_SURFACE;
        let all_are_thin = !somewhere.iter().any(is_solid);
        let bounds = |axis: usize| {
            let solid_means = somewhere.iter().filter(|gaussian| all_are_thin || is_solid(gaussian));
            let mut coordinates: Vec<f32> = solid_means.map(|gaussian| gaussian[axis]).collect();
            coordinates.sort_unstable_by(f32::total_cmp);
            let outliers = (OUTLIER_SHARE * coordinates.len() as f32) as usize;
            let at = |index: usize| coordinates.get(index).copied().unwrap_or_default();
            [at(outliers), at(coordinates.len().saturating_sub(1 + outliers))]
        };
        let bounds = [bounds(0), bounds(1), bounds(2)];
        let min = Vec3::from(bounds.map(|[min, _]| min));
        let extent = Vec3::from(bounds.map(|[_, max]| max)) - min;
        let margin = (MARGIN * extent.max_element()).max(f32::MIN_POSITIVE);
        let (min, extent) = (min - margin, extent + 2.0 * margin);
        let step = extent.max_element() / f32::from(voxels);
        let size = extent.to_array().map(|edge| (edge / step).ceil() as usize + 1);
        let count = size.iter().map(|edge| edge.div_ceil(BRICK)).product();
        Self { min, step, size, bricks: vec![Brick::Same(Voxel::default()); count] }
    }

    fn point(&self, [x, y, z]: [usize; 3]) -> Vec3 {
        self.min + self.step * Vec3::new(x as f32, y as f32, z as f32)
    }

    /// Index of a vertex of the grid.
    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size[1] + y) * self.size[0] + x
    }

    /// Brick of a voxel.
    fn brick(&self, at: [usize; 3]) -> &Brick {
        let [columns, rows, _] = self.size.map(|edge| edge.div_ceil(BRICK));
        let [x, y, z] = at.map(|k| k / BRICK);
        &self.bricks[(z * rows + y) * columns + x]
    }

    /// Whether a cell lies in a brick of voxels that are the same.
    fn is_uniform(&self, cell: [usize; 3]) -> bool {
        cell.iter().all(|k| k % BRICK < BRICK - 1) && matches!(self.brick(cell), Brick::Same(_))
    }

    fn voxel(&self, at: [usize; 3]) -> &Voxel {
        match self.brick(at) {
            Brick::Same(voxel) => voxel,
            Brick::Each(voxels) => {
                let [x, y, z] = at.map(|k| k % BRICK);
                &voxels[(z * BRICK + y) * BRICK + x]
            }
        }
    }

    /// Adds the distances and colours of views, one after the other, to the visible voxels.
    fn integrate(&mut self, views: &[View]) {
        let [columns, rows, _] = self.size.map(|edge| edge.div_ceil(BRICK));
        let mut bricks = core::mem::take(&mut self.bricks);
        bricks.par_iter_mut().enumerate().for_each(|(index, brick)| {
            let first = [index % columns, index / columns % rows, index / columns / rows].map(|k| k * BRICK);
            let voxel = |index: usize| {
                let offset = [index % BRICK, index / BRICK % BRICK, index / (BRICK * BRICK)];
                self.point(core::array::from_fn(|k| first[k] + offset[k]))
            };
            let corners = core::array::from_fn(|corner| {
                self.point(core::array::from_fn(|k| first[k] + (corner >> k & 1) * (BRICK - 1)))
            });
            for view in views {
                match view.shown(corners, TRUNCATION_VOXELS * self.step) {
                    Shown::Nothing => {}
                    Shown::Free => brick.clear(),
                    Shown::Any => {
                        let voxels = brick.each().iter_mut().enumerate();
                        voxels.for_each(|(index, own)| *own = self.seen_in(view, voxel(index), *own));
                    }
                }
            }
        });
        self.bricks = bricks;
    }

    /// A voxel at a point after a view.
    fn seen_in(&self, view: &View, point: Vec3, voxel: Voxel) -> Voxel {
        let Some((depth, pixel)) = view.pixel(point) else { return voxel };
        match view.coverage[pixel] {
            coverage if coverage >= COVERAGE_SURFACE => {
                let distance = (view.depths[pixel] - depth) / (TRUNCATION_VOXELS * self.step);
                voxel.seen(distance, view.colors[pixel], coverage)
            }
            coverage if coverage < COVERAGE_FREE => voxel.seen(f32::INFINITY, [0.0; 3], 1.0),
            _ => voxel,
        }
    }

    /// Zero level set by surface nets: a vertex in each cell with all corners seen, and two
    /// triangles across each edge of the grid between four such cells.
    fn surface(&self) -> Mesh {
        let mut mesh = Mesh::default();
        let mut vertex_of = vec![u32::MAX; self.size.iter().product()];
        for cell in cells(self.size.map(|size| size - 1)).filter(|cell| !self.is_uniform(*cell)) {
            if let Some((position, normal, color)) = self.vertex(cell) {
                vertex_of[self.index(cell)] = mesh.positions.len() as u32;
                mesh.positions.push(position.to_array());
                mesh.normals.push(normal);
                mesh.colors.push(color);
            }
        }
        // Of the four cells of a quad, the one at its corner is the last.
        let with_vertex = cells(self.size.map(|size| size - 1)).filter(|cell| vertex_of[self.index(*cell)] != u32::MAX);
        for (cell, axis) in with_vertex.flat_map(|cell| (0..3).map(move |axis| (cell, axis))) {
            if let Some(quad) = self.quad(cell, axis).and_then(|cells| complete(cells.map(|cell| vertex_of[cell]))) {
                let [a, b, c, d] = quad;
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        mesh
    }

    /// Position, normal and colour of a cell's vertex.
    fn vertex(&self, cell: [usize; 3]) -> Option<(Vec3, [f32; 3], [f32; 3])> {
        let corners: [Voxel; CORNERS] =
            core::array::from_fn(|corner| *self.voxel(core::array::from_fn(|k| cell[k] + (corner >> k & 1))));
        if corners.iter().any(|voxel| voxel.weight == 0.0) {
            return None;
        }
        let (offset, normal) = vertex(&corners.map(|voxel| voxel.distance))?;
        let weight: f32 = corners.iter().map(|voxel| voxel.color_weight).sum();
        let color = |c: usize| corners.iter().map(|voxel| voxel.color_weight * voxel.color[c]).sum::<f32>();
        let color = core::array::from_fn(|c| if weight > 0.0 { color(c) / weight } else { 0.0 });
        Some((self.point(cell) + self.step * Vec3::from(offset), normal, color))
    }

    /// Four cells around the edge of the grid from a corner along an axis, counterclockwise as seen
    /// from outside of the surface; `None` for an edge that the surface does not cross.
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
        let is_behind = [corner, end].map(|corner| self.voxel(corner).distance < 0.0);
        let around = [[0, 0], [1, 0], [1, 1], [0, 1]].map(stepped);
        match is_behind {
            [true, false] => Some(around),
            [false, true] => Some([around[3], around[2], around[1], around[0]]),
            _ => None,
        }
    }
}

/// Cells of a grid, x fastest.
fn cells([width, height, depth]: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..depth).flat_map(move |z| (0..height).flat_map(move |y| (0..width).map(move |x| [x, y, z])))
}

fn complete(vertices: [u32; 4]) -> Option<[u32; 4]> {
    (!vertices.contains(&u32::MAX)).then_some(vertices)
}

/// Mesh without connected components of few triangles and without unused vertices, and the number
/// of these components.
fn without_small_components(mesh: &Mesh) -> (Mesh, usize) {
    let mut parents: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    for [a, b, c] in &mesh.triangles {
        for (one, other) in [(a, b), (b, c)] {
            let (one, other) = (root(&mut parents, *one), root(&mut parents, *other));
            parents[one.max(other) as usize] = one.min(other);
        }
    }
    let roots: Vec<usize> = (0..parents.len()).map(|vertex| root(&mut parents, vertex as u32) as usize).collect();
    let mut sizes = vec![0_usize; parents.len()];
    mesh.triangles.iter().for_each(|[a, ..]| sizes[roots[*a as usize]] += 1);
    let count_min = (COMPONENT_SHARE_MIN * mesh.triangles.len() as f32) as usize;
    let omitted = sizes.iter().filter(|size| (1..=count_min).contains(*size)).count();
    (mesh.with_vertices(|vertex| sizes[roots[vertex]] > count_min), omitted)
}

/// First vertex of the component of a vertex, by union-find with path halving.
fn root(parents: &mut [u32], mut vertex: u32) -> u32 {
    while parents[vertex as usize] != vertex {
        parents[vertex as usize] = parents[parents[vertex as usize] as usize];
        vertex = parents[vertex as usize];
    }
    vertex
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::{
        rules::{Channels, channel},
        scene::{Layout, len_of_values},
    };

    #[test]
    fn a_mean_that_is_not_finite_does_not_widen_the_volume() {
        const COUNT: usize = 50;
        let layout = Layout::radiance(0);
        let mut gaussians = Gaussians { count: COUNT, layout, values: vec![0.0; len_of_values(COUNT, layout)] };
        for index in 0..COUNT {
            let x = index as f32 / COUNT as f32;
            gaussians.set(index, MEAN, [x, 2.0 * x, 0.5 - x]);
            gaussians.set(index, OPACITY, [4.0]);
        }
        let size = |gaussians: &Gaussians<Vec<f32>>| Volume::around(gaussians, 40).size;
        let whole = size(&gaussians);
        assert!(whole.iter().all(|edge| *edge > 10), "{whole:?}");
        for broken in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            gaussians.set(7, MEAN, [broken, 0.0, 0.0]);
            assert_eq!(size(&gaussians), whole, "a mean at {broken}");
        }
        for index in 0..COUNT {
            gaussians.set(index, MEAN, [f32::NAN; 3]);
        }
        assert_eq!(size(&gaussians).len(), 3, "no mean is finite");
    }

    /// Channels of a picture of a ball of radius one half around the origin: its depths, full and
    /// half covered, before nothing.
    fn ball(camera: &Camera) -> Image<Vec<f32>> {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let (channels, size) = (Channels::Training.count() + 1, width * height);
        let depth = Channels::Training.index_of(channel::DEPTH).expect("depths are trained");
        let mut values = vec![0.0; channels * size];
        for pixel in 0..size {
            let (x, y) = (pixel % width, pixel / width);
            let ray = Vec3::new(
                (x as f32 + 0.5 - camera.principal_px[0]) / camera.focal_px[0],
                (y as f32 + 0.5 - camera.principal_px[1]) / camera.focal_px[1],
                1.0,
            );
            let center = camera.camera_from_world * -camera.position;
            let half = ray.dot(center) / ray.length_squared();
            let root = half * half - (center.length_squared() - 0.25) / ray.length_squared();
            let coverage = if root > 0.0 { [0.3, 0.7, 1.0][(x + y) % 3] } else { 0.0 };
            values[depth * size + pixel] = coverage * (half - root.max(0.0).sqrt());
            values[pixel] = coverage * 0.01 * (x % 90) as f32;
            values[(channels - 1) * size + pixel] = 1.0 - coverage;
        }
        Image { width, height, channels, values }
    }

    #[test]
    fn bricks_have_the_voxels_that_every_voxel_by_itself_has() {
        let layout = Layout::radiance(0);
        let mut gaussians = Gaussians { count: 2, layout, values: vec![0.0; len_of_values(2, layout)] };
        gaussians.set(0, MEAN, [-0.7, -0.6, -0.65]);
        gaussians.set(1, MEAN, [0.7, 0.6, 0.62]);
        let mut volume = Volume::around(&gaussians, 45);
        let from = |eye: [f32; 3], at: [f32; 3], width| {
            Camera::look_at(Vec3::from(eye), Vec3::from(at), Vec3::Y, 0.8, width, 40)
        };
        let cameras = [
            from([0.2, 0.4, 2.5], [0.0; 3], 150),
            from([9.0, 5.0, 0.0], [0.0, 1.0, 0.0], 400),
            from([2.0, 1.0, 1.0], [0.3, 0.2, 0.0], 61),
            // Beside the ball, in the volume, and away from it.
            from([0.65, 0.0, 0.6], [0.65, 0.0, -1.0], 50),
            from([0.0, 0.0, 2.0], [0.0, 0.0, 4.0], 50),
        ];
        let views: Vec<View> = cameras.iter().map(|camera| View::new(camera, &ball(camera))).collect();
        let plain = |at: [usize; 3]| {
            let point = volume.point(at);
            views.iter().fold(Voxel::default(), |voxel, view| volume.seen_in(view, point, voxel))
        };
        let all: Vec<[usize; 3]> = cells(volume.size).collect();
        let expected: Vec<Voxel> = all.iter().map(|at| plain(*at)).collect();
        let (far, near) = views.split_at(2);
        volume.integrate(far);
        let same = volume.bricks.iter().filter(|brick| matches!(brick, Brick::Same(_))).count();
        assert!(same > volume.bricks.len() / 5, "{same} of {} bricks have one state", volume.bricks.len());
        volume.integrate(near);
        let other = all.iter().zip(&expected).find(|(at, voxel)| volume.voxel(**at) != *voxel);
        assert_eq!(other, None, "{:?}", other.map(|(at, _)| volume.voxel(*at)));
    }

    #[test]
    fn voxels_are_no_finer_than_pixels() {
        let camera = |width, height| Camera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 0.7, width, height);
        let voxels = |cameras: &[Camera]| voxels_resolved(160, cameras);
        assert_eq!(voxels(&[camera(32, 48), camera(40, 16)]), 48, "the longest edge of any picture");
        assert_eq!(voxels(&[camera(400, 300)]), 160);
        assert_eq!(voxels(&[camera(100_000, 1)]), 160, "more pixels than the maximum of voxels");
        assert_eq!(voxels(&[]), 160, "no pictures");
    }

    #[test]
    fn items_are_taken_from_the_whole_slice() {
        let all: Vec<usize> = (0..250).collect();
        let taken = evenly_spaced(&all, 100);
        assert_eq!((taken.len(), taken[0], taken[99]), (100, 1, 248));
        assert!(taken.is_sorted_by(|a, b| a < b));
        assert_eq!(evenly_spaced(&all[..3], 100), [0, 1, 2]);
        assert_eq!(evenly_spaced(&all, 0), [0; 0]);
    }
}
