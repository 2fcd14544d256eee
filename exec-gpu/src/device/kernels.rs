//! Recording of kernels into command encoders, and their compilation from WGSL.

use crate::{
    codegen::source::WORKGROUP_SIZE,
    device::{
        cache::Kernel,
        error::GpuError,
        gpu::Gpu,
        memory::{Array, filled},
        timer::KernelTimer,
    },
};
use core::mem;
use wgpu::{
    BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry, BindingType,
    BufferBindingType, BufferUsages, CommandEncoder, ComputePassDescriptor, ComputePipelineDescriptor,
    PipelineCompilationOptions, PipelineLayoutDescriptor, ShaderModuleDescriptor, ShaderSource, ShaderStages,
};

/// Resource of a kernel's binding; a kernel's bindings are numbered in the order in which they are
/// passed.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Binding<'a> {
    /// Bytes of a uniform structure.
    Uniform(&'a [u8]),
    /// Array in a storage buffer.
    Buffer(&'a Array),
}

/// Size of a dispatch.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Dispatch {
    /// Invocations in workgroups of [`WORKGROUP_SIZE`], numbered by `linear_index`.
    Invocations(usize),
    /// Workgroups, numbered by `linear_index`.
    Workgroups(usize),
    /// Two-dimensional grid of workgroups.
    Grid([u32; 2]),
}

/// Passes of a submission: the device computes one submission while the next is recorded.
const PASSES_PER_SUBMISSION: usize = 32;

/// Commands that are recorded but not submitted.
#[derive(Debug, Default)]
pub(crate) struct Recorder {
    encoder: Option<CommandEncoder>,
    /// Compute passes in the encoder.
    passes: usize,
    /// Timer of the kernels, while they are timed.
    pub(crate) timer: Option<KernelTimer>,
}

impl Recorder {
    /// Encoder of the commands since the last submission.
    pub(crate) fn encoder(&mut self, gpu: &Gpu) -> &mut CommandEncoder {
        self.encoder.get_or_insert_with(|| gpu.device.create_command_encoder(&Default::default()))
    }

    /// Submits the recorded commands.
    ///
    /// # Errors
    ///
    /// Errors that the device reported since the last call.
    pub(crate) fn submit(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        self.passes = 0;
        if let Some(mut encoder) = mem::take(&mut self.encoder) {
            let timestamps = self.timer.as_ref().map(|timer| timer.resolve(gpu, &mut encoder));
            gpu.queue.submit([encoder.finish()]);
            if let (Some(timer), Some(timestamps)) = (&mut self.timer, &timestamps) {
                timer.collect(gpu, timestamps)?;
            }
        }
        gpu.check()
    }

    /// Records a kernel. `source` is evaluated only if the kernel is not compiled yet; `key`
    /// identifies the variant of the entry point.
    ///
    /// # Errors
    ///
    /// Errors of compilation, of submission, and of the allocation of uniforms.
    pub(crate) fn dispatch(
        &mut self,
        gpu: &Gpu,
        key: &str,
        entry: &'static str,
        source: &dyn Fn() -> String,
        bindings: &[Binding<'_>],
        size: Dispatch,
    ) -> Result<(), GpuError> {
        let [x, y] = grid_of(size, gpu.workgroups_max());
        if x == 0 || y == 0 {
            return Ok(());
        }
        let kernel = gpu.kernel_cache.get(key, entry, || compile(gpu, entry, &source()))?;
        let uniforms: Vec<Option<wgpu::Buffer>> =
            bindings.iter().map(|binding| uniform(gpu, *binding)).collect::<Result<_, _>>()?;
        let layout = &kernel.layout;
        let entries: Vec<BindGroupEntry<'_>> = bindings
            .iter()
            .zip(&uniforms)
            .enumerate()
            .map(|(number, (binding, uniform))| BindGroupEntry {
                binding: number as u32,
                resource: match (binding, uniform) {
                    (Binding::Buffer(array), _) => array.buffer().as_entire_binding(),
                    (Binding::Uniform(_), Some(buffer)) => buffer.as_entire_binding(),
                    (Binding::Uniform(_), None) => unreachable!("uniforms have buffers"),
                },
            })
            .collect();
        let group =
            gpu.device.create_bind_group(&BindGroupDescriptor { label: Some(entry), layout, entries: &entries });
        // Each timed submission blocks until it is done, so passes are submitted only when the
        // timer is full.
        if self.timer.as_ref().map_or(self.passes >= PASSES_PER_SUBMISSION, KernelTimer::is_full) {
            self.submit(gpu)?;
        }
        self.passes += 1;
        let encoder = self.encoder.get_or_insert_with(|| gpu.device.create_command_encoder(&Default::default()));
        let timestamp_writes = self.timer.as_mut().map(|timer| timer.next_pass(entry));
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor { label: Some(entry), timestamp_writes });
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(x, y, 1);
        Ok(())
    }
}

fn uniform(gpu: &Gpu, binding: Binding<'_>) -> Result<Option<wgpu::Buffer>, GpuError> {
    match binding {
        Binding::Uniform(bytes) => filled(gpu, bytes, BufferUsages::UNIFORM).map(Some),
        Binding::Buffer(_) => Ok(None),
    }
}

/// Workgroups along both axes, at most `axis_max` each.
fn grid_of(size: Dispatch, axis_max: u32) -> [u32; 2] {
    let in_rows = |count: usize| {
        let count = count as u32;
        let rows = count.div_ceil(axis_max).max(1);
        [count.div_ceil(rows), rows]
    };
    match size {
        Dispatch::Invocations(count) => in_rows(count.div_ceil(WORKGROUP_SIZE as usize)),
        Dispatch::Workgroups(count) => in_rows(count),
        Dispatch::Grid(grid) => grid,
    }
}

fn compile(gpu: &Gpu, entry: &'static str, source: &str) -> Result<Kernel, GpuError> {
    let module = gpu
        .device
        .create_shader_module(ShaderModuleDescriptor { label: Some(entry), source: ShaderSource::Wgsl(source.into()) });
    let layout = layout_of(gpu, entry, source, ShaderStages::COMPUTE);
    let pipeline_layout = gpu.device.create_pipeline_layout(&PipelineLayoutDescriptor {
        label: Some(entry),
        bind_group_layouts: &[Some(&layout)],
        immediate_size: 0,
    });
    let pipeline = gpu.device.create_compute_pipeline(&ComputePipelineDescriptor {
        label: Some(entry),
        layout: Some(&pipeline_layout),
        module: &module,
        entry_point: Some(entry),
        // All kernels write workgroup memory before they read it.
        compilation_options: PipelineCompilationOptions {
            zero_initialize_workgroup_memory: false,
            ..PipelineCompilationOptions::default()
        },
        cache: None,
    });
    gpu.check().map(|()| Kernel { pipeline, layout })
}

/// Bind group layout of the bindings that a source declares, visible to one shader stage.
pub(crate) fn layout_of(gpu: &Gpu, label: &str, source: &str, visibility: ShaderStages) -> BindGroupLayout {
    let entries: Vec<BindGroupLayoutEntry> = bindings_of(source)
        .map(|(binding, kind)| BindGroupLayoutEntry {
            binding,
            visibility,
            ty: BindingType::Buffer { ty: kind, has_dynamic_offset: false, min_binding_size: None },
            count: None,
        })
        .collect();
    gpu.device.create_bind_group_layout(&BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

/// Numbers and types of the bindings that a source declares.
fn bindings_of(source: &str) -> impl Iterator<Item = (u32, BufferBindingType)> + '_ {
    source.lines().filter_map(|line| {
        let (number, declared) = line.strip_prefix("@group(0) @binding(")?.split_once(") var<")?;
        let kind = match declared.split_once('>')?.0 {
            "uniform" => BufferBindingType::Uniform,
            access => BufferBindingType::Storage { read_only: access == "storage, read" },
        };
        Some((number.parse().ok()?, kind))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dispatch_has_enough_groups_and_rows_that_are_allowed() {
        for count in [0, 1, 256, 257, 65_535 * 256, 65_536 * 256, 100_000_000] {
            let [x, y] = grid_of(Dispatch::Invocations(count), 65_535);
            assert!(x <= 65_535 && y <= 65_535, "{count} invocations are {x} × {y} groups");
            assert!(
                x as usize * y as usize * WORKGROUP_SIZE as usize >= count,
                "{count} invocations fit into {x} × {y} groups"
            );
        }
        assert_eq!(grid_of(Dispatch::Grid([7, 3]), 65_535), [7, 3]);
    }
}
