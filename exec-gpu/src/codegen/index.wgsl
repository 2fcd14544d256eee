// Numbers of invocations that a dispatch cannot count along one axis alone.

fn linear_index(group: vec3u, groups: vec3u, local: u32) -> u32 {
    return (group.y * groups.x + group.x) * GROUP + local;
}
