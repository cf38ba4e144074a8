//! Notes on skipped data, so that nothing is left out silently.

use crate::error::brief;
use std::fmt;

/// Everything that was skipped: the first ones in words, all of them counted.
#[derive(Clone, Debug, Default)]
pub struct Skipped {
    first: Vec<String>,
    count: usize,
}

impl Skipped {
    /// Number of notes that are printed.
    const SHOWN: usize = 20;

    /// Something at `place` was skipped.
    pub fn add(&mut self, place: String, reason: String) {
        if self.count < Self::SHOWN {
            self.first
                .push(format!("skipped {}: {}", brief(place), brief(reason)));
        }
        self.count += 1;
    }

    /// How many were skipped.
    pub fn count(&self) -> usize {
        self.count
    }
}

impl fmt::Display for Skipped {
    /// A line each for the first ones, then the count; nothing if nothing was skipped.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for line in &self.first {
            writeln!(f, "{line}")?;
        }
        if self.count > 0 {
            writeln!(f, "skipped {} in all", self.count)?;
        }
        Ok(())
    }
}
