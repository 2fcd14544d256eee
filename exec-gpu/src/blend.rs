//! Tiles to a picture.

use crate::{
    bin::Tiles,
    device::{Gpu, GpuError},
    formulas::blend::PixelBlock,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    memory::Array,
    project::Splats,
    shade::Colors,
    source,
    view::View,
};
use specula_core::camera::Camera;
use wgpu::DeviceType;

/// A picture, plane by plane: what was blended, then the transmittance.
#[derive(Debug)]
pub struct Frame {
    pub(crate) size: [usize; 2],
    pub(crate) channels: usize,
    pub(crate) blended: Array,
    /// The colour of the picture, where it is not what was blended.
    pub(crate) shaded: Option<Array>,
    /// And as a photograph of some exposure shows it.
    pub(crate) exposed: Option<Array>,
}

impl Frame {
    /// Width and height, in pixels.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }
    pub(crate) fn pixel_count(&self) -> usize {
        self.size[0] * self.size[1]
    }
    /// Numbers of the frame: those of each channel, and transmittance.
    pub(crate) fn len_of_values(&self) -> usize {
        (self.channels + 1) * self.pixel_count()
    }
    /// The colour of the picture in three planes; others may lie behind them.
    pub(crate) fn color(&self) -> &Array {
        self.exposed.as_ref().unwrap_or(self.color_before_exposure())
    }
    /// The same before [`mod@crate::expose`].
    pub(crate) fn color_before_exposure(&self) -> &Array {
        self.shaded.as_ref().unwrap_or(&self.blended)
    }
}

pub(crate) fn blend(
    machine: &mut Machine,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    camera: &Camera,
) -> Result<Frame, GpuError> {
    let view = View::new(camera, splats.count);
    let channels = colors.channels;
    let blended = machine.take("channels of a picture", (channels + 1) * view.pixel_count())?;
    let bound = [
        Uniform(view.bytes()),
        Of(&splats.splats),
        Of(&colors.values),
        Of(&tiles.ranges),
        Of(&tiles.gaussians),
        Of(&blended),
    ];
    let block = block_of(&machine.gpu);
    let source = || source::blend(block, channels);
    machine.run(&format!("{channels} channels, {block:?}"), "blend", &source, &bound, Groups::Grid(view.tiles()))?;
    Ok(Frame { size: [camera.width as usize, camera.height as usize], channels, blended, shaded: None, exposed: None })
}

/// The pixels of an invocation. Real hardware hides what reading a splat costs behind other invocations; a program that
/// computes on the CPU reads it once for many pixels.
fn block_of(gpu: &Gpu) -> PixelBlock {
    match gpu.info().device_type {
        DeviceType::Cpu => PixelBlock { width: 4, height: 4 },
        _ => PixelBlock { width: 1, height: 1 },
    }
}

/// The frame on the host: its channels, then the transmittance.
pub(crate) fn read(machine: &mut Machine, frame: &Frame, values: &mut [f32]) -> Result<(), GpuError> {
    let other_color = frame.exposed.as_ref().or(frame.shaded.as_ref());
    let shown = other_color.map_or(0, |_| 3 * frame.pixel_count());
    let (colors, others) = values.split_at_mut(shown);
    if let Some(color) = other_color {
        machine.download(color, 0, colors)?;
    }
    machine.download(&frame.blended, shown, others)
}
