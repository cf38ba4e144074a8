//! Why a station does not start, or ends early.

use std::path::Path;

/// Why a station does not start, or ends early.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The source cannot be opened, or has failed for good.
    #[error("{0}")]
    Source(String),
    /// A key, a token or a log cannot be read.
    #[error("{file}: {reason}")]
    File {
        /// The file, and where in it.
        file: String,
        /// What was expected and found.
        reason: String,
    },
    /// An output cannot be set up.
    #[error("{output}: {reason}")]
    Output {
        /// The option, file or stream.
        output: String,
        /// What was expected, or what the system said.
        reason: String,
    },
    /// The reader of standard output has gone, and nobody else listens.
    #[error("standard output was closed")]
    ClosedPipe,
}

impl Error {
    /// A failure to read `path`.
    pub fn file(path: &Path, reason: impl ToString) -> Error {
        Error::File {
            file: path.display().to_string(),
            reason: reason.to_string(),
        }
    }

    /// A failure to set up an output.
    pub fn output(output: impl ToString, reason: impl ToString) -> Error {
        Error::Output {
            output: output.to_string(),
            reason: reason.to_string(),
        }
    }
}
