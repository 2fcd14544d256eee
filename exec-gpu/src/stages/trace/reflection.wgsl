// Declarations: reflection of a kernel's pixel, in the layout of the stage `trace`.

fn reflection_number(k: u32) -> f32 {
    return reflections[k * camera.size.x * camera.size.y + pixel];
}
