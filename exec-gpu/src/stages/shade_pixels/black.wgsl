// Declarations: colour of a pixel of a physical material that no light reaches.

fn lit_pixel(surface: SurfaceOfPixel, point: vec2f, light: vec3f) -> LitPixel {
    return LitPixel(vec3f(0.0), vec3f(0.0));
}

fn irradiance_of_pixel(coverage: f32, point: vec2f) -> vec3f {
    return vec3f(0.0);
}
