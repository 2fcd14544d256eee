//! Results of stages on the host.

use crate::{
    CpuError, CpuExecutor,
    frame::{Frame, FrameGrad, RGB},
    stages::{
        bin::Tiles,
        blend_vjp::{SplatGrads, absolute_center_grads},
        project::{SplatRecord, Splats},
        shade::Colors,
    },
};
use core::ops::Range;
use specula_core::{
    executor::{BufferLength, OnScreen, ReadBack},
    scene::BLOCK,
    splat::SplatGrad,
};

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

    fn read_frame_grad(&mut self, frame: &Frame, grad: &FrameGrad, planes: &mut [f32]) -> Result<(), CpuError> {
        BufferLength::check(frame.len_of_values(), planes).map_err(CpuError::BufferLength)?;
        grad.read(frame, planes);
        Ok(())
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

    fn read_splats(&mut self, splats: &Splats, screens: &mut [OnScreen]) -> Result<(), CpuError> {
        BufferLength::check_len(splats.records.len(), screens.len()).map_err(CpuError::BufferLength)?;
        screens.iter_mut().zip(splats.records.iter()).for_each(|(screen, record)| {
            let SplatRecord { mean2d, opacity, depth, reach, half_extent, .. } = *record;
            let half_extent = if reach > 0.0 { half_extent } else { [0.0; 2] };
            *screen = OnScreen { mean2d, half_extent, depth, opacity };
        });
        Ok(())
    }

    fn read_splat_grads(&mut self, grads: &SplatGrads, values: &mut [SplatGrad<f32>]) -> Result<(), CpuError> {
        BufferLength::check_len(grads.count(), values.len().next_multiple_of(BLOCK)).map_err(CpuError::BufferLength)?;
        values.iter_mut().enumerate().for_each(|(gaussian, value)| *value = grads.of_splat(gaussian));
        Ok(())
    }

    fn read_absolute_center_grads(
        &mut self,
        splats: &Splats,
        colors: &Colors,
        tiles: &Tiles,
        frame: &Frame,
        grad: &FrameGrad,
        sums: &mut [[f32; 2]],
    ) -> Result<(), CpuError> {
        BufferLength::check_len(tiles.emissions.len() - 1, sums.len()).map_err(CpuError::BufferLength)?;
        absolute_center_grads(&self.context, splats, colors, tiles, frame, grad, sums);
        Ok(())
    }

    fn write_colors(&mut self, colors: &mut Colors, rgb: &[[f32; 3]]) -> Result<(), CpuError> {
        let count = colors.values.len() / colors.channels;
        BufferLength::check_len(count, rgb.len()).map_err(CpuError::BufferLength)?;
        let gaussians = colors.values.chunks_exact_mut(colors.channels);
        gaussians.zip(rgb).for_each(|(channels, rgb)| channels[..RGB].copy_from_slice(rgb));
        Ok(())
    }
}
