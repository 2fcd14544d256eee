// Declarations: light that other surfaces reflect onto a pixel, where no ray was traced.

fn indirect_of_pixel() -> vec3f {
    return vec3f(0.0);
}

fn visibility_of_pixel() -> f32 {
    return 1.0;
}
