//! Rendered images and their gradients on the device.

use crate::device::memory::Array;
use core::ops::Range;

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

/// Planes of a frame to read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameContent {
    /// Final colours and transmittance.
    Colors,
    /// All channels, with the final colours first, and transmittance.
    Channels,
}

impl FrameContent {
    /// Number of planes.
    pub(crate) fn planes(self, frame: &Frame) -> usize {
        match self {
            Self::Colors => 4,
            Self::Channels => frame.channels + 1,
        }
    }
}

impl Frame {
    /// Width and height, in pixels.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }
    /// Number of pixels.
    pub(crate) fn pixel_count(&self) -> usize {
        self.size[0] * self.size[1]
    }
    /// Numbers of the frame: those of each channel, and transmittance.
    pub(crate) fn len_of_values(&self) -> usize {
        (self.channels + 1) * self.pixel_count()
    }
    /// Arrays with the read planes, in order, with the elements of each.
    pub(crate) fn parts(&self, content: FrameContent) -> [(&Array, Range<usize>); 2] {
        let (shown, len) = (3 * self.pixel_count(), self.len_of_values());
        let first = match content {
            FrameContent::Colors => len - self.pixel_count(),
            FrameContent::Channels => shown,
        };
        [(self.color(), 0..shown), (&self.blended, first..len)]
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
