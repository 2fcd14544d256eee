// Declarations: lookup of the split-sum table.

// Position between four neighbouring entries of the split-sum table.
struct SplitSumCell {
    // Index of the upper left entry.
    first: u32,
    share: vec2f,
    // 1 if a coordinate is inside the table, 0 if it was clamped.
    is_free: vec2f,
}

fn split_sum_cell(n_dot_v: f32, roughness: f32) -> SplitSumCell {
    let size = f32(SPLIT_SUM_SIZE);
    let free = vec2f(n_dot_v, roughness) * size - 0.5;
    let at = clamp(free, vec2f(0.0), vec2f(size - 1.0));
    let corner = min(floor(at), vec2f(size - 2.0));
    let is_free = select(vec2f(0.0), vec2f(1.0), (free > vec2f(0.0)) & (free < vec2f(size - 1.0)));
    return SplitSumCell(u32(corner.y) * SPLIT_SUM_SIZE + u32(corner.x), at - corner, is_free);
}

fn split_sum(n_dot_v: f32, roughness: f32) -> vec2f {
    let cell = split_sum_cell(n_dot_v, roughness);
    let lower_first = cell.first + SPLIT_SUM_SIZE;
    let upper = mix(split_sums[cell.first], split_sums[cell.first + 1u], cell.share.x);
    let lower = mix(split_sums[lower_first], split_sums[lower_first + 1u], cell.share.x);
    return mix(upper, lower, cell.share.y);
}
