// Children: the Gaussians after densification (stage `densify`).
//
// Kept Gaussians come first, then clones, then the two children of each split Gaussian; a child is
// its parent's index and its origin.
//
// Threads: `mark`, `store_children`: one invocation a Gaussian; `find_bounds`: one a column of
// COLUMN Gaussians.
// Inputs: planes and actions of the Gaussians.
// Outputs: flags of the actions, box around all means; children with Morton codes, by the exclusive
// prefix sums of the flags; split parents.

@group(0) @binding(0) var<uniform> size: ChunkSize;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read> actions: array<u32>;
// Flags of all Gaussians: kept, then cloned, then split; later their exclusive prefix sums.
@group(0) @binding(3) var<storage, read_write> offsets: array<u32>;
// Lowest and highest coordinates, as bits that sort.
@group(0) @binding(4) var<storage, read_write> bounds: array<atomic<u32>>;
// Morton codes of the parents, by which children are sorted.
@group(0) @binding(5) var<storage, read_write> codes: array<u32>;
@group(0) @binding(6) var<storage, read_write> children: array<u32>;
@group(0) @binding(7) var<storage, read_write> split_parents: array<u32>;

// Index in its chunk.
var<private> gaussian: u32;

@compute @workgroup_size(GROUP)
fn mark(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    gaussian = linear_index(group, groups, local);
    if gaussian >= size.piece {
        return;
    }
    let index = size.first + gaussian;
    let action = actions[index];
    offsets[index] = select(0u, 1u, action == KEEP || action == CLONE);
    offsets[size.count + index] = select(0u, 1u, action == CLONE);
    offsets[2u * size.count + index] = select(0u, 1u, action == SPLIT);
}

// Box around all means; coordinates that are not finite are ignored.
@compute @workgroup_size(GROUP)
fn find_bounds(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let first = linear_index(group, groups, local) * COLUMN;
    let end = min(first + COLUMN, size.piece);
    if first >= end {
        return;
    }
    for (var axis = 0u; axis < 3u; axis++) {
        var low = 0xffffffffu;
        var high = 0u;
        for (gaussian = first; gaussian < end; gaussian++) {
            let x = plane(MEAN + axis);
            if is_finite(x) {
                low = min(low, ordered_bits(x));
                high = max(high, ordered_bits(x));
            }
        }
        atomicMin(&bounds[axis], low);
        atomicMax(&bounds[3u + axis], high);
    }
}

// Index of the cell of the Gaussian's mean along an axis.
fn cell_of(axis: u32) -> u32 {
    let low = number_of_ordered(atomicLoad(&bounds[axis]));
    let high = number_of_ordered(atomicLoad(&bounds[3u + axis]));
    return u32(cell_at(plane(MEAN + axis), low, high));
}

fn store_child(child: u32, origin: u32, code: u32) {
    children[child] = (size.first + gaussian) * ORIGINS + origin;
    codes[child] = code;
}

// Stores the children of every Gaussian; `offsets` are exclusive prefix sums.
@compute @workgroup_size(GROUP)
fn store_children(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    gaussian = linear_index(group, groups, local);
    if gaussian >= size.piece {
        return;
    }
    let index = size.first + gaussian;
    let action = actions[index];
    if action == PRUNE {
        return;
    }
    let code = morton_code(cell_of(0u), cell_of(1u), cell_of(2u));
    if action == SPLIT {
        let first_split = offsets[2u * size.count];
        let split = offsets[2u * size.count + index] - first_split;
        split_parents[split] = index;
        store_child(first_split + 2u * split, FIRST_SPLIT, code);
        store_child(first_split + 2u * split + 1u, FIRST_SPLIT + 1u, code);
        return;
    }
    store_child(offsets[index], KEPT, code);
    if action == CLONE {
        store_child(offsets[size.count + index], CLONED, code);
    }
}
