//! Symmetry of the cube: each face sees the light as the first one does, after a rotation of the
//! cube or a mirror image. So only rows of the first face are stored, and a weight serves six rows.

use specula_core::cubemap::{FACE_COUNT, direction, face_of, texel_index, texel_of_index};

/// Nodes and rows side by side: for each node of the pyramid the six that lie to the faces as it
/// lies to the first, and for each row of the first face the rows of all faces. Element 6 k + f of
/// a list belongs to node or row k and face f.
#[derive(Debug)]
pub struct SideBySide {
    /// Node at each place.
    pub nodes: Vec<u32>,
    /// Places of each node: 6 j + f is the place of node j in the frame of face f.
    pub places_of_nodes: Vec<u32>,
    /// Row at each place.
    pub rows: Vec<u32>,
    /// Place of each row.
    pub places_of_rows: Vec<u32>,
}

impl SideBySide {
    /// Lists for pyramid levels of a resolution and a first node, and rows of levels of a
    /// resolution and a first row.
    pub(crate) fn new(pyramid: &[(usize, usize)], levels: impl Iterator<Item = (usize, usize)>) -> Self {
        let (last, first) = pyramid[pyramid.len() - 1];
        let count = (first + FACE_COUNT * last * last) as u32;
        let faces = |node: u32| (0..FACE_COUNT).map(move |face| node_seen_from(face, node, pyramid));
        let nodes: Vec<u32> = (0..count).flat_map(faces).collect();
        let mut rows = Vec::new();
        for (resolution, first) in levels {
            let area = resolution * resolution;
            for texel in 0..area {
                rows.extend((0..FACE_COUNT).map(|face| (first + face * area + texel) as u32));
            }
        }
        let mut places_of_nodes = vec![0; nodes.len()];
        let mut places_of_rows = vec![0; rows.len()];
        for (place, node) in nodes.iter().enumerate() {
            places_of_nodes[FACE_COUNT * *node as usize + place % FACE_COUNT] = place as u32;
        }
        for (place, row) in rows.iter().enumerate() {
            places_of_rows[*row as usize] = place as u32;
        }
        Self { nodes, places_of_nodes, rows, places_of_rows }
    }
}

/// Node of a pyramid that lies to a face as a node lies to the first. Levels have a resolution and
/// a first node.
pub(crate) fn node_seen_from(face: usize, node: u32, pyramid: &[(usize, usize)]) -> u32 {
    let level = pyramid.partition_point(|(_, first)| *first <= node as usize) - 1;
    let (resolution, first) = pyramid[level];
    let (of, column, row) = texel_of_index(node as usize - first, resolution);
    let centre = |k: usize| (2 * k + 1) as f64 / resolution as f64 - 1.0;
    let (of, u, v) = face_of(turned(face, direction(of, centre(column), centre(row))));
    let texel = |place: f64| ((place + 1.0) / 2.0 * resolution as f64) as usize;
    (first + texel_index(of, texel(u), texel(v), resolution)) as u32
}

/// Direction under the map of the cube onto itself that takes the first face to `face`, columns to
/// columns and rows to rows.
fn turned(face: usize, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let major = direction(face, 0.0, 0.0);
    let along = |u: f64, v: f64| {
        let end = direction(face, u, v);
        [end[0] - major[0], end[1] - major[1], end[2] - major[2]]
    };
    // On the first face the columns run along −z and the rows along −y.
    let (columns, rows) = (along(1.0, 0.0), along(0.0, 1.0));
    [0, 1, 2].map(|axis| x * major[axis] - z * columns[axis] - y * rows[axis])
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::cubemap::texel_direction;

    const RESOLUTION: usize = 8;

    fn direction_of(index: usize) -> [f64; 3] {
        let area = RESOLUTION * RESOLUTION;
        texel_direction(index / area, index % RESOLUTION, index % area / RESOLUTION, RESOLUTION)
    }

    fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    }

    #[test]
    fn a_face_sees_nodes_under_the_angles_of_the_first() {
        let count = FACE_COUNT * RESOLUTION * RESOLUTION;
        let area = RESOLUTION * RESOLUTION;
        for row in 0..count {
            let (face, first) = (row / area, row % area);
            for node in 0..count {
                let seen = node_seen_from(face, node as u32, &[(RESOLUTION, 0)]) as usize;
                let [expected, found] =
                    [(first, node), (row, seen)].map(|(row, node)| dot(direction_of(row), direction_of(node)));
                assert!((expected - found).abs() < 1e-14, "row {row}, node {node}: {found}, not {expected}");
            }
        }
    }

    #[test]
    fn every_face_sees_every_node_once() {
        let pyramid = [(8, 0), (4, 6 * 64)];
        let levels = [(4, 0), (2, 6 * 16)];
        let SideBySide { nodes, places_of_nodes, rows, places_of_rows } = SideBySide::new(&pyramid, levels.into_iter());
        for (place, node) in nodes.iter().enumerate() {
            assert_eq!(places_of_nodes[FACE_COUNT * *node as usize + place % FACE_COUNT] as usize, place);
        }
        for (place, row) in rows.iter().enumerate() {
            assert_eq!(places_of_rows[*row as usize] as usize, place);
        }
        for face in 0..FACE_COUNT {
            let mut seen: Vec<u32> = nodes.iter().skip(face).step_by(FACE_COUNT).copied().collect();
            seen.sort_unstable();
            assert!(seen.into_iter().eq(0..6 * 80), "face {face}");
        }
    }
}
