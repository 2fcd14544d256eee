// Exclusive sums of a row of numbers: block by block, then the blocks' own sums are added.

const PER_THREAD: u32 = SCAN_BLOCK / GROUP;

struct ScanSize {
    count: u32,
}

@group(0) @binding(0) var<uniform> size: ScanSize;
@group(0) @binding(1) var<storage, read_write> numbers: array<u32>;
@group(0) @binding(2) var<storage, read_write> block_sums: array<u32>;

var<workgroup> sums: array<u32, GROUP>;

// Every block becomes its exclusive sums; what it came to goes to `block_sums`.
@compute @workgroup_size(GROUP)
fn scan_blocks(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let first = linear_index(group, groups, local) * PER_THREAD;
    var own: array<u32, PER_THREAD>;
    var sum = 0u;
    for (var k = 0u; k < PER_THREAD; k++) {
        own[k] = sum;
        if first + k < size.count {
            sum += numbers[first + k];
        }
    }
    sums[local] = sum;
    workgroupBarrier();
    var before = 0u;
    for (var reach = 1u; reach < GROUP; reach *= 2u) {
        if local >= reach {
            before = sums[local - reach];
        } else {
            before = 0u;
        }
        workgroupBarrier();
        sums[local] += before;
        workgroupBarrier();
    }
    let start = sums[local] - sum;
    for (var k = 0u; k < PER_THREAD; k++) {
        if first + k < size.count {
            numbers[first + k] = start + own[k];
        }
    }
    let block = group.y * groups.x + group.x;
    if local == GROUP - 1u && block * SCAN_BLOCK < size.count {
        block_sums[block] = sums[local];
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
    if first >= size.count {
        return;
    }
    let before = block_sums[group.y * groups.x + group.x];
    for (var k = 0u; k < PER_THREAD; k++) {
        if first + k < size.count {
            numbers[first + k] += before;
        }
    }
}
