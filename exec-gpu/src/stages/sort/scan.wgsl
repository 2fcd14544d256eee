// Exclusive prefix sums: block by block, then the sums of the previous blocks are added.
//
// Threads: one workgroup a block of SCAN_BLOCK numbers, one invocation PER_THREAD of them.
// Memory: sums of invocations and of segments of SEGMENT invocations in workgroup memory.
// Inputs, outputs: the numbers, in place; the sum of each block.

const PER_THREAD: u32 = SCAN_BLOCK / GROUP;
// Invocations of a segment, whose sums are added one after the other.
const SEGMENT: u32 = 16u;

@group(0) @binding(0) var<uniform> size: Count;
@group(0) @binding(1) var<storage, read_write> numbers: array<u32>;
@group(0) @binding(2) var<storage, read_write> block_sums: array<u32>;

var<workgroup> sums: array<u32, GROUP>;
var<workgroup> segment_sums: array<u32, GROUP / SEGMENT>;

// Replaces every block by its exclusive prefix sums, and stores its total.
@compute @workgroup_size(GROUP)
fn scan_blocks(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let first = linear_index(group, groups, local) * PER_THREAD;
    let end = min(first + PER_THREAD, size.count);
    var sum = 0u;
    for (var index = first; index < end; index++) {
        sum += numbers[index];
    }
    sums[local] = sum;
    workgroupBarrier();
    let segment = local / SEGMENT;
    var before = 0u;
    for (var other = segment * SEGMENT; other < local; other++) {
        before += sums[other];
    }
    if local % SEGMENT == SEGMENT - 1u {
        segment_sums[segment] = before + sum;
    }
    workgroupBarrier();
    for (var other = 0u; other < segment; other++) {
        before += segment_sums[other];
    }
    let block = group.y * groups.x + group.x;
    if local == GROUP - 1u && block * SCAN_BLOCK < size.count {
        block_sums[block] = before + sum;
    }
    for (var index = first; index < end; index++) {
        let number = numbers[index];
        numbers[index] = before;
        before += number;
    }
}

// Adds to every number of a block the sum of the previous blocks.
@compute @workgroup_size(GROUP)
fn add_block_sums(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let first = linear_index(group, groups, local) * PER_THREAD;
    let end = min(first + PER_THREAD, size.count);
    if first >= end {
        return;
    }
    let before = block_sums[group.y * groups.x + group.x];
    for (var index = first; index < end; index++) {
        numbers[index] += before;
    }
}
