// Declarations: channels of the splat that is composited.

var<private> color: array<vec4f, CHANNEL_VECTORS>;

fn read_color(gaussian: u32) {
    for (var k = 0u; k < CHANNEL_VECTORS; k++) {
        color[k] = colors[gaussian * CHANNEL_VECTORS + k];
    }
}
