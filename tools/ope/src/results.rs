//! Folders of results: the boxes and times that a tracker wrote.

use crate::error::Error;
use sequences::annotation::sequence_name;
use sequences::folder::{entries, file_name};
use sequences::{Rect, text};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// What made the results in a folder. The file `made-by.json` beside them keeps it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Origin {
    /// This repository's tracker.
    Model {
        /// The model's name or file.
        model: String,
        /// CRC-32 of the weights file, in hexadecimal digits.
        crc32: String,
        /// The arithmetic of its convolutions.
        precision: String,
        /// The instruction set of the kernels, on which the last bits of a box depend.
        isa: String,
    },
    /// Another program.
    Program {
        /// The command that starts it.
        command: String,
    },
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Origin::Model {
                model,
                crc32,
                precision,
                isa,
            } => write!(f, "{model} (CRC-32 {crc32}) in {precision} on {isa}"),
            Origin::Program { command } => write!(f, "the command {command}"),
        }
    }
}

/// Name of the file that holds the [`Origin`].
const ORIGIN: &str = "made-by.json";

/// A folder with the results of one tracker on one benchmark.
///
/// | what | where it is looked for |
/// |---|---|
/// | boxes | `<sequence>.txt`, `<sequence>/<sequence>_001.txt` (GOT-10k), `<sequence>/<sequence>.txt` |
/// | seconds per frame | `times/<sequence>_time.txt`, `<sequence>_time.txt`, `<sequence>/<sequence>_time.txt` |
#[derive(Clone, Debug)]
pub struct Results {
    folder: PathBuf,
}

impl Results {
    /// The results in `folder`.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn open(folder: &Path) -> Result<Results, Error> {
        fs::read_dir(folder).map_err(Error::unreadable(folder))?;
        Ok(Results {
            folder: folder.to_path_buf(),
        })
    }

    /// The results in `folder`, which is created if it does not exist.
    ///
    /// # Errors
    /// If the folder cannot be created.
    pub fn create(folder: &Path) -> Result<Results, Error> {
        fs::create_dir_all(folder).map_err(Error::unwritable(folder))?;
        Results::open(folder)
    }

    /// What made the results; `None` if the folder does not say.
    ///
    /// # Errors
    /// If the file that says it cannot be read.
    pub fn origin(&self) -> Result<Option<Origin>, Error> {
        let path = self.folder.join(ORIGIN);
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(Error::unreadable(&path)(error)),
        };
        let origin = serde_json::from_str(&text)
            .map_err(|error| Error::content(&path, "what made the results", error))?;
        Ok(Some(origin))
    }

    /// Reserves the folder for the results of one tracker. An interrupted run of it can continue,
    /// but never with boxes of another model or program.
    ///
    /// # Errors
    /// If the folder holds results of another tracker, or cannot be written.
    pub fn reserve(&self, origin: &Origin) -> Result<(), Error> {
        match self.origin()? {
            Some(there) if there == *origin => Ok(()),
            Some(there) => {
                let expected = format!(
                    "results of {origin}; use another --name or --out, or delete the folder"
                );
                Err(Error::content(&self.folder, expected, there))
            }
            None => {
                let text = serde_json::to_string_pretty(origin).expect("strings can be written");
                write_whole(&self.folder.join(ORIGIN), &(text + "\n"))
            }
        }
    }

    /// Whether a sequence has boxes for all of its `frames`.
    pub fn is_whole(&self, sequence: &str, frames: usize) -> bool {
        self.boxes(sequence)
            .is_ok_and(|boxes| boxes.is_some_and(|boxes| boxes.len() == frames))
    }

    /// Writes the boxes of a sequence as `<sequence>.txt`, `x,y,w,h` to three digits, and the
    /// seconds of its frames, if known, as `times/<sequence>_time.txt` to eight digits. The file of
    /// boxes is renamed into place last.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, sequence: &str, boxes: &[Rect], seconds: &[f64]) -> Result<(), Error> {
        if !seconds.is_empty() {
            let folder = self.folder.join("times");
            fs::create_dir_all(&folder).map_err(Error::unwritable(&folder))?;
            let text: String = seconds.iter().map(|t| format!("{t:.8}\n")).collect();
            write_whole(&folder.join(format!("{sequence}_time.txt")), &text)?;
        }
        write_whole(
            &self.folder.join(format!("{sequence}.txt")),
            &lines(boxes, ","),
        )
    }

    /// The folder's path.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The boxes of a sequence, one per frame; `None` without a file.
    ///
    /// # Errors
    /// If the file cannot be read, or a line is not a box.
    pub fn boxes(&self, sequence: &str) -> Result<Option<Vec<Rect>>, Error> {
        let names = [
            format!("{sequence}.txt"),
            format!("{sequence}/{sequence}_001.txt"),
            format!("{sequence}/{sequence}.txt"),
        ];
        let path = self.first(&names);
        Ok(path.map(|path| text::read_boxes(&path)).transpose()?)
    }

    /// The seconds of each frame of a sequence; `None` without a file.
    ///
    /// # Errors
    /// If the file cannot be read, or a line is not a number.
    pub fn times(&self, sequence: &str) -> Result<Option<Vec<f64>>, Error> {
        let names = [
            format!("times/{sequence}_time.txt"),
            format!("{sequence}_time.txt"),
            format!("{sequence}/{sequence}_time.txt"),
        ];
        let path = self.first(&names);
        Ok(path.map(|path| text::read_numbers(&path)).transpose()?)
    }

    /// The names of all sequences with a file `<sequence>.txt`.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn names(&self) -> Result<Vec<String>, Error> {
        Ok(entries(&self.folder)?
            .iter()
            .filter(|path| path.is_file())
            .filter_map(|p| sequence_name(p))
            .collect())
    }

    /// The folder's own name, which is the tracker's by default.
    pub fn name(&self) -> String {
        let resolved = self
            .folder
            .canonicalize()
            .unwrap_or_else(|_| self.folder.clone());
        file_name(&resolved)
    }

    fn first(&self, names: &[String]) -> Option<PathBuf> {
        names
            .iter()
            .map(|name| self.folder.join(name))
            .find(|path| path.is_file())
    }
}

/// Boxes as text, a line each, to three digits.
pub fn lines(boxes: &[Rect], separator: &str) -> String {
    let line = |b: &Rect| {
        let [x, y, w, h] = [b.x, b.y, b.w, b.h].map(|v| format!("{v:.3}"));
        [x, y, w, h].join(separator) + "\n"
    };
    boxes.iter().map(line).collect()
}

/// Writes a file under another name, then renames it, so that readers never see a part of it.
///
/// # Errors
/// If the file cannot be written.
pub fn write_whole(path: &Path, text: &str) -> Result<(), Error> {
    // Shards in containers of their own may have one process number and write into one folder.
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    let unique = format!(
        "{}-{}",
        std::process::id(),
        now.map_or(0, |now| now.as_nanos())
    );
    let part = path.with_file_name(format!(".{}.{unique}.part", file_name(path)));
    let written = fs::write(&part, text).and_then(|()| fs::rename(&part, path));
    written.map_err(Error::unwritable(path))
}
