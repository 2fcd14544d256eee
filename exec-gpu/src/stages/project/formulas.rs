//! Projection of a Gaussian.

use crate::{
    codegen::formula::formula,
    stages::{
        camera::{camera_fields, take_camera},
        gaussians::{Planes, planes_field},
    },
};
use specula_core::{
    attributes::AttributePlanes,
    bin::{footprint, half_extent},
    project::project,
    scene::Layout,
    splat::Splat2d,
};

/// Splat of a Gaussian ([`mod@specula_core::project`], [`specula_core::bin`]), in the form for
/// compositing.
#[derive(Clone, Copy, Debug)]
pub struct SplatOf {
    /// Planes of the Gaussian.
    pub layout: Layout,
}

formula!(SplatOf, |this, inputs| splat_of(..planes_field(this.layout), ..camera_fields()) -> (
    mean2d: 2, log2_opacity: 1, opacity: 1, root: 3, reach: 1, half_extent: 2, depth: 1, root_conic: 3
) {
    let planes = Planes(inputs.slice(this.layout.plane_count()));
    let splat = project(&planes.shape(this.layout), &take_camera(inputs));
    let reach = footprint(&splat).reach;
    let Splat2d { mean2d, root, log2_opacity } = Splat2d::new(splat.mean2d, splat.root_conic, splat.opacity.log2());
    let half_extent = half_extent(&splat, reach);
    (mean2d, [log2_opacity, splat.opacity], root, [reach], half_extent, [splat.depth], splat.root_conic)
});
