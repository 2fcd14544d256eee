// Declarations: surfaces of another renderer, which hide splats pixel by pixel.

@group(0) @binding(7) var<storage, read> occlusion: array<f32>;

fn is_hidden(depth: f32, point: vec2f) -> bool {
    let surface = occlusion[u32(point.y) * camera.size.x + u32(point.x)];
    return hidden_by(depth, surface) != 0.0;
}
