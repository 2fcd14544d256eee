//! Texels of a filtered light.

/// Red, green, blue and padding: a texel as wide as a small vector.
pub type Texel = [f32; 4];
