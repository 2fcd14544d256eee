//! Blended surfaces to pictures: light, pixel by pixel.

use crate::{
    blend::Frame,
    blend_vjp::FrameGrad,
    device::GpuError,
    executor::GpuExecutor,
    formulas::SurfaceOfPixel,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    light_sums::LightSums,
    machine::Machine,
    prefilter::{Light, LightGrad},
    source,
    view::View,
};
use specula_core::{camera::Camera, rules::Channels};

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
    machine: &mut Machine,
    surface: &Frame,
    light: Option<&Light>,
    camera: &Camera,
    grad: FrameGrad,
) -> Result<(FrameGrad, Option<LightGrad>), GpuError> {
    let view = View::new(camera, 0);
    let of_pixel = SurfaceOfPixel { blended: Channels::of_count(surface.channels) };
    let sums = light.map(|light| LightSums::new(machine, light)).transpose()?;
    let none = [machine.take("no light", 4)?, machine.take("no sums", 4)?];
    let bound = [
        Uniform(view.bytes()),
        Of(&surface.blended),
        Of(light.map_or(&none[0], |light| &light.texels)),
        Of(&grad.values),
        Of(sums.as_ref().map_or(&none[1], LightSums::array)),
    ];
    let layout = light.map(|light| &light.layout);
    let key = format!("{of_pixel:?} {layout:?}");
    let source = || source::shade_pixels_vjp(&of_pixel, layout);
    machine.run(&key, "shade_pixels_vjp", &source, &bound, Groups::For(surface.pixel_count()))?;
    let light_grad = sums.map(|sums| sums.finish(machine)).transpose()?;
    Ok((grad, light_grad))
}

impl GpuExecutor {
    /// The gradient of a frame from its planes, as [`specula_core::executor::Renderer::read_frame`] gives those of the
    /// frame.
    pub fn frame_grad(&mut self, frame: &Frame, planes: &[f32]) -> Result<FrameGrad, GpuError> {
        let values = self.machine.upload("gradient of a picture", planes)?;
        Ok(FrameGrad { size: frame.size, channels: frame.channels, values })
    }
}
