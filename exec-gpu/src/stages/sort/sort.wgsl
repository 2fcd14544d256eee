// Stable radix sort of pairs, one pass of DIGIT_BITS bits.
//
// Threads: one invocation a column of COLUMN consecutive elements, so that no invocation waits for
// another; ranks follow from sums over the columns before.
// Memory: a counter for each digit and invocation in workgroup memory.
// Inputs: keys and items; number of elements, of the host or of the step counters.
// Outputs: counts of digits, then keys and items sorted by the digit.

const DIGITS: u32 = 1u << DIGIT_BITS;

struct SortPass {
    // Elements, at most.
    count: u32,
    columns: u32,
    shift: u32,
    mask: u32,
    // Whether the number of elements is read from the step counters.
    is_counted: u32,
}

@group(0) @binding(0) var<uniform> pass_: SortPass;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> items: array<u32>;
@group(0) @binding(3) var<storage, read_write> starts: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_items: array<u32>;
@group(0) @binding(6) var<storage, read> counters: array<u32>;

// Counters of each digit, one for each invocation.
var<workgroup> digit_counters: array<u32, DIGITS * SORT_GROUP>;

fn element_count() -> u32 {
    return select(pass_.count, counters[STORED_PAIRS], pass_.is_counted != 0u);
}

fn counter_of(key: u32, local: u32) -> u32 {
    return ((key >> pass_.shift) & pass_.mask) * SORT_GROUP + local;
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
