// Exclusive prefix sums: block by block, then the sums of the blocks are added.

const PER_THREAD: u32 = SCAN_BLOCK / GROUP;
// Invocations whose sums are added up one after the other, before those of whole segments are.
const SEGMENT: u32 = 16u;

struct ScanSize {
    count: u32,
}

@group(0) @binding(0) var<uniform> size: ScanSize;
@group(0) @binding(1) var<storage, read_write> numbers: array<u32>;
@group(0) @binding(2) var<storage, read_write> block_sums: array<u32>;

var<workgroup> sums: array<u32, GROUP>;
var<workgroup> segment_sums: array<u32, GROUP / SEGMENT>;

// Replaces every block by its exclusive sums; its total goes to `block_sums`.
@compute @workgroup_size(GROUP)
fn scan_blocks(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let first = linear_index(group, groups, local) * PER_THREAD;
    let end = min(first + PER_THREAD, size.count);
    var sum = 0u;
    for (var place = first; place < end; place++) {
        sum += numbers[place];
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
    for (var place = first; place < end; place++) {
        let number = numbers[place];
        numbers[place] = before;
        before += number;
    }
}

// Adds to every number of a block the sum of the blocks before.
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
    for (var place = first; place < end; place++) {
        numbers[place] += before;
    }
}
