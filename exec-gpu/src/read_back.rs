//! Results of stages on the host.

use crate::{
    device::error::GpuError,
    executor::GpuExecutor,
    stages::{
        blend_vjp::{SplatGrads, formulas::GEOMETRY},
        frame::{Frame, FrameGrad},
        shade::Colors,
    },
};
use core::ops::Range;
use specula_core::{
    executor::{BufferLength, ReadBack},
    scene::BLOCK,
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

    fn read_channel_grads(
        &mut self,
        grads: &SplatGrads,
        channels: Range<usize>,
        values: &mut [f32],
    ) -> Result<(), GpuError> {
        let mut blocks = vec![0.0; grads.values.len()];
        self.context.download_chunks(&grads.values, &mut blocks)?;
        let planes = GEOMETRY + grads.channels;
        for (gaussian, values) in values.chunks_exact_mut(channels.len().max(1)).enumerate() {
            let block = &blocks[gaussian / BLOCK * planes * BLOCK..];
            values.iter_mut().zip(channels.clone()).for_each(|(value, channel)| {
                *value = block[(GEOMETRY + channel) * BLOCK + gaussian % BLOCK];
            });
        }
        Ok(())
    }
}
