//! Blended surfaces to pictures: light, pixel by pixel.

use crate::{
    blend::Frame,
    blend_vjp::FrameGrad,
    device::GpuError,
    formulas::SurfaceOfPixel,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    prefilter::{Light, LightGrad},
    source,
    view::View,
};
use specula_core::{camera::Camera, plan::Channels};

pub(crate) fn shade_pixels(
    machine: &mut Machine,
    mut frame: Frame,
    light: Option<&Light>,
    camera: &Camera,
) -> Result<Frame, GpuError> {
    let view = View::new(camera, 0);
    let surface = SurfaceOfPixel { blended: Channels::of_count(frame.channels) };
    let shaded = machine.take("colours", 3 * frame.pixel_count())?;
    let none = machine.take("no light", 4)?;
    let texels = light.map_or(&none, |light| &light.texels);
    let bound = [Uniform(view.bytes()), Of(&frame.blended), Of(texels), Of(&shaded)];
    let layout = light.map(|light| &light.layout);
    let key = format!("{surface:?} {layout:?}");
    let source = || source::shade_pixels(&surface, layout);
    machine.run(&key, "shade_pixels", &source, &bound, Groups::For(frame.pixel_count()))?;
    frame.shaded = Some(shaded);
    Ok(frame)
}

pub(crate) fn shade_pixels_vjp(
    _machine: &mut Machine,
    _surface: &Frame,
    _light: Option<&Light>,
    _camera: &Camera,
    _grad: FrameGrad,
) -> Result<(FrameGrad, Option<LightGrad>), GpuError> {
    unimplemented!()
}
