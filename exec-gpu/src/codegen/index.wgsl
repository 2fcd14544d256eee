// Declarations: linear index of an invocation. A dispatch counts at most 65 535 workgroups along
// one axis, so one-dimensional dispatches are grids of rows.

fn linear_index(group: vec3u, groups: vec3u, local: u32) -> u32 {
    return (group.y * groups.x + group.x) * GROUP + local;
}
