//! The flight log: a JSON object per line, enough to repeat the whole flight.
//!
//! | line | what it says |
//! |---|---|
//! | the first | the program, its input and its model; `continues` names the file before it |
//! | with `frame` | commands at this frame, time since the one before, searches made, box found; where several targets can be followed, `targets` lists the latter for each |
//! | with `source` | the source's health has changed |
//! | with `continued` | the log continues in this file |
//!
//! Numbers are written so that they read back to the same bits. Frames are saved as PNG, which is
//! lossless. A full disk is reported once; tracking continues, and so does the log once there is
//! room.

mod frames;
mod reader;

use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use serde_json::{Value, json};

use crate::error::Error;
use crate::health::Health;
use crate::picture::{FrameBox, Picture};
use crate::report::{Followed, Report, TargetId, Tracked};
use crate::say::say;
use frames::Saver;
pub use frames::frame_name;
pub use reader::{Entry, Found, Reader};

/// Newest version of the lines; older ones are read as well.
pub const VERSION: u64 = 4;

/// Most files of one name.
const MAX_FILES: usize = 10_000;
/// Time between two attempts to continue a log that could not be written.
const RETRY: Duration = Duration::from_secs(30);

/// Where the log goes and how large it may become.
#[derive(Clone, Debug)]
pub struct LogOptions {
    /// The file; an earlier one is kept, and the new one gets a number.
    pub path: PathBuf,
    /// Folder for the tracked frames; an earlier flight's folder is kept, and the new one gets a
    /// number.
    pub frames: Option<PathBuf>,
    /// Bytes after which the log continues in a new file.
    pub max_file: u64,
    /// Bytes of all files of this name, above which the oldest ones are removed.
    pub max_total: u64,
}

/// What was asked for at a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Asked {
    /// To follow what is inside a box.
    Start {
        /// The box.
        bbox: FrameBox,
        /// The earlier frame in which it was drawn; `None` for this one.
        at: Option<u64>,
        /// The number of the target.
        id: TargetId,
    },
    /// To stop following.
    Stop {
        /// The number of the target; `None` for all.
        id: Option<TargetId>,
    },
}

/// Version of the lines for `room` targets. A log of one target has an older version, which older
/// programs can read.
pub fn version(room: usize) -> u64 {
    if room > 1 { VERSION } else { 3 }
}

/// A flight log.
pub struct Log {
    options: LogOptions,
    head: Value,
    file: Option<Part>,
    retry: Instant,
    saver: Option<Saver>,
}

/// One open file.
struct Part {
    path: PathBuf,
    file: BufWriter<File>,
    bytes: u64,
}

impl Log {
    /// Creates the file and writes its first line.
    ///
    /// # Errors
    /// If the file or the folder cannot be created for another reason than a full or broken disk.
    pub fn create(options: LogOptions, head: Value) -> Result<Log, Error> {
        let mut log = Log {
            head,
            file: None,
            retry: Instant::now(),
            saver: None,
            options,
        };
        if let Some(folder) = &log.options.frames {
            match Saver::start(folder) {
                Ok((saver, folder)) => {
                    log.head["frames"] = folder.display().to_string().into();
                    log.saver = Some(saver);
                }
                Err(error) => log.tolerate(folder, error)?,
            }
        }
        if let Err(error) = log.open(None) {
            log.tolerate(&log.options.path, error)?;
            log.retry = Instant::now() + RETRY;
        }
        Ok(log)
    }

    /// Reports a failure of the disk and continues; returns one that is the user's, a wrong path.
    fn tolerate(&self, path: &Path, error: std::io::Error) -> Result<(), Error> {
        if matches!(
            error.kind(),
            ErrorKind::NotFound
                | ErrorKind::PermissionDenied
                | ErrorKind::NotADirectory
                | ErrorKind::InvalidInput
                | ErrorKind::AlreadyExists
        ) {
            return Err(Error::output(path.display(), error));
        }
        say!(
            "log: {}: {error}; tracking continues without it",
            path.display()
        );
        Ok(())
    }

    /// Adds a frame; a failure is reported once.
    pub fn add(&mut self, asked: &[Asked], report: &Report, picture: &Picture) {
        let tells_ids = report.tells_ids();
        let asked: Vec<Value> = asked.iter().map(|asked| asked.to_json(tells_ids)).collect();
        let mut line = json!({
            "frame": report.frame,
            "time_ms": report.time_ms,
            "elapsed_us": u64::try_from(report.elapsed.as_micros()).unwrap_or(u64::MAX),
            "asked": asked,
            "state": report.state(),
            "latency_ms": report.latency_ms,
        });
        if tells_ids {
            line["targets"] = report.targets.iter().map(target_to_json).collect();
        } else if let Some(target) = report.first() {
            add_track(&mut line, &target.track);
        }
        if let Some(saver) = &mut self.saver {
            line["saved"] = saver.save(report.frame, picture).into();
        }
        self.write(&line);
    }

    /// Adds a change of the source's health.
    pub fn source(&mut self, time_ms: f64, health: Health, reason: Option<&str>) {
        self.write(&json!({ "source": health.name(), "time_ms": time_ms, "reason": reason }));
    }

    fn write(&mut self, line: &Value) {
        if self.file.is_none() {
            if Instant::now() < self.retry {
                return;
            }
            if self.open(None).is_err() {
                self.retry = Instant::now() + RETRY;
                return;
            }
        }
        let Some(part) = &mut self.file else {
            return;
        };
        if let Err(error) = part.line(line) {
            let path = part.path.display();
            say!("log: {path}: {error}; tracking continues without the log");
            self.file = None;
            self.retry = Instant::now() + RETRY;
            return;
        }
        if part.bytes > self.options.max_file {
            self.rotate();
        }
    }

    /// Continues in a new file.
    fn rotate(&mut self) {
        let Some(mut full) = self.file.take() else {
            return;
        };
        let opened = self.open(Some(&full.path));
        match (opened, &self.file) {
            (Ok(()), Some(part)) => {
                let name = part.path.file_name().unwrap_or_default();
                let _ = full.line(&json!({ "continued": name.to_string_lossy() }));
            }
            (Err(error), _) => {
                say!("log: {error}; tracking continues without the log");
                self.retry = Instant::now() + RETRY;
            }
            _ => {}
        }
        self.prune();
    }

    /// Creates the next file and writes its first line.
    fn open(&mut self, before: Option<&Path>) -> std::io::Result<()> {
        let (path, file) = create_new(&self.options.path)?;
        let mut head = self.head.clone();
        if let Some(name) = before.and_then(Path::file_name) {
            head["continues"] = name.to_string_lossy().into();
        }
        let mut part = Part {
            path,
            file: BufWriter::new(file),
            bytes: 0,
        };
        if let Err(error) = part.line(&head) {
            let _ = std::fs::remove_file(&part.path); // an empty file would only be in the way
            return Err(error);
        }
        say!("log: {}", part.path.display());
        self.file = Some(part);
        self.prune();
        Ok(())
    }

    /// Removes the oldest files of this name while all of them together are too large.
    fn prune(&self) {
        let Some(current) = self.file.as_ref().map(|part| part.path.clone()) else {
            return;
        };
        let mut files = siblings(&self.options.path);
        files.sort_by_key(|file| (file.modified, file.number));
        let mut total: u64 = files.iter().map(|file| file.bytes).sum();
        for file in files {
            if total <= self.options.max_total {
                return;
            }
            if file.path != current && is_log(&file.path) {
                match std::fs::remove_file(&file.path) {
                    Ok(()) => {
                        total -= file.bytes;
                        say!("log: removed {}, the oldest", file.path.display());
                    }
                    Err(error) => say!("log: {}: {error}", file.path.display()),
                }
            }
        }
    }

    /// Waits until every frame is saved.
    pub fn finish(self) {
        if let Some(saver) = self.saver {
            saver.finish();
        }
    }
}

impl Part {
    /// Writes a line and flushes it, so that a crash or an empty battery costs at most the last
    /// line.
    fn line(&mut self, line: &Value) -> std::io::Result<()> {
        let line = line.to_string();
        writeln!(self.file, "{line}")?;
        self.file.flush()?;
        self.bytes += line.len() as u64 + 1;
        Ok(())
    }
}

/// The path with a number before its extension: `flight.jsonl`, `flight-1.jsonl` ...
pub(crate) fn numbered(path: &Path, number: usize) -> PathBuf {
    if number == 0 {
        return path.to_path_buf();
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path
        .extension()
        .map_or(String::new(), |e| format!(".{}", e.to_string_lossy()));
    path.with_file_name(format!("{stem}-{number}{extension}"))
}

/// Creates a new file, with a number if there is one of this name.
fn create_new(path: &Path) -> std::io::Result<(PathBuf, File)> {
    // The numbers after the largest one in use: those of removed files are not used again.
    let used = siblings(path).iter().map(|file| file.number + 1).max();
    for number in used.unwrap_or(0)..MAX_FILES {
        let path = numbered(path, number);
        match File::create_new(&path) {
            Ok(file) => return Ok((path, file)),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
        }
    }
    Err(std::io::Error::other(format!(
        "{MAX_FILES} logs of this name are there, expected fewer"
    )))
}

/// A file of the log's name, with or without a number.
struct Sibling {
    path: PathBuf,
    number: usize,
    bytes: u64,
    modified: SystemTime,
}

/// The files of a log's name, with and without numbers.
fn siblings(path: &Path) -> Vec<Sibling> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let Ok(entries) = std::fs::read_dir(folder) else {
        return Vec::new();
    };
    let mut found = Vec::new();
    for entry in entries.flatten() {
        let (found_path, name) = (entry.path(), entry.file_name());
        let Some(number) = number_of(Path::new(&name), path, &stem) else {
            continue;
        };
        if let Ok(data) = entry.metadata() {
            found.push(Sibling {
                path: found_path,
                number,
                bytes: data.len(),
                modified: data.modified().unwrap_or(SystemTime::UNIX_EPOCH),
            });
        }
    }
    found
}

/// The number of a file of the log's name.
fn number_of(name: &Path, path: &Path, stem: &str) -> Option<usize> {
    if name.extension() != path.extension() {
        return None;
    }
    let found = name.file_stem()?.to_string_lossy();
    if found == stem {
        return Some(0);
    }
    let number = found.strip_prefix(stem)?.strip_prefix('-')?;
    number.parse().ok().filter(|_| !number.starts_with('0'))
}

/// Whether a file is a flight log; no other file is ever removed.
fn is_log(path: &Path) -> bool {
    let mut line = String::new();
    let Ok(file) = File::open(path) else {
        return false;
    };
    let _ = BufReader::new(file.take(1 << 16)).read_line(&mut line);
    serde_json::from_str::<Value>(&line).is_ok_and(|head| head["log"] == "track-cpu")
}

impl Asked {
    fn to_json(self, tells_ids: bool) -> Value {
        match self {
            Asked::Start { bbox, at, id } => {
                let mut value = json!({ "start": box_to_json(&bbox) });
                if let Some(at) = at {
                    value["at"] = at.into();
                }
                if tells_ids {
                    value["target"] = id.into();
                }
                value
            }
            Asked::Stop { id: Some(id) } if tells_ids => json!({ "stop": id }),
            Asked::Stop { .. } => json!("stop"),
        }
    }

    fn from_json(value: &Value) -> Option<Asked> {
        if value == "stop" {
            return Some(Asked::Stop { id: None });
        }
        if let Some(id) = value.get("stop") {
            let id = Some(read_id(id)?);
            return Some(Asked::Stop { id });
        }
        Some(Asked::Start {
            bbox: read_box(value.get("start")?)?,
            at: value.get("at").and_then(Value::as_u64),
            id: value.get("target").map_or(Some(1), read_id)?,
        })
    }
}

/// One target among several.
fn target_to_json(target: &Followed) -> Value {
    let mut value = json!({ "target": target.id, "state": target.track.state.name() });
    add_track(&mut value, &target.track);
    value
}

/// Adds where a target is to `value`.
fn add_track(value: &mut Value, track: &Tracked) {
    value["box"] = box_to_json(&track.bbox);
    value["presence"] = track.presence.map_or(Value::Null, |p| f64::from(p).into());
    value["searches"] = track.searches.into();
}

/// The number of a target.
fn read_id(value: &Value) -> Option<TargetId> {
    TargetId::try_from(value.as_u64()?)
        .ok()
        .filter(|id| *id > 0)
}

/// A box whose numbers read back to the same bits: every f32 is exactly an f64, written in full.
fn box_to_json(bbox: &FrameBox) -> Value {
    [bbox.x, bbox.y, bbox.w, bbox.h]
        .map(f64::from)
        .to_vec()
        .into()
}

/// The box that [`box_to_json`] wrote.
fn read_box(value: &Value) -> Option<FrameBox> {
    let mut numbers = Vec::new();
    for number in value.as_array()? {
        numbers.push(number.as_f64()? as f32);
    }
    match numbers[..] {
        [x, y, w, h] => Some(FrameBox::new(x, y, w, h)),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
