//! The video for viewers: encoded once, however many watch, and on a thread of its own.

use std::io::Write;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use image::codecs::jpeg::JpegEncoder;
use track_cpu::source::Image;

use super::PATIENCE;
use crate::overlay::Canvas;
use crate::serve::hub::Hub;

/// Time between pictures.
const PERIOD: Duration = Duration::from_millis(66);
/// Largest width of a picture.
const MAX_WIDTH: usize = 640;
/// JPEG quality.
const QUALITY: u8 = 70;
const BOUNDARY: &str = "frame";

/// The newest picture as JPEG and its number.
type Newest = (u64, Arc<Vec<u8>>);

/// What encodes and hands out.
#[derive(Default)]
pub struct Video {
    newest: Mutex<Newest>,
    changed: Condvar,
}

impl Video {
    /// Encodes pictures as long as somebody watches, until the program ends.
    pub fn encode(&self, hub: &Hub) {
        let mut seen = 0;
        while !hub.is_stopping() {
            if hub.viewers() == 0 {
                std::thread::sleep(PERIOD);
                continue;
            }
            let started = Instant::now();
            let (number, _) = hub.report_after(seen, PATIENCE);
            if number == seen {
                continue;
            }
            seen = number;
            if let Some(Some(bytes)) = hub.with_picture(encode) {
                let mut newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
                *newest = (newest.0 + 1, Arc::new(bytes));
                self.changed.notify_all();
            }
            std::thread::sleep(PERIOD.saturating_sub(started.elapsed()));
        }
    }

    /// Writes pictures until the client goes or the program ends.
    pub fn stream(&self, hub: &Hub, out: &mut dyn Write) -> std::io::Result<()> {
        write!(
            out,
            "HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary={BOUNDARY}\r\n\
             Cache-Control: no-store\r\nConnection: close\r\n\r\n"
        )?;
        let mut seen = 0;
        while !hub.is_stopping() {
            let newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
            let waited = self
                .changed
                .wait_timeout_while(newest, PATIENCE, |newest| newest.0 == seen);
            let (number, bytes) = waited.unwrap_or_else(PoisonError::into_inner).0.clone();
            if number == seen {
                continue;
            }
            seen = number;
            write!(
                out,
                "--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n",
                bytes.len()
            )?;
            out.write_all(&bytes)?;
            write!(out, "\r\n")?;
            out.flush()?;
        }
        Ok(())
    }
}

fn encode(image: &Image) -> Option<Vec<u8>> {
    let frame = image.frame();
    let width = image.width.min(MAX_WIDTH);
    let height = (image.height * width / image.width).max(1);
    let picture = Canvas::fitted(&frame, width as u32, height as u32).picture;
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, QUALITY)
        .encode_image(&picture)
        .ok()?;
    Some(bytes)
}
