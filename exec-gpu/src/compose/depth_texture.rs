//! Depths of another program's depth texture, for splats behind its surfaces.

use crate::{
    codegen::{formula::formula, source::Source, uniform::uniform},
    device::{chunks::ChunkedArray, error::GpuError, gpu::Gpu, memory::filled},
    executor::GpuExecutor,
};
use specula_core::occlusion::{DepthRange, depth_of_value};
use wgpu::{
    BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry,
    BindingResource, BindingType, BufferBindingType, BufferUsages, ComputePipeline, ComputePipelineDescriptor,
    PipelineLayoutDescriptor, ShaderModuleDescriptor, ShaderSource, ShaderStages, TextureSampleType, TextureView,
    TextureViewDimension,
};

const LABEL: Option<&str> = Some("depth texture");
/// Pixels along an edge of a workgroup.
const GROUP_EDGE: u32 = 8;

/// Depth of a texture's value ([`specula_core::occlusion::depth_of_value`]).
#[derive(Clone, Copy, Debug)]
struct DepthOfValue;

formula!(DepthOfValue, |_, inputs| depth_of_value(value: 1, offset: 1, scale: 1) -> (depth: 1) {
    let [value, offset, scale] = inputs.array();
    [depth_of_value(value, offset, scale)]
});

uniform! {
    /// Texture that is read.
    struct DepthTexture {
        size: [u32; 2],
        offset: f32,
        scale: f32,
    }
}

/// Reads the depth textures of the program that shares its device ([`Gpu::shared`]).
#[derive(Debug)]
pub struct DepthReader {
    pipeline: ComputePipeline,
    layout: BindGroupLayout,
}

impl DepthReader {
    /// A reader for the device of an executor.
    pub fn new<P>(exec: &GpuExecutor<P>) -> Self {
        let device = &exec.gpu().device;
        let source = Source::new().real().formula(&DepthOfValue).uniform::<DepthTexture>();
        let source = ShaderSource::Wgsl(source.with(include_str!("depth_texture.wgsl")).text().into());
        let module = device.create_shader_module(ShaderModuleDescriptor { label: LABEL, source });
        let buffer = |ty| BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
        let texture = BindingType::Texture {
            sample_type: TextureSampleType::Depth,
            view_dimension: TextureViewDimension::D2,
            multisampled: false,
        };
        let storage = buffer(BufferBindingType::Storage { read_only: false });
        let types = [buffer(BufferBindingType::Uniform), texture, storage];
        let visibility = ShaderStages::COMPUTE;
        let entries: Vec<BindGroupLayoutEntry> = (0..)
            .zip(types)
            .map(|(binding, ty)| BindGroupLayoutEntry { binding, visibility, ty, count: None })
            .collect();
        let layout = device.create_bind_group_layout(&BindGroupLayoutDescriptor { label: LABEL, entries: &entries });
        let pipeline_layout = device.create_pipeline_layout(&PipelineLayoutDescriptor {
            label: LABEL,
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = device.create_compute_pipeline(&ComputePipelineDescriptor {
            label: LABEL,
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some("read_depths"),
            compilation_options: Default::default(),
            cache: None,
        });
        Self { pipeline, layout }
    }

    /// Reads the depths of a picture of this size for
    /// [`render_occluded`](specula_core::pipeline::render_occluded). The texture has one sample a
    /// pixel, the usage `TEXTURE_BINDING`, and a view of its depth; it must have been drawn before,
    /// in the same encoder ([`GpuExecutor::record`]), or else in commands that are submitted before
    /// the executor's next submission.
    ///
    /// # Errors
    ///
    /// [`GpuError::TooLarge`] for a picture beyond the device's limit; errors that the device
    /// reported since the last call, such as a texture without that usage.
    pub fn read<P>(
        &self,
        exec: &mut GpuExecutor<P>,
        texture: &TextureView,
        size: [u32; 2],
        range: DepthRange,
    ) -> Result<ChunkedArray, GpuError> {
        let context = &mut exec.context;
        let depths = context.allocate("depths of surfaces", size[0] as usize * size[1] as usize)?;
        let source = DepthTexture { size, offset: range.offset, scale: range.scale };
        let source = filled(&context.gpu, source.bytes().as_slice(), BufferUsages::UNIFORM)?;
        let resources =
            [source.as_entire_binding(), BindingResource::TextureView(texture), depths.buffer().as_entire_binding()];
        let entries: Vec<BindGroupEntry<'_>> =
            (0..).zip(resources).map(|(binding, resource)| BindGroupEntry { binding, resource }).collect();
        let Gpu { device, .. } = &context.gpu;
        let group =
            device.create_bind_group(&BindGroupDescriptor { label: LABEL, layout: &self.layout, entries: &entries });
        let mut pass = context.recorder.encoder(&context.gpu).begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        let [columns, rows] = size.map(|pixels| pixels.div_ceil(GROUP_EDGE));
        pass.dispatch_workgroups(columns, rows, 1);
        drop(pass);
        context.gpu.check().map(|()| ChunkedArray::from(depths))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::context::Context;
    use specula_core::executor::Renderer;
    use wgpu::{
        Extent3d, LoadOp, Operations, RenderPassDepthStencilAttachment, RenderPassDescriptor, StoreOp,
        TextureDescriptor, TextureDimension, TextureFormat, TextureUsages,
    };

    #[test]
    fn depths_of_a_texture_are_those_of_its_range() {
        let Some(context) = Context::for_tests() else { return };
        let mut exec = GpuExecutor::new(context.gpu);
        let (device, queue) = (exec.gpu().device.clone(), exec.gpu().queue.clone());
        let size = [13, 9];
        let texture = device.create_texture(&TextureDescriptor {
            label: None,
            size: Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format: TextureFormat::Depth32Float,
            usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let view = texture.create_view(&Default::default());
        let reader = DepthReader::new(&exec);
        for range in [DepthRange::reversed(0.1, f32::INFINITY), DepthRange::forward(0.1, 50.0)] {
            for value in [0.0, 0.02, 0.6, 1.0] {
                let mut encoder = device.create_command_encoder(&Default::default());
                let depth_ops = Some(Operations { load: LoadOp::Clear(value), store: StoreOp::Store });
                let depth = RenderPassDepthStencilAttachment { view: &view, depth_ops, stencil_ops: None };
                encoder.begin_render_pass(&RenderPassDescriptor {
                    depth_stencil_attachment: Some(depth),
                    ..Default::default()
                });
                queue.submit([encoder.finish()]);
                let depths = reader.read(&mut exec, &view, size, range).expect("it is recorded");
                let mut found = vec![0.0; (size[0] * size[1]) as usize];
                exec.download(&depths, &mut found).expect("it is there");
                let expected = range.depth(value);
                // Devices divide in their own way.
                let is_same = |depth: &f32| (depth - expected).abs() <= 1e-5 * expected;
                assert!(found.iter().all(is_same), "{value} of {range:?} is {found:?}, not {expected}");
            }
        }
    }
}
