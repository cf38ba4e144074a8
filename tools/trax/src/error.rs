//! What can be wrong with a message.

use std::io;

/// Why a message cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The stream broke.
    #[error("the stream broke: {0}")]
    Stream(#[from] io::Error),
    /// A line is longer than any message.
    #[error("a line of more than {limit} bytes")]
    TooLong {
        /// The most that is read.
        limit: usize,
    },
    /// A part of a message is not what it should be.
    #[error("{part}: expected {expected}, found {found:?}")]
    Part {
        /// Which part.
        part: &'static str,
        /// What should be there.
        expected: &'static str,
        /// What is there, cut to a length.
        found: String,
    },
}

impl Error {
    /// A part of a message that holds `found`.
    pub fn part(part: &'static str, expected: &'static str, found: &str) -> Error {
        const LONGEST: usize = 80;
        let mut cut: String = found.chars().take(LONGEST).collect();
        if cut.len() < found.len() {
            cut.push_str("...");
        }
        Error::Part {
            part,
            expected,
            found: cut,
        }
    }
}
