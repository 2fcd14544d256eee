// Declarations: depth of a Gaussian's largest response in memory.

// Depth as a function of the pixel (`specula_core::order`).
struct Response {
    mean2d: vec2f,
    slope: vec2f,
    root: vec3f,
    depth: f32,
}
