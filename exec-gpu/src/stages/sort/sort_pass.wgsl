// Declarations: one pass of a radix sort.

@group(0) @binding(0) var<uniform> pass_: SortPass;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> items: array<u32>;
@group(0) @binding(3) var<storage, read_write> starts: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_items: array<u32>;
@group(0) @binding(6) var<storage, read> counters: array<u32>;

fn element_count() -> u32 {
    return select(pass_.count, counters[STORED_PAIRS], pass_.is_counted != 0u);
}

fn digit_of(key: u32) -> u32 {
    return (key >> pass_.shift) & pass_.mask;
}
