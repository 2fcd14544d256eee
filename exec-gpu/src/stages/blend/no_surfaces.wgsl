// Declarations: a tile rasteriser without surfaces of another renderer.

fn before_tile() {
    blend_start();
}

fn before_splat(position: u32) {}
