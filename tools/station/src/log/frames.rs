//! Tracked frames as picture files, saved on a thread of its own.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Instant;

use super::{MAX_FILES, RETRY, numbered};
use crate::picture::Picture;
use crate::say::say;

/// Frames that may wait to be saved.
const MAX_WAITING: usize = 8;

/// Saves frames.
pub(super) struct Saver {
    queue: SyncSender<(u64, Picture)>,
    thread: JoinHandle<()>,
}

impl Saver {
    /// Starts to save into a new or empty folder, and returns it.
    pub(super) fn start(folder: &Path) -> std::io::Result<(Saver, PathBuf)> {
        let folder = create_empty(folder)?;
        let (queue, frames) = sync_channel(MAX_WAITING);
        let into = folder.clone();
        let thread = std::thread::spawn(move || save_all(&into, &frames));
        Ok((Saver { queue, thread }, folder))
    }

    /// Queues a frame and returns whether it will be saved. If the disk is slow, frames are left
    /// out of the log; the tracker never waits.
    pub(super) fn save(&mut self, frame: u64, picture: &Picture) -> bool {
        self.queue.try_send((frame, picture.clone())).is_ok()
    }

    /// Waits until every frame is saved.
    pub(super) fn finish(self) {
        drop(self.queue);
        let _ = self.thread.join();
    }
}

/// Creates a folder that is empty: `path`, or else with a number.
fn create_empty(path: &Path) -> std::io::Result<PathBuf> {
    for number in 0..MAX_FILES {
        let path = numbered(path, number);
        std::fs::create_dir_all(&path)?;
        if std::fs::read_dir(&path)?.next().is_none() {
            return Ok(path);
        }
    }
    Err(std::io::Error::other(format!(
        "{MAX_FILES} folders of this name hold files, expected fewer"
    )))
}

/// Saves until no frame follows. A full disk is reported once and tried again later.
fn save_all(folder: &Path, frames: &Receiver<(u64, Picture)>) {
    let mut retry = None;
    for (frame, picture) in frames {
        if retry.is_some_and(|retry| Instant::now() < retry) {
            continue;
        }
        let path = folder.join(frame_name(frame));
        match picture.to_rgb().save(&path) {
            Ok(()) => retry = None,
            Err(error) => {
                let _ = std::fs::remove_file(&path); // half a picture would stop a replay
                if retry.is_none() {
                    say!("log: {}: {error}; frames are not saved", path.display());
                }
                retry = Some(Instant::now() + RETRY);
            }
        }
    }
}

/// File name of a saved frame.
pub fn frame_name(frame: u64) -> String {
    format!("{frame:08}.png")
}
