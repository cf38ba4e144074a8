//! This repository's tracker over one sequence.

use super::{Outcome, failure};
use crate::boxes::{from_tracker, to_tracker};
use crate::error::Error;
use sequences::{Rect, Sequence};
use std::time::Instant;
use track_cpu::source::{BadFrames, Decoder, OnBadFrame};
use track_cpu::{Model, Tracker};

/// Tracks a sequence on this thread; the clock runs during `init` and `update` only.
pub fn track(
    model: &Model,
    policy: OnBadFrame,
    sequence: &Sequence,
    first: Rect,
) -> Result<Outcome, Error> {
    let name = &sequence.annotation.name;
    let mut tracker = Tracker::new(model.clone());
    let mut outcome = Outcome {
        boxes: Vec::new(),
        seconds: Vec::new(),
        held: 0,
    };
    // One decoder per sequence: its 16-bit pictures share a range.
    let mut decoder = Decoder::default();
    let mut bad = BadFrames::new(policy);
    for path in &sequence.frames {
        let image = match (decoder.read(path.clone(), Vec::new()), outcome.boxes.last()) {
            (Ok(image), _) => image,
            (Err(error), None) => return Err(failure(name, error)), // nothing to hold yet
            (Err(error), Some(&last)) => {
                let frame = outcome.boxes.len();
                let bad = bad.pass(error).map_err(|error| failure(name, error))?;
                eprintln!("warning: {name}: frame {frame}: {bad}");
                outcome.boxes.push(last);
                outcome.seconds.push(0.0);
                continue;
            }
        };
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
    outcome.held = bad.count();
    Ok(outcome)
}
