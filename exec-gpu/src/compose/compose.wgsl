// Composition of a frame over a texture.
//
// Threads: one vertex a corner of a triangle that covers the viewport, one fragment a pixel.
// Inputs: colours and blended planes of the frame.
// Outputs: premultiplied colour and alpha, linear if the pass mixes linear light.

@group(0) @binding(0) var<uniform> picture: Picture;
@group(0) @binding(1) var<storage, read> colors: array<f32>;
@group(0) @binding(2) var<storage, read> blended: array<f32>;

struct Corner {
    @builtin(position) position: vec4f,
    // 0 at the upper left corner of the picture, 1 at the lower right one.
    @location(0) uv: vec2f,
}

@vertex
fn corner(@builtin(vertex_index) number: u32) -> Corner {
    let uv = vec2f(f32((number << 1u) & 2u), f32(number & 2u));
    return Corner(vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, 0.0, 1.0), uv);
}

// IEC 61966-2-1.
fn linear_from_srgb(srgb: vec3f) -> vec3f {
    let above = pow((max(srgb, vec3f(0.0)) + 0.055) / 1.055, vec3f(2.4));
    return select(above, srgb / 12.92, srgb <= vec3f(0.04045));
}

fn color_of(pixel: vec2u) -> vec4f {
    let index = pixel.y * picture.size.x + pixel.x;
    let plane = picture.size.x * picture.size.y;
    let alpha = 1.0 - blended[picture.transmittance * plane + index];
    let premultiplied = vec3f(colors[index], colors[plane + index], colors[2u * plane + index]);
    if picture.is_linear == 0u || alpha <= 0.0 {
        return vec4f(premultiplied, alpha);
    }
    return vec4f(linear_from_srgb(premultiplied / alpha) * alpha, alpha);
}

fn color_near(column: i32, row: i32) -> vec4f {
    return color_of(vec2u(clamp(vec2i(column, row), vec2i(0), vec2i(picture.size) - 1)));
}

@fragment
fn color(corner: Corner) -> @location(0) vec4f {
    let position = corner.uv * vec2f(picture.size);
    if picture.is_smooth == 0u {
        return color_near(i32(position.x), i32(position.y));
    }
    // Between the centres of four pixels.
    let first = floor(position - 0.5);
    let share = position - 0.5 - first;
    let column = i32(first.x);
    let row = i32(first.y);
    let above = mix(color_near(column, row), color_near(column + 1, row), share.x);
    let below = mix(color_near(column, row + 1), color_near(column + 1, row + 1), share.x);
    return mix(above, below, share.y);
}
