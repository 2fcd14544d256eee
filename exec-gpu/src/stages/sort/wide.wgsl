// Stable radix sort of pairs, one pass, with ranks within rows of elements.
//
// Threads: one workgroup a run of ROWS × GROUP consecutive elements, which it takes row by row; an
// invocation has one element of each row.
// Memory: for each digit the rank of its next element, and a bit for each invocation that has the
// digit, in workgroup memory: as many digits as invocations.
// Inputs: keys and items; number of elements, of the host or of the step counters.
// Outputs: counts of digits, then keys and items sorted by the digit.

const WORDS: u32 = GROUP / 32u;

var<workgroup> next_ranks: array<atomic<u32>, GROUP>;
// Word after word, each of all digits.
var<workgroup> holders: array<atomic<u32>, WORDS * GROUP>;

// Counts the digits of each run: digit after digit, run after run.
@compute @workgroup_size(GROUP)
fn count_digits(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let run = group.y * groups.x + group.x;
    atomicStore(&next_ranks[local], 0u);
    workgroupBarrier();
    let first = run * ROWS * GROUP + local;
    let end = min(first + ROWS * GROUP, element_count());
    for (var element = first; element < end; element += GROUP) {
        atomicAdd(&next_ranks[digit_of(keys[element])], 1u);
    }
    workgroupBarrier();
    if run < pass_.columns {
        starts[local * pass_.columns + run] = atomicLoad(&next_ranks[local]);
    }
}

// Elements of the row with the same digit, in invocations before this one.
fn rank_in_row(digit: u32, local: u32) -> u32 {
    let own = local / 32u;
    var rank = countOneBits(atomicLoad(&holders[own * GROUP + digit]) & ((1u << (local % 32u)) - 1u));
    for (var word = 0u; word < own; word++) {
        rank += countOneBits(atomicLoad(&holders[word * GROUP + digit]));
    }
    return rank;
}

// Number of elements of the row with a digit; resets them.
fn take_holders(digit: u32) -> u32 {
    var count = 0u;
    for (var word = 0u; word < WORDS; word++) {
        count += countOneBits(atomicLoad(&holders[word * GROUP + digit]));
        atomicStore(&holders[word * GROUP + digit], 0u);
    }
    return count;
}

// Moves every element to its rank; `starts` are the exclusive prefix sums of the counts.
@compute @workgroup_size(GROUP)
fn move_elements(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let run = group.y * groups.x + group.x;
    var next_rank = 0u;
    if run < pass_.columns {
        next_rank = starts[local * pass_.columns + run];
    }
    for (var word = 0u; word < WORDS; word++) {
        atomicStore(&holders[word * GROUP + local], 0u);
    }
    let count = element_count();
    let first = run * ROWS * GROUP;
    let end = min(first + ROWS * GROUP, count);
    for (var row = first; row < end; row += GROUP) {
        let element = row + local;
        let is_there = element < end;
        var key = 0u;
        atomicStore(&next_ranks[local], next_rank);
        workgroupBarrier();
        if is_there {
            key = keys[element];
            atomicOr(&holders[local / 32u * GROUP + digit_of(key)], 1u << (local % 32u));
        }
        workgroupBarrier();
        if is_there {
            let digit = digit_of(key);
            let rank = atomicLoad(&next_ranks[digit]) + rank_in_row(digit, local);
            sorted_keys[rank] = key;
            sorted_items[rank] = items[element];
        }
        workgroupBarrier();
        next_rank += take_holders(local);
    }
}
