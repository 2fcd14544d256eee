// Stable radix sort of pairs, one pass of DIGIT_BITS bits, without barriers.
//
// Threads: one invocation a column of COLUMN consecutive elements, so no invocation waits for
// another; ranks follow from sums over the previous columns.
// Memory: a counter for each digit and invocation in workgroup memory.
// Inputs: keys and items; number of elements, of the host or of the step counters.
// Outputs: counts of digits, then keys and items sorted by the digit.

const DIGITS: u32 = 1u << DIGIT_BITS;

// Counters of each digit, one for each invocation.
var<workgroup> digit_counters: array<u32, DIGITS * SORT_GROUP>;

fn counter_of(key: u32, local: u32) -> u32 {
    return digit_of(key) * SORT_GROUP + local;
}

// Counts the digits of each column: digit after digit, column after column.
@compute @workgroup_size(SORT_GROUP)
fn count_digits(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let column = (group.y * groups.x + group.x) * SORT_GROUP + local;
    if column >= pass_.columns {
        return;
    }
    for (var digit = 0u; digit < DIGITS; digit++) {
        digit_counters[digit * SORT_GROUP + local] = 0u;
    }
    let first = column * COLUMN;
    let end = min(first + COLUMN, element_count());
    for (var element = first; element < end; element++) {
        digit_counters[counter_of(keys[element], local)] += 1u;
    }
    for (var digit = 0u; digit < DIGITS; digit++) {
        starts[digit * pass_.columns + column] = digit_counters[digit * SORT_GROUP + local];
    }
}

// Moves every element to its rank; `starts` are the exclusive prefix sums of the counts.
@compute @workgroup_size(SORT_GROUP)
fn move_elements(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let column = (group.y * groups.x + group.x) * SORT_GROUP + local;
    if column >= pass_.columns {
        return;
    }
    for (var digit = 0u; digit < DIGITS; digit++) {
        digit_counters[digit * SORT_GROUP + local] = starts[digit * pass_.columns + column];
    }
    let first = column * COLUMN;
    let end = min(first + COLUMN, element_count());
    for (var element = first; element < end; element++) {
        let key = keys[element];
        let counter = counter_of(key, local);
        let rank = digit_counters[counter];
        digit_counters[counter] = rank + 1u;
        sorted_keys[rank] = key;
        sorted_items[rank] = items[element];
    }
}
