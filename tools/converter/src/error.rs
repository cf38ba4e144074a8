//! What can go wrong: the input, the checkpoint's content, the output, or an option.

use std::{io, path::PathBuf};
pub(crate) use weights_format::brief;
use weights_format::{ReadError, WriteError};

/// Why a checkpoint was not converted.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The checkpoint cannot be read.
    #[error("{}: cannot be read: {error}", path.display())]
    Unreadable {
        /// The checkpoint.
        path: PathBuf,
        /// The system's reason.
        error: io::Error,
    },
    /// The checkpoint is not one, or not one of this network.
    #[error("{}: {refusal}", path.display())]
    Refused {
        /// The checkpoint.
        path: PathBuf,
        /// What is wrong with it.
        refusal: Refusal,
    },
    /// A weights file, trainer checkpoint or parameter file cannot be read.
    #[error(transparent)]
    Input(#[from] ReadError),
    /// The file cannot be written.
    #[error(transparent)]
    Unwritable(#[from] WriteError),
    /// An option makes no sense, alone or with the others.
    #[error("{0}")]
    Usage(String),
}

/// What is wrong with a checkpoint: where, what was expected there, what was found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: expected {expected}, found {found}")]
pub struct Refusal {
    /// The tensor, the part of the file, the byte of the pickle.
    pub place: String,
    /// What would have been accepted.
    pub expected: String,
    /// What was found.
    pub found: String,
}

impl Refusal {
    pub(crate) fn new(
        place: impl ToString,
        expected: impl ToString,
        found: impl ToString,
    ) -> Refusal {
        Refusal {
            place: brief(place),
            expected: brief(expected),
            found: brief(found),
        }
    }
}
