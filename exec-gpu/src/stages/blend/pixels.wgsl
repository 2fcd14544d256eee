// Declarations: division of the pixels of a tile into blocks, small rectangles.

const BLOCK_PIXELS: u32 = BLOCK_WIDTH * BLOCK_HEIGHT;
const BLOCKS: u32 = TILE_EDGE * TILE_EDGE / BLOCK_PIXELS;
const BLOCKS_ACROSS: u32 = TILE_EDGE / BLOCK_WIDTH;

// Upper left pixel of the block.
var<private> corner: vec2u;

fn corner_of(tile: vec2u, block: u32) -> vec2u {
    return tile * TILE_EDGE + vec2u(block % BLOCKS_ACROSS * BLOCK_WIDTH, block / BLOCKS_ACROSS * BLOCK_HEIGHT);
}

fn pixel_at(number: u32) -> vec2u {
    return corner + vec2u(number % BLOCK_WIDTH, number / BLOCK_WIDTH);
}

fn is_inside(pixel: u32) -> bool {
    return all(pixel_at(pixel) < camera.size);
}

// Initial transmittance; pixels outside the image have terminated.
fn initial_transmittance(pixel: u32) -> f32 {
    return select(0.0, 1.0, is_inside(pixel));
}
