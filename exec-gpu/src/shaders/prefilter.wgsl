// A sparse matrix times texels: one invocation a row.

struct Product {
    row_count: u32,
    source_first: u32,
    out_first: u32,
}

@group(0) @binding(0) var<uniform> product: Product;
@group(0) @binding(1) var<storage, read> starts: array<u32>;
@group(0) @binding(2) var<storage, read> columns: array<u32>;
@group(0) @binding(3) var<storage, read> weights: array<f32>;
@group(0) @binding(4) var<storage, read_write> texels: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> padded: array<vec4f>;

fn product_of_row(row: u32) -> vec4f {
    var sum = vec4f(0.0);
    for (var tap = starts[row]; tap < starts[row + 1u]; tap++) {
        sum += weights[tap] * texels[product.source_first + columns[tap]];
    }
    return sum;
}

// From some texels to others.
@compute @workgroup_size(GROUP)
fn filter_texels(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let row = linear_index(group, groups, local);
    if row < product.row_count {
        texels[product.out_first + row] = product_of_row(row);
    }
}

// The same, added to what is there.
@compute @workgroup_size(GROUP)
fn add_filtered_texels(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let row = linear_index(group, groups, local);
    if row < product.row_count {
        texels[product.out_first + row] += product_of_row(row);
    }
}

// From texels to levels with aprons.
@compute @workgroup_size(GROUP)
fn pad_texels(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let row = linear_index(group, groups, local);
    if row < product.row_count {
        padded[row] = product_of_row(row);
    }
}
