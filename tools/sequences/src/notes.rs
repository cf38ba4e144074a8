//! Remarks about input that was unusual or was left out.

use crate::error::brief;
use std::fmt;

/// One remark.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// The sequence, file or tracker that it is about.
    pub about: String,
    /// The remark.
    pub text: String,
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.about, self.text)
    }
}

/// Remarks in the order in which they arose.
#[derive(Clone, Debug, Default)]
pub struct Notes(Vec<Note>);

impl Notes {
    /// Most remarks that [`Display`](fmt::Display) writes out; it only counts the others.
    const SHOWN: usize = 50;

    /// Adds a remark.
    pub fn add(&mut self, about: impl ToString, text: impl ToString) {
        self.0.push(Note {
            about: brief(about),
            text: brief(text),
        });
    }

    /// Adds all remarks of another collection.
    pub fn extend(&mut self, other: Notes) {
        self.0.extend(other.0);
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = &Note> {
        self.0.iter()
    }

    /// The first `count` remarks in one line, for an error that they explain.
    pub fn summary(&self, count: usize) -> String {
        let shown: Vec<String> = self.0.iter().take(count).map(Note::to_string).collect();
        let more = self.0.len().saturating_sub(count);
        if more > 0 {
            format!("{}; and {more} more", shown.join("; "))
        } else {
            shown.join("; ")
        }
    }
}

impl fmt::Display for Notes {
    /// A line for each of the first remarks, then the count of the others; empty without remarks.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for note in self.0.iter().take(Self::SHOWN) {
            writeln!(f, "note: {note}")?;
        }
        let more = self.0.len().saturating_sub(Self::SHOWN);
        if more > 0 {
            writeln!(f, "note: and {more} more")?;
        }
        Ok(())
    }
}
