//! Errors of the trainer.

use std::path::PathBuf;

pub(crate) use weights_format::brief;

/// An error that ends the program.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused a file or folder.
    #[error("{}: {error}", path.display())]
    Io {
        /// Which one.
        path: PathBuf,
        /// What the operating system said.
        error: std::io::Error,
    },
    /// Sequences or annotations that cannot be used.
    #[error(transparent)]
    Sequences(#[from] sequences::Error),
    /// A file is not what it should be.
    #[error("{}: expected {expected}, found {found}", path.display())]
    File {
        /// Which one.
        path: PathBuf,
        /// What would have been accepted.
        expected: String,
        /// What was found.
        found: String,
    },
    /// An option makes no sense, alone or with the others.
    #[error("{option}: expected {expected}, found {found}")]
    Option {
        /// Its name.
        option: String,
        /// What would have been accepted.
        expected: String,
        /// What was found.
        found: String,
    },
    /// Nothing to train on is left.
    #[error("{data}: expected at least one usable {what}, found none ({skipped} skipped)")]
    NoData {
        /// The data as named by the user.
        data: String,
        /// What there should be.
        what: String,
        /// How many were skipped.
        skipped: usize,
    },
    /// Training went wrong in a way that no further step repairs.
    #[error("step {step}: {what} is {found}, expected a finite number")]
    Diverged {
        /// The step.
        step: u64,
        /// The loss or tensor.
        what: String,
        /// Its value.
        found: f64,
    },
    /// Weights that cannot be read or written.
    #[error(transparent)]
    ReadWeights(#[from] weights_format::ReadError),
    /// Weights that cannot be written.
    #[error(transparent)]
    WriteWeights(#[from] weights_format::WriteError),
    /// A network that cannot be built.
    #[error(transparent)]
    Architecture(#[from] weights_format::ArchitectureError),
    /// A model that cannot run.
    #[error(transparent)]
    Model(#[from] track_cpu::ModelError),
    /// A target that cannot be tracked.
    #[error(transparent)]
    Track(#[from] track_cpu::TrackError),
}

impl Error {
    pub(crate) fn io(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Error {
        let path = path.into();
        move |error| Error::Io { path, error }
    }

    pub(crate) fn file(
        path: impl Into<PathBuf>,
        expected: impl ToString,
        found: impl ToString,
    ) -> Error {
        Error::File {
            path: path.into(),
            expected: expected.to_string(),
            found: brief(found),
        }
    }

    pub(crate) fn option(option: &str, expected: impl ToString, found: impl ToString) -> Error {
        Error::Option {
            option: option.into(),
            expected: expected.to_string(),
            found: brief(found),
        }
    }
}
