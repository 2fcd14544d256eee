//! Measures of pictures.

use crate::{
    arrays::{Floats, planes},
    errors::{Failure, Result},
    threads::compute,
};
use pyo3::prelude::*;
use specula_core::{metrics, scene::Image};
use specula_train::evaluate::{mean_squared_error, mean_ssim};

/// Two pictures of one shape [H, W, 3].
fn pair<'py>(a: &Bound<'py, PyAny>, b: &Bound<'py, PyAny>) -> Result<[Floats<'py>; 2]> {
    let read = |value, name| Floats::new(value, name)?.shaped(name, "[H, W, 3]")?.finite(name);
    let pictures = [read(a, "a")?, read(b, "b")?];
    let [a, b] = [pictures[0].shape(), pictures[1].shape()];
    match a == b && a[0] * a[1] > 0 {
        true => Ok(pictures),
        false => Err(Failure::input(format!("pictures of the shapes {a:?} and {b:?} cannot be compared"))),
    }
}

/// Peak signal-to-noise ratio of two pictures.
#[pyfunction]
#[pyo3(signature = (a, b, *, quantized=true))]
pub(crate) fn psnr(a: &Bound<'_, PyAny>, b: &Bound<'_, PyAny>, quantized: bool) -> PyResult<f64> {
    let [a, b] = pair(a, b)?;
    let (a, b) = (a.values(), b.values());
    let square = |(x, y): (&f32, &f32)| (f64::from(*x) - f64::from(*y)).powi(2);
    let error = match quantized {
        true => mean_squared_error(a, b),
        false => a.iter().zip(b).map(square).sum::<f64>() / a.len() as f64,
    };
    Ok(metrics::psnr(error))
}

/// Mean structural similarity of two pictures.
#[pyfunction]
pub(crate) fn ssim(py: Python<'_>, a: &Bound<'_, PyAny>, b: &Bound<'_, PyAny>) -> PyResult<f64> {
    let [a, b] = pair(a, b)?;
    let (height, width) = (a.shape()[0], a.shape()[1]);
    let [a, b] = [planes(a.values(), 3), planes(b.values(), 3)];
    Ok(compute(py, || mean_ssim(width, height, &a, &b))?)
}

/// Mean ꟻLIP of two pictures.
#[pyfunction]
pub(crate) fn flip(py: Python<'_>, reference: &Bound<'_, PyAny>, test: &Bound<'_, PyAny>) -> PyResult<f64> {
    let [reference, test] = pair(reference, test)?;
    let (height, width) = (reference.shape()[0], reference.shape()[1]);
    let image = |values: &[f32]| {
        let values = planes(values, 3).into_iter().map(f64::from).collect();
        Image { width, height, channels: 3, values }
    };
    let [reference, test] = [image(reference.values()), image(test.values())];
    Ok(compute(py, || specula_accuracy::flip::flip(&reference, &test))?)
}

/// Mean angle between normals in degrees.
#[pyfunction]
#[pyo3(signature = (a, b, mask=None))]
pub(crate) fn normal_mae(a: &Bound<'_, PyAny>, b: &Bound<'_, PyAny>, mask: Option<&Bound<'_, PyAny>>) -> PyResult<f64> {
    let [a, b] = pair(a, b)?;
    let mask = mask.map(|mask| Floats::new(mask, "mask")?.shaped("mask", "[H, W]")).transpose()?;
    if mask.as_ref().is_some_and(|mask| mask.shape() != &a.shape()[..2]) {
        return Err(Failure::input("mask has another size than the normals").into());
    }
    let counts = |index: usize| mask.as_ref().is_none_or(|mask| mask.values()[index] != 0.0);
    let (a, b) = (a.rows::<3>(), b.rows::<3>());
    let is_known = |index: &usize| counts(*index) && a[*index] != [0.0; 3] && b[*index] != [0.0; 3];
    let angles: Vec<f64> =
        (0..a.len()).filter(is_known).map(|index| metrics::angle_degrees(a[index], b[index])).collect();
    match angles.len() {
        0 => Err(Failure::input("no pixel has a normal in both pictures").into()),
        count => Ok(angles.iter().sum::<f64>() / count as f64),
    }
}
