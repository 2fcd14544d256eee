// Declarations: channels of the splat that is composited.

var<private> color: array<vec4f, CHANNEL_VECTORS>;
