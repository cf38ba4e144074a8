//! What can go wrong: each message names the file or option, what was expected and what was found.

use std::io;
use std::path::{Path, PathBuf};

/// Why an evaluation cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Sequences, annotations or results cannot be used.
    #[error(transparent)]
    Data(#[from] sequences::Error),
    /// A file or folder cannot be written.
    #[error("{}: cannot be written: {error}", path.display())]
    Unwritable {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        error: io::Error,
    },
    /// An output would destroy an input.
    #[error(transparent)]
    Clash(#[from] program::Clash),
    /// A sequence cannot be tracked.
    #[error("{sequence}: {reason}")]
    Sequence {
        /// The sequence.
        sequence: String,
        /// The reason.
        reason: String,
    },
    /// Sequences could not be tracked.
    #[error("{failed} of {of} sequences failed (the reasons are above)")]
    Failed {
        /// Sequences that failed.
        failed: usize,
        /// Sequences that were run.
        of: usize,
    },
    /// An option does not fit the others or the input.
    #[error("{option}: expected {expected}, found {found}")]
    Option {
        /// The option.
        option: &'static str,
        /// What would fit.
        expected: String,
        /// What was given.
        found: String,
    },
    /// Frames could not be read; every sequence is complete nevertheless.
    #[error("{held} frames could not be read; their boxes are those of the frames before")]
    BadFrames {
        /// Number of frames.
        held: usize,
    },
    /// A model cannot be used.
    #[error(transparent)]
    Model(#[from] track_cpu::ModelError),
    /// No frame of any sequence counts.
    #[error("no frame to count: every annotation is NaN or empty under the rule {convention}")]
    NothingToCount {
        /// The rule.
        convention: &'static str,
    },
}

impl Error {
    /// `path` cannot be read.
    pub fn unreadable(path: &Path) -> impl FnOnce(io::Error) -> Error + '_ {
        move |error| Error::Data(sequences::Error::unreadable(path)(error))
    }

    /// `path` cannot be written.
    pub fn unwritable(path: &Path) -> impl FnOnce(io::Error) -> Error + '_ {
        move |error| Error::Unwritable {
            path: path.to_path_buf(),
            error,
        }
    }

    /// `path` holds something else than it should.
    pub fn content(path: &Path, expected: impl ToString, found: impl ToString) -> Error {
        Error::Data(sequences::Error::content(path, expected, found))
    }
}
