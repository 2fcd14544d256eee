// Declarations: channels of the composited splat.

var<private> color: array<vec4f, CHANNEL_VECTORS>;
