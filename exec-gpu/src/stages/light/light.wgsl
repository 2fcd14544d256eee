// Declarations: lookup of a light, whose levels are stored one after the other, six faces with an
// apron each.

// Lower of two neighbouring levels, and the share of the upper.
struct Between {
    level: u32,
    share: f32,
}

fn texel(index: u32) -> vec3f {
    return color_of(texels[min(index, arrayLength(&texels) - 1u)]);
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

fn levels_at(roughness: f32) -> Between {
    let position = level_of(roughness);
    let sharp = clamp(floor(position), 0.0, f32(LEVELS - 2u));
    return Between(u32(sharp), position - sharp);
}

fn radiance(direction: vec3f, roughness: f32) -> vec3f {
    let between = levels_at(roughness);
    let sharp = radiance_in_level(direction, between.level);
    let blurred = radiance_in_level(direction, between.level + 1u);
    return mix(sharp, blurred, between.share);
}

// Irradiance / pi along a normal, from the last map.
fn irradiance(normal: vec3f) -> vec3f {
    return radiance_in_level(normal, IRRADIANCE_LEVEL);
}
