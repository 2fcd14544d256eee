//! Near field of a scene: a mesh of its own surface, which reflected rays may hit before the
//! distant light.
//!
//! A pixel that shows the point x with the normal n reflects its view direction to r. If the ray
//! from x + o n along r hits no triangle, it sees the far light: L = L_s(r, ρ). If it hits one, it
//! sees that surface: its base colour b, tint s, roughness ρ_h and normal n_h under the far light
//! along the ray, mirrored again,
//!
//! ```text
//! L = (1 − w) L_s(r, ρ) + w (b + s ⊙ L_s(r − 2 (r·n_h) n_h, ρ′)),    ρ′⁴ = ρ⁴ + ρ_h⁴
//! ```
//!
//! since α = ρ² and the variances of two lobes add. A single ray represents the lobe of a mirror,
//! not that of a rough surface, so w falls from one to zero with ρ ([`share_of_near`]).
//! [`Reflection`] holds the second lookup with its summand and factors. Gradients flow through the
//! lookups, not through the hit point.
//!
//! Triangles are found by a hierarchy of boxes in depth-first order. A node contains the index of
//! the node after its descendants, so a traversal needs no stack, and the order of tests and the
//! result are the same everywhere. The numbers of a [`NearField`] are [`NODE_LEN`] for each node,
//! [`TRIANGLE_LEN`] for each triangle and [`VERTEX_LEN`] for each vertex, one list after the other;
//! indices are whole numbers below [`INDEX_MAX`], which an `f32` represents exactly.

use crate::{
    camera::CameraOf,
    each, math,
    real::{AnyLane, Real},
    shade::reflect,
    shade_pixels::{Pixel, per_coverage, pixel_normal},
    vector::{Vec3, normalize_or, vec3},
};

/// Numbers of a node: least corner, index, greatest corner, count. With a count the node is a leaf,
/// and the index is its first triangle; otherwise the index is that of the node after its
/// descendants.
pub const NODE_LEN: usize = 8;
/// Numbers of a triangle: three vertices, counterclockwise as seen from outside; padding.
pub const TRIANGLE_LEN: usize = 4;
/// Numbers of a vertex: position, normal, base colour, tint, roughness, diffuse albedo.
pub const VERTEX_LEN: usize = 16;
/// First number of a vertex's normal.
pub const VERTEX_NORMAL: usize = 3;
/// First number of a vertex's base colour.
pub const VERTEX_BASE: usize = 6;
/// First number of a vertex's diffuse albedo times its ambient transfer: of a physical material,
/// for its base colour under another light; zero without materials.
pub const VERTEX_ALBEDO: usize = 13;
/// Largest albedo of a vertex: 1, and the rounding of means.
const ALBEDO_MAX: f32 = 1.001;
/// Smallest index that an `f32` may not represent.
pub const INDEX_MAX: usize = 1 << 24;
/// Distance along a ray that hits nothing.
pub const T_MISS: f32 = f32::MAX;
/// Reach of a ray that is not traced, or is already blocked.
pub const T_DONE: f32 = -1.0;

/// Roughness up to which a single ray represents the lobe: GGX half-widths of 3.6°.
pub const NEAR_ROUGHNESS_START: f32 = 0.25;
/// Roughness from which a single ray has no weight: half-widths of 14°.
pub const NEAR_ROUGHNESS_END: f32 = 0.5;

/// Depth below the plane of a triangle, in offsets of the near field, from which a shadow ray is
/// blocked by its back: a start on the surface has an error of at most one offset, and so has the
/// triangle.
pub const BACK_DEPTH: f32 = 2.0;

/// Maximum distance from the start of shadow rays to their own surface, in offsets: one offset was
/// added, and a pixel's depth and the triangles differ by up to one more.
pub const BELOW: f32 = 4.0;

/// Back depth of rays that hit only the fronts of triangles.
pub const CULL_BACKFACES: f32 = -1.0;

/// Largest number of open boxes of a ray that visits near ones first: one for each level of a
/// hierarchy of two children each.
const OPEN_MAX: usize = 64;

/// Relative enlargement of triangles for rays, so that none passes between neighbours.
const EDGE: f32 = 1e-5;
/// Relative enlargement of boxes for rays, more than rounding shrinks them.
const BOX_MARGIN: f32 = 2e-6;
/// Smallest magnitude of a direction's component: 1 / 0 times 0 is not a number.
const SLOPE_MIN: f32 = 1e-18;

/// Surface of a scene for reflected rays; `A` is the storage of its numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearField<A> {
    /// Number of nodes.
    pub node_count: usize,
    /// Number of triangles.
    pub triangle_count: usize,
    /// Number of vertices.
    pub vertex_count: usize,
    /// Distance along the normal at which reflected rays start: about the error of the surface.
    pub offset: f32,
    /// Nodes, triangles, vertices.
    pub values: A,
}

impl<A> NearField<A> {
    /// The same surface with other storage.
    pub fn with_values<B>(&self, values: B) -> NearField<B> {
        NearField::of_sizes(self.sizes(), self.offset, values)
    }
    /// Near field of numbers of nodes, triangles and vertices.
    pub const fn of_sizes([node_count, triangle_count, vertex_count]: [usize; 3], offset: f32, values: A) -> Self {
        Self { node_count, triangle_count, vertex_count, offset, values }
    }
    /// Numbers of nodes, triangles and vertices.
    pub const fn sizes(&self) -> [usize; 3] {
        [self.node_count, self.triangle_count, self.vertex_count]
    }
    /// Index of the first number of triangles.
    pub const fn triangles_start(&self) -> usize {
        NODE_LEN * self.node_count
    }
    /// Index of the first number of vertices.
    pub const fn vertices_start(&self) -> usize {
        self.triangles_start() + TRIANGLE_LEN * self.triangle_count
    }
    /// Length of `values`.
    pub const fn len_of_values(&self) -> usize {
        self.vertices_start() + VERTEX_LEN * self.vertex_count
    }
}

/// Number of rays for estimating the cost.
const COST_RAYS: usize = 64;
/// Largest mean number of boxes and triangles that a ray is tested against. A scene of 400 000
/// triangles has a few hundred.
const COST_MAX: usize = 4096;

/// Fault of a near field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum NearFieldError {
    /// There are no triangles, or more nodes, triangles or vertices than can be counted.
    Size,
    /// The number of values does not match the sizes.
    Length {
        /// Expected number of values.
        expected: usize,
        /// Number of values.
        found: usize,
    },
    /// A number is not finite, or the offset is negative.
    NotFinite,
    /// A node's index or count is not that of a hierarchy in depth-first order.
    Node {
        /// Index of the node.
        index: usize,
    },
    /// A triangle refers to a vertex that does not exist.
    Triangle {
        /// Index of the triangle.
        index: usize,
    },
    /// Boxes overlap so much that rays would take too long.
    Overlap {
        /// Mean number of boxes and triangles that a ray is tested against.
        cost: usize,
    },
    /// A vertex reflects more light than arrives.
    Albedo {
        /// Index of the vertex.
        index: usize,
    },
}

impl core::fmt::Display for NearFieldError {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Size => write!(out, "it has no triangles, or {INDEX_MAX} or more nodes, triangles or vertices"),
            Self::Length { expected, found } => write!(out, "it has {found} numbers instead of {expected}"),
            Self::NotFinite => write!(out, "a number is not finite, or rays would start below the surface"),
            Self::Node { index } => write!(out, "node {index} does not belong to a hierarchy in depth-first order"),
            Self::Triangle { index } => write!(out, "triangle {index} has a vertex that does not exist"),
            Self::Overlap { cost } => {
                write!(
                    out,
                    "its boxes overlap: a ray would be tested against {cost} of them, above the limit of {COST_MAX}"
                )
            }
            Self::Albedo { index } => write!(out, "vertex {index} has an albedo that is not from 0 to 1"),
        }
    }
}

impl core::error::Error for NearFieldError {}

/// Triangle that a ray hits first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit<R> {
    /// Distance along the ray, in lengths of its direction.
    pub distance: R,
    /// Index of the triangle.
    pub triangle: usize,
    /// Barycentric coordinates: the weights of the second and the third vertex.
    pub weights: [R; 2],
}

/// First hits of rays side by side.
#[derive(Clone, Copy, Debug)]
pub struct Hits<R> {
    /// Distances along the rays, in lengths of their directions; [`T_MISS`] for rays that hit
    /// none.
    pub distance: R,
    /// Indices of the triangles, whole numbers.
    pub triangle: R,
    /// Barycentric coordinates: the weights of the second and the third vertex.
    pub weights: [R; 2],
}

impl<R: Real> Hits<R> {
    /// Hits of rays that hit nothing.
    #[inline(always)]
    fn none(like: R) -> Self {
        Self { distance: like.constant(T_MISS), triangle: like.zero(), weights: [like.zero(); 2] }
    }

    /// Mask of the rays that hit a triangle.
    #[inline(always)]
    pub fn is_hit(&self) -> R::Mask {
        self.distance.less(self.distance.constant(T_MISS))
    }

    /// Takes the crossing of a triangle where the mask holds.
    #[inline(always)]
    fn or_nearer(self, mask: R::Mask, triangle: usize, crossing: &Crossing<R>) -> Self {
        let index = self.triangle.constant(triangle as f32);
        Self {
            distance: R::select(mask, crossing.distance, self.distance),
            triangle: R::select(mask, index, self.triangle),
            weights: [
                R::select(mask, crossing.weights[0], self.weights[0]),
                R::select(mask, crossing.weights[1], self.weights[1]),
            ],
        }
    }
}

impl<A: AsMut<[f32]>> NearField<A> {
    /// Numbers of every vertex, to be written.
    pub fn vertices_mut(&mut self) -> &mut [[f32; VERTEX_LEN]] {
        let start = self.vertices_start();
        self.values.as_mut()[start..].as_chunks_mut().0
    }
}

impl<A: AsRef<[f32]>> NearField<A> {
    /// Checks that a traversal ends within a bounded time and reads only existing numbers.
    ///
    /// # Errors
    ///
    /// The first fault.
    pub fn check(&self) -> Result<(), NearFieldError> {
        let Self { node_count, triangle_count, vertex_count, offset, .. } = *self;
        if self.sizes().iter().any(|size| !(1..INDEX_MAX).contains(size)) {
            return Err(NearFieldError::Size);
        }
        let (expected, found) = (self.len_of_values(), self.values.as_ref().len());
        if expected != found {
            return Err(NearFieldError::Length { expected, found });
        }
        if !(offset >= 0.0 && offset.is_finite() && self.values.as_ref().iter().all(|number| number.is_finite())) {
            return Err(NearFieldError::NotFinite);
        }
        let mut next = 0;
        for index in 0..node_count {
            let [first, count] = self.range(index).ok_or(NearFieldError::Node { index })?;
            // Leaves contain the triangles in order, so none is tested twice.
            let is_whole = match count {
                0 => index < first && first <= node_count,
                _ => first == next && first + count <= triangle_count,
            };
            if !is_whole {
                return Err(NearFieldError::Node { index });
            }
            next += count;
        }
        for index in 0..triangle_count {
            let corners = self.numbers::<3>(self.triangles_start() + TRIANGLE_LEN * index);
            let is_there = |corner: f32| whole(corner).is_some_and(|vertex| vertex < vertex_count);
            if !corners.into_iter().all(is_there) {
                return Err(NearFieldError::Triangle { index });
            }
        }
        let is_albedo = |albedo: &f32| (0.0..=ALBEDO_MAX).contains(albedo);
        let is_bright = |vertex: &[f32; VERTEX_LEN]| !vertex[VERTEX_ALBEDO..].iter().all(is_albedo);
        if let Some(index) = self.vertices().iter().position(is_bright) {
            return Err(NearFieldError::Albedo { index });
        }
        let cost = self.cost();
        if cost <= COST_MAX { Ok(()) } else { Err(NearFieldError::Overlap { cost }) }
    }

    /// Mean number of boxes and triangles that rays between the middles of triangles are tested
    /// against.
    fn cost(&self) -> usize {
        let middle = |triangle: usize| {
            let [a, b, c] = self.corners(triangle).map(|vertex| self.position(vertex, 0.0_f32));
            (a + b + c) * 3.0_f32.recip()
        };
        let cost_of = |ray: usize| {
            let from = ray * self.triangle_count / COST_RAYS;
            let to = (from + self.triangle_count / 2 + ray) % self.triangle_count;
            self.count_tests(middle(from), middle(to) - middle(from))
        };
        (0..COST_RAYS).map(cost_of).sum::<usize>() / COST_RAYS
    }

    /// Number of boxes and triangles that a ray of any length is tested against.
    fn count_tests(&self, origin: Vec3<f32>, direction: Vec3<f32>) -> usize {
        let inverse = inverse_direction(direction);
        let (mut index, mut tests) = (0, 0);
        while index < self.node_count {
            let node = self.numbers::<NODE_LEN>(NODE_LEN * index);
            let [min, max] = [[node[0], node[1], node[2]], [node[4], node[5], node[6]]].map(|at| constant(at, 0.0));
            let [enter, leave] = box_span(min, max, origin, inverse);
            let (first, count) = (node[3] as usize, node[7] as usize);
            let is_open = enter <= leave;
            tests += 1 + if is_open { count } else { 0 };
            index = if is_open || count > 0 { index + 1 } else { first };
        }
        tests
    }

    /// Index and count of a node; `None` unless they are whole numbers.
    fn range(&self, node: usize) -> Option<[usize; 2]> {
        let node = self.numbers::<NODE_LEN>(NODE_LEN * node);
        Some([whole(node[3])?, whole(node[7])?])
    }

    #[inline(always)]
    fn numbers<const N: usize>(&self, first: usize) -> [f32; N] {
        let numbers = &self.values.as_ref()[first..first + N];
        core::array::from_fn(|k| numbers[k])
    }

    /// Vertices of a triangle.
    #[inline(always)]
    pub fn corners(&self, triangle: usize) -> [usize; 3] {
        self.numbers::<3>(self.triangles_start() + TRIANGLE_LEN * triangle).map(|vertex| vertex as usize)
    }

    /// Numbers of every vertex.
    #[inline(always)]
    pub fn vertices(&self) -> &[[f32; VERTEX_LEN]] {
        self.values.as_ref()[self.vertices_start()..].as_chunks().0
    }

    /// Numbers of a vertex.
    #[inline(always)]
    pub fn vertex(&self, vertex: usize) -> [f32; VERTEX_LEN] {
        self.numbers(self.vertices_start() + VERTEX_LEN * vertex)
    }

    #[inline(always)]
    fn position<R: Real>(&self, vertex: usize, like: R) -> Vec3<R> {
        constant(self.numbers(self.vertices_start() + VERTEX_LEN * vertex), like)
    }

    /// Finds the first triangle whose front a ray hits; of several at the same distance, the first
    /// in order. A ray that is not finite hits nothing.
    pub fn first_hit<R: Real<Mask = bool>>(&self, origin: Vec3<R>, direction: Vec3<R>) -> Option<Hit<R>> {
        let inverse = inverse_direction(direction);
        let mut nearest: Option<Hit<R>> = None;
        let mut reach = origin.x.constant(T_MISS);
        // Open boxes, each with the distance at which the ray enters it.
        let mut rest = [(0, reach.zero()); OPEN_MAX];
        let mut open = 1;
        while open > 0 {
            open -= 1;
            let (index, enter) = rest[open];
            if !enter.less_or_equal(reach * (1.0 + BOX_MARGIN)) {
                continue;
            }
            let [end, count] = self.extent(index);
            if count > 0 {
                for triangle in end..end + count {
                    let corners = self.corners(triangle).map(|corner| self.position(corner, reach));
                    let Crossing { distance, weights } =
                        crossing(corners, origin, direction, reach.constant(CULL_BACKFACES));
                    let is_first = nearest.is_some_and(|hit| triangle < hit.triangle && distance.less_or_equal(reach));
                    if distance.less(reach) || is_first {
                        reach = distance;
                        nearest = Some(Hit { distance, triangle, weights });
                    }
                }
                continue;
            }
            // The nearest child is next, so that its hits close boxes behind them.
            let first = open;
            let mut child = index + 1;
            while child < end {
                let node = self.numbers::<NODE_LEN>(NODE_LEN * child);
                let [min, max] =
                    [[node[0], node[1], node[2]], [node[4], node[5], node[6]]].map(|at| constant(at, reach));
                let [enter, leave] = box_span(min, max, origin, inverse);
                if enter.less_or_equal(leave) {
                    if open == OPEN_MAX {
                        return self.hit_within(origin, direction, origin.x.constant(T_MISS));
                    }
                    rest[open] = (child, enter);
                    open += 1;
                    if open > first + 1 && rest[open - 2].1.less_or_equal(enter) {
                        rest.swap(open - 2, open - 1);
                    }
                }
                child = if node[7] > 0.0 { child + 1 } else { node[3] as usize };
            }
        }
        nearest
    }

    /// End of an inner node's descendants and 0, or a leaf's first triangle and their number.
    #[inline(always)]
    fn extent(&self, node: usize) -> [usize; 2] {
        let numbers = self.numbers::<NODE_LEN>(NODE_LEN * node);
        [numbers[3] as usize, numbers[7] as usize]
    }

    /// [`NearField::first_hit`] of rays side by side, each within `reach`, in lengths of its
    /// direction. Rays with a negative reach are skipped and hit nothing.
    #[inline(always)]
    pub fn first_hits<R: Real<Mask: AnyLane>>(&self, origin: Vec3<R>, direction: Vec3<R>, reach: R) -> Hits<R> {
        let mut hits = Hits::none(reach);
        self.traverse(origin, direction, reach, reach.constant(CULL_BACKFACES), |is_nearer, triangle, crossing| {
            hits = hits.or_nearer(is_nearer, triangle, crossing);
            crossing.distance
        });
        hits
    }

    fn hit_within<R: Real<Mask = bool>>(&self, origin: Vec3<R>, direction: Vec3<R>, reach: R) -> Option<Hit<R>> {
        let mut hit = None;
        self.traverse(origin, direction, reach, reach.constant(CULL_BACKFACES), |_, triangle, crossing| {
            hit = Some(Hit { distance: crossing.distance, triangle, weights: crossing.weights });
            crossing.distance
        });
        hit
    }

    /// Tests whether a ray hits a triangle within a distance, in lengths of its direction: its
    /// front, or its back from at least [`BACK_DEPTH`] offsets below it. Unseen undersides have no
    /// triangles, so the surfaces above them block light with their backs.
    pub fn is_blocked<R: Real<Mask = bool>>(&self, origin: Vec3<R>, direction: Vec3<R>, reach: R) -> bool {
        self.are_blocked(origin, direction, reach)
    }

    /// [`NearField::is_blocked`] of rays side by side. Rays with a negative reach are skipped:
    /// nothing blocks them.
    #[inline(always)]
    pub fn are_blocked<R: Real<Mask: AnyLane>>(&self, origin: Vec3<R>, direction: Vec3<R>, reach: R) -> R::Mask {
        let zero = reach.zero();
        let mut are_blocked = zero.less(zero);
        self.traverse(origin, direction, reach, reach.constant(BACK_DEPTH * self.offset), |is_nearer, _, _| {
            are_blocked = are_blocked | is_nearer;
            zero.constant(T_DONE)
        });
        are_blocked
    }

    /// Finds the surface below `start`, a start of shadow rays that is lifted along the unit
    /// normal, within [`BELOW`] offsets. `None` if the surface is farther away.
    pub fn surface_below<R: Real<Mask = bool>>(&self, start: Vec3<R>, normal: Vec3<R>) -> Option<Hit<R>> {
        self.hit_within(start, -normal, self.reach_below(start.x))
    }

    /// Distance within which [`NearField::surface_below`] finds a surface.
    #[inline(always)]
    pub fn reach_below<R: Real>(&self, like: R) -> R {
        like.constant(BELOW * self.offset)
    }

    /// Interpolates a vector at a hit from those of the vertices, three numbers each.
    pub fn between<R: Real>(&self, hit: &Hit<R>, vectors: &[f32]) -> Vec3<R> {
        let [second, third] = hit.weights;
        let vector = |vertex: usize| {
            let [x, y, z] = [0, 1, 2].map(|k| second.constant(vectors[3 * vertex + k]));
            vec3(x, y, z)
        };
        let [a, b, c] = self.corners(hit.triangle).map(vector);
        a * (-(second + third) + 1.0) + b * second + c * third
    }

    /// Finds the triangles that rays hit within `reach`, their backs from `back_depth` on. Calls
    /// `meet(mask, triangle, crossing)` for each in turn; it returns the new reach of the rays.
    ///
    /// Rays side by side open the boxes that any of them hits; each has the same hits as when
    /// traced separately.
    #[inline(always)]
    fn traverse<R: Real<Mask: AnyLane>>(
        &self,
        origin: Vec3<R>,
        direction: Vec3<R>,
        mut reach: R,
        back_depth: R,
        mut meet: impl FnMut(R::Mask, usize, &Crossing<R>) -> R,
    ) {
        let inverse = inverse_direction(direction);
        let mut index = 0;
        while index < self.node_count {
            let node = self.numbers::<NODE_LEN>(NODE_LEN * index);
            let min = constant([node[0], node[1], node[2]], reach);
            let max = constant([node[4], node[5], node[6]], reach);
            let [enter, leave] = box_span(min, max, origin, inverse);
            let (first, count) = (node[3] as usize, node[7] as usize);
            let is_met = enter.less_or_equal(leave) & enter.less(reach);
            let is_open = is_met.any();
            index = if is_open || count > 0 { index + 1 } else { first };
            if !is_open {
                continue;
            }
            for triangle in first..first + count {
                // No closures: compilers build them without the vector instructions of the machine.
                let [a, b, c] = self.corners(triangle);
                let corners = [self.position(a, reach), self.position(b, reach), self.position(c, reach)];
                let crossing = crossing(corners, origin, direction, back_depth);
                let is_nearer = is_met & crossing.distance.less(reach);
                if is_nearer.any() {
                    reach = R::select(is_nearer, meet(is_nearer, triangle, &crossing), reach);
                    if !reach.zero().less_or_equal(reach).any() {
                        return;
                    }
                }
            }
        }
    }

    /// Surface at a hit.
    pub fn surface<R: Real>(&self, hit: &Hit<R>) -> NearSurface<R> {
        let lifted = |vertex: usize| vertex_surface(self.vertex(vertex).map(|x| hit.distance.constant(x)));
        let vertices = self.corners(hit.triangle).map(lifted);
        surface_within(&vertices, hit.weights)
    }
}

/// A vector in every lane.
#[inline(always)]
fn constant<R: Real>([x, y, z]: [f32; 3], like: R) -> Vec3<R> {
    vec3(like.constant(x), like.constant(y), like.constant(z))
}

/// A number as an index.
fn whole(number: f32) -> Option<usize> {
    let is_whole = number >= 0.0 && number <= INDEX_MAX as f32 && math::floor(number) == number;
    is_whole.then_some(number as usize)
}

/// Reciprocals of a direction's components, none of which is infinite.
#[inline(always)]
pub fn inverse_direction<R: Real>(direction: Vec3<R>) -> Vec3<R> {
    each!(direction, x => R::select(x.abs().less(x.constant(SLOPE_MIN)), x.constant(SLOPE_MIN), x).recip())
}

/// Distances at which a ray enters and leaves a box, the first zero inside of it; in this order if
/// the ray hits the box (slabs; Kay and Kajiya 1986). `inverse` is that of [`inverse_direction`].
#[inline(always)]
pub fn box_span<R: Real>(min: Vec3<R>, max: Vec3<R>, origin: Vec3<R>, inverse: Vec3<R>) -> [R; 2] {
    let (to_min, to_max) = ((min - origin).times(inverse), (max - origin).times(inverse));
    let enter = to_min.x.min(to_max.x).max(to_min.y.min(to_max.y)).max(to_min.z.min(to_max.z));
    let leave = to_min.x.max(to_max.x).min(to_min.y.max(to_max.y)).min(to_min.z.max(to_max.z));
    [enter.max(enter.zero()), leave * (1.0 + BOX_MARGIN)]
}

/// Point at which a ray hits a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Crossing<R> {
    /// Distance along the ray, in lengths of its direction; [`T_MISS`] if the ray misses the
    /// triangle.
    pub distance: R,
    /// Weights of the second and the third corner.
    pub weights: [R; 2],
}

/// Crossing of a ray and a triangle, whose corners are counterclockwise seen from its front (Möller
/// and Trumbore 1997, "Fast, Minimum Storage Ray/Triangle Intersection"). Rays that start at least
/// `back_depth` below its plane hit its back; none do if that is negative.
#[inline(always)]
pub fn crossing<R: Real>([a, b, c]: [Vec3<R>; 3], origin: Vec3<R>, direction: Vec3<R>, back_depth: R) -> Crossing<R> {
    let (to_b, to_c, from_a) = (b - a, c - a, origin - a);
    let across = direction.cross(to_c);
    let volume = to_b.dot(across);
    let zero = volume.zero();
    let is_front = zero.less(volume);
    let normal = to_b.cross(to_c);
    let below = -(normal.dot(from_a));
    let is_deep = (back_depth * normal.dot(normal).sqrt()).less_or_equal(below);
    let is_back = volume.less(zero) & zero.less_or_equal(back_depth) & is_deep;
    let is_faced = is_front | is_back;
    let per_volume = R::select(is_faced, volume, volume.constant(1.0)).recip();
    let u = from_a.dot(across) * per_volume;
    let along = from_a.cross(to_b);
    let v = direction.dot(along) * per_volume;
    let distance = to_c.dot(along) * per_volume;
    let least = zero.constant(-EDGE);
    let is_inside = least.less(u) & least.less(v) & (u + v).less(zero.constant(1.0 + EDGE));
    let is_met = is_faced & is_inside & zero.less(distance);
    Crossing { distance: R::select(is_met, distance, zero.constant(T_MISS)), weights: [u, v] }
}

/// Surface that a reflected ray hits.
#[derive(Clone, Copy, Debug)]
pub struct NearSurface<R> {
    /// Normal; of any length.
    pub normal: Vec3<R>,
    /// Diffuse and residual colour, linear.
    pub base: Vec3<R>,
    /// Specular tint.
    pub tint: Vec3<R>,
    /// Perceptual roughness.
    pub roughness: R,
}

/// Surface at a vertex, from its numbers.
#[inline(always)]
pub fn vertex_surface<R: Real>(numbers: [R; VERTEX_LEN]) -> NearSurface<R> {
    let [_, _, _, a, b, c, d, e, f, g, h, i, roughness, ..] = numbers;
    NearSurface { normal: vec3(a, b, c), base: vec3(d, e, f), tint: vec3(g, h, i), roughness }
}

/// Surface inside a triangle of three vertices; `weights` are those of the second and the third.
#[inline(always)]
pub fn surface_within<R: Real>(vertices: &[NearSurface<R>; 3], weights: [R; 2]) -> NearSurface<R> {
    let [a, b, c] = vertices;
    let [u, v] = weights;
    let w = -(u + v) + 1.0;
    NearSurface {
        normal: (a.normal * w).add_scaled(u, b.normal).add_scaled(v, c.normal),
        base: (a.base * w).add_scaled(u, b.base).add_scaled(v, c.base),
        tint: (a.tint * w).add_scaled(u, b.tint).add_scaled(v, c.tint),
        roughness: a.roughness * w + b.roughness * u + c.roughness * v,
    }
}

/// Start of the reflected ray of a pixel that is seen along −`view_dir`: the point at its mean
/// depth, lifted from the surface by `offset` along its normal. `depth` is the premultiplied sum of
/// depths along the optical axis.
#[inline(always)]
pub fn ray_origin<R: Real>(camera: &CameraOf<R>, pixel: &Pixel<R>, depth: R, view_dir: Vec3<R>, offset: R) -> Vec3<R> {
    let axis = camera.camera_from_world.rows[2];
    let distance = depth * per_coverage(pixel.coverage) / (-view_dir.dot(axis));
    camera.position.add_scaled(-distance, view_dir).add_scaled(offset, pixel_normal(pixel, view_dir))
}

/// Reflected light of a pixel, L = base + far L_s(r, ρ) + tint ⊙ L_s(direction, roughness): the far
/// light, and the surface that its ray hits.
#[derive(Clone, Copy, Debug)]
pub struct Reflection<R> {
    /// Light of the surface that the ray hits; zero for rays that hit none.
    pub base: Vec3<R>,
    /// Share of the far light that this surface reflects; zero without a surface.
    pub tint: Vec3<R>,
    /// Direction in which this surface looks up the far light.
    pub direction: Vec3<R>,
    /// Roughness of that lookup.
    pub roughness: R,
    /// Share of the pixel's own far light: 1 if the ray hits nothing.
    pub far: R,
}

impl<R: Real> Reflection<R> {
    /// Numbers of a reflection: base, tint, direction, roughness, far.
    pub const LEN: usize = 11;

    /// Reflection of a ray that hits nothing.
    #[inline(always)]
    pub fn of_far(direction: Vec3<R>, roughness: R) -> Self {
        let none = Vec3::zero(roughness);
        Self { base: none, tint: none, direction, roughness, far: roughness.constant(1.0) }
    }

    /// Reflection of a ray along a unit direction, from a surface of some roughness, that hits
    /// another surface. The weight of that surface falls with the roughness ([`share_of_near`]).
    #[inline(always)]
    pub fn of_near(direction: Vec3<R>, roughness: R, near: &NearSurface<R>) -> Self {
        let fourth = |roughness: R| roughness.squared().squared();
        let widened = (fourth(roughness) + fourth(near.roughness)).sqrt().sqrt();
        let share = share_of_near(roughness);
        Self {
            base: near.base * share,
            tint: near.tint * share,
            direction: reflect(-direction, normalize_or(near.normal, -direction)),
            roughness: widened.min(roughness.constant(1.0)),
            far: -share + 1.0,
        }
    }

    /// This reflection where the mask holds, the other elsewhere.
    #[must_use]
    #[inline(always)]
    pub fn or(&self, other: &Self, mask: R::Mask) -> Self {
        let (mut either, other) = (self.to_array(), other.to_array());
        for (number, other) in either.iter_mut().zip(other) {
            *number = R::select(mask, *number, other);
        }
        Self::from_array(either)
    }

    /// The numbers, in the order of [`Reflection::LEN`].
    #[inline(always)]
    pub fn to_array(&self) -> [R; 11] {
        let Self { base, tint, direction, roughness, far } = *self;
        let ([a, b, c], [d, e, f], [g, h, i]) = (base.to_array(), tint.to_array(), direction.to_array());
        [a, b, c, d, e, f, g, h, i, roughness, far]
    }

    /// Inverse of [`Reflection::to_array`].
    #[inline(always)]
    pub fn from_array([a, b, c, d, e, f, g, h, i, roughness, far]: [R; 11]) -> Self {
        Self { base: vec3(a, b, c), tint: vec3(d, e, f), direction: vec3(g, h, i), roughness, far }
    }

    /// Light of the reflection, from the far light of the pixel and that of the surface that its
    /// ray hits.
    #[inline(always)]
    pub fn light(&self, own: Vec3<R>, second: Vec3<R>) -> Vec3<R> {
        self.base + own * self.far + self.tint.times(second)
    }

    /// Part of [`Reflection::light`] from the hit surface.
    #[inline(always)]
    pub fn indirect(&self, second: Vec3<R>) -> Vec3<R> {
        self.base + self.tint.times(second)
    }

    /// Gradient of [`Reflection::light`] with respect to both lights.
    #[inline(always)]
    pub fn light_vjp(&self, grad: Vec3<R>) -> [Vec3<R>; 2] {
        [grad * self.far, self.tint.times(grad)]
    }
}

/// Mask of pixels whose reflected rays are traced: covered, and smooth enough that
/// [`share_of_near`] is above zero.
#[inline(always)]
pub fn is_traced<R: Real>(coverage: R, roughness: R) -> R::Mask {
    coverage.zero().less(coverage) & roughness.less(roughness.constant(NEAR_ROUGHNESS_END))
}

/// Weight of the surface that a single ray hits, in the reflection of a surface of some roughness:
/// 1 for mirrors, falling smoothly to 0 between [`NEAR_ROUGHNESS_START`] and
/// [`NEAR_ROUGHNESS_END`], because a single ray does not represent a wide lobe.
#[inline(always)]
pub fn share_of_near<R: Real>(roughness: R) -> R {
    let x = ((roughness - NEAR_ROUGHNESS_START) / (NEAR_ROUGHNESS_END - NEAR_ROUGHNESS_START)).clamp(0.0, 1.0);
    x.squared() * (x * 2.0 - 3.0) + 1.0
}
