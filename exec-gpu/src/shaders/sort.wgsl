// A stable radix sort of pairs, four bits a pass (Harada & Howes 2011): each thread counts the digits of its own
// elements, which lie side by side, so that ranks follow from sums over the threads before.

const DIGITS: u32 = 16u;
// Counters of digits d and d + 8 share a word: no block has more than 65535 elements.
const WORDS: u32 = DIGITS / 2u;
const PER_THREAD: u32 = SORT_BLOCK / GROUP;

struct SortPass {
    count: u32,
    shift: u32,
    blocks: u32,
}

@group(0) @binding(0) var<uniform> pass_: SortPass;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> items: array<u32>;
@group(0) @binding(3) var<storage, read_write> starts: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_items: array<u32>;

var<workgroup> counters: array<u32, WORDS * GROUP>;

fn digit_of(key: u32) -> u32 {
    return (key >> pass_.shift) & (DIGITS - 1u);
}
fn counter_of(digit: u32, local: u32) -> u32 {
    return (digit % WORDS) * GROUP + local;
}
fn half_of(digit: u32) -> u32 {
    return digit / WORDS * 16u;
}

fn count_own(first: u32, local: u32) {
    for (var word = 0u; word < WORDS; word++) {
        counters[word * GROUP + local] = 0u;
    }
    for (var k = 0u; k < PER_THREAD; k++) {
        if first + k < pass_.count {
            let digit = digit_of(keys[first + k]);
            counters[counter_of(digit, local)] += 1u << half_of(digit);
        }
    }
}

// How many elements of a block have each digit: digit after digit, block after block.
@compute @workgroup_size(GROUP)
fn count_digits(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group.y * groups.x + group.x;
    count_own(linear_index(group, groups, local) * PER_THREAD, local);
    workgroupBarrier();
    if local < WORDS && block < pass_.blocks {
        var sum = 0u;
        for (var thread = 0u; thread < GROUP; thread++) {
            sum += counters[local * GROUP + thread];
        }
        starts[local * pass_.blocks + block] = sum & 0xffffu;
        starts[(local + WORDS) * pass_.blocks + block] = sum >> 16u;
    }
}

// Moves every element to its place; `starts` are the exclusive sums of what `count_digits` left.
@compute @workgroup_size(GROUP)
fn move_elements(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group.y * groups.x + group.x;
    let first = linear_index(group, groups, local) * PER_THREAD;
    count_own(first, local);
    var own: array<u32, WORDS>;
    for (var word = 0u; word < WORDS; word++) {
        own[word] = counters[word * GROUP + local];
    }
    workgroupBarrier();
    var before: array<u32, WORDS>;
    for (var reach = 1u; reach < GROUP; reach *= 2u) {
        for (var word = 0u; word < WORDS; word++) {
            before[word] = 0u;
            if local >= reach {
                before[word] = counters[word * GROUP + local - reach];
            }
        }
        workgroupBarrier();
        for (var word = 0u; word < WORDS; word++) {
            counters[word * GROUP + local] += before[word];
        }
        workgroupBarrier();
    }
    for (var word = 0u; word < WORDS; word++) {
        counters[word * GROUP + local] -= own[word];
    }
    for (var k = 0u; k < PER_THREAD; k++) {
        if first + k < pass_.count {
            let key = keys[first + k];
            let digit = digit_of(key);
            let counter = counter_of(digit, local);
            let rank = (counters[counter] >> half_of(digit)) & 0xffffu;
            counters[counter] += 1u << half_of(digit);
            let place = starts[digit * pass_.blocks + block] + rank;
            sorted_keys[place] = key;
            sorted_items[place] = items[first + k];
        }
    }
}
