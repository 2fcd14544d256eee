//! Pictures into the textures of another program, over what it has drawn there.
//!
//! The program makes a [`Gpu`] of its own device with [`Gpu::shared`], renders with an executor on it, and has a
//! [`Composer`] draw the frame in a render pass of its own. Nothing leaves the device:
//!
//! ```no_run
//! # use specula_gpu::{Composer, Gpu, GpuError, GpuExecutor, blend::Frame};
//! # fn frame(_: &mut GpuExecutor) -> Result<Frame, GpuError> { unimplemented!() }
//! # fn draw(device: wgpu::Device, queue: wgpu::Queue, pass: &mut wgpu::RenderPass<'_>) -> Result<(), GpuError> {
//! let mut exec = GpuExecutor::new(Gpu::shared(device, queue)?);
//! let composer = Composer::new(&exec, wgpu::TextureFormat::Bgra8Unorm);
//! let picture = frame(&mut exec)?; // `specula_core::pipeline::render`
//! composer.draw(&mut exec, &picture, pass)
//! # }
//! ```

use crate::{
    blend::Frame,
    device::{Gpu, GpuError},
    executor::GpuExecutor,
    kernel::layout_of,
    memory::filled,
};
use bytemuck::{Pod, Zeroable};
use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BlendState, BufferUsages, ColorTargetState,
    ColorWrites, FragmentState, MultisampleState, PipelineCompilationOptions, PipelineLayoutDescriptor, PrimitiveState,
    RenderPass, RenderPipeline, RenderPipelineDescriptor, ShaderModuleDescriptor, ShaderSource, ShaderStages,
    TextureFormat, VertexState,
};

const SOURCE: &str = include_str!("shaders/compose.wgsl");
const LABEL: Option<&str> = Some("compose");

/// Draws frames into textures of one format, of one sample a pixel.
///
/// What a texture holds is kept in so far as a picture lets it through: premultiplied colours, then `(1 − α)` of what was
/// there. Colours of a frame are sRGB. A format that does not encode them takes them as they are and has the pixels that
/// `over_background` has; one that does (`…Srgb`) blends linear light, so that pixels that are covered in part are
/// brighter there.
#[derive(Debug)]
pub struct Composer {
    pipeline: RenderPipeline,
    layout: BindGroupLayout,
    is_encoded: bool,
}

/// `Picture` of `compose.wgsl`.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Picture {
    size: [u32; 2],
    transmittance: u32,
    is_encoded: u32,
}

impl Composer {
    /// A composer for the device of an executor, and for textures of a format that can be drawn into and blended.
    pub fn new(exec: &GpuExecutor, format: TextureFormat) -> Self {
        let gpu = exec.gpu();
        let layout = layout_of(gpu, "compose", SOURCE, ShaderStages::FRAGMENT);
        Self { pipeline: pipeline(gpu, &layout, format), layout, is_encoded: format.is_srgb() }
    }

    /// Records that a frame fills the viewport of a pass, without depth: pixel for pixel where the viewport is as large as
    /// the frame, else each pixel of the texture takes the nearest of the frame. What the executor has to do for it is
    /// given to the queue now. The program submits its pass before the executor renders the next frame, whose memory may
    /// be that of this one.
    pub fn draw(&self, exec: &mut GpuExecutor, frame: &Frame, pass: &mut RenderPass<'_>) -> Result<(), GpuError> {
        let machine = &mut exec.machine;
        machine.kernels.submit(&machine.gpu)?;
        let group = self.bind(&machine.gpu, frame)?;
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
        let picture = filled(gpu, bytemuck::bytes_of(&picture), BufferUsages::UNIFORM)?;
        let colors = frame.color().buffer();
        let buffers = [&picture, colors, frame.blended.buffer()];
        let entries = [0, 1, 2]
            .map(|binding| BindGroupEntry { binding: binding as u32, resource: buffers[binding].as_entire_binding() });
        let descriptor = BindGroupDescriptor { label: LABEL, layout: &self.layout, entries: &entries };
        Ok(gpu.device.create_bind_group(&descriptor))
    }
}

fn pipeline(gpu: &Gpu, layout: &BindGroupLayout, format: TextureFormat) -> RenderPipeline {
    let source = ShaderSource::Wgsl(SOURCE.into());
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
    use crate::machine::Machine;
    use wgpu::{
        BufferDescriptor, Color, DeviceDescriptor, Extent3d, Limits, LoadOp, MapMode, Operations, PollType,
        RenderPassColorAttachment, RenderPassDescriptor, StoreOp, TexelCopyBufferInfo, TexelCopyBufferLayout,
        TextureDescriptor, TextureDimension, TextureUsages,
    };

    /// Pixels in a row whose bytes wgpu copies.
    const WIDTH: u32 = 64;
    /// What the texture holds before, of each channel.
    const BEFORE: f64 = 0.25;

    /// A row that goes from black to white, the first half of it opaque and the second not covered at all.
    fn row(exec: &mut GpuExecutor) -> Frame {
        let (width, half) = (WIDTH as usize, WIDTH as usize / 2);
        let color = |k: usize| if k < half { k as f32 / half as f32 } else { 0.0 };
        let passed = |k: usize| if k < half { 0.0 } else { 1.0 };
        let planes: Vec<f32> =
            (0..4 * width).map(|k| if k < 3 * width { color(k % width) } else { passed(k % width) }).collect();
        let blended = exec.machine.upload("a picture", &planes).expect("it fits");
        Frame { size: [width, 1], channels: 3, blended, shaded: None, exposed: None }
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
    fn what_is_opaque_has_the_same_bytes_in_every_format_and_what_is_not_covered_stays() {
        let Some(machine) = Machine::for_tests() else { return };
        let mut exec = GpuExecutor::new(machine.gpu);
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
    fn a_device_that_allows_too_little_is_refused_with_what_it_lacks() {
        if Machine::for_tests().is_none() {
            return;
        }
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapter = pollster::block_on(instance.request_adapter(&Default::default())).expect("there is one");
        let required_limits = Limits::downlevel_webgl2_defaults();
        let descriptor = DeviceDescriptor { required_limits, ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).expect("it asks for little");
        let refusal = Gpu::shared(device, queue).expect_err("it has no storage buffers").to_string();
        assert!(refusal.contains("max_storage_buffers_per_shader_stage: 0 of 8"), "{refusal}");
        assert!(refusal.contains("ask for wgpu::Limits::default()"), "{refusal}");
    }
}
