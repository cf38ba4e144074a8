//! What can go wrong: each message names the file or option, what was expected and what was found.

use std::io;
use std::path::{Path, PathBuf};

/// Why an evaluation cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file or folder cannot be read.
    #[error("{}: cannot be read: {error}", path.display())]
    Unreadable {
        /// Which.
        path: PathBuf,
        /// What the system said.
        error: io::Error,
    },
    /// A file or folder cannot be written.
    #[error("{}: cannot be written: {error}", path.display())]
    Unwritable {
        /// Which.
        path: PathBuf,
        /// What the system said.
        error: io::Error,
    },
    /// A file is larger than any file of its kind.
    #[error("{}: {bytes} bytes, expected at most {limit}", path.display())]
    TooLarge {
        /// Which.
        path: PathBuf,
        /// Its size.
        bytes: u64,
        /// The most that is read.
        limit: u64,
    },
    /// A line of a file is not what it should be.
    #[error("{}: line {line}: expected {expected}, found {found:?}", path.display())]
    Line {
        /// Which file.
        path: PathBuf,
        /// The line, 1-based.
        line: usize,
        /// What should be there.
        expected: &'static str,
        /// What is there.
        found: String,
    },
    /// A file or folder holds nothing of what was looked for, or something else.
    #[error("{}: expected {expected}, found {found}", path.display())]
    Content {
        /// Which.
        path: PathBuf,
        /// What should be there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A sequence cannot be tracked.
    #[error("{sequence}: {reason}")]
    Sequence {
        /// Which.
        sequence: String,
        /// Why.
        reason: String,
    },
    /// Sequences could not be tracked.
    #[error("{failed} of {of} sequences failed, as told above")]
    Failed {
        /// How many.
        failed: usize,
        /// Of how many.
        of: usize,
    },
    /// An option does not fit the others or the input.
    #[error("{option}: expected {expected}, found {found}")]
    Option {
        /// Which.
        option: &'static str,
        /// What would fit.
        expected: String,
        /// What was given.
        found: String,
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
        move |error| Error::Unreadable {
            path: path.to_path_buf(),
            error,
        }
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
        let (expected, found) = (brief(expected), brief(found));
        Error::Content {
            path: path.to_path_buf(),
            expected,
            found,
        }
    }
}

/// A stranger's text, cut to a length and stripped of control characters, fit for a terminal.
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
