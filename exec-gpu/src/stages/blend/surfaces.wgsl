// Declarations: surfaces of another renderer, which end the pixels of a tile rasteriser.

@group(0) @binding(6) var<storage, read> occlusion: array<f32>;

var<private> surfaces: Pixels;

fn surface_at(pixel: u32) -> f32 {
    let at = pixel_at(pixel);
    return occlusion[at.y * camera.size.x + at.x];
}

fn before_tile() {
    blend_start();
    read_surfaces();
}

fn before_splat(position: u32) {
    end_pixels(splats[gaussians_of[position]].depth);
}
