//! Light into roughness levels.

use crate::{
    device::GpuError,
    formulas::LevelOf,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    memory::Array,
    source::{self, LightLayout},
};
use specula_core::{
    prefilter::{LevelRange, PrefilterScheme},
    scene::{Environment, RadianceActivation},
};
use specula_prefilter::{Operator, SPLIT_SUM, sparse::Sparse};
use std::sync::Arc;

/// Numbers of a texel: red, green, blue and nothing.
const TEXEL_LEN: usize = 4;

/// A light filtered into levels.
#[derive(Debug)]
pub struct Light {
    pub(crate) layout: LightLayout,
    /// All levels with their aprons, one after the other.
    pub(crate) texels: Array,
    /// The split-sum table of the authors' shading; one entry in other schemes.
    pub(crate) split_sum: Array,
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
    /// From each level of the pyramid to the next.
    reductions: Vec<Matrix>,
    rows: Matrix,
    aprons: Matrix,
}

/// A sparse matrix on the device.
#[derive(Debug)]
struct Matrix {
    row_count: usize,
    starts: Array,
    columns: Array,
    weights: Array,
}

impl Matrix {
    fn new(machine: &mut Machine, sparse: &Sparse) -> Result<Self, GpuError> {
        let starts: Vec<u32> = sparse.starts.iter().map(|start| *start as u32).collect();
        Ok(Self {
            row_count: sparse.row_count(),
            starts: machine.upload("starts of a prefilter's rows", &starts)?,
            columns: machine.upload("columns of a prefilter", &sparse.columns)?,
            weights: machine.upload("weights of a prefilter", &sparse.weights)?,
        })
    }

    /// Its product with the texels from `source` on; within `texels` from `out` on, or, if there are, to `padded`.
    fn apply(
        &self,
        machine: &mut Machine,
        texels: &Array,
        [source, out]: [usize; 2],
        padded: Option<&Array>,
    ) -> Result<(), GpuError> {
        let settings = [self.row_count as u32, source as u32, out as u32];
        let none = machine.take("nothing", TEXEL_LEN)?;
        let bound = [
            Uniform(bytemuck::cast_slice(&settings)),
            Of(&self.starts),
            Of(&self.columns),
            Of(&self.weights),
            Of(texels),
            Of(padded.unwrap_or(&none)),
        ];
        let entry = if padded.is_some() { "pad_texels" } else { "filter_texels" };
        machine.run("prefilter", entry, &source::prefilter, &bound, Groups::For(self.row_count))
    }
}

impl Weights {
    pub(crate) fn new(machine: &mut Machine, key: (PrefilterScheme, usize, LevelRange)) -> Result<Arc<Self>, GpuError> {
        let (scheme, resolution, kept) = key;
        let operator = Operator::new(scheme, resolution, kept);
        let reductions: Result<Vec<Matrix>, GpuError> =
            operator.reductions().map(|(_, reduction)| Matrix::new(machine, &reduction.forward)).collect();
        let rows = operator.rows().ok_or(GpuError::LightTooLarge { resolution })?;
        Ok(Arc::new(Self {
            key,
            reductions: reductions?,
            rows: Matrix::new(machine, &rows.forward)?,
            aprons: Matrix::new(machine, &operator.aprons().forward)?,
            operator,
        }))
    }

    fn layout(&self) -> LightLayout {
        let levels = self.operator.levels().to_vec();
        let offsets = self.operator.offsets();
        let places = offsets[..offsets.len() - 1].iter().enumerate();
        LightLayout {
            places: places.map(|(level, first)| (*first, self.operator.resolution(level))).collect(),
            levels: LevelOf { levels },
        }
    }
}

pub(crate) fn prefilter(
    machine: &mut Machine,
    weights: &Weights,
    environment: &Environment<Array>,
) -> Result<Light, GpuError> {
    let operator = &weights.operator;
    let texel_count = 6 * environment.resolution * environment.resolution;
    let nodes = machine.take("texels of a light", TEXEL_LEN * (operator.node_count() + operator.row_count()))?;
    let is_exponential = environment.activation == RadianceActivation::Exponential;
    let settings = [texel_count as u32, u32::from(is_exponential)];
    let bound = [Uniform(bytemuck::cast_slice(&settings)), Of(&environment.values), Of(&nodes)];
    machine.run("activate", "activate_texels", &source::activate, &bound, Groups::For(texel_count))?;
    for ((places, _), matrix) in operator.reductions().zip(&weights.reductions) {
        matrix.apply(machine, &nodes, places, None)?;
    }
    weights.rows.apply(machine, &nodes, [0, operator.node_count()], None)?;
    let texels = machine.take("levels of a light", TEXEL_LEN * operator.padded_count())?;
    weights.aprons.apply(machine, &nodes, [0, 0], Some(&texels))?;
    let split_sum = match weights.key.0 {
        PrefilterScheme::Official => machine.upload("split sums", &SPLIT_SUM)?,
        PrefilterScheme::Exact => machine.upload("split sums", &[[0.0_f32; 2]])?,
    };
    Ok(Light { layout: weights.layout(), texels, split_sum })
}

pub(crate) fn prefilter_vjp(
    _machine: &mut Machine,
    _environment: &Environment<Array>,
    _light: &Light,
    _grad: &LightGrad,
) -> Result<Array, GpuError> {
    unimplemented!()
}
