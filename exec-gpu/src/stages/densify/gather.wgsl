// Gathering of the children's numbers from those of their parents (stage `densify`).
//
// Threads: one invocation a number of the new chunk.
// Inputs: children, and a chunk of their parents' numbers.
// Outputs: numbers of the children whose parents are in the chunk, bit by bit.

@group(0) @binding(0) var<uniform> gathering: Gathering;
@group(0) @binding(1) var<storage, read> children: array<u32>;
@group(0) @binding(2) var<storage, read> old: array<u32>;
@group(0) @binding(3) var<storage, read_write> gathered: array<u32>;

@compute @workgroup_size(GROUP)
fn gather(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let number = linear_index(group, groups, local);
    if number >= gathering.numbers {
        return;
    }
    let row = number / BLOCK;
    let index = gathering.first + row / PLANES * BLOCK + number % BLOCK;
    var bits = 0u;
    if index < gathering.end {
        let child = children[index];
        if child / ORIGINS < gathering.old_first || child / ORIGINS >= gathering.old_end {
            return;
        }
        let parent = child / ORIGINS - gathering.old_first;
        if gathering.keeps_new != 0u || child % ORIGINS == KEPT {
            bits = old[(parent / BLOCK * PLANES + row % PLANES) * BLOCK + parent % BLOCK];
        }
    }
    gathered[number] = bits;
}
