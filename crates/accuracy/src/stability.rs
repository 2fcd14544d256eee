//! Guarantees for scenes at the limits of valid input, with the margin of each case.

use rayon::{ThreadPool, ThreadPoolBuilder};
use specula_core::{
    double::Double,
    executor::Renderer,
    plan::{Needs, Plan},
    prefilter::{Levels, PrefilterScheme},
    rules::{Channels, RenderRules},
    scene::Image,
    shade::{ShadingForm, ShadingRules},
};
use specula_cpu::{CpuError, CpuExecutor};
use specula_oracle::{
    self as oracle, Operator,
    stress::{Case, LAYOUT, RESOLUTION, every_case},
};
use specula_train::evaluate::{largest_difference, render_view};

/// Share of the numbers above the percentile: pixels at the edge of a splat depend on rounding.
const LARGEST: f64 = 0.01;

/// Margins of a case for every guarantee.
#[derive(Clone, Debug)]
pub struct Row {
    /// Difficulty of the case.
    pub case: &'static str,
    /// Shading form.
    pub form: ShadingForm,
    /// Whether much of the picture depends on rounding.
    pub is_on_edge: bool,
    /// Count of numbers that are not finite; must be 0.
    pub nonfinite: usize,
    /// 99th percentile of the distances from `f64`, relative to the larger of one and the number.
    pub from_exact: f64,
    /// Largest such distance.
    pub from_exact_max: f64,
    /// Excess of transmittance beyond \[0, 1\]; must be 0.
    pub outside: f64,
    /// Change by the plan's omissions; must be 0.
    pub omissions: f32,
    /// Count of numbers that differ on one thread; must be 0.
    pub threads: usize,
}

/// Names and descriptions of the guarantees.
pub const PROMISES: [(&str, &str); 6] = [
    ("not finite", "numbers that are not finite"),
    ("from f64, 99 %", "distance from f64, 99th percentile over all numbers"),
    ("from f64, largest", "distance from f64, largest"),
    ("transmittance", "excess of transmittance over 0 to 1"),
    ("omissions", "largest difference due to the plan"),
    ("threads", "numbers that differ on one thread"),
];

impl Row {
    /// Value for each of [`PROMISES`].
    pub fn values(&self) -> [f64; PROMISES.len()] {
        [
            self.nonfinite as f64,
            self.from_exact,
            self.from_exact_max,
            self.outside,
            self.omissions.into(),
            self.threads as f64,
        ]
    }

    /// Returns whether all guarantees of equality hold.
    pub fn is_kept(&self) -> bool {
        self.nonfinite == 0 && self.outside == 0.0 && self.omissions == 0.0 && self.threads == 0
    }
}

/// Number of rows.
pub fn row_count() -> usize {
    every_case().iter().map(|case| case.shadings().len()).sum()
}

/// Measures every case in each of its shading forms; calls `done` with the number of finished rows.
///
/// # Errors
///
/// [`CpuError`] if a case cannot be rendered.
pub fn rows(mut done: impl FnMut(usize)) -> Result<Vec<Row>, CpuError> {
    let one = ThreadPoolBuilder::new().num_threads(1).build().ok();
    let operator = Operator::new(RESOLUTION);
    // Executors keep the prefilter weights of their light's resolution.
    let mut execs = [CpuExecutor::new(), CpuExecutor::new()];
    let mut rows = Vec::new();
    for case in every_case() {
        for shading in case.shadings() {
            rows.push(row(&mut execs, &case, *shading, one.as_ref(), &operator)?);
            done(rows.len());
        }
    }
    Ok(rows)
}

fn row(
    [exec, other]: &mut [CpuExecutor; 2],
    case: &Case,
    shading: ShadingRules,
    one: Option<&ThreadPool>,
    operator: &Operator,
) -> Result<Row, CpuError> {
    let full = RenderRules::full(shading, PrefilterScheme::Exact, Channels::Training);
    let needs = Needs::of(&case.cloud).under(case.environment.as_ref());
    let levels = case.environment.as_ref().map(|light| Levels::new(full.scheme, light.resolution));
    let plan = Plan::new(LAYOUT, &needs, levels.as_ref(), &full);

    let whole = picture(exec, case, &full)?;
    let planned = picture(other, case, &plan.rules)?;
    let on_one = one.map(|pool| pool.install(|| picture(exec, case, &full))).transpose()?;
    let differs = |other: &Image<Vec<f32>>| {
        whole.values.iter().zip(&other.values).filter(|(a, b)| a.to_bits() != b.to_bits()).count()
    };
    let passed = whole.plane(whole.channels - 1);
    let outside = passed.iter().map(|passed| f64::from((passed - 1.0).max(-passed))).fold(0.0, f64::max);
    let [from_exact, from_exact_max] = distances(&whole.values, &exact(case, &full, operator, whole.values.len()));
    Ok(Row {
        case: case.name,
        form: shading.form,
        is_on_edge: case.is_on_edge,
        nonfinite: whole.values.iter().filter(|number| !number.is_finite()).count(),
        from_exact,
        from_exact_max,
        outside,
        omissions: largest_difference(&whole, &planned, Channels::Training),
        threads: on_one.as_ref().map_or(0, differs),
    })
}

fn picture(exec: &mut CpuExecutor, case: &Case, rules: &RenderRules) -> Result<Image<Vec<f32>>, CpuError> {
    let light = case.environment.as_ref().filter(|_| rules.is_lit);
    let light = light.map(|light| exec.prefilter(light, rules.scheme, rules.levels)).transpose()?;
    render_view(exec, &case.cloud, light.as_ref(), &case.camera, rules)
}

/// Picture in `f64` with a given number of channels, which are zero without Gaussians.
fn exact(case: &Case, rules: &RenderRules, operator: &Operator, len: usize) -> Vec<f64> {
    let light = case.environment.as_ref().map(|light| oracle::prefilter(&oracle::lift_environment(light), operator));
    let frame = oracle::render::<Double>(&oracle::lift_gaussians(&case.cloud), light.as_ref(), &case.camera, rules);
    let channels = vec![0.0; len.saturating_sub(frame.values.len())];
    channels.into_iter().chain(frame.values.iter().map(|number| number.0)).collect()
}

/// 99th percentile of the distances, and the largest; infinite for NaN.
fn distances(values: &[f32], exact: &[f64]) -> [f64; 2] {
    if values.len() != exact.len() {
        return [f64::INFINITY; 2];
    }
    let distance = |(value, exact): (&f32, &f64)| {
        let distance = (f64::from(*value) - exact).abs() / exact.abs().max(1.0);
        if distance.is_nan() { f64::INFINITY } else { distance }
    };
    let mut distances: Vec<f64> = values.iter().zip(exact).map(distance).collect();
    distances.sort_by(f64::total_cmp);
    let Some(last) = distances.len().checked_sub(1) else { return [0.0; 2] };
    [distances[((1.0 - LARGEST) * last as f64) as usize], distances[last]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_lists_have_no_distance_and_wrong_numbers_are_found() {
        let exact: Vec<f64> = (0..200).map(f64::from).collect();
        let mut values: Vec<f32> = exact.iter().map(|x| *x as f32).collect();
        assert_eq!(distances(&values, &exact), [0.0, 0.0]);
        values[100] += 10.0;
        assert_eq!(distances(&values, &exact), [0.0, 0.1]);
        values[100] = f32::NAN;
        assert_eq!(distances(&values, &exact), [0.0, f64::INFINITY]);
        assert_eq!(distances(&values[1..], &exact), [f64::INFINITY; 2]);
    }
}
