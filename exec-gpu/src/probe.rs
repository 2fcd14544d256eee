//! Parts of stages on the device, for whoever wants to know whether it computes there what is computed on the host.

use crate::{
    device::GpuError,
    executor::GpuExecutor,
    formula::{Formula, Inputs},
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    light_sums::LightSums,
    prefilter::{Light, LightGrad},
    source,
    trace::trace,
};

impl GpuExecutor {
    /// A formula for rows of inputs, on the device: all its results, row by row. A row has all numbers of all
    /// parameters in order, wherever shaders take them from.
    pub fn evaluate(&mut self, formula: &impl Formula, inputs: &[f32]) -> Result<Vec<f32>, GpuError> {
        let (width, height) = (len_of(&formula.parameters()), len_of(&formula.results()));
        let rows = inputs.len() / width;
        let inputs = self.machine.upload("rows", inputs)?;
        let outputs = self.machine.zeros("rows", rows * height)?;
        let source = || source::probe(&statements(formula, width, height));
        let settings = [rows as u32];
        let bound = [Uniform(bytemuck::cast_slice(&settings)), Of(&inputs), Of(&outputs)];
        let key = format!("{} {}", formula.name(), statements(formula, width, height));
        self.machine.run(&key, "probe", &source, &bound, Groups::For(rows))?;
        let mut values = vec![0.0; rows * height];
        self.machine.download(&outputs, 0, &mut values)?;
        Ok(values)
    }

    /// The gradient of looking a light up, or its irradiance, for rows of a direction, a roughness, and a gradient of
    /// three colours; a row's eighth number is left out. Rows of the gradient of direction and roughness, and that of
    /// the light.
    pub fn look_up_vjp(
        &mut self,
        light: &Light,
        rows: &[[f32; 8]],
        is_irradiance: bool,
    ) -> Result<(Vec<[f32; 4]>, LightGrad), GpuError> {
        let machine = &mut self.machine;
        let sums = LightSums::new(machine, light)?;
        let inputs = machine.upload("rows", rows)?;
        let outputs = machine.take("rows", 4 * rows.len())?;
        let settings = [rows.len() as u32, u32::from(is_irradiance)];
        let bound =
            [Uniform(bytemuck::cast_slice(&settings)), Of(&inputs), Of(&light.texels), Of(&outputs), Of(sums.array())];
        let key = format!("{:?}", light.layout);
        let source = || source::probe_light(&light.layout);
        machine.run(&key, "probe_light", &source, &bound, Groups::For(rows.len()))?;
        let mut values = vec![[0.0; 4]; rows.len()];
        machine.download(&outputs, 0, values.as_flattened_mut())?;
        Ok((values, sums.finish(machine)?))
    }
}

fn len_of(fields: &[crate::formula::Field]) -> usize {
    fields.iter().map(|field| field.len).sum()
}

/// The formula with numbers of a row of inputs, and its results written to a row of outputs.
fn statements(formula: &impl Formula, width: usize, height: usize) -> String {
    let inputs: Vec<String> = (0..width).map(|k| format!("inputs[row * {width}u + {k}u]")).collect();
    let (mut statements, results) = trace(&inputs, |numbers| formula.evaluate(&mut Inputs::new(numbers)));
    for (k, result) in results.iter().enumerate() {
        statements.push_str(&format!("    outputs[row * {height}u + {k}u] = {result};\n"));
    }
    statements
}
