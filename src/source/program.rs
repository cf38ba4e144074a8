//! A program that decodes for us: it is spawned, writes frames into a pipe, and is killed when
//! nobody wants it any more.
//!
//! ffmpeg ends with success where a file is cut off or damaged, and only says so. Its words
//! therefore count as an error at the end. Of a GIF or a transport stream that is cut off it says
//! nothing: their last bytes are looked at here.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{self, ErrorKind, Read, Seek, SeekFrom};
use std::process::{Child, ChildStderr, ChildStdout, Command, ExitStatus};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use super::child;

/// How much of its error output is kept: the end, where the reason stands.
const KEPT_BYTES: usize = 1000;
/// Lines of its error output that a message shows at most.
const KEPT_LINES: usize = 5;
/// Bytes of a packet of a transport stream; each begins with [`SYNC`].
const PACKET: usize = 188;
const SYNC: u8 = 0x47;
/// The last byte of a GIF.
const TRAILER: u8 = 0x3b;

/// A running program; killed when dropped.
pub(super) struct Program {
    child: Arc<Mutex<Child>>,
    complaints: Option<JoinHandle<Option<String>>>,
    file: Option<File>, // if a local one is decoded
}

/// Ends a blocked read of a [`Source`](super::Source) from another thread.
pub struct Stopper(Arc<Mutex<Child>>);

impl Stopper {
    /// Kills the process, unless it is being waited for and so is about to end anyway.
    pub fn stop(&self) {
        if let Ok(mut child) = self.0.try_lock() {
            let _ = child.kill(); // an error means that it has ended
        }
    }
}

impl Program {
    /// Starts a program that writes frames into the pipe; `location` is what it decodes.
    ///
    /// # Errors
    /// If it cannot be started; the words follow the program's name.
    pub(super) fn start(
        command: Command,
        location: &OsStr,
    ) -> Result<(Program, ChildStdout), String> {
        let started = child::start(command, read_last_words);
        let (child, pipe, complaints) = started.map_err(|error| match error.kind() {
            ErrorKind::NotFound => {
                "is needed to read this, but was not found: install it, put the frames into a \
                 folder, or pipe them in (--input -)"
                    .to_string()
            }
            _ => format!("could not be started: {error}"),
        })?;
        Ok((
            Program {
                child: Arc::new(Mutex::new(child)),
                complaints: Some(complaints),
                file: local_file(location),
            },
            pipe,
        ))
    }

    /// A handle that stops this process from another thread.
    pub(super) fn stopper(&self) -> Stopper {
        Stopper(Arc::clone(&self.child))
    }

    /// Waits for the end; whatever it complained about is an error that carries its last words.
    pub(super) fn finish(mut self) -> Result<(), String> {
        let status = self.wait().ok_or("was lost")?;
        let words = self.last_words();
        if !status.success() {
            return Err(format!("failed ({status}){words}"));
        }
        if !words.is_empty() {
            return Err(format!("reported damage, and frames may be missing{words}"));
        }
        match self.file.take().map(missing_end) {
            Some(Ok(Some(what))) => Err(format!("reported no damage, but {what}: it is cut short")),
            _ => Ok(()),
        }
    }

    /// Ends the program because of a bad frame; returns `reason` and its last words.
    pub(super) fn abort(mut self, reason: &str) -> String {
        self.stopper().stop();
        self.wait();
        format!("delivered a bad frame: {reason}{}", self.last_words())
    }

    fn wait(&self) -> Option<ExitStatus> {
        self.child.lock().ok()?.wait().ok()
    }

    /// The end of its error output, on lines of their own; empty if there was none.
    fn last_words(&mut self) -> String {
        let words = self
            .complaints
            .take()
            .and_then(|thread| thread.join().ok()?)
            .unwrap_or_default();
        if words.is_empty() {
            return words;
        }
        format!(":\n{words}")
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        self.stopper().stop();
        self.wait(); // so that no zombie is left
    }
}

/// The file that a `file:` location names.
fn local_file(location: &OsStr) -> Option<File> {
    File::open(location.to_str()?.strip_prefix("file:")?).ok()
}

/// What the end of a GIF or transport stream lacks; `None` for whole ones and other files.
fn missing_end(mut file: File) -> io::Result<Option<&'static str>> {
    let mut head = Vec::new();
    file.by_ref()
        .take(PACKET as u64 + 1)
        .read_to_end(&mut head)?;
    let length = file.seek(SeekFrom::End(0))?;
    if head.starts_with(b"GIF8") {
        let mut tail = Vec::new();
        file.seek(SeekFrom::Start(length.saturating_sub(PACKET as u64)))?;
        file.read_to_end(&mut tail)?;
        let last = tail.iter().rev().find(|byte| **byte != 0); // some are padded
        let is_whole = last == Some(&TRAILER);
        return Ok((!is_whole).then_some("the GIF has no end"));
    }
    let is_transport = head.first() == Some(&SYNC) && head.get(PACKET) == Some(&SYNC);
    let is_whole = length % PACKET as u64 == 0;
    Ok((is_transport && !is_whole).then_some("the transport stream ends within a packet"))
}

/// Reads to the end, so that the process never blocks on it, and keeps the last lines.
fn read_last_words(mut errors: ChildStderr) -> String {
    let mut kept = Vec::new();
    let mut chunk = [0; 4096];
    while let Ok(n @ 1..) = errors.read(&mut chunk) {
        kept.extend_from_slice(&chunk[..n]);
        let excess = kept.len().saturating_sub(KEPT_BYTES);
        kept.drain(..excess);
    }
    let text = String::from_utf8_lossy(&kept);
    // File names and metadata in it are a stranger's: no control character reaches the terminal.
    let text = text.replace(|c: char| c.is_control() && c != '\n', " ");
    let lines: Vec<&str> = text
        .lines()
        .map(str::trim_end)
        .filter(|line| !line.is_empty())
        .collect();
    lines[lines.len().saturating_sub(KEPT_LINES)..].join("\n")
}
