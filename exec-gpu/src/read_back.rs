//! Results of stages on the host.

use crate::{
    device::error::GpuError,
    executor::GpuExecutor,
    stages::{
        blend_vjp::{SplatGrads, formulas::GEOMETRY},
        frame::{Frame, FrameGrad},
        project::{SPLAT_LEN, Splats},
        shade::Colors,
    },
};
use core::ops::Range;
use specula_core::{
    executor::{BufferLength, OnScreen, ReadBack},
    scene::BLOCK,
    splat::SplatGrad,
};

impl ReadBack for GpuExecutor {
    fn read_colors(&mut self, colors: &Colors, values: &mut [f32]) -> Result<(), GpuError> {
        let (channels, stride) = (colors.channels, colors.channels.next_multiple_of(4));
        let mut padded = vec![0.0; colors.values.len()];
        BufferLength::check(padded.len() / stride * channels, values).map_err(GpuError::BufferLength)?;
        self.context.download(&colors.values, 0, &mut padded)?;
        let gaussians = values.chunks_exact_mut(channels).zip(padded.chunks_exact(stride));
        gaussians.for_each(|(values, padded)| values.copy_from_slice(&padded[..channels]));
        Ok(())
    }

    fn upload_frame_grad(&mut self, frame: &Frame, planes: &[f32]) -> Result<FrameGrad, GpuError> {
        BufferLength::check(frame.len_of_values(), planes).map_err(GpuError::BufferLength)?;
        let values = self.context.upload("gradient of a picture", planes)?;
        Ok(FrameGrad { size: frame.size, channels: frame.channels, values })
    }

    fn read_frame_grad(&mut self, frame: &Frame, grad: &FrameGrad, planes: &mut [f32]) -> Result<(), GpuError> {
        BufferLength::check(frame.len_of_values(), planes).map_err(GpuError::BufferLength)?;
        self.context.download(&grad.values, 0, planes)
    }

    fn read_channel_grads(
        &mut self,
        grads: &SplatGrads,
        channels: Range<usize>,
        values: &mut [f32],
    ) -> Result<(), GpuError> {
        let number = self.read_grads(grads)?;
        for (gaussian, values) in values.chunks_exact_mut(channels.len().max(1)).enumerate() {
            values.iter_mut().zip(channels.clone()).for_each(|(value, channel)| {
                *value = number(gaussian, GEOMETRY + channel);
            });
        }
        Ok(())
    }

    fn read_splats(&mut self, splats: &Splats, screens: &mut [OnScreen]) -> Result<(), GpuError> {
        BufferLength::check_len(splats.count, screens.len()).map_err(GpuError::BufferLength)?;
        let mut numbers = vec![0.0_f32; splats.splats.len()];
        self.context.download(&splats.splats, 0, &mut numbers)?;
        for (screen, numbers) in screens.iter_mut().zip(numbers.as_chunks::<SPLAT_LEN>().0) {
            let [x, y, _, opacity, .., reach, half_width, half_height, depth, _] = *numbers;
            let half_extent = if reach > 0.0 { [half_width, half_height] } else { [0.0; 2] };
            *screen = OnScreen { mean2d: [x, y], half_extent, depth, opacity };
        }
        Ok(())
    }

    fn read_splat_grads(&mut self, grads: &SplatGrads, values: &mut [SplatGrad<f32>]) -> Result<(), GpuError> {
        let count = grads.values.len() / (GEOMETRY + grads.channels);
        BufferLength::check_len(count, values.len().next_multiple_of(BLOCK)).map_err(GpuError::BufferLength)?;
        let number = self.read_grads(grads)?;
        values.iter_mut().enumerate().for_each(|(gaussian, value)| {
            let at = |plane: usize| number(gaussian, plane);
            let root_conic = [at(2), at(3), at(4)];
            *value = SplatGrad { mean2d: [at(0), at(1)], root_conic, depth: 0.0, opacity: at(5) };
        });
        Ok(())
    }

    fn write_colors(&mut self, colors: &mut Colors, rgb: &[[f32; 3]]) -> Result<(), GpuError> {
        let stride = colors.channels.next_multiple_of(4);
        let mut padded = vec![0.0_f32; colors.values.len()];
        BufferLength::check_len(padded.len() / stride, rgb.len()).map_err(GpuError::BufferLength)?;
        self.context.download(&colors.values, 0, &mut padded)?;
        padded.chunks_exact_mut(stride).zip(rgb).for_each(|(channels, rgb)| channels[..3].copy_from_slice(rgb));
        self.context.write(&colors.values, &padded)
    }
}

impl GpuExecutor {
    /// Downloads gradients of splats; the result reads a plane of a Gaussian, the channels behind
    /// [`GEOMETRY`].
    fn read_grads(&mut self, grads: &SplatGrads) -> Result<impl Fn(usize, usize) -> f32 + use<>, GpuError> {
        let mut blocks = vec![0.0; grads.values.len()];
        self.context.download_chunks(&grads.values, &mut blocks)?;
        let planes = GEOMETRY + grads.channels;
        Ok(move |gaussian: usize, plane: usize| blocks[(gaussian / BLOCK * planes + plane) * BLOCK + gaussian % BLOCK])
    }
}
