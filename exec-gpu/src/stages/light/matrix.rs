//! Sparse matrices over the texels of a light.

use crate::{
    codegen::{source::Source, uniform::uniform},
    device::{
        context::Context,
        error::GpuError,
        kernel_set::KernelSet,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
        memory::Array,
    },
    stages::light::texels,
};
use core::ops::Range;
use specula_core::pack::Storage;
use specula_prefilter::sparse::Sparse;

/// Partial sums of a row of a sparse matrix, a power of two: on hardware many of them hide the
/// latency of long rows, a software driver is sequential.
const fn row_sums(kernels: KernelSet) -> usize {
    match kernels {
        KernelSet::Software => 4,
        KernelSet::Hardware => 32,
    }
}

uniform! {
    /// Rows of a matrix product.
    struct Product {
        row_count: u32,
        /// Texels that the first column and the first row belong to.
        source_first: u32,
        out_first: u32,
    }
}

/// Kernel of a matrix product, named `entry`; `destination` appends the function `store_product`.
fn product_source(kernels: KernelSet, entry: &str, destination: impl FnOnce(Source) -> Source) -> String {
    let kernel = include_str!("product.wgsl").replace("fn multiply_rows(", &format!("fn {entry}("));
    Source::new().count("ROW_SUMS", row_sums(kernels)).uniform::<Product>().with(&kernel).part(destination).text()
}

const STORED: &str = "fn store_product(index: u32, texel: vec4f) {\n    texels[index] = texel;\n}\n";
const ADDED: &str = "fn store_product(index: u32, texel: vec4f) {\n    texels[index] += texel;\n}\n";
const PADDED: &str = "@group(0) @binding(5) var<storage, read_write> padded: array<Texel>;
fn store_product(index: u32, texel: vec4f) {
    padded[index] = texel_of(texel);
}
";

/// Destination of a matrix product.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Out<'a> {
    /// The texels themselves, from this index on.
    Texels(usize),
    /// The texels themselves, from this index on, to which the product is added.
    AddedTexels(usize),
    /// Another array, in a storage format.
    Other(&'a Array, Storage),
}

impl Out<'_> {
    /// Name of the kernel.
    fn entry(self) -> &'static str {
        match self {
            Self::Texels(_) => "filter_texels",
            Self::AddedTexels(_) => "add_filtered_texels",
            Self::Other(..) => "pad_texels",
        }
    }

    /// Variant of the kernel.
    fn key(self, kernels: KernelSet) -> String {
        match self {
            Self::Texels(_) | Self::AddedTexels(_) => format!("prefilter, {kernels:?}"),
            Self::Other(_, storage) => format!("prefilter {storage:?}, {kernels:?}"),
        }
    }

    /// Source of the kernel.
    fn source(self, kernels: KernelSet) -> String {
        product_source(kernels, self.entry(), |source| match self {
            Self::Texels(_) => source.with(STORED),
            Self::AddedTexels(_) => source.with(ADDED),
            Self::Other(_, storage) => texels(source, storage).with(PADDED),
        })
    }
}

/// Sparse matrix on the device, in parts that fit into arrays.
#[derive(Debug)]
pub(crate) struct Matrix {
    parts: Vec<RowRange>,
}

/// Some rows of a matrix.
#[derive(Debug)]
struct RowRange {
    first_row: usize,
    row_count: usize,
    starts: Array,
    columns: Array,
    weights: Array,
}

impl Matrix {
    pub(crate) fn new(context: &mut Context, sparse: &Sparse) -> Result<Self, GpuError> {
        // `starts` has one number more, for the end of the last row.
        let most = (context.gpu.binding_max() / 4) as usize - 1;
        let parts: Result<Vec<RowRange>, GpuError> =
            sparse.ranges(most).into_iter().map(|rows| RowRange::new(context, sparse, rows)).collect();
        Ok(Self { parts: parts? })
    }

    /// Multiplies the matrix with the texels from index `first` on.
    pub(crate) fn apply(
        &self,
        context: &mut Context,
        texels: &Array,
        first: usize,
        out: Out<'_>,
    ) -> Result<(), GpuError> {
        self.parts.iter().try_for_each(|rows| rows.apply(context, texels, first, out))
    }
}

impl RowRange {
    fn new(context: &mut Context, sparse: &Sparse, rows: Range<usize>) -> Result<Self, GpuError> {
        let first = sparse.starts[rows.start];
        let weights = first..sparse.starts[rows.end];
        let starts: Vec<u32> =
            sparse.starts[rows.start..=rows.end].iter().map(|start| (*start - first) as u32).collect();
        Ok(Self {
            first_row: rows.start,
            row_count: rows.len(),
            starts: context.upload("starts of a prefilter's rows", &starts)?,
            columns: context.upload("columns of a prefilter", &sparse.columns[weights.clone()])?,
            weights: context.upload("weights of a prefilter", &sparse.weights[weights])?,
        })
    }

    fn apply(&self, context: &mut Context, source: &Array, first: usize, out: Out<'_>) -> Result<(), GpuError> {
        let out_first = match out {
            Out::Texels(first) | Out::AddedTexels(first) => first,
            Out::Other(..) => 0,
        };
        let [row_count, source_first, out_first] =
            [self.row_count, first, out_first + self.first_row].map(|number| number as u32);
        let product = Product { row_count, source_first, out_first };
        let mut bindings = vec![
            Uniform(product.bytes()),
            Buffer(&self.starts),
            Buffer(&self.columns),
            Buffer(&self.weights),
            Buffer(source),
        ];
        if let Out::Other(array, _) = out {
            bindings.push(Buffer(array));
        }
        let kernels = context.kernels;
        context.dispatch(
            &out.key(kernels),
            out.entry(),
            &|| out.source(kernels),
            &bindings,
            Dispatch::Invocations(row_sums(kernels) * self.row_count),
        )
    }
}
