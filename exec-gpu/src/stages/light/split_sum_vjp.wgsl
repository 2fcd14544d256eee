// Declarations: gradient of the split-sum table.

// Gradient of `split_sum` with respect to n·v and roughness.
fn split_sum_vjp(n_dot_v: f32, roughness: f32, grad: vec2f) -> vec2f {
    let cell = split_sum_cell(n_dot_v, roughness);
    let lower_first = cell.first + SPLIT_SUM_SIZE;
    let slopes = split_sum_slopes(
        split_sums[cell.first],
        split_sums[cell.first + 1u],
        split_sums[lower_first],
        split_sums[lower_first + 1u],
        cell.share,
        grad,
    );
    return slopes * cell.is_free * f32(SPLIT_SUM_SIZE);
}
