// Depths of the surfaces in a depth texture.
//
// Threads: one invocation a pixel.
// Inputs: values of the texture.
// Outputs: depths in camera space, row by row.

@group(0) @binding(0) var<uniform> source: DepthTexture;
@group(0) @binding(1) var texture: texture_depth_2d;
@group(0) @binding(2) var<storage, read_write> depths: array<f32>;

@compute @workgroup_size(8, 8)
fn read_depths(@builtin(global_invocation_id) pixel: vec3u) {
    if all(pixel.xy < source.size) {
        let value = textureLoad(texture, pixel.xy, 0);
        depths[pixel.y * source.size.x + pixel.x] = depth_of_value(value, source.offset, source.scale);
    }
}
