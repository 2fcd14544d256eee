//! Fewer triangles for the same surface: edges are collapsed in the order of the error that this
//! causes (Garland and Heckbert 1997, "Surface Simplification Using Quadric Error Metrics").
//!
//! The error of a vertex at x is the sum of the squared distances from the planes of the triangles
//! around the vertices that it replaces, weighted by area. Planes through the edges of holes keep
//! their outlines. A small share of the squared distance from the replaced vertices makes the
//! minimum unique where a surface is flat.

use crate::Mesh;
use core::cmp::Reverse;
use glam::{DMat3, DVec3, Vec3};
use std::collections::BinaryHeap;

/// Weight of the distance from the replaced vertices, relative to that from planes.
const TO_VERTICES: f64 = 1e-3;
/// Weight of planes through the edges of holes, relative to those of triangles.
const TO_OUTLINES: f64 = 4.0;
/// Cosine below which a triangle must not turn by one collapse.
const TURN_MIN: f64 = 0.2;

/// Mesh of at most `count_max` triangles, and its unused vertices removed; the same mesh if it has
/// no more. Normals and colours are interpolated along collapsed edges.
///
/// Collapses that fold the surface or join its sheets wait until no other is left.
pub fn simplified(mesh: Mesh, count_max: usize) -> Mesh {
    if mesh.triangles.len() <= count_max {
        return mesh;
    }
    let mut simplifier = Simplifier::new(mesh);
    for is_strict in [true, false] {
        while simplifier.count > count_max && simplifier.pass(count_max, is_strict) {}
    }
    simplifier.finish()
}

/// Squared distances from weighted planes and points: xᵀ A x − 2 b·x + c.
#[derive(Clone, Copy)]
struct Quadric {
    a: DMat3,
    b: DVec3,
    c: f64,
}

impl Quadric {
    const ZERO: Self = Self { a: DMat3::ZERO, b: DVec3::ZERO, c: 0.0 };

    /// Squared distance from a plane through a point.
    fn plane(normal: DVec3, point: DVec3, weight: f64) -> Self {
        let (along, normal_weighted) = (normal.dot(point), weight * normal);
        let a = DMat3::from_cols(normal_weighted * normal.x, normal_weighted * normal.y, normal_weighted * normal.z);
        Self { a, b: along * normal_weighted, c: along * along * weight }
    }

    /// Squared distance from a point.
    fn point(point: DVec3, weight: f64) -> Self {
        Self { a: DMat3::from_diagonal(DVec3::splat(weight)), b: weight * point, c: weight * point.length_squared() }
    }

    fn add(&mut self, other: &Self) {
        self.a += other.a;
        self.b += other.b;
        self.c += other.c;
    }

    fn plus(mut self, other: &Self) -> Self {
        self.add(other);
        self
    }

    fn error(&self, x: DVec3) -> f64 {
        (x.dot(self.a * x) - 2.0 * self.b.dot(x) + self.c).max(0.0)
    }

    /// Point of the least error.
    fn minimum(&self) -> Option<DVec3> {
        let minimum = self.a.inverse() * self.b;
        minimum.is_finite().then_some(minimum)
    }
}

/// Edge in the order of its error: the bits of a float that is not negative are in its order. Then
/// both vertices, and their versions.
type Candidate = Reverse<(u64, [u32; 2], [u32; 2])>;

struct Simplifier {
    mesh: Mesh,
    /// First vertex.
    origin: DVec3,
    /// Positions relative to it.
    positions: Vec<DVec3>,
    quadrics: Vec<Quadric>,
    /// Triangles around each vertex.
    triangles_of: Vec<Vec<u32>>,
    is_removed: Vec<bool>,
    /// Number of changes of each vertex.
    versions: Vec<u32>,
    /// Number of triangles that are left.
    count: usize,
}

impl Simplifier {
    fn new(mesh: Mesh) -> Self {
        let origin = mesh.positions.first().map_or(DVec3::ZERO, |position| DVec3::from(position.map(f64::from)));
        let positions: Vec<DVec3> =
            mesh.positions.iter().map(|position| DVec3::from(position.map(f64::from)) - origin).collect();
        let mut triangles_of = vec![Vec::new(); positions.len()];
        for (triangle, corners) in mesh.triangles.iter().enumerate() {
            corners.iter().for_each(|corner| triangles_of[*corner as usize].push(triangle as u32));
        }
        let is_removed = vec![false; mesh.triangles.len()];
        let (count, versions) = (mesh.triangles.len(), vec![0; positions.len()]);
        let quadrics = vec![Quadric::ZERO; positions.len()];
        let mut all = Self { mesh, origin, positions, quadrics, triangles_of, is_removed, versions, count };
        (0..all.mesh.triangles.len()).for_each(|triangle| all.weigh(triangle));
        all
    }

    /// Adds the planes of a triangle and of its edges at holes to its vertices.
    fn weigh(&mut self, triangle: usize) {
        let corners = self.mesh.triangles[triangle];
        let across = self.across(corners);
        let Some(normal) = across.try_normalize() else { return };
        let area = 0.5 * across.length();
        let plane = Quadric::plane(normal, self.positions[corners[0] as usize], area);
        for (k, corner) in corners.into_iter().enumerate() {
            let position = self.positions[corner as usize];
            self.quadrics[corner as usize].add(&plane.plus(&Quadric::point(position, TO_VERTICES * area)));
            let next = corners[(k + 1) % 3];
            if self.shared([corner, next]).count() == 1 {
                let along = self.positions[next as usize] - position;
                let weight = TO_OUTLINES * along.length_squared();
                let outline = Quadric::plane(normal.cross(along).normalize_or_zero(), position, weight);
                [corner, next].into_iter().for_each(|vertex| self.quadrics[vertex as usize].add(&outline));
            }
        }
    }

    /// Normal of a triangle, twice its area long.
    fn across(&self, corners: [u32; 3]) -> DVec3 {
        let [a, b, c] = corners.map(|corner| self.positions[corner as usize]);
        (b - a).cross(c - a)
    }

    /// Triangles at both ends of an edge.
    fn shared(&self, [a, b]: [u32; 2]) -> impl Iterator<Item = u32> {
        let around = self.triangles_of[a as usize].iter().copied();
        around.filter(move |triangle| self.mesh.triangles[*triangle as usize].contains(&b))
    }

    /// Other vertices of the triangles around a vertex, ascending.
    fn neighbours(&self, vertex: u32) -> Vec<u32> {
        let around = &self.triangles_of[vertex as usize];
        let corners = around.iter().flat_map(|triangle| self.mesh.triangles[*triangle as usize]);
        let mut neighbours: Vec<u32> = corners.filter(|corner| *corner != vertex).collect();
        neighbours.sort_unstable();
        neighbours.dedup();
        neighbours
    }

    /// Position and error of the vertex that replaces an edge.
    fn replacement(&self, [a, b]: [u32; 2]) -> (DVec3, f64) {
        let quadric = self.quadrics[a as usize].plus(&self.quadrics[b as usize]);
        let middle = 0.5 * (self.positions[a as usize] + self.positions[b as usize]);
        let position = quadric.minimum().unwrap_or(middle);
        (position, quadric.error(position))
    }

    fn candidate(&self, edge: [u32; 2]) -> Candidate {
        Reverse((self.replacement(edge).1.to_bits(), edge, edge.map(|vertex| self.versions[vertex as usize])))
    }

    /// Collapses edges until few enough triangles are left, or no edge. Returns whether any was
    /// collapsed.
    fn pass(&mut self, count_max: usize, is_strict: bool) -> bool {
        let vertices = 0..self.positions.len() as u32;
        let edges = vertices.flat_map(|vertex| {
            let after = self.neighbours(vertex).into_iter().filter(move |other| *other > vertex);
            after.map(move |other| [vertex, other])
        });
        let mut heap: BinaryHeap<Candidate> = edges.map(|edge| self.candidate(edge)).collect();
        let count_before = self.count;
        while self.count > count_max {
            let Some(Reverse((_, edge, versions))) = heap.pop() else { break };
            if edge.map(|vertex| self.versions[vertex as usize]) != versions {
                continue;
            }
            let (position, _) = self.replacement(edge);
            if is_strict && !(self.is_simple(edge) && self.keeps_sides(edge, position)) {
                continue;
            }
            self.collapse(edge, position);
            let [kept, _] = edge;
            for other in self.neighbours(kept) {
                heap.push(self.candidate([kept.min(other), kept.max(other)]));
            }
        }
        self.count < count_before
    }

    /// True if the vertices of an edge have no common neighbours but those of its triangles, so
    /// that no sheets are joined, and if more than these triangles are around them.
    fn is_simple(&self, edge: [u32; 2]) -> bool {
        let [of_a, of_b] = edge.map(|vertex| self.neighbours(vertex));
        let common = of_a.iter().filter(|vertex| of_b.binary_search(vertex).is_ok()).count();
        let shared = self.shared(edge).count();
        common == shared && shared <= 2 && of_a.len().max(of_b.len()) > 3
    }

    /// True if no other triangle around an edge turns too far, or loses its area, when the edge
    /// moves to a position.
    fn keeps_sides(&self, edge: [u32; 2], to: DVec3) -> bool {
        let [a, b] = edge;
        edge.iter().all(|moved| {
            self.triangles_of[*moved as usize].iter().all(|triangle| {
                let corners = self.mesh.triangles[*triangle as usize];
                if corners.contains(&a) && corners.contains(&b) {
                    return true;
                }
                let at = |corner: u32| if corner == *moved { to } else { self.positions[corner as usize] };
                let [p, q, r] = corners.map(at);
                let (before, after) = (self.across(corners), (q - p).cross(r - p));
                after.dot(before) > TURN_MIN * before.length() * after.length()
            })
        })
    }

    /// Replaces an edge by its first vertex at a position.
    fn collapse(&mut self, edge: [u32; 2], position: DVec3) {
        let [kept, gone] = edge.map(|vertex| vertex as usize);
        for triangle in self.shared(edge).collect::<Vec<_>>() {
            self.is_removed[triangle as usize] = true;
            self.count -= 1;
            for corner in self.mesh.triangles[triangle as usize] {
                self.triangles_of[corner as usize].retain(|other| *other != triangle);
            }
        }
        for triangle in core::mem::take(&mut self.triangles_of[gone]) {
            let corners = &mut self.mesh.triangles[triangle as usize];
            corners.iter_mut().filter(|corner| **corner == edge[1]).for_each(|corner| *corner = edge[0]);
            self.triangles_of[kept].push(triangle);
        }
        let along = self.positions[gone] - self.positions[kept];
        let share = (position - self.positions[kept]).dot(along) / along.length_squared();
        let share = if share.is_finite() { share.clamp(0.0, 1.0) as f32 } else { 0.5 };
        let mixed = |of: &[[f32; 3]]| core::array::from_fn(|k| of[kept][k] + share * (of[gone][k] - of[kept][k]));
        let normal = Vec3::from(mixed(&self.mesh.normals)).normalize_or(self.mesh.normals[kept].into());
        self.mesh.normals[kept] = normal.to_array();
        self.mesh.colors[kept] = mixed(&self.mesh.colors);
        self.mesh.positions[kept] = (self.origin + position).as_vec3().to_array();
        self.positions[kept] = position;
        let quadric = self.quadrics[gone];
        self.quadrics[kept].add(&quadric);
        self.versions[kept] += 1;
        self.versions[gone] += 1;
    }

    /// Triangles that are left, and their vertices.
    fn finish(self) -> Mesh {
        let Self { mut mesh, is_removed, triangles_of, .. } = self;
        let mut removed = is_removed.into_iter();
        mesh.triangles.retain(|_| !removed.next().unwrap_or_default());
        mesh.with_vertices(|vertex| !triangles_of[vertex].is_empty())
    }
}
