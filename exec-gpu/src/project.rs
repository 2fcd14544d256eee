//! Gaussians to splats.

use crate::{
    device::GpuError,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    memory::Array,
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
    /// `Splat` of `camera.wgsl`, one for each Gaussian.
    pub(crate) splats: Array,
    /// Bits of the depths, which sort as they do; `NOT_DRAWN` for what is not drawn.
    pub(crate) depth_keys: Array,
    /// How many tiles each touches.
    pub(crate) tile_counts: Array,
}

pub(crate) fn project(
    machine: &mut Machine,
    gaussians: &Gaussians<&Array>,
    storage: Storage,
    camera: &Camera,
) -> Result<Splats, GpuError> {
    let Gaussians { count, layout, values } = *gaussians;
    let splats = Splats {
        count,
        splats: machine.take("splats", SPLAT_LEN * count)?,
        depth_keys: machine.take("depths", count)?,
        tile_counts: machine.take("numbers of tiles", count)?,
    };
    let view = View::new(camera, count);
    let bound =
        [Uniform(view.bytes()), Of(values), Of(&splats.splats), Of(&splats.depth_keys), Of(&splats.tile_counts)];
    let (key, source) = (format!("{layout:?} {storage:?}"), || source::project(layout, storage));
    machine.run(&key, "project", &source, &bound, Groups::For(count))?;
    Ok(splats)
}
