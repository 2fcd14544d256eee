//! Rendered images and their gradients on the device.

use crate::device::memory::Array;

/// Image on the device, plane by plane: the blended channels, then the transmittance.
#[derive(Debug)]
pub struct Frame {
    pub(crate) size: [usize; 2],
    pub(crate) channels: usize,
    pub(crate) blended: Array,
    /// Reflections of the pixels, plane by plane, if rays were traced.
    pub(crate) reflections: Option<Array>,
    /// Light of lamps on the pixels, plane by plane, if there are any.
    pub(crate) direct: Option<Array>,
    /// Colour after deferred shading, if there was any.
    pub(crate) shaded: Option<Array>,
    /// Colour after exposure, if there was any.
    pub(crate) exposed: Option<Array>,
}

impl Frame {
    /// Width and height, in pixels.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }
    /// Planes that are read: the channels, and the transmittance.
    pub fn planes(&self) -> usize {
        self.channels + 1
    }
    /// Number of pixels.
    pub(crate) fn pixel_count(&self) -> usize {
        self.size[0] * self.size[1]
    }
    /// Numbers of the frame: those of each channel, and transmittance.
    pub(crate) fn len_of_values(&self) -> usize {
        (self.channels + 1) * self.pixel_count()
    }
    /// Final colour in three planes; other planes may follow.
    pub(crate) fn color(&self) -> &Array {
        self.exposed.as_ref().unwrap_or(self.color_before_exposure())
    }
    /// Colour before exposure.
    pub(crate) fn color_before_exposure(&self) -> &Array {
        self.shaded.as_ref().unwrap_or(&self.blended)
    }
}

/// Gradient of a [`Frame`], plane by plane: the blended channels, then the transmittance.
#[derive(Debug)]
pub struct FrameGrad {
    pub(crate) size: [usize; 2],
    pub(crate) channels: usize,
    pub(crate) values: Array,
}
