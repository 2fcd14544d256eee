// Lookup of the light by a Gaussian.

@group(0) @binding(4) var<storage, read> texels: array<Texel>;
@group(0) @binding(5) var<storage, read> split_sums: array<vec2f>;

// Four neighbouring entries of the split-sum table, by the first of them, and how far between them
// a place lies.
struct SplitSumPlace {
    first: u32,
    share: vec2f,
    // 1 where a coordinate lies inside the table, 0 where it was limited.
    is_free: vec2f,
}

// The place of n·v and roughness.
fn split_sum_place(n_dot_v: f32, roughness: f32) -> SplitSumPlace {
    let size = f32(SPLIT_SUM_SIZE);
    let free = vec2f(n_dot_v, roughness) * size - 0.5;
    let at = clamp(free, vec2f(0.0), vec2f(size - 1.0));
    let cell = min(floor(at), vec2f(size - 2.0));
    let is_free = select(vec2f(0.0), vec2f(1.0), (free > vec2f(0.0)) & (free < vec2f(size - 1.0)));
    return SplitSumPlace(u32(cell.y) * SPLIT_SUM_SIZE + u32(cell.x), at - cell, is_free);
}

fn split_sum(n_dot_v: f32, roughness: f32) -> vec2f {
    let place = split_sum_place(n_dot_v, roughness);
    let lower_first = place.first + SPLIT_SUM_SIZE;
    let upper = mix(split_sums[place.first], split_sums[place.first + 1u], place.share.x);
    let lower = mix(split_sums[lower_first], split_sums[lower_first + 1u], place.share.x);
    return mix(upper, lower, place.share.y);
}

// Light that a Gaussian looked up.
struct OwnLight {
    specular: vec3f,
    ambient: vec3f,
    split_sum: vec2f,
}

fn own_light(surface: SurfaceOf) -> OwnLight {
    let specular = radiance(surface.reflection_dir, surface.roughness);
    if IS_OFFICIAL {
        let ambient = radiance_in_level(surface.normal, LEVELS);
        return OwnLight(specular, ambient, split_sum(surface.n_dot_v, surface.roughness));
    }
    return OwnLight(specular, vec3f(0.0), vec2f(0.0));
}
