// Gaussians that look light up themselves.

@group(0) @binding(4) var<storage, read> texels: array<vec4f>;
@group(0) @binding(5) var<storage, read> split_sums: array<vec2f>;

// The split-sum table at n·v and roughness.
fn split_sum(n_dot_v: f32, roughness: f32) -> vec2f {
    let size = f32(SPLIT_SUM_SIZE);
    let at = clamp(vec2f(n_dot_v, roughness) * size - 0.5, vec2f(0.0), vec2f(size - 1.0));
    let cell = min(floor(at), vec2f(size - 2.0));
    let first = u32(cell.y) * SPLIT_SUM_SIZE + u32(cell.x);
    let share = at - cell;
    let upper = mix(split_sums[first], split_sums[first + 1u], share.x);
    let lower = mix(split_sums[first + SPLIT_SUM_SIZE], split_sums[first + SPLIT_SUM_SIZE + 1u], share.x);
    return mix(upper, lower, share.y);
}

fn channels_of() -> Channels {
    let surface = surface_of();
    let specular = radiance(surface.reflection_dir, surface.roughness);
    var ambient = vec3f(0.0);
    var reflected = vec2f(0.0);
    if IS_OFFICIAL {
        ambient = radiance_in_level(surface.normal, LEVELS);
        reflected = split_sum(surface.n_dot_v, surface.roughness);
    }
    return lit_colors_of(specular, ambient, reflected);
}
