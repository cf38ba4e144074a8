//! Reading a flight log through all of its files.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::Value;

use super::{Asked, MAX_FILES, VERSION, read_box, read_id};
use crate::error::Error;
use crate::picture::FrameBox;
use crate::report::TargetId;

/// Longest line that is read.
const MAX_LINE: u64 = 1 << 16;

/// One frame's line.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Index of the frame.
    pub frame: u64,
    /// Time from the frame before; `None` in a log of version 1 or 2.
    pub elapsed: Option<Duration>,
    /// What was asked for, in this order.
    pub asked: Vec<Asked>,
    /// The targets that were found, by rising number.
    pub found: Vec<Found>,
}

/// One target in a frame's line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Its number.
    pub id: TargetId,
    /// Its box.
    pub bbox: FrameBox,
    /// Searches made.
    pub searches: u32,
}

impl Found {
    fn from_json(value: &Value, id: TargetId) -> Option<Found> {
        let searches = match value["searches"].as_u64() {
            Some(searches) => u32::try_from(searches).ok()?,
            None => 0,
        };
        Some(Found {
            id,
            bbox: read_box(&value["box"])?,
            searches,
        })
    }
}

impl Entry {
    fn from_json(line: &Value) -> Option<Entry> {
        let asked = line["asked"].as_array()?.iter().map(Asked::from_json);
        let mut found = Vec::new();
        match line.get("targets") {
            Some(targets) => {
                for target in targets.as_array()? {
                    found.push(Found::from_json(target, read_id(&target["target"])?)?);
                }
            }
            None if line["box"].is_null() => {}
            None => found.push(Found::from_json(line, 1)?),
        }
        Some(Entry {
            frame: line["frame"].as_u64()?,
            elapsed: line["elapsed_us"].as_u64().map(Duration::from_micros),
            asked: asked.collect::<Option<_>>()?,
            found,
        })
    }
}

/// Reads a log line by line.
pub struct Reader {
    head: Value,
    path: PathBuf,
    lines: BufReader<File>,
    number: u64,
    files: usize,
}

impl Reader {
    /// Opens a log and reads its first line.
    ///
    /// # Errors
    /// If the file cannot be read or is no log of a known version.
    pub fn open(path: &Path) -> Result<Reader, Error> {
        let file = File::open(path).map_err(|error| Error::file(path, error))?;
        let mut reader = Reader {
            head: Value::Null,
            path: path.to_path_buf(),
            lines: BufReader::new(file),
            number: 0,
            files: 1,
        };
        let head = reader
            .line()?
            .ok_or_else(|| reader.wrong("is empty, expected its first line"))?;
        let is_known = head["version"]
            .as_u64()
            .is_some_and(|version| (1..=VERSION).contains(&version));
        if head["log"] != "track-cpu" || !is_known {
            return Err(reader.wrong(&format!(
                "starts with log {}, version {}, expected track-cpu, version 1 to {VERSION}",
                head["log"], head["version"]
            )));
        }
        reader.head = head;
        Ok(reader)
    }

    /// The first line.
    pub fn head(&self) -> &Value {
        &self.head
    }

    /// The next frame's line; `None` at the end.
    ///
    /// # Errors
    /// If a line does not belong in a log.
    #[expect(clippy::should_implement_trait, reason = "an iterator cannot fail")]
    pub fn next(&mut self) -> Result<Option<Entry>, Error> {
        while let Some(line) = self.line()? {
            if let Some(name) = line["continued"].as_str() {
                let files = self.files + 1;
                if files > MAX_FILES {
                    return Err(self.wrong(&format!(
                        "continues in too many files, expected at most {MAX_FILES}"
                    )));
                }
                *self = Reader::open(&self.next_file(name)?)?;
                self.files = files;
            } else if line.get("source").is_none() {
                let entry = Entry::from_json(&line);
                return entry.map(Some).ok_or_else(|| {
                    self.wrong("expected a frame, found a line that does not belong in a log")
                });
            }
        }
        Ok(None)
    }

    /// The file in which the log continues, beside this one.
    fn next_file(&self, name: &str) -> Result<PathBuf, Error> {
        if Path::new(name).file_name() != Some(name.as_ref()) {
            return Err(self.wrong(&format!(
                "continues in {name:?}, a file of another folder, expected one beside it"
            )));
        }
        Ok(self.path.with_file_name(name))
    }

    fn line(&mut self) -> Result<Option<Value>, Error> {
        let mut line = String::new();
        self.number += 1;
        let read = self.lines.by_ref().take(MAX_LINE).read_line(&mut line);
        let read = read.map_err(|error| self.wrong(&error.to_string()))?;
        if read == 0 {
            return Ok(None);
        }
        if !line.ends_with('\n') {
            if read as u64 == MAX_LINE {
                return Err(self.wrong(&format!("expected at most {MAX_LINE} bytes, found more")));
            }
            // The flight may have ended while this line was written.
            return Ok(None);
        }
        let value = serde_json::from_str(&line);
        value
            .map(Some)
            .map_err(|error| self.wrong(&format!("expected JSON, found no JSON: {error}")))
    }

    /// An error that names the file and the line that was read last.
    pub fn wrong(&self, reason: &str) -> Error {
        Error::File {
            file: format!("{} line {}", self.path.display(), self.number),
            reason: reason.to_string(),
        }
    }
}
