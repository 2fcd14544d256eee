// Sampling of split children, which move and shrink (stage `densify`).
//
// Threads: one invocation a child of the chunk.
// Inputs: children, prefix sums of the split flags, noise.
// Outputs: means and log scales of split children, in place.

@group(0) @binding(0) var<uniform> chunk: SplitChunk;
@group(0) @binding(1) var<storage, read> children: array<u32>;
@group(0) @binding(2) var<storage, read> offsets: array<u32>;
// Three numbers for each split child, in the order of the parents.
@group(0) @binding(3) var<storage, read> noise: array<f32>;
@group(0) @binding(4) var<storage, read_write> values: array<f32>;

// Index in its chunk.
var<private> gaussian: u32;

fn set_plane(number: u32, value: f32) {
    values[(gaussian / BLOCK * PLANES + number) * BLOCK + gaussian % BLOCK] = value;
}

@compute @workgroup_size(GROUP)
fn sample_split_children(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    gaussian = linear_index(group, groups, local);
    if gaussian >= chunk.count {
        return;
    }
    let entry = children[chunk.first + gaussian];
    if entry % ORIGINS < FIRST_SPLIT {
        return;
    }
    let parent = entry / ORIGINS;
    let split = offsets[2u * chunk.old_count + parent] - offsets[2u * chunk.old_count];
    let first = 3u * (2u * split + entry % ORIGINS - FIRST_SPLIT);
    let child = split_child(vec3f(noise[first], noise[first + 1u], noise[first + 2u]));
    for (var axis = 0u; axis < 3u; axis++) {
        set_plane(MEAN + axis, child.mean[axis]);
        set_plane(LOG_SCALE + axis, child.log_scales[axis]);
    }
}
