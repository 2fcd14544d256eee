//! Errors, as exceptions of `specula_gs._errors`.

use core::fmt::Display;
use pyo3::{IntoPyObjectExt, prelude::*};
use specula_cpu::CpuError;
use specula_scene::SceneError;

/// Result of a call from Python.
pub(crate) type Result<T, E = Failure> = core::result::Result<T, E>;

/// Exception to raise: the name of its class, and its sentence.
#[derive(Debug)]
pub(crate) enum Failure {
    /// Class of `specula_gs._errors`, and a sentence.
    Named(&'static str, String),
    /// Exception of Python's, such as that of a callback.
    Python(PyErr),
}

impl Failure {
    /// A value that a function does not take.
    pub(crate) fn input(sentence: impl Display) -> Self {
        Self::Named("InvalidInput", sentence.to_string())
    }

    /// A feature that this package does not have.
    pub(crate) fn unsupported(sentence: impl Display) -> Self {
        Self::Named("Unsupported", sentence.to_string())
    }
}

impl From<PyErr> for Failure {
    fn from(error: PyErr) -> Self {
        Self::Python(error)
    }
}

impl From<specula_io::Error> for Failure {
    fn from(error: specula_io::Error) -> Self {
        Self::Named("FileError", error.to_string())
    }
}

impl From<CpuError> for Failure {
    fn from(error: CpuError) -> Self {
        Self::Named("DeviceError", error.to_string())
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        let class = match &error {
            SceneError::File(_) => "FileError",
            SceneError::Training(_) | SceneError::Picture(_) | SceneError::Ranks(_) | SceneError::Locked(_) => {
                "TrainingError"
            }
            SceneError::GpuUnsupported | SceneError::ProjectionUnsupported => "Unsupported",
            SceneError::Cpu(_) | SceneError::Executor(_) => "DeviceError",
            #[cfg(feature = "gpu")]
            SceneError::Gpu(_) => "DeviceError",
            _ => "InvalidInput",
        };
        Self::Named(class, error.to_string())
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        let (class, sentence) = match failure {
            Failure::Python(error) => return error,
            Failure::Named(class, sentence) => (class, sentence),
        };
        Python::attach(|py| {
            let raised = py.import("specula_gs._errors").and_then(|errors| errors.getattr(class)?.call1((sentence,)));
            raised.and_then(|raised| raised.into_bound_py_any(py)).map_or_else(|error| error, PyErr::from_value)
        })
    }
}
