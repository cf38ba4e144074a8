//! The flight log: a JSON object per line, enough to do the whole flight again.
//!
//! The first line describes the program and its input; then every tracked frame has a line with what was asked for at it
//! (`start` with a box in pixels, `stop`), the searches made and the box found. Numbers are written so that they read back
//! to the same bits. Frames are saved as PNG, which loses nothing.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;

use serde_json::{Value, json};
use track_cpu::BBox;
use track_cpu::source::Image;

use super::report::Report;
use crate::exit::Failure;
use crate::overlay::Canvas;

/// Frames that may wait to be saved.
const MAX_WAITING: usize = 8;

/// Most logs of one name.
const MAX_LOGS: usize = 10_000;

/// Version of the lines.
pub const VERSION: u64 = 1;

/// What was asked for at a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Asked {
    /// To follow what is inside a box, in pixels.
    Start(BBox),
    /// To follow nothing.
    Stop,
}

/// An open log.
pub struct Log {
    path: PathBuf,
    file: BufWriter<File>,
    saver: Option<Saver>,
}

/// Saves frames on its own thread.
struct Saver {
    queue: SyncSender<(u64, Image)>,
    thread: JoinHandle<()>,
}

impl Log {
    /// Creates the file and writes its first line. An earlier flight's log is kept: the new one gets a number.
    ///
    /// # Errors
    /// If the file or the folder cannot be created.
    pub fn create(path: &Path, frames: Option<&Path>, head: &Value) -> Result<Log, Failure> {
        let (path, file) = create_new(path)?;
        eprintln!("log: {}", path.display());
        let saver = frames.map(Saver::start).transpose()?;
        let mut log = Log {
            path,
            file: BufWriter::new(file),
            saver,
        };
        log.line(head)?;
        Ok(log)
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn add(&mut self, asked: &[Asked], report: &Report, image: &Image) -> Result<(), Failure> {
        let asked: Vec<Value> = asked
            .iter()
            .map(|asked| match asked {
                Asked::Start(bbox) => json!({ "start": exact(bbox) }),
                Asked::Stop => json!("stop"),
            })
            .collect();
        let mut line = json!({
            "frame": report.frame,
            "time_ms": report.time_ms,
            "asked": asked,
            "state": report.state(),
            "latency_ms": report.latency_ms,
        });
        if let Some(track) = &report.track {
            line["box"] = exact(&track.bbox);
            line["presence"] = track.presence.map_or(Value::Null, |p| f64::from(p).into());
            line["searches"] = track.searches.into();
        }
        if let Some(saver) = &self.saver {
            line["saved"] = saver.save(report.frame, image).into();
        }
        self.line(&line)
    }

    fn line(&mut self, line: &Value) -> Result<(), Failure> {
        // Flushed line by line: a crash or a lost battery costs no more than the last one.
        let written = writeln!(self.file, "{line}").and_then(|()| self.file.flush());
        written.map_err(|error| Failure::output(&self.path, error))
    }

    /// Waits until every frame is saved.
    pub fn finish(self) {
        if let Some(Saver { queue, thread }) = self.saver {
            drop(queue);
            let _ = thread.join();
        }
    }
}

/// Creates a file that was not there: `path`, or else with -1, -2 ... before its extension.
fn create_new(path: &Path) -> Result<(PathBuf, File), Failure> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path
        .extension()
        .map_or(String::new(), |e| format!(".{}", e.to_string_lossy()));
    for number in 0..MAX_LOGS {
        let numbered = match number {
            0 => path.to_path_buf(),
            _ => path.with_file_name(format!("{stem}-{number}{extension}")),
        };
        match File::create_new(&numbered) {
            Ok(file) => return Ok((numbered, file)),
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(Failure::output(&numbered, error)),
        }
    }
    Err(Failure::output(
        path,
        format!("{MAX_LOGS} logs of this name are there, expected fewer"),
    ))
}

impl Saver {
    fn start(folder: &Path) -> Result<Saver, Failure> {
        std::fs::create_dir_all(folder).map_err(|error| Failure::output(folder, error))?;
        let (queue, frames) = sync_channel::<(u64, Image)>(MAX_WAITING);
        let folder = folder.to_path_buf();
        let thread = std::thread::spawn(move || {
            for (frame, image) in frames {
                let path = folder.join(frame_name(frame));
                if let Err(error) = Canvas::new(&image.frame()).picture.save(&path) {
                    eprintln!("log: {}: {error}", path.display());
                }
            }
        });
        Ok(Saver { queue, thread })
    }

    /// Whether the frame will be saved; a disk too slow costs frames of the log, never of the tracker.
    fn save(&self, frame: u64, image: &Image) -> bool {
        match self.queue.try_send((frame, image.clone())) {
            Ok(()) => true,
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => false,
        }
    }
}

/// File name of a saved frame.
pub fn frame_name(frame: u64) -> String {
    format!("{frame:08}.png")
}

/// A box whose numbers read back to the same bits: every f32 is exactly a f64, and those are written in full.
fn exact(bbox: &BBox) -> Value {
    [bbox.x, bbox.y, bbox.w, bbox.h]
        .map(f64::from)
        .to_vec()
        .into()
}

/// The box that [`exact`] wrote.
pub fn read_box(value: &Value) -> Option<BBox> {
    let numbers: Vec<f32> = value
        .as_array()?
        .iter()
        .map(|v| v.as_f64().map(|v| v as f32))
        .collect::<Option<_>>()?;
    match numbers[..] {
        [x, y, w, h] => Some(BBox::new(x, y, w, h)),
        _ => None,
    }
}

/// What [`Log::add`] wrote of `asked`.
pub fn read_asked(value: &Value) -> Option<Asked> {
    match value {
        Value::String(word) if word == "stop" => Some(Asked::Stop),
        _ => read_box(value.get("start")?).map(Asked::Start),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_read_back_to_the_same_bits() {
        for v in [0.1f32, -1.0 / 3.0, 1e-30, 123456.79, f32::MIN_POSITIVE] {
            let bbox = BBox::new(v, -v, v * 1.000_000_1, 7.0);
            let text = exact(&bbox).to_string();
            let back = read_box(&serde_json::from_str(&text).unwrap()).unwrap();
            assert_eq!(bbox.x.to_bits(), back.x.to_bits(), "{text}");
            assert_eq!(bbox, back);
        }
        assert_eq!(read_box(&json!([1, 2, 3])), None);
        assert_eq!(read_box(&json!([1, 2, 3, "4"])), None);
    }

    #[test]
    fn an_earlier_log_is_kept() {
        let path = std::env::temp_dir().join(format!("track-cpu-log-{}.jsonl", std::process::id()));
        let (first, _) = create_new(&path).unwrap();
        let (second, _) = create_new(&path).unwrap();
        assert_eq!(first, path);
        assert!(second.to_string_lossy().ends_with("-1.jsonl"), "{second:?}");
        std::fs::remove_file(first).unwrap();
        std::fs::remove_file(second).unwrap();
        assert!(create_new(std::path::Path::new("/no/such/folder/x")).is_err());
    }

    #[test]
    fn commands_read_back() {
        let bbox = BBox::new(1.5, 2.0, 3.0, 4.0);
        assert_eq!(
            read_asked(&json!({ "start": exact(&bbox) })),
            Some(Asked::Start(bbox))
        );
        assert_eq!(read_asked(&json!("stop")), Some(Asked::Stop));
        assert_eq!(read_asked(&json!(7)), None);
    }
}
