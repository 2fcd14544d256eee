// Declarations: no surfaces of another renderer.

fn is_hidden(depth: f32, point: vec2f) -> bool {
    return false;
}
