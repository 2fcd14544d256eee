// Product of a sparse matrix with texels (stages `prefilter` and `prefilter_vjp`).
//
// Threads: ROW_SUMS invocations a row, each with every ROW_SUMS-th tap, because some rows are very
// long.
// Memory: partial sums of the rows in workgroup memory, added up in pairs.
// Inputs: rows of the matrix, texels.
// Outputs: texels, in place.
// Variants: the product is stored, added, or stored in another array as levels with aprons.

@group(0) @binding(0) var<uniform> product: Product;
@group(0) @binding(1) var<storage, read> starts: array<u32>;
@group(0) @binding(2) var<storage, read> columns: array<u32>;
@group(0) @binding(3) var<storage, read> weights: array<f32>;
@group(0) @binding(4) var<storage, read_write> texels: array<vec4f>;

var<workgroup> sums: array<vec4f, GROUP>;

// Product of a row by neighbouring invocations; complete in the first of them.
fn product_of_row(row: u32, local: u32) -> vec4f {
    var sum = vec4f(0.0);
    if row < product.row_count {
        let end = starts[row + 1u];
        for (var tap = starts[row] + local % ROW_SUMS; tap < end; tap += ROW_SUMS) {
            sum += weights[tap] * texels[product.source_first + columns[tap]];
        }
    }
    sums[local] = sum;
    for (var apart = 1u; apart < ROW_SUMS; apart *= 2u) {
        workgroupBarrier();
        if local % (2u * apart) == 0u {
            sum += sums[local + apart];
            sums[local] = sum;
        }
    }
    return sum;
}

// `store_product` is the kernel's destination.
@compute @workgroup_size(GROUP)
fn multiply_rows(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let row = linear_index(group, groups, local) / ROW_SUMS;
    let texel = product_of_row(row, local);
    if local % ROW_SUMS == 0u && row < product.row_count {
        store_product(product.out_first + row, texel);
    }
}
