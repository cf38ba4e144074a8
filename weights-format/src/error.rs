//! Errors of reading and writing weights files.

use crate::architecture::ArchitectureError;
use std::{io, path::PathBuf};

/// Reason why bytes are not a valid weights file, or [`Weights`](crate::Weights) are incomplete.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// One of the other errors, with the file's name.
    #[error("{}: {error}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The error in it.
        error: Box<ReadError>,
    },
    /// The operating system refused.
    #[error("cannot be read: {0}")]
    Io(#[from] io::Error),
    /// The bytes are not a safetensors container of an acceptable size.
    #[error("{part}: expected {expected}, found {found}")]
    Container {
        /// The part of the container.
        part: &'static str,
        /// The accepted values.
        expected: String,
        /// The found value.
        found: String,
    },
    /// A metadata field is missing, of the wrong type or out of range.
    #[error("metadata `{field}`: expected {expected}, found {found}")]
    Metadata {
        /// The field, as a path from the metadata object.
        field: String,
        /// The accepted values.
        expected: String,
        /// The found value.
        found: String,
    },
    /// The metadata describe a network that cannot run.
    #[error(transparent)]
    Architecture(#[from] ArchitectureError),
    /// A tensor is missing, unexpected, or has the wrong type, shape or values.
    #[error("tensor {name:?}: expected {expected}, found {found}")]
    Tensor {
        /// The tensor.
        name: String,
        /// The accepted values.
        expected: String,
        /// The found value.
        found: String,
    },
}

impl ReadError {
    pub(crate) fn container(
        part: &'static str,
        expected: impl ToString,
        found: impl ToString,
    ) -> ReadError {
        ReadError::Container {
            part,
            expected: expected.to_string(),
            found: brief(found),
        }
    }

    pub(crate) fn metadata(
        field: &str,
        expected: impl ToString,
        found: impl ToString,
    ) -> ReadError {
        ReadError::Metadata {
            field: field.into(),
            expected: expected.to_string(),
            found: brief(found),
        }
    }

    pub(crate) fn tensor(name: &str, expected: impl ToString, found: impl ToString) -> ReadError {
        ReadError::Tensor {
            name: brief(name),
            expected: expected.to_string(),
            found: brief(found),
        }
    }
}

/// Reason why weights cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// No reader would accept the weights: incomplete, wrong shapes, values out of range.
    #[error("refused to write: {0}")]
    Invalid(#[from] ReadError),
    /// A value is too large for the storage type.
    #[error(
        "refused to write: tensor {name:?}: {value} does not fit f16 (at most 65504); store as f32"
    )]
    Overflow {
        /// The tensor.
        name: String,
        /// The value.
        value: f32,
    },
    /// The operating system refused.
    #[error("{}: cannot be written: {error}", path.display())]
    Io {
        /// The file to write.
        path: PathBuf,
        /// The operating system's error.
        error: io::Error,
    },
}

/// Makes untrusted text fit for a message: cuts it to 300 characters and replaces control
/// characters.
pub fn brief(text: impl ToString) -> String {
    const LONGEST: usize = 300;
    let text = text.to_string();
    let mut short: String = text
        .chars()
        .take(LONGEST)
        .map(|c| if c.is_control() { '\u{fffd}' } else { c })
        .collect();
    if text.chars().nth(LONGEST).is_some() {
        short.push_str("...");
    }
    short
}
