// Declarations: exposure and pixels of the stage `expose` and its gradient.

@group(0) @binding(0) var<uniform> exposure: ExposureSettings;
@group(0) @binding(1) var<storage, read> blended: array<f32>;
@group(0) @binding(2) var<storage, read> colors: array<f32>;

fn pixel_count() -> u32 {
    return exposure.size.x * exposure.size.y;
}

// Colour of a pixel before exposure.
fn color_at(index: u32) -> vec3f {
    let size = pixel_count();
    return vec3f(colors[index], colors[index + size], colors[index + 2u * size]);
}

fn transmittance_at(index: u32) -> f32 {
    return blended[CHANNELS * pixel_count() + index];
}
