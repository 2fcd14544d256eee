//! Arrays of numpy, in and out.

use crate::errors::{Failure, Result};
use numpy::{
    Element, IntoPyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods, ndarray::IxDyn,
};
use pyo3::{
    prelude::*,
    types::{IntoPyDict, PyAny},
};

/// Array of 32-bit floats in rows, the last axis fastest; the caller's own where it has that form.
#[derive(Debug)]
pub(crate) struct Floats<'py> {
    array: PyReadonlyArrayDyn<'py, f32>,
}

impl<'py> Floats<'py> {
    /// Numbers of an array, or of anything that numpy makes one of.
    pub(crate) fn new(value: &Bound<'py, PyAny>, name: &str) -> Result<Self> {
        let py = value.py();
        let numpy = py.import("numpy")?;
        let no_numbers = |error: PyErr| Failure::input(format!("{name} is no array of numbers: {}", error.value(py)));
        let array = numpy.call_method1("asarray", (value,)).map_err(no_numbers)?;
        let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
        if !["f", "i", "u", "b"].contains(&kind.as_str()) {
            return Err(Failure::input(format!(
                "{name} is an array of {}, not of real numbers",
                array.getattr("dtype")?
            )));
        }
        let options = [("dtype", numpy.getattr("float32")?)].into_py_dict(py)?;
        let array = numpy.call_method("ascontiguousarray", (array,), Some(&options)).map_err(no_numbers)?;
        let array = array.cast_into::<PyArrayDyn<f32>>().map_err(|error| no_numbers(error.into()))?;
        let readonly = array.try_readonly().map_err(|error| Failure::input(format!("{name}: {error}")))?;
        Ok(Self { array: readonly })
    }

    /// Numbers, row by row.
    pub(crate) fn values(&self) -> &[f32] {
        self.array.as_slice().unwrap_or_default()
    }

    /// Rows of `N` numbers.
    pub(crate) fn rows<const N: usize>(&self) -> &[[f32; N]] {
        self.values().as_chunks().0
    }

    /// Length along each axis.
    pub(crate) fn shape(&self) -> &[usize] {
        self.array.shape()
    }

    /// The same, if it has the shape that is written as text, such as `[N, 3]`; letters stand for
    /// any length.
    pub(crate) fn shaped(self, name: &str, text: &str) -> Result<Self> {
        let wanted: Vec<&str> = text.trim_matches(['[', ']']).split(',').map(str::trim).collect();
        let fits = |(length, wanted): (&usize, &&str)| {
            wanted.parse::<usize>().is_ok_and(|n| n == *length) || wanted.parse::<usize>().is_err()
        };
        let shape = self.shape();
        if shape.len() != wanted.len() || !shape.iter().zip(&wanted).all(fits) {
            return Err(Failure::input(format!("{name} has the shape {shape:?}; use {text}")));
        }
        Ok(self)
    }

    /// The same, if all numbers are finite.
    pub(crate) fn finite(self, name: &str) -> Result<Self> {
        match self.values().iter().find(|number| !number.is_finite()) {
            Some(number) => Err(Failure::input(format!("{name} holds {number}; use finite numbers"))),
            None => Ok(self),
        }
    }
}

/// Array of this shape from numbers row by row, which it takes over.
pub(crate) fn array<'py, T: Element>(
    py: Python<'py>,
    values: Vec<T>,
    shape: &[usize],
) -> Result<Bound<'py, PyArrayDyn<T>>> {
    Ok(values.into_pyarray(py).reshape(IxDyn(shape))?)
}

/// Array from rows of numbers.
pub(crate) fn rows<'py, const N: usize>(
    py: Python<'py>,
    rows: Vec<[f32; N]>,
    shape: &[usize],
) -> Result<Bound<'py, PyArrayDyn<f32>>> {
    array(py, rows.into_flattened(), shape)
}

/// Pixels from planes, channel by channel.
pub(crate) fn interleaved(planes: &[&[f32]]) -> Vec<f32> {
    let pixels = planes.first().map_or(0, |plane| plane.len());
    (0..pixels).flat_map(|pixel| planes.iter().map(move |plane| plane[pixel])).collect()
}

/// Planes from pixels, channel by channel.
pub(crate) fn planes(pixels: &[f32], channels: usize) -> Vec<f32> {
    (0..channels).flat_map(|channel| pixels.iter().skip(channel).step_by(channels).copied()).collect()
}
