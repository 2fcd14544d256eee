//! Gaussians to splats.

use crate::{
    device::GpuError,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    memory::Array,
    pieces::Pieces,
    source,
    view::View,
};
use specula_core::{camera::Camera, pack::Storage, scene::Gaussians};

/// Numbers of a splat in memory.
pub(crate) const SPLAT_LEN: usize = 12;

/// Gaussians on the screen.
#[derive(Debug)]
pub struct Splats {
    pub(crate) count: usize,
    /// Gaussians in each piece of those that they come from.
    pub(crate) gaussians_each: usize,
    /// `Splat` of `camera.wgsl`, one for each Gaussian.
    pub(crate) splats: Array,
    /// Bits of the depths, which sort as they do; `NOT_DRAWN` for what is not drawn.
    pub(crate) depth_keys: Array,
    /// How many tiles each touches.
    pub(crate) tile_counts: Array,
}

pub(crate) fn project(
    machine: &mut Machine,
    gaussians: &Gaussians<&Pieces>,
    storage: Storage,
    camera: &Camera,
) -> Result<Splats, GpuError> {
    let Gaussians { count, layout, values } = *gaussians;
    let splats = Splats {
        count,
        gaussians_each: values.gaussians_each(),
        splats: machine.take("splats", SPLAT_LEN * count)?,
        depth_keys: machine.take("depths", count)?,
        tile_counts: machine.take("numbers of tiles", count)?,
    };
    let (key, source) = (format!("{layout:?} {storage:?}"), || source::project(layout, storage));
    for piece in values.of(count) {
        let view = View::of(camera, piece.gaussians.clone());
        let bound = [
            Uniform(view.bytes()),
            Of(piece.array),
            Of(&splats.splats),
            Of(&splats.depth_keys),
            Of(&splats.tile_counts),
        ];
        machine.run(&key, "project", &source, &bound, Groups::For(piece.gaussians.len()))?;
    }
    Ok(splats)
}
