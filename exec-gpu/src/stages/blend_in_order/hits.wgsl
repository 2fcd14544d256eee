// Declarations: waiting splats of a pixel in the order of depths; ties in the order of the tile.

@group(0) @binding(6) var<storage, read> responses: array<Response>;

struct Hit {
    depth: f32,
    alpha: f32,
    gaussian: u32,
    // Position in the list of the tile.
    position: u32,
}

var<private> hits: array<Hit, HITS>;

// Splat in the pixel around a point; its alpha is zero if it is not visible.
fn hit_at(position: u32, point: vec2f) -> Hit {
    let gaussian = gaussians_of[position];
    let splat = splats[gaussian];
    let alpha = alpha_of(splat.root, splat.log2_opacity, point - splat.mean2d);
    var depth = 0.0;
    if alpha > 0.0 {
        let response = responses[gaussian];
        depth = depth_at(response.slope, response.root, response.depth, point - response.mean2d);
    }
    return Hit(depth, select(alpha, 0.0, is_hidden(depth, point)), gaussian, position);
}

fn blend_hit(hit: Hit) {
    read_color(hit.gaussian);
    blend_alpha(hit.alpha);
}
