//! Bounding volume hierarchy in depth-first order, as [`specula_core::near_field`] traverses it.

use glam::Vec3A;
use obvhs::{
    BvhBuildParams,
    bvh2::{Bvh2, leaf_collapser::collapse, reinsertion::ReinsertionOptimizer},
    ploc::PlocBuilder,
    triangle::Triangle,
};
use specula_core::near_field::NODE_LEN;

/// Hierarchy of boxes around triangles.
#[derive(Clone, Debug, PartialEq)]
pub struct Hierarchy {
    /// Nodes in depth-first order.
    pub nodes: Vec<[f32; NODE_LEN]>,
    /// Triangles in the order of the leaves.
    pub order: Vec<u32>,
}

/// Builds a hierarchy with the settings of `medium_build`, without its clock, which browsers do not
/// have.
fn build(triangles: &[Triangle]) -> Bvh2 {
    let settings = BvhBuildParams::medium_build();
    let indices: Vec<u32> = (0..triangles.len() as u32).collect();
    let mut built = PlocBuilder::with_capacity(triangles.len()).build(
        settings.ploc_search_distance,
        triangles,
        indices,
        settings.sort_precision,
        settings.search_depth_threshold,
    );
    let mut optimiser = ReinsertionOptimizer::default();
    let ratio = settings.reinsertion_batch_ratio;
    optimiser.run(&mut built, ratio, None);
    collapse(&mut built, settings.max_prims_per_leaf.clamp(1, 255), settings.collapse_traversal_cost);
    optimiser.run(&mut built, ratio * settings.post_collapse_reinsertion_batch_ratio_multiplier, None);
    built
}

impl Hierarchy {
    /// Hierarchy of triangles with these corners; the same for the same triangles on every machine.
    ///
    /// # Panics
    ///
    /// Without triangles.
    pub fn new(triangles: &[[[f32; 3]; 3]]) -> Self {
        assert!(!triangles.is_empty(), "rays need a surface");
        let corners = |[a, b, c]: [[f32; 3]; 3]| Triangle { v0: a.into(), v1: b.into(), v2: c.into() };
        let triangles: Vec<Triangle> = triangles.iter().map(|triangle| corners(*triangle)).collect();
        let built = build(&triangles);
        let mut hierarchy = Self { nodes: Vec::with_capacity(built.nodes.len()), order: Vec::new() };
        hierarchy.append(&built);
        hierarchy
    }

    /// Appends all nodes in depth-first order.
    fn append(&mut self, built: &Bvh2) {
        // Inner nodes with incomplete descendants, each with the number of open nodes before its
        // children.
        let mut open: Vec<usize> = Vec::new();
        let mut rest = vec![(0_usize, 0_usize)];
        while let Some((index, depth)) = rest.pop() {
            self.close(&mut open, depth);
            let node = &built.nodes[index];
            let (first, count) = (node.first_index as usize, node.prim_count as usize);
            let triangles = match count {
                0 => {
                    open.push(self.nodes.len());
                    rest.extend([(first + 1, depth + 1), (first, depth + 1)]);
                    &[]
                }
                _ => &built.primitive_indices[first..first + count],
            };
            self.nodes.push(numbers(node.aabb().min, self.order.len(), node.aabb().max, count));
            self.order.extend(triangles);
        }
        self.close(&mut open, 0);
    }

    /// Sets the next node in open nodes of this depth and deeper ones.
    fn close(&mut self, open: &mut Vec<usize>, depth: usize) {
        for node in open.drain(depth..) {
            self.nodes[node][3] = self.nodes.len() as f32;
        }
    }
}

fn numbers(min: Vec3A, index: usize, max: Vec3A, count: usize) -> [f32; NODE_LEN] {
    [min.x, min.y, min.z, index as f32, max.x, max.y, max.z, count as f32]
}
