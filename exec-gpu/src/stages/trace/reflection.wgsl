// Declarations: reflection of a kernel's pixel, as the stage `trace` stores it.

fn reflection_number(k: u32) -> f32 {
    return reflections[k * camera.size.x * camera.size.y + pixel];
}
