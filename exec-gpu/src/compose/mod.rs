//! Composition of frames over the contents of another program's textures.
//!
//! The program wraps its device in a [`Gpu`] with [`Gpu::shared`], renders with an executor on it,
//! and draws the frame with a [`Composer`] in one of its own render passes. Nothing leaves the
//! device:
//!
//! ```no_run
//! # use specula_gpu::{Composer, PassFormat, Frame, Gpu, GpuError, GpuExecutor};
//! # fn frame(_: &mut GpuExecutor) -> Result<Frame, GpuError> { unimplemented!() }
//! # use wgpu::{Device, Queue, RenderPass};
//! # fn draw(device: Device, queue: Queue, pass: &mut RenderPass<'_>) -> Result<(), GpuError> {
//! let mut exec = GpuExecutor::new(Gpu::shared(device, queue)?);
//! let composer = Composer::new(&exec, &PassFormat::new(wgpu::TextureFormat::Bgra8Unorm));
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
    ColorWrites, CompareFunction, DepthBiasState, DepthStencilState, FragmentState, MultisampleState,
    PipelineCompilationOptions, PipelineLayoutDescriptor, PrimitiveState, RenderPass, RenderPipeline,
    RenderPipelineDescriptor, ShaderModuleDescriptor, ShaderSource, ShaderStages, StencilState, TextureFormat,
    VertexState,
};

mod depth_texture;

pub use depth_texture::DepthReader;

const LABEL: Option<&str> = Some("compose");

/// Numbers of a pass that frames are drawn in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mixing {
    /// sRGB colours, as in a texture of bytes that is shown: the pixels of `over_background`.
    Srgb,
    /// Linear light: textures that encode (`…Srgb`), and those of floating-point numbers.
    Linear,
}

/// Render pass of another program.
#[derive(Clone, Debug)]
pub struct PassFormat {
    color: TextureFormat,
    mixing: Mixing,
    depth: Option<TextureFormat>,
    samples: u32,
    is_smooth: bool,
}

impl PassFormat {
    /// A pass with one attachment of a format that can be rendered to and blended, and with one
    /// sample a pixel. Formats that encode (`…Srgb`) and floating-point formats mix linear light,
    /// all others sRGB colours.
    pub fn new(color: TextureFormat) -> Self {
        let is_float =
            matches!(color, TextureFormat::Rgba16Float | TextureFormat::Rgba32Float | TextureFormat::Rg11b10Ufloat);
        let mixing = if color.is_srgb() || is_float { Mixing::Linear } else { Mixing::Srgb };
        Self { color, mixing, depth: None, samples: 1, is_smooth: false }
    }

    /// Selects what the pass mixes. A texture that encodes always mixes linear light.
    #[must_use]
    pub fn mixing(self, mixing: Mixing) -> Self {
        let mixing = if self.color.is_srgb() { Mixing::Linear } else { mixing };
        Self { mixing, ..self }
    }

    /// A pass with a depth attachment of this format. Frames neither test it nor write to it: their
    /// splats behind surfaces are hidden one by one ([`DepthReader`]).
    #[must_use]
    pub fn depth(self, format: TextureFormat) -> Self {
        Self { depth: Some(format), ..self }
    }

    /// A pass with several samples a pixel; all get the same colour.
    #[must_use]
    pub fn samples(self, samples: u32) -> Self {
        Self { samples, ..self }
    }

    /// Frames of another size than the viewport are interpolated bilinearly.
    #[must_use]
    pub fn smooth(self) -> Self {
        Self { is_smooth: true, ..self }
    }
}

/// Draws frames in passes of one format.
///
/// A texture becomes the frame's premultiplied colour plus (1 − α) times its former contents.
/// Colours of a frame are sRGB, and are decoded in passes that mix linear light, where partially
/// covered pixels are brighter.
#[derive(Debug)]
pub struct Composer {
    pipeline: RenderPipeline,
    layout: BindGroupLayout,
    mixing: Mixing,
    is_smooth: bool,
}

uniform! {
    /// Frame that is drawn.
    struct Picture {
        size: [u32; 2],
        /// Index of the transmittance among the blended planes.
        transmittance: u32,
        /// 1 if the pass mixes linear light.
        is_linear: u32,
        /// 1 to interpolate between pixels.
        is_smooth: u32,
        padding: u32,
    }
}

fn source() -> String {
    Picture::declaration() + include_str!("compose.wgsl")
}

impl Composer {
    /// A composer for the device of an executor, and for passes of a format.
    pub fn new<P>(exec: &GpuExecutor<P>, pass: &PassFormat) -> Self {
        let gpu = exec.gpu();
        let layout = layout_of(gpu, "compose", &source(), ShaderStages::FRAGMENT);
        let PassFormat { mixing, is_smooth, .. } = *pass;
        Self { pipeline: pipeline(gpu, &layout, pass), layout, mixing, is_smooth }
    }

    /// Records a draw of the frame over the viewport of a pass: pixel for pixel if the viewport has
    /// the size of the frame, else the nearest pixel, or as [`PassFormat::smooth`] says. Submits
    /// the executor's own commands for the frame, of which a recorded one has none. The program
    /// must submit its pass before the executor renders the next frame, which may reuse this
    /// frame's memory.
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
            is_linear: (self.mixing == Mixing::Linear).into(),
            is_smooth: self.is_smooth.into(),
            padding: 0,
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

fn pipeline(gpu: &Gpu, layout: &BindGroupLayout, pass: &PassFormat) -> RenderPipeline {
    let source = ShaderSource::Wgsl(source().into());
    let module = gpu.device.create_shader_module(ShaderModuleDescriptor { label: LABEL, source });
    let layout = gpu.device.create_pipeline_layout(&PipelineLayoutDescriptor {
        label: LABEL,
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    let target = ColorTargetState {
        format: pass.color,
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
        depth_stencil: pass.depth.map(untouched),
        multisample: MultisampleState { count: pass.samples, ..MultisampleState::default() },
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

/// Depth attachment that is neither tested nor written.
fn untouched(format: TextureFormat) -> DepthStencilState {
    DepthStencilState {
        format,
        depth_write_enabled: Some(false),
        depth_compare: Some(CompareFunction::Always),
        stencil: StencilState::default(),
        bias: DepthBiasState::default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::context::Context;
    use specula_core::color::linear_from_srgb;
    use wgpu::{
        BufferDescriptor, Color, DeviceDescriptor, Extent3d, Limits, LoadOp, MapMode, Operations, PollType,
        RenderPassColorAttachment, RenderPassDepthStencilAttachment, RenderPassDescriptor, StoreOp,
        TexelCopyBufferInfo, TexelCopyBufferLayout, TextureDescriptor, TextureDimension, TextureUsages,
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

    /// The bytes of a texture after the row was drawn over grey, in a viewport of this width.
    fn drawn(exec: &mut GpuExecutor, pass: &PassFormat, width: u32) -> Vec<u8> {
        let (device, queue) = (exec.gpu().device.clone(), exec.gpu().queue.clone());
        let size = Extent3d { width, height: 1, depth_or_array_layers: 1 };
        let texture = |format, sample_count, usage| {
            let texture = device.create_texture(&TextureDescriptor {
                label: None,
                size,
                mip_level_count: 1,
                sample_count,
                dimension: TextureDimension::D2,
                format,
                usage: TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: &[],
            });
            (texture.create_view(&Default::default()), texture)
        };
        let (target, shown) = texture(pass.color, 1, TextureUsages::COPY_SRC);
        let (sampled, _) = texture(pass.color, pass.samples, TextureUsages::empty());
        let depth = pass.depth.map(|format| texture(format, pass.samples, TextureUsages::empty()).0);
        let frame = row(exec);
        let composer = Composer::new(exec, pass);
        let mut encoder = device.create_command_encoder(&Default::default());
        let grey = RenderPassColorAttachment {
            view: if pass.samples > 1 { &sampled } else { &target },
            depth_slice: None,
            resolve_target: (pass.samples > 1).then_some(&target),
            ops: Operations {
                load: LoadOp::Clear(Color { r: BEFORE, g: BEFORE, b: BEFORE, a: 1.0 }),
                store: StoreOp::Store,
            },
        };
        let depth_stencil_attachment = depth.as_ref().map(|view| RenderPassDepthStencilAttachment {
            view,
            depth_ops: Some(Operations { load: LoadOp::Clear(0.5), store: StoreOp::Store }),
            stencil_ops: None,
        });
        let descriptor =
            RenderPassDescriptor { color_attachments: &[Some(grey)], depth_stencil_attachment, ..Default::default() };
        composer.draw(exec, &frame, &mut encoder.begin_render_pass(&descriptor)).expect("it is drawn");
        let usage = BufferUsages::COPY_DST | BufferUsages::MAP_READ;
        let row_bytes = width * pass.color.block_copy_size(None).expect("it has one plane");
        let bytes = u64::from(row_bytes);
        let buffer =
            device.create_buffer(&BufferDescriptor { label: None, size: bytes, usage, mapped_at_creation: false });
        let layout = TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row_bytes), rows_per_image: None };
        encoder.copy_texture_to_buffer(shown.as_image_copy(), TexelCopyBufferInfo { buffer: &buffer, layout }, size);
        queue.submit([encoder.finish()]);
        buffer.map_async(MapMode::Read, .., |_| ());
        device.poll(PollType::wait_indefinitely()).expect("the device is there");
        buffer.get_mapped_range(..).expect("it was mapped").to_vec()
    }

    /// Number of the bits of a half.
    fn unpacked(bits: u16) -> f32 {
        specula_core::pack::unpack2(bits.into())[0]
    }

    #[test]
    fn opaque_pixels_are_equal_in_every_format_and_uncovered_ones_unchanged() {
        let Some(context) = Context::for_tests() else { return };
        let mut exec = GpuExecutor::new(context.gpu);
        let half = WIDTH as usize / 2;
        for (format, grey) in [(TextureFormat::Rgba8Unorm, 64), (TextureFormat::Rgba8UnormSrgb, 137)] {
            let bytes = drawn(&mut exec, &PassFormat::new(format), WIDTH);
            for (k, byte) in bytes.iter().step_by(4).enumerate() {
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
    fn passes_with_depth_and_samples_get_the_same_picture() {
        let Some(context) = Context::for_tests() else { return };
        let mut exec = GpuExecutor::new(context.gpu);
        let plain = PassFormat::new(TextureFormat::Rgba8Unorm);
        let expected = drawn(&mut exec, &plain, WIDTH);
        let deep = plain.clone().depth(TextureFormat::Depth32Float);
        for pass in [deep.clone(), plain.samples(4), deep.samples(4)] {
            assert!(drawn(&mut exec, &pass, WIDTH) == expected, "{pass:?}");
        }
    }

    #[test]
    fn floating_point_targets_get_linear_light_unless_told_otherwise() {
        let Some(context) = Context::for_tests() else { return };
        let mut exec = GpuExecutor::new(context.gpu);
        let pass = PassFormat::new(TextureFormat::Rgba16Float);
        let half = WIDTH as usize / 2;
        for (mixing, curve) in [(Mixing::Linear, linear_from_srgb as fn(f32) -> f32), (Mixing::Srgb, |srgb| srgb)] {
            let bytes = drawn(&mut exec, &pass.clone().mixing(mixing), WIDTH);
            for (k, pixel) in bytes.chunks_exact(8).enumerate() {
                let red = unpacked(u16::from_le_bytes([pixel[0], pixel[1]]));
                let expected = if k < half { curve(k as f32 / half as f32) } else { BEFORE as f32 };
                // Halves have eleven bits, and devices compute powers in their own way.
                assert!((red - expected).abs() <= 2e-3 * expected + 1e-4, "pixel {k} is {red}, not {expected}");
            }
        }
        assert_eq!(pass.mixing, PassFormat::new(TextureFormat::Rgba8UnormSrgb).mixing(Mixing::Srgb).mixing);
    }

    #[test]
    fn a_wider_viewport_is_interpolated_if_wanted() {
        let Some(context) = Context::for_tests() else { return };
        let mut exec = GpuExecutor::new(context.gpu);
        let pass = PassFormat::new(TextureFormat::Rgba8Unorm);
        let [nearest, smooth] = [pass.clone(), pass.smooth()].map(|pass| drawn(&mut exec, &pass, 2 * WIDTH));
        let half = WIDTH as usize / 2;
        // Before the last opaque pixel.
        for k in 1..2 * half - 2 {
            let [nearest, smooth] = [nearest[4 * k], smooth[4 * k]].map(f32::from);
            let place = (k as f32 + 0.5) / 2.0;
            let of = |pixel: f32| 255.0 * pixel / half as f32;
            assert!((nearest - of(place.floor())).abs() <= 1.0, "pixel {k} is {nearest}");
            assert!((smooth - of(place - 0.5)).abs() <= 1.0, "pixel {k} is {smooth}");
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
