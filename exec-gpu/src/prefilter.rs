//! Light into roughness levels.

use crate::{
    device::GpuError,
    executor::GpuExecutor,
    formulas::LevelOf,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    memory::Array,
    source::{self, LightLayout, ROW_SUMS},
};
use core::ops::Range;
use specula_core::{
    cubemap::FACE_COUNT,
    pack::{Storage, unpack2},
    prefilter::{LevelRange, PrefilterScheme},
    scene::{Environment, RadianceActivation},
};
use specula_prefilter::{
    Operator, SPLIT_SUM,
    sparse::{Linear, Sparse},
};
use std::sync::{Arc, OnceLock};

/// Numbers of a texel: red, green, blue and nothing.
pub(crate) const TEXEL_LEN: usize = 4;

/// Words that a texel of a filtered light takes.
fn texel_words(storage: Storage) -> usize {
    match storage {
        Storage::F32 => TEXEL_LEN,
        Storage::F16 => TEXEL_LEN / 2,
    }
}

/// A light filtered into levels.
#[derive(Debug)]
pub struct Light {
    pub(crate) layout: LightLayout,
    /// All levels with their aprons, one after the other.
    pub(crate) texels: Array,
    /// The split-sum table of the authors' shading; one entry in other schemes.
    pub(crate) split_sum: Array,
    /// What they were filtered with.
    weights: Arc<Weights>,
}

/// Gradient of a [`Light`], texel by texel.
#[derive(Debug)]
pub struct LightGrad {
    /// As [`Light::texels`] lie.
    pub(crate) texels: Array,
}

/// The weights of a prefilter on the device.
#[derive(Debug)]
pub(crate) struct Weights {
    /// What they are for.
    pub(crate) key: (PrefilterScheme, usize, LevelRange),
    operator: Operator,
    forward: Matrices,
    /// The way back, once a gradient has been asked for.
    transposed: OnceLock<Matrices>,
}

/// The matrices of a prefilter, or all of them transposed.
#[derive(Debug)]
struct Matrices {
    /// From each level of the pyramid to the next.
    reductions: Vec<Matrix>,
    /// None where there are too many weights to keep: then they are worked out anew at each use.
    rows: Option<Matrix>,
    aprons: Matrix,
}

impl Matrices {
    fn new(machine: &mut Machine, operator: &Operator, of: fn(&Linear) -> &Sparse) -> Result<Self, GpuError> {
        let reductions: Result<Vec<Matrix>, GpuError> =
            operator.reductions().map(|(_, reduction)| Matrix::new(machine, of(reduction))).collect();
        Ok(Self {
            reductions: reductions?,
            rows: operator.rows().map(|rows| Matrix::new(machine, of(rows))).transpose()?,
            aprons: Matrix::new(machine, of(operator.aprons()))?,
        })
    }
}

/// What becomes of a matrix's product.
#[derive(Clone, Copy, Debug)]
enum Out<'a> {
    /// It goes to the texels from some place on.
    Texels(usize),
    /// It is added to them.
    AddedTexels(usize),
    /// It goes to another array, and is stored there in this way.
    Other(&'a Array, Storage),
}

/// A sparse matrix on the device, in as many pieces as arrays are too small for it.
#[derive(Debug)]
struct Matrix {
    pieces: Vec<Piece>,
}

/// Some rows of a matrix.
#[derive(Debug)]
struct Piece {
    first_row: usize,
    row_count: usize,
    starts: Array,
    columns: Array,
    weights: Array,
}

impl Matrix {
    fn new(machine: &mut Machine, sparse: &Sparse) -> Result<Self, GpuError> {
        // One number is left for the end of the last row.
        let most = (machine.gpu.binding_max() / 4) as usize - 1;
        let pieces: Result<Vec<Piece>, GpuError> =
            sparse.ranges(most).into_iter().map(|rows| Piece::new(machine, sparse, rows)).collect();
        Ok(Self { pieces: pieces? })
    }

    /// Its product with the texels from `source` on.
    fn apply(&self, machine: &mut Machine, texels: &Array, source: usize, out: Out<'_>) -> Result<(), GpuError> {
        self.pieces.iter().try_for_each(|piece| piece.apply(machine, texels, source, out))
    }
}

impl Piece {
    fn new(machine: &mut Machine, sparse: &Sparse, rows: Range<usize>) -> Result<Self, GpuError> {
        let first = sparse.starts[rows.start];
        let weights = first..sparse.starts[rows.end];
        let starts: Vec<u32> =
            sparse.starts[rows.start..=rows.end].iter().map(|start| (*start - first) as u32).collect();
        Ok(Self {
            first_row: rows.start,
            row_count: rows.len(),
            starts: machine.upload("starts of a prefilter's rows", &starts)?,
            columns: machine.upload("columns of a prefilter", &sparse.columns[weights.clone()])?,
            weights: machine.upload("weights of a prefilter", &sparse.weights[weights])?,
        })
    }

    fn apply(&self, machine: &mut Machine, texels: &Array, source: usize, out: Out<'_>) -> Result<(), GpuError> {
        let none = machine.take("nothing", TEXEL_LEN)?;
        let (entry, first, other, storage) = match out {
            Out::Texels(first) => ("filter_texels", first, &none, Storage::F32),
            Out::AddedTexels(first) => ("add_filtered_texels", first, &none, Storage::F32),
            Out::Other(array, storage) => ("pad_texels", 0, array, storage),
        };
        let settings = [self.row_count as u32, source as u32, (first + self.first_row) as u32];
        let bound = [
            Uniform(bytemuck::cast_slice(&settings)),
            Of(&self.starts),
            Of(&self.columns),
            Of(&self.weights),
            Of(texels),
            Of(other),
        ];
        let (key, source) = (format!("prefilter {storage:?}"), || source::prefilter(storage));
        machine.run(&key, entry, &source, &bound, Groups::For(ROW_SUMS * self.row_count))
    }
}

/// Weights that are on the device at once where not all are kept.
const WEIGHTS_AT_ONCE: usize = 1 << 22;

/// Applies rows that are not kept, piece by piece: `apply` is given each with the number of its first row. Waits for
/// the device, so that no more than a piece is there at once.
fn apply_pieces(
    machine: &mut Machine,
    operator: &Operator,
    mut apply: impl FnMut(&mut Machine, usize, &Sparse) -> Result<(), GpuError>,
) -> Result<(), GpuError> {
    for (first_row, piece) in operator.pieces(WEIGHTS_AT_ONCE) {
        apply(machine, first_row, &piece)?;
        machine.finish()?;
    }
    Ok(())
}

impl Weights {
    pub(crate) fn new(machine: &mut Machine, key: (PrefilterScheme, usize, LevelRange)) -> Result<Arc<Self>, GpuError> {
        let (scheme, resolution, kept) = key;
        Self::of(machine, key, Operator::new(scheme, resolution, kept))
    }

    fn of(
        machine: &mut Machine,
        key: (PrefilterScheme, usize, LevelRange),
        operator: Operator,
    ) -> Result<Arc<Self>, GpuError> {
        let forward = Matrices::new(machine, &operator, |linear| &linear.forward)?;
        Ok(Arc::new(Self { key, forward, operator, transposed: OnceLock::new() }))
    }

    fn transposed(&self, machine: &mut Machine) -> Result<&Matrices, GpuError> {
        if let Some(transposed) = self.transposed.get() {
            return Ok(transposed);
        }
        let transposed = Matrices::new(machine, &self.operator, Linear::transposed)?;
        Ok(self.transposed.get_or_init(|| transposed))
    }

    fn layout(&self, storage: Storage) -> LightLayout {
        let levels = self.operator.levels().to_vec();
        let offsets = self.operator.offsets();
        let places = offsets[..offsets.len() - 1].iter().enumerate();
        LightLayout {
            places: places.map(|(level, first)| (*first, self.operator.resolution(level))).collect(),
            levels: LevelOf { levels },
            storage,
        }
    }
}

pub(crate) fn prefilter(
    machine: &mut Machine,
    weights: &Arc<Weights>,
    environment: &Environment<&Array>,
    storage: Storage,
) -> Result<Light, GpuError> {
    let operator = &weights.operator;
    let texel_count = texel_count(environment);
    let nodes = machine.take("texels of a light", TEXEL_LEN * (operator.node_count() + operator.row_count()))?;
    let settings = base_of(environment);
    let bound = [Uniform(bytemuck::cast_slice(&settings)), Of(environment.values), Of(&nodes)];
    machine.run("activate", "activate_texels", &source::activate, &bound, Groups::For(texel_count))?;
    for (([fine, coarse], _), matrix) in operator.reductions().zip(&weights.forward.reductions) {
        matrix.apply(machine, &nodes, fine, Out::Texels(coarse))?;
    }
    let first_row = operator.node_count();
    match &weights.forward.rows {
        Some(rows) => rows.apply(machine, &nodes, 0, Out::Texels(first_row))?,
        None => apply_pieces(machine, operator, |machine, first, piece| {
            Matrix::new(machine, piece)?.apply(machine, &nodes, 0, Out::Texels(first_row + first))
        })?,
    }
    let texels = machine.take("levels of a light", texel_words(storage) * operator.padded_count())?;
    weights.forward.aprons.apply(machine, &nodes, 0, Out::Other(&texels, storage))?;
    let split_sum = match weights.key.0 {
        PrefilterScheme::Official => machine.upload("split sums", &SPLIT_SUM)?,
        PrefilterScheme::Exact => machine.upload("split sums", &[[0.0_f32; 2]])?,
    };
    Ok(Light { layout: weights.layout(storage), texels, split_sum, weights: weights.clone() })
}

pub(crate) fn prefilter_vjp(
    machine: &mut Machine,
    environment: &Environment<&Array>,
    light: &Light,
    grad: &LightGrad,
) -> Result<Array, GpuError> {
    let operator = &light.weights.operator;
    let transposed = light.weights.transposed(machine)?;
    let nodes = machine.take("gradient of a light", TEXEL_LEN * (operator.node_count() + operator.row_count()))?;
    transposed.aprons.apply(machine, &grad.texels, 0, Out::Other(&nodes, Storage::F32))?;
    let first_row = operator.node_count();
    match &transposed.rows {
        Some(rows) => rows.apply(machine, &nodes, first_row, Out::AddedTexels(0))?,
        None => apply_pieces(machine, operator, |machine, first, piece| {
            let transposed = Matrix::new(machine, &piece.transpose(first_row))?;
            transposed.apply(machine, &nodes, first_row + first, Out::AddedTexels(0))
        })?,
    }
    for (([fine, coarse], _), matrix) in operator.reductions().rev().zip(transposed.reductions.iter().rev()) {
        matrix.apply(machine, &nodes, coarse, Out::AddedTexels(fine))?;
    }
    let out = machine.take("gradient of an environment", environment.values.len())?;
    let settings = base_of(environment);
    let bound = [Uniform(bytemuck::cast_slice(&settings)), Of(environment.values), Of(&nodes), Of(&out)];
    let groups = Groups::For(texel_count(environment));
    machine.run("activate", "activate_texels_vjp", &source::activate_vjp, &bound, groups)?;
    Ok(out)
}

fn texel_count<A>(environment: &Environment<A>) -> usize {
    FACE_COUNT * environment.resolution * environment.resolution
}

/// `Base` of `radiance.wgsl`.
fn base_of<A>(environment: &Environment<A>) -> [u32; 2] {
    let is_exponential = environment.activation == RadianceActivation::Exponential;
    [texel_count(environment) as u32, u32::from(is_exponential)]
}

impl GpuExecutor {
    /// The texels of a light, level by level with their aprons, each of four numbers; the fourth is zero.
    pub fn read_light(&mut self, light: &Light) -> Result<Vec<f32>, GpuError> {
        if light.layout.storage == Storage::F32 {
            return self.read_texels(&light.texels);
        }
        let mut words = vec![0; light.texels.len()];
        self.machine.download(&light.texels, 0, &mut words)?;
        Ok(words.into_iter().flat_map(unpack2).collect())
    }

    /// The gradient of a light from that of its texels, as [`Self::read_light`] gives them.
    pub fn light_grad(&mut self, texels: &[f32]) -> Result<LightGrad, GpuError> {
        Ok(LightGrad { texels: self.machine.upload("gradient of a light", texels)? })
    }

    /// The gradient of a light's texels.
    pub fn read_light_grad(&mut self, grad: &LightGrad) -> Result<Vec<f32>, GpuError> {
        self.read_texels(&grad.texels)
    }

    fn read_texels(&mut self, texels: &Array) -> Result<Vec<f32>, GpuError> {
        let mut values = vec![0.0; texels.len()];
        self.machine.download(texels, 0, &mut values)?;
        Ok(values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::random::uniform;

    /// A light and the gradient of its environment, from random numbers.
    fn there_and_back(machine: &mut Machine, weights: &Arc<Weights>) -> [Vec<f32>; 2] {
        let (_, resolution, _) = weights.key;
        let mut draw = |stream: u64, len: usize| {
            let numbers: Vec<f32> = (0..len).map(|k| uniform(3, stream, k as u64)).collect();
            machine.upload("numbers", &numbers).expect("numbers fit")
        };
        let values = draw(0, 3 * FACE_COUNT * resolution * resolution);
        let grad = LightGrad { texels: draw(1, TEXEL_LEN * weights.operator.padded_count()) };
        let environment = Environment { resolution, activation: RadianceActivation::Identity, values };
        let environment = environment.with_values(&environment.values);
        let light = prefilter(machine, weights, &environment, Storage::F32).expect("the device filters");
        let back = prefilter_vjp(machine, &environment, &light, &grad).expect("the device goes back");
        [light.texels, back].map(|array| {
            let mut numbers = vec![0.0; array.len()];
            machine.download(&array, 0, &mut numbers).expect("there are so many");
            numbers
        })
    }

    #[test]
    fn rows_that_are_not_kept_filter_as_those_that_are() {
        let Some(mut machine) = Machine::for_tests() else { return };
        let key = (PrefilterScheme::Official, 64, LevelRange::ALL);
        let kept = Weights::new(&mut machine, key).expect("weights fit");
        let mut operator = Operator::new(key.0, key.1, key.2);
        operator.forget_rows();
        let forgotten = Weights::of(&mut machine, key, operator).expect("weights fit");
        assert!(kept.forward.rows.is_some() && forgotten.forward.rows.is_none(), "both ways are taken");
        let [light, grad] = there_and_back(&mut machine, &kept);
        let [same_light, same_grad] = there_and_back(&mut machine, &forgotten);
        assert!(light == same_light, "a row is the same sum in whatever piece it lies");
        // Sums over all rows are those of the pieces.
        let largest = grad.iter().fold(0.0, |most: f32, x| most.max(x.abs()));
        let apart = grad.iter().zip(&same_grad).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(largest > 0.0 && apart <= 1e-6 * largest, "{apart:e} of {largest:e} apart");
    }
}
