//! Splitting a stream of bytes into lines of bounded length.

use super::MAX_LINE;

/// A line that has ended.
#[derive(Debug, PartialEq, Eq)]
pub enum Line {
    /// Its bytes, without the end.
    Whole(Vec<u8>),
    /// A line that was longer than any command.
    TooLong,
}

/// Splits a stream into lines, and keeps the part of a line that has not ended yet.
#[derive(Debug, Default)]
pub struct LineSplitter {
    partial: Vec<u8>,
    is_too_long: bool,
}

impl LineSplitter {
    /// Takes bytes of the stream and returns the lines that end in them, except blank ones.
    pub fn add(&mut self, bytes: &[u8]) -> Vec<Line> {
        let mut found = Vec::new();
        for part in bytes.split_inclusive(|byte| *byte == b'\n') {
            let text = part.strip_suffix(b"\n").unwrap_or(part);
            let room = MAX_LINE - self.partial.len();
            self.is_too_long |= text.len() > room;
            self.partial
                .extend_from_slice(&text[..text.len().min(room)]);
            if text.len() < part.len() {
                found.extend(self.rest());
            }
        }
        found
    }

    /// The last line of a stream that has ended, if it is not blank.
    pub fn rest(&mut self) -> Option<Line> {
        let line = std::mem::take(&mut self.partial);
        if std::mem::take(&mut self.is_too_long) {
            return Some(Line::TooLong);
        }
        let is_blank = line.iter().all(u8::is_ascii_whitespace);
        (!is_blank).then_some(Line::Whole(line))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_assembled_from_parts() {
        let mut lines = LineSplitter::default();

        assert_eq!(lines.add(b"{\"a\""), []);
        let ended = lines.add(b": 1}\r\n\n{}\n{");
        let last = lines.rest();

        let whole = |text: &[u8]| Line::Whole(text.to_vec());
        assert_eq!(ended, [whole(b"{\"a\": 1}\r"), whole(b"{}")]);
        assert_eq!(last, Some(whole(b"{")));
        assert_eq!(lines.rest(), None);
    }

    #[test]
    fn endless_line_is_bounded_and_the_next_one_is_whole() {
        let mut lines = LineSplitter::default();
        for _ in 0..50 {
            assert_eq!(lines.add(&[b'a'; 1000]), []);
            assert!(lines.partial.len() <= MAX_LINE);
        }

        let ended = lines.add(b"\n{}\n");

        assert_eq!(ended, [Line::TooLong, Line::Whole(b"{}".to_vec())]);
    }
}
