//! The video for viewers, encoded once for all of them on a thread of its own.

use std::io::Write;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;

use super::{PATIENCE, PROTECTION};
use crate::hub::{Hub, lock};

/// Time between pictures.
const PERIOD: Duration = Duration::from_millis(66);
/// Largest width of a picture.
const MAX_WIDTH: usize = 640;
/// JPEG quality of the video.
const QUALITY: u8 = 70;
/// JPEG quality of a single frame.
const FRAME_QUALITY: u8 = 90;
/// How long a single frame is waited for.
const FRAME_PATIENCE: Duration = Duration::from_secs(1);
/// Separates the pictures of the multipart stream.
const BOUNDARY: &str = "frame";

/// A picture as JPEG.
#[derive(Clone, Debug, Default)]
struct Encoded {
    number: u64,
    frame: u64,
    bytes: Arc<Vec<u8>>,
}

/// The newest encoded picture, for all viewers.
#[derive(Default)]
pub struct Video {
    newest: Mutex<Encoded>,
    changed: Condvar,
}

impl Video {
    /// Encodes pictures while there are viewers, until the program ends.
    pub fn encode(&self, hub: &Hub) {
        let mut seen = 0;
        while !hub.is_stopping() {
            if hub.viewers() == 0 {
                std::thread::sleep(PERIOD);
                continue;
            }
            let started = Instant::now();
            let view = hub.view_after(seen, PATIENCE);
            if view.number == seen {
                continue;
            }
            seen = view.number;
            // A copy, so that the lock is free for the tracking thread during encoding.
            let newest = hub.pictures().newest();
            if let Some((frame, picture)) = newest
                && let Some(bytes) = jpeg(&picture.fitted(MAX_WIDTH), QUALITY)
            {
                let mut newest = lock(&self.newest);
                *newest = Encoded {
                    number: newest.number + 1,
                    frame,
                    bytes: Arc::new(bytes),
                };
                self.changed.notify_all();
            }
            std::thread::sleep(PERIOD.saturating_sub(started.elapsed()));
        }
    }

    /// Writes pictures until the client goes or the program ends.
    pub fn stream(&self, hub: &Hub, out: &mut dyn Write) -> std::io::Result<()> {
        write!(
            out,
            "HTTP/1.1 200 OK\r\n\
             Content-Type: multipart/x-mixed-replace; boundary={BOUNDARY}\r\n{PROTECTION}\r\n"
        )?;
        let mut seen = 0;
        while !hub.is_stopping() {
            let waited = self
                .changed
                .wait_timeout_while(lock(&self.newest), PATIENCE, |newest| newest.number == seen);
            let newest = waited.unwrap_or_else(PoisonError::into_inner).0.clone();
            if newest.number == seen {
                continue;
            }
            seen = newest.number;
            write!(
                out,
                "--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nX-Frame: {}\r\n\
                 Content-Length: {}\r\n\r\n",
                newest.frame,
                newest.bytes.len()
            )?;
            out.write_all(&newest.bytes)?;
            write!(out, "\r\n")?;
            out.flush()?;
        }
        Ok(())
    }
}

/// The newest frame in full size as JPEG, kept so that a box can be drawn in it.
pub fn freeze(hub: &Arc<Hub>) -> Option<(u64, Vec<u8>)> {
    // Pictures are kept only while there is a viewer, so this counts as one and waits for the next.
    let _viewer = hub.watch();
    let wanted = hub.view().report.frame;
    let until = Instant::now() + FRAME_PATIENCE;
    let mut seen = hub.view().number;
    loop {
        let newest = hub.pictures().newest().map(|(frame, _)| frame);
        if newest.is_some_and(|frame| frame >= wanted) || Instant::now() >= until {
            break;
        }
        seen = hub.view_after(seen, PERIOD).number;
    }
    let (frame, picture) = hub.pictures().freeze()?;
    Some((frame, jpeg(&picture.to_rgb(), FRAME_QUALITY)?))
}

fn jpeg(image: &RgbImage, quality: u8) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality)
        .encode_image(image)
        .ok()?;
    Some(bytes)
}
