//! Results of stages on the host.

use crate::{
    CpuError, CpuExecutor,
    frame::{Frame, FrameGrad},
    stages::{blend_vjp::SplatGrads, shade::Colors},
};
use core::ops::Range;
use specula_core::executor::{BufferLength, ReadBack};

impl ReadBack for CpuExecutor {
    fn read_colors(&mut self, colors: &Colors, values: &mut [f32]) -> Result<(), CpuError> {
        BufferLength::check(colors.values.len(), values).map_err(CpuError::BufferLength)?;
        values.copy_from_slice(&colors.values);
        Ok(())
    }

    fn upload_frame_grad(&mut self, frame: &Frame, planes: &[f32]) -> Result<FrameGrad, CpuError> {
        BufferLength::check(frame.len_of_values(), planes).map_err(CpuError::BufferLength)?;
        Ok(frame.grad(planes))
    }

    fn read_channel_grads(
        &mut self,
        grads: &SplatGrads,
        channels: Range<usize>,
        values: &mut [f32],
    ) -> Result<(), CpuError> {
        let count = channels.len();
        for (gaussian, values) in values.chunks_exact_mut(count.max(1)).enumerate() {
            values.iter_mut().zip(channels.clone()).for_each(|(value, channel)| {
                *value = grads.of_channel(gaussian, channel);
            });
        }
        Ok(())
    }
}
