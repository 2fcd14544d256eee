//! Formulas on the device against the same formulas on the host.

use crate::strategies::{random_cloud, under_turned_light};
use specula_core::{camera::Camera, double::Double, random, real::Real, scene::Layout};
use specula_gpu::{
    GpuExecutor,
    codegen::formula::{Formula, Inputs},
};
pub use specula_oracle::scenes::camera;

/// Rounding of a device as a multiple of that of `f32`: divisions and roots are allowed 2.5 units
/// in the last place, and operations may be fused.
const WORSE_ROUNDING: f64 = 16.0;
/// Below this share of the largest result nothing is compared: a few units in the last place.
const LAST_PLACES: f64 = 2e-6;
/// Rows of inputs that a formula is tried with.
pub const ROWS: usize = 500;

/// The numbers of a camera, as formulas take them.
pub fn numbers_of(camera: &Camera) -> Vec<f32> {
    let lifted = camera.lift(0.0_f32);
    let mut numbers: Vec<f32> = lifted.camera_from_world.rows.iter().flat_map(|row| row.to_array()).collect();
    numbers.extend(lifted.position.to_array());
    numbers.extend(lifted.focal_px);
    numbers.extend(lifted.principal_px);
    numbers.extend(lifted.slope_limit);
    numbers.push(lifted.near);
    numbers
}

/// Uniform numbers between two bounds, a row for each draw.
pub fn uniform_rows(seed: u64, bounds: &[[f32; 2]]) -> Vec<f32> {
    let draw = |k: usize, [low, high]: [f32; 2]| low + (high - low) * random::uniform(seed, 0, k as u64);
    (0..ROWS * bounds.len()).map(|k| draw(k, bounds[k % bounds.len()])).collect()
}

/// The rotation of a light in each row.
pub fn light_frame_rows() -> Vec<f32> {
    let frame = under_turned_light(camera(70, 45)).lift(0.0_f32).light;
    let rows = frame.light_from_world.expect("it is turned").rows;
    rows.iter().flat_map(|row| row.to_array()).collect::<Vec<f32>>().repeat(ROWS)
}

/// A Gaussian and the camera in each row.
pub fn gaussian_rows(layout: Layout) -> Vec<f32> {
    let cloud = random_cloud(ROWS, layout, 3);
    let camera = numbers_of(&camera(70, 45));
    let planes = |index: usize| (0..layout.plane_count()).map(move |plane| (index, plane));
    (0..ROWS)
        .flat_map(|index| {
            let own = planes(index).map(|(index, plane)| cloud.get::<1>(index, plane)[0]);
            own.chain(camera.iter().copied()).collect::<Vec<f32>>()
        })
        .collect()
}

/// Gaussians with the numbers of another table behind each.
pub fn side_by_side(rows: &[f32], others: &[f32]) -> Vec<f32> {
    let (width, other) = (rows.len() / ROWS, others.len() / ROWS);
    rows.chunks(width).zip(others.chunks(other)).flat_map(|(a, b)| [a, b].concat()).collect()
}

fn on_host<R: Real>(formula: &impl Formula, rows: &[f32], number: impl Fn(f32) -> R) -> Vec<R> {
    let width = rows.len() / ROWS;
    let evaluate = |row: &[f32]| {
        let numbers: Vec<R> = row.iter().map(|x| number(*x)).collect();
        formula.evaluate(&mut Inputs::new(&numbers))
    };
    rows.chunks(width).flat_map(evaluate).collect()
}

/// Error of the device beyond the allowance for `f32` on the host, as a share of that allowance.
/// Its scale is the largest of all results of the same kind.
fn excess(device: &[f32], host: &[f32], exact: &[f64]) -> f64 {
    let height = exact.len() / ROWS;
    let column = |k: usize| (k..exact.len()).step_by(height);
    let worst_of_result = |k: usize| {
        let scale = column(k).map(|i| exact[i].abs()).fold(f64::MIN_POSITIVE, f64::max);
        let rounding = column(k).map(|i| (f64::from(host[i]) - exact[i]).abs()).fold(0.0, f64::max);
        let allowed = WORSE_ROUNDING * rounding + LAST_PLACES * scale;
        column(k).map(|i| (f64::from(device[i]) - exact[i]).abs() / allowed).fold(0.0, nan_wins)
    };
    (0..height).map(worst_of_result).fold(0.0, nan_wins)
}

fn nan_wins(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::INFINITY } else { a.max(b) }
}

/// Checks that a formula on the device is no further from the exact result than `f32` on the host
/// may be.
#[track_caller]
pub fn assert_same(gpu: &mut GpuExecutor, formula: &impl Formula, rows: &[f32]) {
    let device = gpu.evaluate(formula, rows).expect("the device computes");
    let host = on_host(formula, rows, |x| x);
    let exact: Vec<f64> = on_host(formula, rows, |x| Double(f64::from(x))).iter().map(|x| x.0).collect();
    let excess = excess(&device, &host, &exact);
    println!("{}: {excess:.2} of what is allowed", formula.name());
    assert!(excess <= 1.0, "{} is {excess} times as far off as allowed", formula.name());
}

/// Checks that each formula of some sources of the GPU executor has a case in the source of a test;
/// at least `count_min` formulas are found.
#[track_caller]
pub fn assert_every_formula_has_a_case(formulas: &[&str], cases: &str, count_min: usize) {
    let cases: String = cases.split_whitespace().collect();
    let formulas = formulas.concat();
    let macro_formulas = formulas.split("formula!(").skip(1);
    let impl_formulas =
        formulas.split("\nimpl").filter_map(|rest| rest.split_once(" Formula for ")).map(|(_, rest)| rest);
    let names = macro_formulas.chain(impl_formulas).filter_map(|rest| rest.split([',', ' ', '<']).next());
    let count = names.inspect(|name| {
        assert!(cases.contains(&format!("assert_same(gpu,&{name}")), "{name} has no case on the device");
    });
    assert!(count.count() >= count_min, "formulas are found by how they are written");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_comparison_of_formulas_can_fail() {
        let exact: Vec<f64> = (0..ROWS).map(|k| 1.0 + k as f64).collect();
        let host: Vec<f32> = exact.iter().map(|x| *x as f32).collect();
        assert!(excess(&host, &host, &exact) <= 1.0, "the same numbers are the same");
        let mut wrong = host.clone();
        wrong[17] *= 1.001;
        assert!(excess(&wrong, &host, &exact) > 1.0, "one wrong number is seen");
        wrong[17] = f32::NAN;
        assert!(excess(&wrong, &host, &exact) > 1.0, "NaN is seen");
    }
}
