//! What can be wrong with a weights file, or with weights that are to become one.

use crate::architecture::ArchitectureError;
use std::{io, path::PathBuf};

/// Why bytes are not a valid weights file, or [`Weights`](crate::Weights) are not complete.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// Any of the others, with the file's name.
    #[error("{}: {error}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        error: Box<ReadError>,
    },
    /// The operating system refused.
    #[error("cannot be read: {0}")]
    Io(#[from] io::Error),
    /// The bytes are not a safetensors container of an acceptable size.
    #[error("{part}: expected {expected}, found {found}")]
    Container {
        /// Which part of the container.
        part: &'static str,
        /// What would have been accepted.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A metadata field is missing, of the wrong type or out of range.
    #[error("metadata `{field}`: expected {expected}, found {found}")]
    Metadata {
        /// The field, as a path from the metadata object.
        field: String,
        /// What would have been accepted.
        expected: String,
        /// What was found.
        found: String,
    },
    /// The metadata describe a network that cannot be built.
    #[error(transparent)]
    Architecture(#[from] ArchitectureError),
    /// A tensor is missing, unexpected, or has the wrong type, shape or values.
    #[error("tensor {name:?}: expected {expected}, found {found}")]
    Tensor {
        /// The tensor.
        name: String,
        /// What would have been accepted.
        expected: String,
        /// What was found.
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

/// Why weights cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// They would not be read back: incomplete, wrong shapes, values out of range.
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
        /// The file that was to be written.
        path: PathBuf,
        /// What the operating system said.
        error: io::Error,
    },
}

/// A stranger's text, cut to a length and stripped of control characters, fit for a message.
fn brief(text: impl ToString) -> String {
    const LONGEST: usize = 200;
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
