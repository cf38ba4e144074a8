//! Errors as Python exceptions.
//!
//! | exception | reason |
//! |---|---|
//! | `ValueError` | a picture, a box or an option is none |
//! | `OSError` | the weights file cannot be read |
//! | `ModelError` | it can be read, but is no usable weights file |
//! | `RuntimeError` | there is no target yet, or the process was forked |

use std::io;

use pyo3::PyErr;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use track_cpu::flight::{PresenceError, ThresholdError};
use track_cpu::shared::SharedError;
use track_cpu::{FrameError, TrackError};
use weights_format::ReadError;

pyo3::create_exception!(
    track_cpu,
    ModelError,
    PyValueError,
    "A model cannot be used: no built-in model has its name, or the file is not a weights file."
);

/// Why a call failed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The message says what was expected and found.
    #[error("{0}")]
    Argument(String),
    /// A model cannot be used.
    #[error(transparent)]
    Model(#[from] track_cpu::ModelError),
    /// A model's presence coefficients are wrong.
    #[error(transparent)]
    Presence(#[from] PresenceError),
    /// A threshold of flight mode is out of its range.
    #[error(transparent)]
    Threshold(#[from] ThresholdError),
    /// A picture is invalid.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The tracker refuses.
    #[error(transparent)]
    Track(#[from] TrackError),
    /// The tracker cannot be used any more.
    #[error(transparent)]
    Shared(#[from] SharedError),
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> PyErr {
        let words = failure.to_string();
        match failure {
            Failure::Model(track_cpu::ModelError::Weights(error)) => match io_kind(&error) {
                Some(kind) => io::Error::new(kind, words).into(),
                None => ModelError::new_err(words),
            },
            Failure::Model(_) | Failure::Presence(_) => ModelError::new_err(words),
            Failure::Argument(_) | Failure::Threshold(_) | Failure::Frame(_) => {
                PyValueError::new_err(words)
            }
            Failure::Track(TrackError::NoTarget) => PyRuntimeError::new_err(words),
            Failure::Track(_) => PyValueError::new_err(words),
            Failure::Shared(_) => PyRuntimeError::new_err(words),
        }
    }
}

/// What the operating system refused; `None` if the file was read.
fn io_kind(error: &ReadError) -> Option<io::ErrorKind> {
    match error {
        ReadError::File { error, .. } => io_kind(error),
        ReadError::Io(error) => Some(error.kind()),
        _ => None,
    }
}
