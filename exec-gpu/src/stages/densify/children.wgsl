// Children: the Gaussians after densification. Those that stay come first, then copies, then parts
// of what is split, two each; a child is its parent's index and its origin.

struct Size {
    // Of all Gaussians.
    count: u32,
    // First Gaussian of the chunk, and their number.
    first: u32,
    piece: u32,
}

@group(0) @binding(0) var<uniform> size: Size;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read> actions: array<u32>;
// For each Gaussian whether it stays, then whether it is copied, then whether it is split; later
// their sums.
@group(0) @binding(3) var<storage, read_write> offsets: array<u32>;
// The lowest coordinates and the highest, as bits that sort.
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
    let number = size.first + gaussian;
    let action = actions[number];
    offsets[number] = select(0u, 1u, action == KEEP || action == CLONE);
    offsets[size.count + number] = select(0u, 1u, action == CLONE);
    offsets[2u * size.count + number] = select(0u, 1u, action == SPLIT);
}

// The box around all means; coordinates that are not finite count for nothing. One invocation for a
// column.
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

// Number of the cell of the Gaussian's mean along an axis.
fn cell_of(axis: u32) -> u32 {
    let low = number_of_ordered(atomicLoad(&bounds[axis]));
    let high = number_of_ordered(atomicLoad(&bounds[3u + axis]));
    return u32(cell_at(plane(MEAN + axis), low, high));
}

fn put(place: u32, origin: u32, own_code: u32) {
    children[place] = (size.first + gaussian) * ORIGINS + origin;
    codes[place] = own_code;
}

// Puts the children of every Gaussian in their offsets, of which `offsets` are now the sums.
@compute @workgroup_size(GROUP)
fn put_children(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    gaussian = linear_index(group, groups, local);
    if gaussian >= size.piece {
        return;
    }
    let number = size.first + gaussian;
    let action = actions[number];
    if action == PRUNE {
        return;
    }
    let own_code = morton_code(cell_of(0u), cell_of(1u), cell_of(2u));
    if action == SPLIT {
        let first_part = offsets[2u * size.count];
        let split = offsets[2u * size.count + number] - first_part;
        split_parents[split] = number;
        put(first_part + 2u * split, FIRST_PART, own_code);
        put(first_part + 2u * split + 1u, FIRST_PART + 1u, own_code);
        return;
    }
    put(offsets[number], KEPT, own_code);
    if action == CLONE {
        put(offsets[size.count + number], COPIED, own_code);
    }
}
