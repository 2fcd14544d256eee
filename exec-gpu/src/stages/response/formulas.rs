//! Depth of a Gaussian's largest response.

use crate::{
    codegen::formula::formula,
    stages::{
        camera::{camera_fields, take_camera},
        gaussians::{Planes, planes_field},
    },
};
use specula_core::{
    attributes::AttributePlanes,
    order::{ResponseDepth, response_depth},
    scene::Layout,
};

/// Depth of a Gaussian's largest response as a function of the pixel
/// ([`specula_core::order::response_depth`]).
#[derive(Clone, Copy, Debug)]
pub struct ResponseOf {
    /// Planes of the Gaussian.
    pub layout: Layout,
}

formula!(ResponseOf, |this, inputs| response_of(..planes_field(this.layout), ..camera_fields()) -> (
    mean2d: 2, slope: 2, root: 3, depth: 1
) {
    let shape = Planes(inputs.slice(this.layout.plane_count())).shape(this.layout);
    let ResponseDepth { mean2d, slope, root, depth } = response_depth(&shape, &take_camera(inputs));
    (mean2d, slope, root, [depth])
});
