//! Kernels: their sources put together, compiled once, recorded with what they read and write.

use crate::{
    device::{Gpu, GpuError},
    memory::{Array, filled},
    stopwatch::Stopwatch,
};
use core::mem;
use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};
use wgpu::{
    BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry, BindingType,
    Buffer, BufferBindingType, BufferUsages, CommandEncoder, ComputePassDescriptor, ComputePipeline,
    ComputePipelineDescriptor, PipelineCompilationOptions, PipelineLayoutDescriptor, ShaderModuleDescriptor,
    ShaderSource, ShaderStages,
};

/// What a kernel is bound to, in the order of its bindings.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Bound<'a> {
    /// Settings: the bytes of a structure.
    Uniform(&'a [u8]),
    /// Numbers on the device.
    Array(&'a Array),
}

/// A compiled kernel.
#[derive(Debug)]
struct Kernel {
    pipeline: ComputePipeline,
    layout: BindGroupLayout,
}

/// How many workgroups.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Groups {
    /// Enough for so many invocations, `GROUP` each; numbered by `linear_index`.
    For(usize),
    /// So many workgroups, numbered by `linear_index`.
    Count(usize),
    /// One for each cell of a grid.
    Grid([u32; 2]),
}

/// Kernels that are recorded before the device is given them: it then computes while others are recorded.
const PASSES_AT_ONCE: usize = 32;

/// Invocations of a workgroup that is a row.
pub(crate) const GROUP: u32 = 256;

/// Kernels of a device by variant and entry point, for all executors on it: each is compiled once.
#[derive(Debug, Default)]
pub(crate) struct Compiled(Mutex<HashMap<(String, &'static str), Arc<Kernel>>>);

impl Compiled {
    /// A kernel, compiled from its source when it is first asked for.
    fn get(
        &self,
        gpu: &Gpu,
        key: &str,
        entry: &'static str,
        source: &dyn Fn() -> String,
    ) -> Result<Arc<Kernel>, GpuError> {
        let mut kernels = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let id = (key.to_owned(), entry);
        if let Some(kernel) = kernels.get(&id) {
            return Ok(kernel.clone());
        }
        let kernel = Arc::new(compile(gpu, entry, &source()));
        gpu.check()?;
        kernels.insert(id, kernel.clone());
        Ok(kernel)
    }
}

/// The commands that were recorded but not yet submitted.
#[derive(Debug, Default)]
pub(crate) struct Kernels {
    encoder: Option<CommandEncoder>,
    /// Kernels among them.
    passes: usize,
    /// Times kernels, if that is wanted.
    pub(crate) stopwatch: Option<Stopwatch>,
}

impl Kernels {
    /// The commands since the last submission.
    pub(crate) fn encoder(&mut self, gpu: &Gpu) -> &mut CommandEncoder {
        self.encoder.get_or_insert_with(|| gpu.device.create_command_encoder(&Default::default()))
    }

    /// Sends what was recorded to the device.
    pub(crate) fn submit(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        self.passes = 0;
        if let Some(mut encoder) = mem::take(&mut self.encoder) {
            let stamps = self.stopwatch.as_ref().map(|stopwatch| stopwatch.stop(gpu, &mut encoder));
            gpu.queue.submit([encoder.finish()]);
            if let (Some(stopwatch), Some(stamps)) = (&mut self.stopwatch, &stamps) {
                stopwatch.note(gpu, stamps)?;
            }
        }
        gpu.check()
    }

    /// Records a kernel. `source` is put together only when it is not yet compiled; `key` tells one variant of an
    /// entry point from another.
    pub(crate) fn run(
        &mut self,
        gpu: &Gpu,
        key: &str,
        entry: &'static str,
        source: &dyn Fn() -> String,
        bound: &[Bound<'_>],
        groups: Groups,
    ) -> Result<(), GpuError> {
        let [x, y] = grid_of(groups, gpu.groups_max());
        if x == 0 || y == 0 {
            return Ok(());
        }
        let kernel = gpu.compiled.get(gpu, key, entry, source)?;
        let uniforms: Vec<Option<Buffer>> = bound.iter().map(|bound| uniform(gpu, *bound)).collect::<Result<_, _>>()?;
        let layout = &kernel.layout;
        let entries: Vec<BindGroupEntry<'_>> = bound
            .iter()
            .zip(&uniforms)
            .enumerate()
            .map(|(binding, (bound, uniform))| BindGroupEntry {
                binding: binding as u32,
                resource: match (bound, uniform) {
                    (Bound::Array(array), _) => array.buffer().as_entire_binding(),
                    (Bound::Uniform(_), Some(buffer)) => buffer.as_entire_binding(),
                    (Bound::Uniform(_), None) => unreachable!("uniforms have buffers"),
                },
            })
            .collect();
        let group =
            gpu.device.create_bind_group(&BindGroupDescriptor { label: Some(entry), layout, entries: &entries });
        // Submissions that are timed are waited for, so there are as few as can be.
        if self.stopwatch.as_ref().map_or(self.passes >= PASSES_AT_ONCE, Stopwatch::is_full) {
            self.submit(gpu)?;
        }
        self.passes += 1;
        let encoder = self.encoder.get_or_insert_with(|| gpu.device.create_command_encoder(&Default::default()));
        let timestamp_writes = self.stopwatch.as_mut().map(|stopwatch| stopwatch.next_pass(entry));
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor { label: Some(entry), timestamp_writes });
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(x, y, 1);
        Ok(())
    }
}

fn uniform(gpu: &Gpu, bound: Bound<'_>) -> Result<Option<Buffer>, GpuError> {
    match bound {
        Bound::Uniform(bytes) => filled(gpu, bytes, BufferUsages::UNIFORM).map(Some),
        Bound::Array(_) => Ok(None),
    }
}

/// Workgroups along both axes, none longer than allowed.
fn grid_of(groups: Groups, most: u32) -> [u32; 2] {
    let in_rows = |count: usize| {
        let count = count as u32;
        let rows = count.div_ceil(most).max(1);
        [count.div_ceil(rows), rows]
    };
    match groups {
        Groups::For(invocations) => in_rows(invocations.div_ceil(GROUP as usize)),
        Groups::Count(count) => in_rows(count),
        Groups::Grid(grid) => grid,
    }
}

fn compile(gpu: &Gpu, entry: &'static str, source: &str) -> Kernel {
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
        // Every kernel writes workgroup memory before it reads it.
        compilation_options: PipelineCompilationOptions {
            zero_initialize_workgroup_memory: false,
            ..PipelineCompilationOptions::default()
        },
        cache: None,
    });
    Kernel { pipeline, layout }
}

/// The bindings that a source declares, for one kind of stage.
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

/// Numbers and kinds of a source's bindings.
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
            let [x, y] = grid_of(Groups::For(count), 65_535);
            assert!(x <= 65_535 && y <= 65_535, "{count} invocations are {x} × {y} groups");
            assert!(x as usize * y as usize * GROUP as usize >= count, "{count} invocations fit into {x} × {y} groups");
        }
        assert_eq!(grid_of(Groups::Grid([7, 3]), 65_535), [7, 3]);
    }
}
