// Declarations: gradient of a pixel of a physical material that no light reaches.

fn lit_pixel_vjp(surface: SurfaceOfPixel, point: vec2f, light: vec3f, grad: vec3f) -> LitPixelGrad {
    return LitPixelGrad(vec3f(0.0), vec3f(0.0), vec3f(0.0), 0.0, vec3f(0.0), 0.0);
}
