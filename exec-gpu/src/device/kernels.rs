//! Recording of kernels into command encoders, and their compilation from WGSL.

use crate::{
    codegen::{source::WORKGROUP_SIZE, uniform::UniformBytes},
    device::{cache::Kernel, error::GpuError, gpu::Gpu, memory::Array, timer::KernelTimer},
};
use core::{mem, num::NonZero, ops::Range};
use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry,
    BindingResource, BindingType, Buffer, BufferBinding, BufferBindingType, BufferDescriptor, BufferUsages,
    CommandEncoder, ComputePass, ComputePassDescriptor, ComputePipelineDescriptor, PipelineCompilationOptions,
    PipelineLayoutDescriptor, ShaderModuleDescriptor, ShaderSource, ShaderStages,
};

/// Resource of a kernel's binding; a kernel's bindings are numbered in the order in which they are
/// passed.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Binding<'a> {
    /// Uniform structure.
    Uniform(UniformBytes<'a>),
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

/// Maximum number of kernels of a submission: the device computes one submission while the next is
/// recorded.
const DISPATCHES_PER_SUBMISSION: usize = 16;

/// Bytes of the uniforms of a submission: enough for its kernels.
const UNIFORM_BYTES: usize = 32 << 10;

/// Sizes of uniforms are multiples of the largest alignment in them.
const UNIFORM_STEP: usize = 16;

/// Uniforms of a submission in a shared buffer: creating a buffer for each would take longer than
/// most kernels.
#[derive(Debug, Default)]
struct Uniforms {
    buffer: Option<Buffer>,
    bytes: Vec<u8>,
}

impl Uniforms {
    /// True if uniforms of these sizes fit into the submission.
    fn have_room(&self, gpu: &Gpu, sizes: impl Iterator<Item = usize>) -> bool {
        let all: usize = sizes.map(|size| size.next_multiple_of(gpu.uniform_alignment())).sum();
        self.next_start(gpu) + all <= UNIFORM_BYTES
    }

    /// Offset of the next uniform.
    fn next_start(&self, gpu: &Gpu) -> usize {
        self.bytes.len().next_multiple_of(gpu.uniform_alignment())
    }

    /// Appends a uniform; returns its offset in the buffer.
    fn push(&mut self, gpu: &Gpu, uniform: &[u8]) -> Range<u64> {
        let start = self.next_start(gpu);
        self.bytes.resize(start, 0);
        self.bytes.extend_from_slice(uniform);
        self.bytes.resize(start + uniform.len().next_multiple_of(UNIFORM_STEP), 0);
        start as u64..self.bytes.len() as u64
    }

    /// Buffer of the uniforms.
    fn buffer(&mut self, gpu: &Gpu) -> Buffer {
        let buffer = self.buffer.get_or_insert_with(|| {
            gpu.device.create_buffer(&BufferDescriptor {
                label: Some("uniforms"),
                size: UNIFORM_BYTES as u64,
                usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        });
        buffer.clone()
    }

    /// Writes the uniforms before the next submission; the buffer can then be reused, because the
    /// device keeps the order.
    fn write(&mut self, gpu: &Gpu) {
        if let Some(buffer) = &self.buffer {
            gpu.queue.write_buffer(buffer, 0, &self.bytes);
        }
        self.bytes.clear();
    }
}

/// Commands that are recorded but not submitted.
#[derive(Debug, Default)]
pub(crate) struct Recorder {
    encoder: Option<CommandEncoder>,
    /// Whether the encoder is another program's, which submits it.
    is_borrowed: bool,
    /// Pass of the last kernels in the encoder, shared by later ones.
    pass: Option<ComputePass<'static>>,
    uniforms: Uniforms,
    /// Kernels in the encoder.
    dispatches: usize,
    /// Timer of the kernels, if they are timed; then each has a separate pass.
    pub(crate) timer: Option<KernelTimer>,
}

impl Recorder {
    /// Encoder of the commands since the last submission, for commands outside of passes.
    pub(crate) fn encoder(&mut self, gpu: &Gpu) -> &mut CommandEncoder {
        self.pass = None;
        self.encoder.get_or_insert_with(|| gpu.device.create_command_encoder(&Default::default()))
    }

    /// Records into the encoder of another program from now on, instead of submitting.
    pub(crate) fn borrow(&mut self, encoder: CommandEncoder) {
        debug_assert!(self.encoder.is_none(), "earlier commands are submitted");
        (self.encoder, self.is_borrowed) = (Some(encoder), true);
    }

    /// The encoder of [`Self::borrow`], with the commands since then.
    pub(crate) fn give_back(&mut self, gpu: &Gpu) -> CommandEncoder {
        self.end_part(gpu);
        self.is_borrowed = false;
        self.encoder.take().expect("a borrowed encoder stays until it is given back")
    }

    /// Whether commands are recorded into the encoder of another program.
    pub(crate) fn is_borrowed(&self) -> bool {
        self.is_borrowed
    }

    /// Ends a part of a borrowed encoder. Its uniforms stay as they are until the program submits
    /// it, so the next part has another buffer.
    fn end_part(&mut self, gpu: &Gpu) {
        (self.dispatches, self.pass) = (0, None);
        self.uniforms.write(gpu);
        self.uniforms.buffer = None;
    }

    /// Submits the recorded commands, unless they are another program's to submit.
    ///
    /// # Errors
    ///
    /// Errors that the device reported since the last call.
    pub(crate) fn submit(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        if self.is_borrowed {
            self.end_part(gpu);
            return gpu.check();
        }
        (self.dispatches, self.pass) = (0, None);
        if let Some(mut encoder) = mem::take(&mut self.encoder) {
            self.uniforms.write(gpu);
            let timestamps = self.timer.as_ref().map(|timer| timer.resolve(gpu, &mut encoder));
            gpu.queue.submit([encoder.finish()]);
            if let (Some(timer), Some(timestamps)) = (&mut self.timer, &timestamps) {
                timer.collect(gpu, timestamps)?;
            }
        }
        // The device may have no memory for the uniforms' buffer.
        gpu.check().inspect_err(|_| self.uniforms.buffer = None)
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
        self.make_room(gpu, bindings)?;
        let group = self.bind(gpu, entry, &kernel.layout, bindings);
        self.dispatches += 1;
        let mut pass = self.open_pass(gpu, entry);
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(x, y, 1);
        self.pass = self.timer.is_none().then_some(pass);
        Ok(())
    }

    /// Submits the recorded commands if a kernel with these bindings does not fit into the
    /// submission.
    fn make_room(&mut self, gpu: &Gpu, bindings: &[Binding<'_>]) -> Result<(), GpuError> {
        let uniforms = bindings.iter().filter_map(|binding| match binding {
            Binding::Uniform(bytes) => Some(bytes.as_slice().len()),
            Binding::Buffer(_) => None,
        });
        // Each timed submission blocks until it is done, so kernels are submitted only when the
        // timer is full.
        let is_full = self.timer.as_ref().map_or(self.dispatches >= DISPATCHES_PER_SUBMISSION, KernelTimer::is_full);
        if is_full || !self.uniforms.have_room(gpu, uniforms) { self.submit(gpu) } else { Ok(()) }
    }

    /// Bind group of some bindings; appends their uniforms to those of the submission.
    fn bind(
        &mut self,
        gpu: &Gpu,
        entry: &'static str,
        layout: &BindGroupLayout,
        bindings: &[Binding<'_>],
    ) -> BindGroup {
        let Self { uniforms, .. } = self;
        let buffer = uniforms.buffer(gpu);
        let resources = bindings.iter().map(|binding| match binding {
            Binding::Buffer(array) => array.buffer().as_entire_binding(),
            Binding::Uniform(bytes) => {
                let Range { start, end } = uniforms.push(gpu, bytes.as_slice());
                BindingResource::Buffer(BufferBinding {
                    buffer: &buffer,
                    offset: start,
                    size: NonZero::new(end - start),
                })
            }
        });
        let entries: Vec<BindGroupEntry<'_>> =
            (0..).zip(resources).map(|(binding, resource)| BindGroupEntry { binding, resource }).collect();
        gpu.device.create_bind_group(&BindGroupDescriptor { label: Some(entry), layout, entries: &entries })
    }

    /// Pass for a kernel: the previous one, unless kernels are timed.
    fn open_pass(&mut self, gpu: &Gpu, entry: &'static str) -> ComputePass<'static> {
        let pass = self.pass.take();
        match (pass, &mut self.timer) {
            (Some(pass), None) => pass,
            (pass, timer) => {
                // A pass without timing ends before a timed one.
                drop(pass);
                let timestamp_writes = timer.as_mut().map(|timer| timer.next_pass(entry));
                let descriptor = ComputePassDescriptor { label: Some(entry), timestamp_writes };
                let encoder =
                    self.encoder.get_or_insert_with(|| gpu.device.create_command_encoder(&Default::default()));
                encoder.begin_compute_pass(&descriptor).forget_lifetime()
            }
        }
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

/// Bind group layout of the bindings in a source, visible to one shader stage.
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

/// Numbers and types of the bindings in a source.
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
