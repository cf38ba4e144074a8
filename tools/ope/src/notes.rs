//! What was out of the ordinary but could be worked with: said, not hidden.

use std::fmt;

/// Remarks in the order in which they arose: the first ones in words, all of them counted.
#[derive(Clone, Debug, Default)]
pub struct Notes {
    first: Vec<String>,
    count: usize,
}

impl Notes {
    /// How many are kept in words.
    const SHOWN: usize = 50;

    /// Adds a remark.
    pub fn add(&mut self, note: String) {
        if self.first.len() < Self::SHOWN {
            self.first.push(crate::error::brief(note));
        }
        self.count += 1;
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Those that are kept in words.
    pub fn lines(&self) -> &[String] {
        &self.first
    }
}

impl fmt::Display for Notes {
    /// A line each for the first ones, then the count of the others; nothing if there are none.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for line in &self.first {
            writeln!(f, "note: {line}")?;
        }
        match self.count - self.first.len() {
            0 => Ok(()),
            more => writeln!(f, "note: and {more} more"),
        }
    }
}
