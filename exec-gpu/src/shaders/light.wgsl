// Looking light up: levels one after the other, each six faces with an apron.

fn texel(index: u32) -> vec3f {
    return texels[min(index, arrayLength(&texels) - 1u)].xyz;
}

fn radiance_in_level(direction: vec3f, level: u32) -> vec3f {
    let resolution = level_resolution(level);
    let at = texels_at(direction, f32(resolution));
    let first = level_start(level) + u32(at.texel);
    let width = resolution + 2u;
    let upper = mix(texel(first), texel(first + 1u), at.right);
    let lower = mix(texel(first + width), texel(first + width + 1u), at.right);
    return mix(upper, lower, at.lower);
}

fn radiance(direction: vec3f, roughness: f32) -> vec3f {
    let position = level_of(roughness);
    let sharp = clamp(floor(position), 0.0, f32(LEVELS - 2u));
    let level = u32(sharp);
    return mix(radiance_in_level(direction, level), radiance_in_level(direction, level + 1u), position - sharp);
}
