// Declarations: colour of a pixel of a physical material.

fn lit_pixel(surface: SurfaceOfPixel, point: vec2f, light: vec3f) -> LitPixel {
    let facing = facing_of_pixel(point);
    let irradiance = radiance_in_level(facing.normal, IRRADIANCE_LEVEL);
    let split_sum = split_sum(facing.n_dot_v, surface.roughness);
    let lit = physical_color_of_pixel(surface.base, surface.tint, light, irradiance, split_sum, surface.coverage);
    return LitPixel(lit.color, lit.specular);
}

fn irradiance_of_pixel(coverage: f32, point: vec2f) -> vec3f {
    return radiance_in_level(facing_of_pixel(point).normal, IRRADIANCE_LEVEL) * blended(AMBIENT_CHANNEL);
}
