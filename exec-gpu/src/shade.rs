//! Splats to channels.

use crate::{
    device::GpuError,
    formulas::ShadingOf,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    memory::Array,
    pieces::Pieces,
    prefilter::Light,
    project::Splats,
    source,
    view::View,
};
use specula_core::{camera::Camera, pack::Storage, rules::RenderRules, scene::Gaussians};

/// The channels of each Gaussian, side by side, filled up to whole vectors of four.
#[derive(Debug)]
pub struct Colors {
    pub(crate) channels: usize,
    pub(crate) values: Array,
}

/// The channels of what is drawn; what has a colour that is not finite is not drawn any more.
pub(crate) fn shade(
    machine: &mut Machine,
    gaussians: &Gaussians<&Pieces>,
    storage: Storage,
    camera: &Camera,
    splats: &mut Splats,
    light: Option<&Light>,
    rules: &RenderRules,
) -> Result<Colors, GpuError> {
    let shading = ShadingOf { layout: gaussians.layout, rules: *rules };
    let channels = shading.blended().count();
    let colors = Colors { channels, values: machine.take("channels", channels.next_multiple_of(4) * gaussians.count)? };
    let own_light = light.filter(|_| shading.looks_light_up());
    let layout = own_light.map(|light| &light.layout);
    let key = format!("{shading:?} {storage:?} {layout:?}");
    let source = || source::shade(&shading, storage, layout);
    for piece in gaussians.values.of(gaussians.count) {
        let view = View::of(camera, piece.gaussians.clone());
        let mut bound = vec![Uniform(view.bytes()), Of(piece.array), Of(&splats.depth_keys), Of(&colors.values)];
        if let Some(light) = own_light {
            bound.extend([Of(&light.texels), Of(&light.split_sum)]);
        }
        bound.extend([Of(&splats.tile_counts), Of(&splats.splats)]);
        machine.run(&key, "shade", &source, &bound, Groups::For(piece.gaussians.len()))?;
    }
    Ok(colors)
}
