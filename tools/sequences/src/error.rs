//! What can go wrong: each message names the file, what was expected and what was found.

use std::io;
use std::path::{Path, PathBuf};

pub use program::brief;

/// Why sequences or annotations cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file or folder cannot be read.
    #[error("{}: cannot be read: {error}", path.display())]
    Unreadable {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        error: io::Error,
    },
    /// A file is larger than any file of its kind.
    #[error("{}: {bytes} bytes, expected at most {limit}", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
        /// The largest size that is read.
        limit: u64,
    },
    /// A line of a file is not what it should be.
    #[error("{}: line {line}: expected {expected}, found {found:?}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// The line, 1-based.
        line: usize,
        /// What should be there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A file or folder lacks what was looked for, or holds something else.
    #[error("{}: expected {expected}, found {found}", path.display())]
    Content {
        /// The file or folder.
        path: PathBuf,
        /// What should be there.
        expected: String,
        /// What is there.
        found: String,
    },
}

impl Error {
    /// `path` cannot be read.
    pub fn unreadable(path: &Path) -> impl FnOnce(io::Error) -> Error + '_ {
        move |error| Error::Unreadable {
            path: path.to_path_buf(),
            error,
        }
    }

    /// `path` holds something else than it should.
    pub fn content(path: &Path, expected: impl ToString, found: impl ToString) -> Error {
        Error::Content {
            path: path.to_path_buf(),
            expected: brief(expected),
            found: brief(found),
        }
    }
}
