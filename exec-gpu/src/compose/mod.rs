//! Composition of frames over the contents of another program's textures.
//!
//! The program wraps its device in a [`Gpu`] with [`Gpu::shared`], renders with an executor on it,
//! and draws the frame with a [`Composer`] in one of its own render passes. Nothing leaves the
//! device:
//!
//! ```no_run
//! # use specula_gpu::{Composer, Frame, Gpu, GpuError, GpuExecutor};
//! # fn frame(_: &mut GpuExecutor) -> Result<Frame, GpuError> { unimplemented!() }
//! # use wgpu::{Device, Queue, RenderPass};
//! # fn draw(device: Device, queue: Queue, pass: &mut RenderPass<'_>) -> Result<(), GpuError> {
//! let mut exec = GpuExecutor::new(Gpu::shared(device, queue)?);
//! let composer = Composer::new(&exec, wgpu::TextureFormat::Bgra8Unorm);
//! let picture = frame(&mut exec)?; // `specula_core::pipeline::render`
//! composer.draw(&mut exec, &picture, pass)
//! # }
//! ```

use crate::{
    codegen::uniform::{UniformStruct, uniform},
    device::{error::GpuError, gpu::Gpu, kernels::layout_of, memory::filled},
    executor::GpuExecutor,
    stages::frame::Frame,
};
use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BlendState, BufferUsages, ColorTargetState,
    ColorWrites, FragmentState, MultisampleState, PipelineCompilationOptions, PipelineLayoutDescriptor, PrimitiveState,
    RenderPass, RenderPipeline, RenderPipelineDescriptor, ShaderModuleDescriptor, ShaderSource, ShaderStages,
    TextureFormat, VertexState,
};

const LABEL: Option<&str> = Some("compose");

/// Draws frames into textures of one format, with one sample per pixel.
///
/// A texture becomes the frame's premultiplied colour plus (1 − α) times its former contents.
/// Colours of a frame are sRGB. A format without encoding stores them unchanged, with the pixels of
/// `over_background`; a format that encodes (`…Srgb`) blends linear light, so partially covered
/// pixels are brighter.
#[derive(Debug)]
pub struct Composer {
    pipeline: RenderPipeline,
    layout: BindGroupLayout,
    is_encoded: bool,
}

uniform! {
    /// Frame that is drawn.
    struct Picture {
        size: [u32; 2],
        /// Index of the transmittance among the blended planes.
        transmittance: u32,
        /// 1 if the texture encodes its values as sRGB.
        is_encoded: u32,
    }
}

fn source() -> String {
    Picture::declaration() + include_str!("compose.wgsl")
}

impl Composer {
    /// A composer for the device of an executor, and for textures of a format that can be rendered
    /// to and blended.
    pub fn new<P>(exec: &GpuExecutor<P>, format: TextureFormat) -> Self {
        let gpu = exec.gpu();
        let layout = layout_of(gpu, "compose", &source(), ShaderStages::FRAGMENT);
        Self { pipeline: pipeline(gpu, &layout, format), layout, is_encoded: format.is_srgb() }
    }

    /// Records a draw of the frame over the viewport of a pass, without depth: pixel for pixel if
    /// the viewport has the size of the frame, else with nearest sampling. Submits the executor's
    /// commands for the frame. The program must submit its pass before the executor renders the
    /// next frame, which may reuse this frame's memory.
    ///
    /// # Errors
    ///
    /// Errors that the device reported since the last call.
    pub fn draw<P>(&self, exec: &mut GpuExecutor<P>, frame: &Frame, pass: &mut RenderPass<'_>) -> Result<(), GpuError> {
        exec.context.submit()?;
        let group = self.bind(&exec.context.gpu, frame)?;
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
        Ok(())
    }

    fn bind(&self, gpu: &Gpu, frame: &Frame) -> Result<BindGroup, GpuError> {
        let picture = Picture {
            size: frame.size.map(|size| size as u32),
            transmittance: frame.channels as u32,
            is_encoded: self.is_encoded.into(),
        };
        let picture = filled(gpu, picture.bytes().as_slice(), BufferUsages::UNIFORM)?;
        let colors = frame.color().buffer();
        let buffers = [&picture, colors, frame.blended.buffer()];
        let entries = [0, 1, 2]
            .map(|binding| BindGroupEntry { binding: binding as u32, resource: buffers[binding].as_entire_binding() });
        let descriptor = BindGroupDescriptor { label: LABEL, layout: &self.layout, entries: &entries };
        Ok(gpu.device.create_bind_group(&descriptor))
    }
}

fn pipeline(gpu: &Gpu, layout: &BindGroupLayout, format: TextureFormat) -> RenderPipeline {
    let source = ShaderSource::Wgsl(source().into());
    let module = gpu.device.create_shader_module(ShaderModuleDescriptor { label: LABEL, source });
    let layout = gpu.device.create_pipeline_layout(&PipelineLayoutDescriptor {
        label: LABEL,
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    let target = ColorTargetState {
        format,
        blend: Some(BlendState::PREMULTIPLIED_ALPHA_BLENDING),
        write_mask: ColorWrites::ALL,
    };
    gpu.device.create_render_pipeline(&RenderPipelineDescriptor {
        label: LABEL,
        layout: Some(&layout),
        vertex: VertexState {
            module: &module,
            entry_point: Some("corner"),
            compilation_options: PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: PrimitiveState::default(),
        depth_stencil: None,
        multisample: MultisampleState::default(),
        fragment: Some(FragmentState {
            module: &module,
            entry_point: Some("color"),
            compilation_options: PipelineCompilationOptions::default(),
            targets: &[Some(target)],
        }),
        multiview_mask: None,
        cache: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::context::Context;
    use wgpu::{
        BufferDescriptor, Color, DeviceDescriptor, Extent3d, Limits, LoadOp, MapMode, Operations, PollType,
        RenderPassColorAttachment, RenderPassDescriptor, StoreOp, TexelCopyBufferInfo, TexelCopyBufferLayout,
        TextureDescriptor, TextureDimension, TextureUsages,
    };

    /// Pixels in a row whose bytes wgpu copies.
    const WIDTH: u32 = 64;
    /// Former contents of the texture, of each channel.
    const BEFORE: f64 = 0.25;

    /// A row from black to white, the first half opaque and the second half not covered.
    fn row(exec: &mut GpuExecutor) -> Frame {
        let (width, half) = (WIDTH as usize, WIDTH as usize / 2);
        let color = |k: usize| if k < half { k as f32 / half as f32 } else { 0.0 };
        let passed = |k: usize| if k < half { 0.0 } else { 1.0 };
        let planes: Vec<f32> =
            (0..4 * width).map(|k| if k < 3 * width { color(k % width) } else { passed(k % width) }).collect();
        let blended = exec.context.upload("a picture", &planes).expect("it fits");
        Frame { size: [width, 1], channels: 3, blended, reflections: None, direct: None, shaded: None, exposed: None }
    }

    /// The bytes of a texture's red channel after the row was drawn over grey.
    fn drawn(exec: &mut GpuExecutor, format: TextureFormat) -> Vec<u8> {
        let (device, queue) = (exec.gpu().device.clone(), exec.gpu().queue.clone());
        let size = Extent3d { width: WIDTH, height: 1, depth_or_array_layers: 1 };
        let texture = device.create_texture(&TextureDescriptor {
            label: None,
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format,
            usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let frame = row(exec);
        let composer = Composer::new(exec, format);
        let mut encoder = device.create_command_encoder(&Default::default());
        let grey = RenderPassColorAttachment {
            view: &texture.create_view(&Default::default()),
            depth_slice: None,
            resolve_target: None,
            ops: Operations {
                load: LoadOp::Clear(Color { r: BEFORE, g: BEFORE, b: BEFORE, a: 1.0 }),
                store: StoreOp::Store,
            },
        };
        let descriptor = RenderPassDescriptor { color_attachments: &[Some(grey)], ..Default::default() };
        composer.draw(exec, &frame, &mut encoder.begin_render_pass(&descriptor)).expect("it is drawn");
        let usage = BufferUsages::COPY_DST | BufferUsages::MAP_READ;
        let bytes = u64::from(4 * WIDTH);
        let buffer =
            device.create_buffer(&BufferDescriptor { label: None, size: bytes, usage, mapped_at_creation: false });
        let layout = TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * WIDTH), rows_per_image: None };
        encoder.copy_texture_to_buffer(texture.as_image_copy(), TexelCopyBufferInfo { buffer: &buffer, layout }, size);
        queue.submit([encoder.finish()]);
        buffer.map_async(MapMode::Read, .., |_| ());
        device.poll(PollType::wait_indefinitely()).expect("the device is there");
        let view = buffer.get_mapped_range(..).expect("it was mapped");
        view.chunks_exact(4).map(|pixel| pixel[0]).collect()
    }

    #[test]
    fn opaque_pixels_are_equal_in_every_format_and_uncovered_ones_unchanged() {
        let Some(context) = Context::for_tests() else { return };
        let mut exec = GpuExecutor::new(context.gpu);
        let half = WIDTH as usize / 2;
        for (format, grey) in [(TextureFormat::Rgba8Unorm, 64), (TextureFormat::Rgba8UnormSrgb, 137)] {
            let bytes = drawn(&mut exec, format);
            for (k, byte) in bytes.iter().enumerate() {
                let expected = if k < half { 255.0 * k as f32 / half as f32 } else { grey as f32 };
                // One step of eight bits: devices round differently.
                assert!(
                    (f32::from(*byte) - expected).abs() <= 1.0,
                    "pixel {k} of {format:?} is {byte}, not {expected}"
                );
            }
        }
    }

    #[test]
    fn a_device_with_low_limits_is_refused_with_their_names() {
        if Context::for_tests().is_none() {
            return;
        }
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapter = pollster::block_on(instance.request_adapter(&Default::default())).expect("there is one");
        let required_limits = Limits::downlevel_webgl2_defaults();
        let descriptor = DeviceDescriptor { required_limits, ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).expect("its limits are low");
        let refusal = Gpu::shared(device, queue).expect_err("it has no storage buffers").to_string();
        assert!(refusal.contains("max_storage_buffers_per_shader_stage: 0 of 8"), "{refusal}");
        assert!(refusal.contains("with wgpu::Limits::default()"), "{refusal}");
    }
}
