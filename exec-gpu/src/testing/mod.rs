//! Access to parts of the executor for tests: formulas on the device, gradients of single stages,
//! divisions of work.

use crate::{
    codegen::{
        formula::{Field, Formula, Inputs},
        source::Source,
        trace::trace,
        uniform::{Count, uniform},
    },
    device::{
        chunks::ChunkedArray,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
        memory::Array,
    },
    executor::GpuExecutor,
    stages::{
        blend_vjp::{ReplayDivision, SplatGrads},
        light::{
            LightGrad, LightLayout,
            sums::{LightSums, light_sums},
        },
        prefilter::Light,
        project::Splats,
        step_counters::Capacity,
    },
};
use specula_core::pack::{Storage, unpack2};

uniform! {
    /// Rows of lookups, of radiance or of irradiance.
    struct LookupRows {
        count: u32,
        is_irradiance: u32,
    }
}

/// Kernel that executes statements for every row of `inputs`, which write a row of `outputs`.
fn probe_source(statements: &str) -> String {
    let source = Source::new().real().uniform::<Count>();
    source.with(&include_str!("probe.wgsl").replace("    // STATEMENTS\n", statements)).text()
}

/// Kernel of a light's lookup gradient, for every row.
fn probe_light_source(light: &LightLayout) -> String {
    Source::new()
        .real()
        .part(|source| light.lookup_vjp(source))
        .uniform::<LookupRows>()
        .with(include_str!("probe_light.wgsl"))
        .text()
}

/// Kernel that adds colours to the sums of a light's gradient.
fn add_colors_source(texel_count: usize) -> String {
    Source::new()
        .part(|source| light_sums(source, texel_count))
        .with(include_str!("../stages/light/light_sums.wgsl"))
        .uniform::<Count>()
        .with(include_str!("add_colors.wgsl"))
        .text()
}

impl<P> GpuExecutor<P> {
    /// Evaluates a formula for rows of inputs on the device: all results, row by row. A row has the
    /// components of all parameters in order, whatever their binding.
    ///
    /// # Errors
    ///
    /// Errors of allocation and of the device; the same for all methods of this module.
    pub fn evaluate(&mut self, formula: &impl Formula, inputs: &[f32]) -> Result<Vec<f32>, GpuError> {
        let (width, height) = (len_of(&formula.parameters()), len_of(&formula.results()));
        let rows = inputs.len() / width;
        let inputs = self.context.upload("rows", inputs)?;
        let outputs = self.context.zeros("rows", rows * height)?;
        let source = || probe_source(&statements(formula, width, height));
        let size = Count::new(rows);
        let bindings = [Uniform(size.bytes()), Buffer(&inputs), Buffer(&outputs)];
        let key = format!("{} {}", formula.name(), statements(formula, width, height));
        self.context.dispatch(&key, "probe", &source, &bindings, Dispatch::Invocations(rows))?;
        let mut values = vec![0.0; rows * height];
        self.context.download(&outputs, 0, &mut values)?;
        Ok(values)
    }

    /// Gradient of the lookup of a light, or of its irradiance, for rows of a direction, a
    /// roughness, and a gradient of three colours; a row's eighth number is ignored. Returns rows
    /// of the gradient of direction and roughness, and the gradient of the light.
    ///
    /// # Errors
    ///
    /// Errors of allocation and of the device.
    pub fn look_up_vjp(
        &mut self,
        light: &Light,
        rows: &[[f32; 8]],
        is_irradiance: bool,
    ) -> Result<(Vec<[f32; 4]>, LightGrad), GpuError> {
        let context = &mut self.context;
        let sums = LightSums::new(context, &light.layout)?;
        let inputs = context.upload("rows", rows)?;
        let outputs = context.allocate("rows", 4 * rows.len())?;
        let lookups = LookupRows { count: rows.len() as u32, is_irradiance: u32::from(is_irradiance) };
        let bindings =
            [Uniform(lookups.bytes()), Buffer(&inputs), Buffer(&light.texels), Buffer(&outputs), Buffer(sums.array())];
        let key = format!("{:?}", light.layout);
        let source = || probe_light_source(&light.layout);
        context.dispatch(&key, "probe_light", &source, &bindings, Dispatch::Invocations(rows.len()))?;
        let mut values = vec![[0.0; 4]; rows.len()];
        context.download(&outputs, 0, values.as_flattened_mut())?;
        Ok((values, sums.finish(context)?))
    }

    /// Adds colours to texels like kernels of a light's gradient; the fourth number of a colour is
    /// ignored.
    ///
    /// # Errors
    ///
    /// Errors of allocation and of the device.
    pub fn add_colors(
        &mut self,
        texel_count: usize,
        texels: &[u32],
        colors: &[[f32; 4]],
    ) -> Result<LightGrad, GpuError> {
        let context = &mut self.context;
        let sums = LightSums::zeros(context, texel_count)?;
        let (texels, added) = (context.upload("texels", texels)?, context.upload("colours", colors)?);
        let size = Count::new(colors.len());
        let bindings = [Uniform(size.bytes()), Buffer(&texels), Buffer(&added), Buffer(sums.array())];
        let (key, source) = (format!("{texel_count} texels"), || add_colors_source(texel_count));
        context.dispatch(&key, "add_colors", &source, &bindings, Dispatch::Invocations(colors.len()))?;
        sums.finish(context)
    }

    /// Texels of a light, level by level with their aprons, each of four numbers; the fourth is
    /// zero.
    ///
    /// # Errors
    ///
    /// Errors of the device.
    pub fn read_light(&mut self, light: &Light) -> Result<Vec<f32>, GpuError> {
        if light.layout.storage == Storage::F32 {
            return self.read_array(&light.texels);
        }
        let mut words = vec![0; light.texels.len()];
        self.context.download(&light.texels, 0, &mut words)?;
        Ok(words.into_iter().flat_map(unpack2).collect())
    }

    /// Gradient of a light from that of its texels, in the order of [`Self::read_light`].
    ///
    /// # Errors
    ///
    /// Errors of allocation.
    pub fn light_grad(&mut self, texels: &[f32]) -> Result<LightGrad, GpuError> {
        Ok(LightGrad { texels: self.context.upload("gradient of a light", texels)? })
    }

    /// Gradient of a light's texels.
    ///
    /// # Errors
    ///
    /// Errors of the device.
    pub fn read_light_grad(&mut self, grad: &LightGrad) -> Result<Vec<f32>, GpuError> {
        self.read_array(&grad.texels)
    }

    /// Gradients of splats, in the layout of [`SplatGrads`].
    ///
    /// # Errors
    ///
    /// Errors of the device.
    pub fn read_splat_grads(&mut self, grads: &SplatGrads) -> Result<Vec<f32>, GpuError> {
        let mut values = vec![0.0; grads.values.len()];
        self.context.download_chunks(&grads.values, &mut values)?;
        Ok(values)
    }

    fn read_array(&mut self, array: &Array) -> Result<Vec<f32>, GpuError> {
        let mut values = vec![0.0; array.len()];
        self.context.download(array, 0, &mut values)?;
        Ok(values)
    }

    /// Sets the capacity of training steps, in tile-splat pairs, until a report shows their need.
    /// Results do not depend on it.
    pub fn set_pair_capacity(&mut self, pairs: usize) {
        let depth_bits = self.capacity.map_or(1, |capacity| capacity.depth_bits);
        self.capacity = Some(Capacity { pairs, depth_bits });
    }

    /// Changes the counted numbers of tiles of splats before the sort.
    ///
    /// # Errors
    ///
    /// Errors of allocation and of the device.
    pub fn recount_tiles(&mut self, splats: &mut Splats, recount: impl Fn(u32) -> u32) -> Result<(), GpuError> {
        let mut counts = vec![0; splats.tile_counts.len()];
        self.context.download(&splats.tile_counts, 0, &mut counts)?;
        counts.iter_mut().for_each(|count: &mut u32| *count = recount(*count));
        splats.tile_counts = self.context.upload("numbers of tiles", &counts)?;
        Ok(())
    }

    /// Division of the replay of splats in the gradient of compositing.
    pub fn replay_division(&self) -> ReplayDivision {
        self.replay
    }

    /// Sets the division of the replay. Results do not depend on the number of slots.
    pub fn set_replay_division(&mut self, division: ReplayDivision) {
        self.replay = division;
    }
}

impl SplatGrads {
    /// Gradients of `channels` channels, in the layout of [`SplatGrads`].
    pub fn new(channels: usize, values: ChunkedArray) -> Self {
        Self { channels, values }
    }
}

fn len_of(fields: &[Field]) -> usize {
    fields.iter().map(|field| field.len).sum()
}

/// Statements of a formula over a row of inputs, with its results written to a row of outputs.
fn statements(formula: &impl Formula, width: usize, height: usize) -> String {
    let inputs: Vec<String> = (0..width).map(|k| format!("inputs[row * {width}u + {k}u]")).collect();
    let (mut statements, results) = trace(&inputs, |numbers| formula.evaluate(&mut Inputs::new(numbers)));
    for (k, result) in results.iter().enumerate() {
        statements.push_str(&format!("    outputs[row * {height}u + {k}u] = {result};\n"));
    }
    statements
}
