// The numbers of children from those of their parents, bit by bit: one invocation a number.

struct Gathering {
    // The children of a piece, and how many numbers it has.
    first: u32,
    end: u32,
    numbers: u32,
    // Whether copies and parts take their parents' numbers too; else they start from zero.
    keeps_new: u32,
    // The parents of a piece; other children are left to those of theirs.
    old_first: u32,
    old_end: u32,
}

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
    let place = gathering.first + row / PLANES * BLOCK + number % BLOCK;
    var bits = 0u;
    if place < gathering.end {
        let child = children[place];
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
