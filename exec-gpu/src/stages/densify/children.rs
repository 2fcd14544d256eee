//! Gaussians after densification.

use crate::{
    codegen::{source::Source, uniform::uniform},
    device::{
        chunks::{Chunk, ChunkedArray},
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{self, Buffer, Uniform},
            Dispatch,
        },
        memory::Array,
    },
    stages::{
        densify::{
            formulas::{CellAt, SplitChild},
            plan::{DensifyPlan, actions},
        },
        gaussians::planes,
        sort::{COLUMN, Len, Pairs, column, scan, sort},
        step_counters::StepCounters,
    },
};
use specula_core::{
    densify::{Action, split_noise},
    executor::RandomKey,
    morton::{CODE_BITS, interleave},
    scene::{Gaussians, LOG_SCALE, Layout, MEAN},
};

/// Appends the origins of children.
fn origins(source: Source) -> Source {
    source.count("KEPT", 0).count("CLONED", 1).count("FIRST_SPLIT", 2).count("ORIGINS", 4)
}

pub(crate) fn children_source(layout: Layout) -> String {
    Source::new()
        .part(|source| planes(source, layout))
        .count("MEAN", MEAN)
        .part(column)
        .bits()
        .part(actions)
        .part(origins)
        .formula(&CellAt)
        .word_formula("morton_code", ["x", "y", "z"], interleave)
        .uniform::<ChunkSize>()
        .with(include_str!("children.wgsl"))
        .text()
}

pub(crate) fn gather_source(layout: Layout) -> String {
    let source = Source::new().count("PLANES", layout.plane_count()).part(origins);
    source.uniform::<Gathering>().with(include_str!("gather.wgsl")).text()
}

pub(crate) fn split_source(layout: Layout) -> String {
    let source = Source::new().real().part(|source| planes(source, layout));
    let source = source.count("MEAN", MEAN).count("LOG_SCALE", LOG_SCALE).part(origins);
    source.formula(&SplitChild { layout }).uniform::<SplitChunk>().with(include_str!("split_children.wgsl")).text()
}

uniform! {
    /// Chunks that children are gathered from and into.
    struct Gathering {
        /// Range of the children of the new chunk, and its length in numbers.
        first: u32,
        end: u32,
        numbers: u32,
        /// 1 if clones and split children take their parents' numbers too; else they are zero.
        keeps_new: u32,
        /// Range of the parents of the old chunk; children of other parents are skipped.
        old_first: u32,
        old_end: u32,
    }
}

uniform! {
    /// Chunk of the Gaussians before densification.
    struct ChunkSize {
        /// Number of all Gaussians.
        count: u32,
        /// First Gaussian of the chunk, and number of them.
        first: u32,
        piece: u32,
    }
}

uniform! {
    /// Chunk of `count` children, the first of index `first`.
    struct SplitChunk {
        first: u32,
        count: u32,
        /// Number of all Gaussians before densification.
        old_count: u32,
    }
}

/// Gaussians after densification, in Morton order.
pub(crate) struct Children {
    count: usize,
    /// Index of each child's parent, and the child's origin.
    children: Array,
    /// Exclusive sums of three flags of each Gaussian: kept, copied, split.
    offsets: Array,
    old_count: usize,
    split_parents: Array,
    split_count: usize,
}

impl Children {
    /// Enumerates the children of all Gaussians, and sorts them by the Morton codes of their
    /// parents.
    ///
    /// # Errors
    ///
    /// See [`Context::allocate`] and [`Context::dispatch`].
    pub(crate) fn new(
        context: &mut Context,
        counters: &StepCounters,
        gaussians: &Gaussians<ChunkedArray>,
        plan: &DensifyPlan,
    ) -> Result<Self, GpuError> {
        let old_count = gaussians.count;
        let split_count = plan.count(Action::Split);
        let count = plan.count(Action::Keep) + 2 * (plan.count(Action::Clone) + split_count);
        let offsets = context.allocate("offsets", 3 * old_count)?;
        let split_parents = context.allocate("parents", split_count)?;
        let pairs = Pairs { keys: context.allocate("codes", count)?, items: context.allocate("children", count)? };
        let [low, high] = [f32::INFINITY, f32::NEG_INFINITY].map(ordered_bits);
        let bounds = context.upload("bounds", &[low, low, low, high, high, high])?;
        let bindings = [&plan.actions, &offsets, &bounds, &pairs.keys, &pairs.items, &split_parents].map(Buffer);
        dispatch_for_chunks(context, "mark", gaussians, &bindings, 1)?;
        dispatch_for_chunks(context, "find_bounds", gaussians, &bindings, COLUMN)?;
        scan(context, &offsets, 3 * old_count)?;
        dispatch_for_chunks(context, "store_children", gaussians, &bindings, 1)?;
        let children = sort(context, counters, pairs, Len::Known(count), CODE_BITS)?.items;
        Ok(Self { count, children, offsets, old_count, split_parents, split_count })
    }

    /// Number of Gaussians after densification.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Numbers of the children from those of their parents. Those of clones and of split children
    /// are zero unless `keeps_new` is set.
    ///
    /// # Errors
    ///
    /// See [`Context::allocate`] and [`Context::dispatch`].
    pub(crate) fn gather(
        &self,
        context: &mut Context,
        layout: Layout,
        old: &ChunkedArray,
        keeps_new: bool,
    ) -> Result<ChunkedArray, GpuError> {
        let chunking = context.chunking(layout.plane_count());
        let gathered = context.allocate_chunks("Gaussians", self.count, chunking)?;
        for new in gathered.chunks(self.count) {
            for old in old.chunks(self.old_count) {
                self.gather_chunk(context, layout, [&old, &new], keeps_new)?;
            }
        }
        Ok(gathered)
    }

    /// Gathers from an old chunk into a new one.
    fn gather_chunk(
        &self,
        context: &mut Context,
        layout: Layout,
        [old, new]: [&Chunk<'_>; 2],
        keeps_new: bool,
    ) -> Result<(), GpuError> {
        let gathering = Gathering {
            first: new.gaussians.start as u32,
            end: new.gaussians.end as u32,
            numbers: new.array.len() as u32,
            keeps_new: u32::from(keeps_new),
            old_first: old.gaussians.start as u32,
            old_end: old.gaussians.end as u32,
        };
        let bindings = [Uniform(gathering.bytes()), Buffer(&self.children), Buffer(old.array), Buffer(new.array)];
        let (key, size) = (format!("{layout:?}"), Dispatch::Invocations(new.array.len()));
        context.dispatch(&key, "gather", &|| gather_source(layout), &bindings, size)
    }

    /// Samples the means of split children, and shrinks them. The host draws the noise, so all
    /// executors use the same numbers.
    ///
    /// # Errors
    ///
    /// See [`Context::download`] and [`Context::dispatch`].
    pub(crate) fn sample_split_children(
        &self,
        context: &mut Context,
        layout: Layout,
        values: &ChunkedArray,
        key: RandomKey,
    ) -> Result<(), GpuError> {
        if self.split_count == 0 {
            return Ok(());
        }
        let mut parents = vec![0_u32; self.split_count];
        context.download(&self.split_parents, 0, &mut parents)?;
        let noise: Vec<f32> = parents
            .iter()
            .flat_map(|parent| [0, 1].map(|child| 2 * u64::from(*parent) + child))
            .flat_map(|draw| split_noise(key.seed, key.stream, draw))
            .collect();
        let noise = context.upload("noise", &noise)?;
        let (key, source) = (format!("{layout:?}"), || split_source(layout));
        for Chunk { gaussians, array } in values.chunks(self.count) {
            let [first, count, old_count] =
                [gaussians.start, gaussians.len(), self.old_count].map(|number| number as u32);
            let chunk = SplitChunk { first, count, old_count };
            let bindings =
                [Uniform(chunk.bytes()), Buffer(&self.children), Buffer(&self.offsets), Buffer(&noise), Buffer(array)];
            let size = Dispatch::Invocations(gaussians.len());
            context.dispatch(&key, "sample_split_children", &source, &bindings, size)?;
        }
        Ok(())
    }
}

/// Dispatches a kernel of `children.wgsl` for every chunk; each invocation processes `each`
/// Gaussians.
fn dispatch_for_chunks(
    context: &mut Context,
    entry: &'static str,
    gaussians: &Gaussians<ChunkedArray>,
    others: &[Binding<'_>],
    each: usize,
) -> Result<(), GpuError> {
    let (count, layout) = (gaussians.count, gaussians.layout);
    let (key, source) = (format!("{layout:?}"), || children_source(layout));
    for Chunk { gaussians, array } in gaussians.values.chunks(count) {
        let [count, first, piece] = [count, gaussians.start, gaussians.len()].map(|number| number as u32);
        let size = ChunkSize { count, first, piece };
        let mut bindings = vec![Uniform(size.bytes()), Buffer(array)];
        bindings.extend(others);
        let invocations = Dispatch::Invocations(gaussians.len().div_ceil(each));
        context.dispatch(&key, entry, &source, &bindings, invocations)?;
    }
    Ok(())
}

/// Bits that sort as numbers do, as in `bits.wgsl`.
fn ordered_bits(x: f32) -> u32 {
    let bits = x.to_bits();
    if x.is_sign_negative() { !bits } else { bits | 1 << 31 }
}
