//! This repository's tracker over one sequence.

use super::{Outcome, failure};
use crate::boxes::{from_tracker, to_tracker};
use crate::error::Error;
use crate::picture::decode;
use sequences::{Rect, Sequence};
use std::time::Instant;
use track_cpu::{Model, Tracker};

/// Tracks a sequence on this thread; the clock runs during `init` and `update` only.
pub fn track(model: &Model, sequence: &Sequence, first: Rect) -> Result<Outcome, Error> {
    let name = &sequence.annotation.name;
    let mut tracker = Tracker::new(model.clone());
    let mut outcome = Outcome {
        boxes: Vec::new(),
        seconds: Vec::new(),
    };
    for path in &sequence.frames {
        let image = decode(path).map_err(|reason| failure(name, reason))?;
        let frame = image.frame();
        let clock = Instant::now();
        let found = if outcome.boxes.is_empty() {
            tracker.init(&frame, to_tracker(first)).map(|()| first)
        } else {
            tracker.update(&frame).map(|track| from_tracker(track.bbox))
        };
        outcome.seconds.push(clock.elapsed().as_secs_f64());
        outcome
            .boxes
            .push(found.map_err(|error| failure(name, error))?);
    }
    Ok(outcome)
}
