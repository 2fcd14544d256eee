// Declarations: splat in memory.

// Projected Gaussian; the root of its conic is scaled for powers of two.
struct Splat {
    mean2d: vec2f,
    log2_opacity: f32,
    opacity: f32,
    root: vec3f,
    reach: f32,
    half_extent: vec2f,
    depth: f32,
    padding: f32,
}
